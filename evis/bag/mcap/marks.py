"""Defines the marks of an MCAP file, and of one that this project wrote."""

MAGIC = b"\x89MCAP0\r\n"
"""The first and the last bytes of a whole file."""
PROFILE = "ros2"
LIBRARY = "evis"
"""The writer that the file's header names. Its schemas and channels stand outside of the chunks."""
