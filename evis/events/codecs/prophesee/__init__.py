"""Decodes and encodes Prophesee's EVT2, EVT2.1, EVT3 and EVT4."""
