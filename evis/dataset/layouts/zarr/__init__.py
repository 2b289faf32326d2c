"""Writes and reads Zarr groups."""
