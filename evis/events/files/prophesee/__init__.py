"""Reads and writes Prophesee's files: RAW and DAT."""
