"""Defines what an audit says: how far a run's events are off, from pixels that were also computed by brute force."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from msgs.fields import array
from msgs.header import Header, Message


@dataclass
class Audit(Message):
    """Carries an audit's running totals up to header.stamp_ns. Numbers without events to tell them from are NaN.

    vp: Victor-Purpura distance (1/ms) over the events of the run and of brute force, 0 ... 1, with its 95 % interval;
    events_wrong: share of both without a partner of the same polarity within 1 ms. vp_frames: vp of the run's frames
    alone, where it has samples of single pixels between them (`time_tolerance`), else NaN.
    """

    header: Header
    worst_pixel: np.ndarray = array("int32", "w 3", "environment, x and y of the pixels with the largest distances")
    worst_distance: np.ndarray = array("float64", "w", "their distances, in events")
    pixels: int = 0
    vp: float = field(default=float("nan"))
    vp_low: float = field(default=float("nan"))
    vp_high: float = field(default=float("nan"))
    events_wrong: float = field(default=float("nan"))
    vp_frames: float = field(default=float("nan"))
    events: float = 0.0
    """Events of both in the whole image, estimated."""
    cause: str = ""
    """What most of the error is about."""
