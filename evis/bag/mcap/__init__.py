"""Reads and writes MCAP containers: a torn file can be read, found again by index or record by record, repaired."""
