"""Reads and writes recordings in files: one module per format, found by `evis.events.open_recording`."""
