"""The clips of the flicked wheel, their reference, and two other ways to its speed that share nothing with the product.

The reference: a line through the wheel's edge per window of 3 ms, and the slope of its angle over nine windows.
"""

from __future__ import annotations

import csv
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from evis.events import open_recording

DATA = Path(os.environ.get("EVIS_TEST_DATA", Path(__file__).parents[3] / "shared" / "data"))
CLIPS = ("11_34_19", "11_34_58", "11_35_33", "11_35_50", "11_36_31", "11_36_46")
WINDOW_US = 3000
WINDOWS = 9


@dataclass(frozen=True)
class Clip:
    """at [s, us from the first event], omega [s, rad/s], windows [s], centre [2, px]: the reference; the rest: events.

    t int64 [n, ns], x, y uint16 [n], p uint8 [n], size (width, height) [px].
    """

    at: np.ndarray
    omega: np.ndarray
    windows: np.ndarray
    centre: np.ndarray
    t: np.ndarray
    x: np.ndarray
    y: np.ndarray
    p: np.ndarray
    size: tuple[int, int]


def load(name: str) -> Clip:
    """A clip and its part of the reference; skips where they are absent."""
    table = DATA / "wheel" / "reference_speed.csv"
    if not table.exists():
        pytest.skip(f"no recordings at {DATA} (set EVIS_TEST_DATA)")
    rows = [row for row in csv.DictReader(table.open()) if name in row["file"]]
    keys = ("t_us_rel_first_event", "omega_rad_s", "n_windows", "cx_px", "cy_px")
    at, omega, windows, *centre = np.array([[float(row[key]) for key in keys] for row in rows]).T
    with open_recording(DATA / "wheel" / rows[0]["file"]) as recording:
        events = recording.read()
        size = (recording.info.width, recording.info.height)
    return Clip(at, omega, windows, np.array([v[0] for v in centre]), events.t, events.x, events.y, events.p, size)


def line_speed(clip: Clip, turns: int = 20) -> np.ndarray:
    """|speed| [s, rad/s] at the reference's stamps, made as it was: slope of a line's angle over nine windows."""
    middles = np.arange(clip.at[0] - 15_000, clip.at[-1] + 15_001, WINDOW_US)
    time_us = (clip.t - clip.t[0]) / 1e3
    angles = []
    for middle in middles:
        first, last = np.searchsorted(time_us, [middle - WINDOW_US / 2, middle + WINDOW_US / 2])
        angles.append(line_angle(clip.x[first:last].astype(float), clip.y[first:last].astype(float), turns))
    angle = np.array(angles)
    good = np.isfinite(angle)
    middles, angle = middles[good], np.unwrap(angle[good], period=np.pi)
    speeds = []
    for at in clip.at:
        near = np.abs(middles - at) < WINDOW_US * (WINDOWS / 2)
        speeds.append(np.polyfit((middles[near] - at) * 1e-6, angle[near], 1)[0])
    return np.abs(speeds)


def line_angle(x: np.ndarray, y: np.ndarray, turns: int) -> float:
    """Angle [rad] of the line through most of the points, whatever lies beside it: weights 1 / (1 + (r / 2 px)^2).

    It begins as the principal axis of all points and is improved `turns` times.
    """
    if len(x) < 30:
        return float("nan")
    weight, angle = np.ones(len(x)), 0.0
    for _ in range(turns + 1):
        dx, dy = x - np.average(x, weights=weight), y - np.average(y, weights=weight)
        # the axis of the weighted second moments
        angle = 0.5 * np.arctan2(2 * weight @ (dx * dy), weight @ (dx * dx - dy * dy))
        weight = 1 / (1 + ((np.cos(angle) * dy - np.sin(angle) * dx) / 2) ** 2)
    return float(angle)


def passage_speed(clip: Clip, at: np.ndarray, half_s: float = 0.0135, quiet_s: float = 0.008) -> np.ndarray:
    """|speed| [rad/s] at `at` [us] from the times at which pixels are first passed: nothing is warped, no line fitted.

    A half black, half white wheel has one edge of each polarity, half a turn apart. Where and when a pixel has its
    first event after `quiet_s` of silence is a point (angle about the hub + pi if ON, time): all of them lie on the
    curve of the wheel's angle. A search over all speeds finds the curve, a robust parabola its slope (the plane fit of
    Benosman et al., IEEE TNNLS 2014, in one dimension).
    """
    key = (clip.y.astype(np.int64) * clip.size[0] + clip.x) * 2 + clip.p
    order = np.lexsort((np.arange(len(key)), key))
    again = np.concatenate([[False], np.diff(key[order]) == 0])
    since = np.full(len(key), np.inf)
    since[order[again]] = np.diff(clip.t[order])[again[1:]] * 1e-9
    dx, dy = clip.x - clip.centre[0], clip.y - clip.centre[1]
    first = (since > quiet_s) & (np.hypot(dx, dy) > 8)
    time_s = (clip.t[first] - clip.t[0]) * 1e-9
    angle = np.arctan2(dy[first], dx[first]) + np.pi * clip.p[first]
    return np.array([_slope(time_s - v * 1e-6, angle, half_s) for v in at])


def _slope(tau: np.ndarray, angle: np.ndarray, half_s: float) -> float:
    near = np.abs(tau) < half_s
    tau, angle = tau[near], angle[near]
    bins = 126

    def gathered(omega: float) -> np.ndarray:
        place = ((angle - omega * tau) % (2 * np.pi) * (bins / (2 * np.pi))).astype(int)
        counts = np.bincount(place, minlength=bins)
        return counts + np.roll(counts, 1)

    omegas = np.arange(-75, 75.1, 0.5)
    omega = float(omegas[np.argmax([gathered(v).max() for v in omegas])])
    terms = np.stack([np.ones(len(tau)), tau, tau**2], 1)
    fit = np.array([gathered(omega).argmax() * 2 * np.pi / bins, omega, 0.0])
    for scale in (0.2, 0.15, 0.1, 0.08, 0.06, *(0.05,) * 5):
        off = (angle - terms @ fit + np.pi) % (2 * np.pi) - np.pi
        root = np.sqrt(1 / (1 + (off / scale) ** 2))
        fit = fit + np.linalg.lstsq(terms * root[:, None], off * root, rcond=None)[0]
    return float(abs(fit[1]))
