"""Reads AEDAT 2, 3.1 and 4, writes AEDAT 4, and handles the flatbuffers of the last."""
