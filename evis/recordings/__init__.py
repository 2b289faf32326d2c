"""Offers recordings and bags to Python: streams to go over, to cut by time and to take windows of.

`evis.open` is `open_recorded`. It stands above the readers of `evis.events` and `evis.bag`, and reads what they read.
"""

from evis.recordings.recorded import Counts, Recorded, open_recorded
from evis.recordings.windows import EventWindow

__all__ = ["Counts", "EventWindow", "Recorded", "open_recorded"]
