"""Measures the decoders of event streams and files, beside other libraries."""
