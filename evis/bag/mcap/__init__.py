"""MCAP containers: written so that a torn file can be read, found again by index or record by record, repaired."""
