"""Handles event streams: the words that sensors send, the files that hold them, and one container for what comes out.

`arrays.py` is the container: events with triggers, inertial samples and frames. The way of the data:

1. `recording.py` opens a recording, whose content decides which reader of `files/` reads it, and creates files.
2. Readers decode a sensor's words with `codecs/`, as cameras' drivers do; writers encode them.
3. `filters/` leaves out events, `representations/` makes images for a network of them, `measure/` measures them;
   `time_histogram.py` counts them over time, `stretches.py` lays episodes one behind the other for that.

`pixel_limit.py` limits the memory that a file's header can claim.
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
