"""Recordings in files: one module per format, found by `evis.streams.open_recording`."""
