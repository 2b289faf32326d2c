"""Decoders of event streams and files, beside other libraries."""
