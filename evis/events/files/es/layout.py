"""Describes the layout of Event Stream files, version 2 (github.com/neuromorphic-paris/event_stream).

A header (signature, three bytes of version, type, u16 width, u16 height), then events of five bytes: a first byte, x
and y as u16. The first byte holds, from its highest bit on, the time since the event before [us], the polarity, and for
ATIS a bit that marks an exposure measurement. A time of all ones is no event but a pause: the bits below count how
often the longest time passes.
"""

MAGIC = b"Event Stream"
VERSION = (2, 0, 0)
HEADER_BYTES = 20
TYPES = {0: "generic", 1: "dvs", 2: "atis", 4: "color"}
EVENT_BYTES = 5
TIME_SHIFT = {"dvs": 1, "atis": 2}
"""Bits below the time in the first byte, the polarity in the highest of them, for the types that hold polarities."""


def longest_time(shift: int) -> int:
    """Returns the time that a first byte without an event stands for [us]."""
    return 0xFF >> shift
