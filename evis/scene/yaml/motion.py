"""Reads motions of a scene file."""

from __future__ import annotations

from typing import Any

import numpy as np

from evis.scene import motion
from evis.scene.spline import Spline, apart
from evis.scene.yaml.reader import Fields

FASTEST = 1e6
"""Frequency [Hz] of a motion; beyond it a period has too few of the clock's nanoseconds to be followed."""
KINDS = ("linear", "sinusoid", "path", "spin", "swing", "turn")


def read_motion(fields: Fields) -> motion.Motion:
    """Reads one entry of `motion:`."""
    kind = fields.text("kind", choices=KINDS)
    result: motion.Motion
    if kind == "linear":
        result = motion.Linear(fields.vector("velocity"))
    elif kind == "spin":
        result = motion.Spin(fields.direction("axis"), fields.number("rate"))
    elif kind == "path":
        times = _times(fields)
        points = [fields.vector_of("points", row, 3) for row in _rows(fields, "points", len(times))]
        loop = _loop(fields, "start_velocity", "end_velocity")
        start, end = (fields.vector(key, 3, [0, 0, 0]) for key in ("start_velocity", "end_velocity"))
        result = motion.Path(Spline(times, np.array(points), loop, start, end))
    elif kind == "turn":
        times = _times(fields)
        angles = np.array([[fields.angle_of("angles", a)] for a in _rows(fields, "angles", len(times))])
        loop = _loop(fields, "start_rate", "end_rate")
        first, last = (np.array([fields.number(key, 0.0)]) for key in ("start_rate", "end_rate"))
        result = motion.Turn(fields.direction("axis"), Spline(times, angles, loop, first, last))
    elif kind == "sinusoid":
        result = motion.Sinusoid(fields.vector("amplitude"), _frequency(fields), fields.angle("phase", 0.0))
    else:
        result = motion.Swing(
            fields.direction("axis"), fields.angle("amplitude"), _frequency(fields), fields.angle("phase", 0.0),
        )  # fmt: skip
    fields.done()
    return result


def _frequency(fields: Fields) -> float:
    return fields.number("frequency", minimum=0.0, maximum=FASTEST)


def _times(fields: Fields) -> np.ndarray:
    rows = _rows(fields, "times", None)
    times = np.array([fields.number_of("times", row) for row in rows])
    if not apart(times):
        raise fields.error("times", "must increase from one to the next, by a nanosecond or more")
    return times


def _rows(fields: Fields, key: str, count: int | None) -> list[Any]:
    rows = fields.plain(key)
    if not isinstance(rows, list) or not 2 <= len(rows) <= 1000:
        raise fields.error(key, "must be a list of 2 to 1000 entries")
    if count is not None and len(rows) != count:
        raise fields.error(key, f"has {len(rows)} entries; `times` has {count}")
    return rows


def _loop(fields: Fields, *ends: str) -> bool:
    loop = fields.flag("loop", False)
    for name in ends:
        if loop and fields.has(name):
            raise fields.error(name, "has no meaning with `loop`; leave one out")
    return loop
