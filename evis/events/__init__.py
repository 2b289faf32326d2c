"""Handles event streams: the words that sensors send, the files that hold them, and one container for what comes out.

One file per codec (`evt3`, `davis`, ...), one per file format (`files/raw`, ...); `open_recording` finds the format.
"""

from evis.events.arrays import Events, Frame, Imu, Triggers
from evis.events.recording import Recording, RecordingError, RecordingInfo, open_recording, open_writer

__all__ = [
    "Events",
    "Frame",
    "Imu",
    "Recording",
    "RecordingError",
    "RecordingInfo",
    "Triggers",
    "open_recording",
    "open_writer",
]
