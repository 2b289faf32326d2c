"""Reads and writes bags: MCAP files whose messages ROS 2 tools can read and that give every message back bit for bit.

`writer.BagWriter` and `reader.BagReader` are the way in and out; `recover` makes a whole bag of a torn one, `export`
takes single topics out. Nothing here is imported before it is used, so that a graph without a bag loads none of it.
"""


class BagError(ValueError):
    """Says that a bag cannot be read or written; the text names the file, what is wrong and what helps."""
