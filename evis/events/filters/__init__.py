"""Leaves out events of a stream.

`crop.py` leaves out those outside of a rectangle, `activity.py` lone ones, as noise is; `activity_kernels.py` finds
those.
"""

from evis.events.filters.activity import ActivityFilter
from evis.events.filters.crop import cropped

__all__ = ["ActivityFilter", "cropped"]
