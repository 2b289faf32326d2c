"""Writes and reads WebDataset: tar shards."""
