"""Recordings in files: one module per format, found by `evis.events.open_recording`."""
