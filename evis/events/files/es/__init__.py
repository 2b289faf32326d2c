"""Reads and writes Event Stream (.es) files, as Prophesee ATIS and DVS recordings of several laboratories have them.

`layout.py` describes the bytes, which `reader.py` decodes with `decoder.py` (`kernels.py`) and `writer.py` writes.
"""
