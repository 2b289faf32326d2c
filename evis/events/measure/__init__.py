"""Measures event streams: rate, noise, sharpness and the rotation they show. Arrays in, plain numbers out.

`measurement.py` makes all measures in one pass: `rate.py`, `noise.py`, `sharpness.py` and `rotation/`. `bursts.py`
finds the bursts that edges make; `distance.py` (`distance_kernels.py`) compares two streams.
"""

from evis.events.measure.measurement import Measurement

__all__ = ["Measurement"]
