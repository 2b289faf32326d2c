"""Writes and reads MVSEC: HDF5 files, and its flow as an archive."""
