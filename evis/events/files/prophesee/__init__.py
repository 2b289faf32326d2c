"""Reads and writes Prophesee's files: `raw.py` RAW, whose header `raw_header.py` reads, and `dat.py` DAT."""
