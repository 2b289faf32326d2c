"""Reads the trajectory of a body or a camera from a file of poses, as SLAM, motion capture and other simulators write
them."""

from __future__ import annotations

from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np

from evis.files.regular import NotAFileError, check_file
from evis.geometry import se3
from evis.geometry.three_turns import three_turns
from evis.scene.motion import Motion, Turn
from evis.scene.motion import Path as Along
from evis.scene.sources import note
from evis.scene.spline import Spline, apart
from evis.scene.yaml.reader import FARTHEST, Fields

MOST_POSES = 100_000
UNITS = {"s": 1, "ms": 1_000, "us": 1_000_000, "ns": 1_000_000_000}
"""Of the times, with how many there are in a second."""
ORDERS = {"xyzw": [0, 1, 2, 3], "wxyz": [1, 2, 3, 0]}
"""Of a quaternion's columns, with where x, y, z and w are."""


def read_trajectory(fields: Fields, home: Path) -> list[Motion]:
    """Reads `trajectory: {file, unit, quaternion}`: the motions that meet each pose of a file at its time.

    The first pose's time is 0 s. A cubic spline leads through the positions, others through the angles of three turns,
    at rest before the first pose and after the last. home: the scene's folder. Raises SceneError.
    """
    unit = UNITS[fields.text("unit", "s", choices=tuple(UNITS))]
    order = ORDERS[fields.text("quaternion", "xyzw", choices=tuple(ORDERS))]
    name = fields.text("file")
    fields.done()
    try:
        times, positions, quaternions = _poses(note(home / Path(name).expanduser()), unit)
        quaternions = _unit(quaternions[:, order])
        axes, angles = three_turns(quaternions)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise fields.error("file", f"cannot be used: {name}: {reason}") from None
    turns = [Turn(axis, Spline(times, angle)) for axis, angle in zip(axes, angles.T)]
    return [Along(Spline(times, positions)), *turns]


def _poses(path: Path, unit: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Reads times [K] in s, the first 0, positions [K, 3] in m, and quaternions [K, 4] as the file has them.

    Raises OSError, NotAFileError, and ValueError with the line that is wrong.
    """
    try:
        check_file(path)
    except NotAFileError as error:
        raise ValueError(str(error)) from None
    times: list[Decimal] = []
    rows: list[list[float]] = []
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, 1):
            words = line.partition("#")[0].replace(",", " ").split()
            if not words:
                continue
            try:
                time, row = Decimal(words[0]), [float(word) for word in words[1:8]]
            except (InvalidOperation, ValueError):
                if rows:
                    raise ValueError(f"line {number} is no time and pose") from None
                continue  # names of the columns
            if len(row) < 7:
                raise ValueError(f"line {number} has {len(words)} numbers; a time, x y z and a quaternion are 8")
            if not (time.is_finite() and np.isfinite(row).all() and max(map(abs, row[:3])) <= FARTHEST):
                raise ValueError(f"line {number} has a number that is not finite, or a place too far away")
            if times and time <= times[-1]:
                raise ValueError(f"line {number}: time {words[0]} does not come after the one before it")
            if len(rows) == MOST_POSES:
                raise ValueError(f"it has more than {MOST_POSES:,} poses; leave some out")
            times.append(time)
            rows.append(row)
    if len(rows) < 2:
        raise ValueError("it has no two poses, a line each: a time, x y z and a quaternion")
    values = np.array(rows)
    seconds = np.array([float((time - times[0]) / unit) for time in times])
    if not apart(seconds) or seconds[-1] > 1e9:
        raise ValueError(
            f"its times are {times[-1] - times[0]} apart from the first to the last, and {min(np.diff(seconds)):.3g} s "
            "from one to the next at least; is their unit right?"
        )
    return seconds, values[:, :3], values[:, 3:]


def _unit(quaternions: np.ndarray) -> np.ndarray:
    """Scales quaternions that are rounded to unit norm. Raises ValueError for what is no rotation."""
    norms = np.linalg.norm(quaternions, axis=-1)
    wrong = np.flatnonzero(np.abs(norms - 1) > 0.01)
    if len(wrong):
        raise ValueError(f"the quaternion of pose {wrong[0] + 1} has norm {norms[wrong[0]]:.3g}; a rotation's is 1")
    return se3.normalize(quaternions)
