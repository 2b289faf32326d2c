"""Prophesee's files: RAW and DAT."""
