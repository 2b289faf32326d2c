"""Reads and writes events as text, one a line.

`columns.py` finds which column is what, `numbers.py` parses the lines, `reader.py` reads a file, `zipped.py` one in a
zip archive; `writer.py` writes.
"""
