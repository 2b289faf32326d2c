"""Reads and writes events as text, one a line."""
