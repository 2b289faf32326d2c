"""Measures the rotation that a stream of events shows: whether there is one, how fast, about which pivot, and how that
changes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from evis.events.measure.rotation.periodicity import candidates, descriptors, off_orders, recurrence
from evis.events.measure.rotation.pivot import Found, find_planes, pick_windows
from evis.events.measure.rotation.plane import FRONT
from evis.events.measure.rotation.polar import STEP_NS
from evis.events.measure.rotation.tracking import Track, consistency, track

SURE = 0.5
"""Confidence from which a speed is reported."""
COHERENT = 0.4
"""Coherence from which a pattern counts as one that turns."""
TOO_FEW = "too few events"
INCOHERENT = "the pattern does not stay the same while it turns: no rotation, or several at once"
_SLOW = 8
"""Factor by which windows and descriptors are longer for slow rotations."""
_EDGE_NS = 20_000_000
"""Longest part before the first and after the last point of a series that is counted as turned."""
_OFF = 0.15
"""Mean distance of the spectrum's peaks from whole orders from which a steady speed is not believed."""
_STEADY = 0.03
"""Largest standard deviation of the mean speeds of the revolutions, over the mean."""


def measure_rotation(
    t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, working: Callable[[str], None] = lambda text: None
) -> dict[str, Any]:
    """Measures the rotation of one stretch of events: t int64 [n, ns] ascending, x, y [n, px], p [n].

    Keys as `evis events measure` reports them; `omega_rad_s` is None where `confidence` is below 0.5. What is too slow
    to be seen in windows of 25 ms is looked for in windows _SLOW times as long.
    working: is told now and then what goes on.
    """
    found = _rotation(t, x, y, p, working)
    if found["omega_rad_s"] is not None or not len(t):
        return found
    slow = _rotation(t[0] + (t - t[0]) // _SLOW, x, y, p, lambda text: working(f"slow, {text}"))
    return found if slow["omega_rad_s"] is None else _stretched(slow, int(t[0]))


def _rotation(
    t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, working: Callable[[str], None]
) -> dict[str, Any]:
    windows = pick_windows(t, x, y, p) if len(t) else []
    if len(windows) < 3:
        return nothing(TOO_FEW)
    steps = int((t[-1] - t[0]) // STEP_NS) + 1
    table = descriptors(t, x, y, p, int(t[0]), steps)
    why, sure = "turning explains the events no better than sliding or standing still", 0.0
    for found in find_planes(windows, working):
        likely = found.gain / (found.gain + 0.05)
        if found.gain < 0.02:
            sure = max(sure, likely)
            continue
        tracked = track(t, x, y, p, found.plane, 1.4 * float(np.abs(found.omegas).max()) + 20, working)
        if found.plane.stretch != FRONT and not tracked.coherence >= COHERENT:
            why = INCOHERENT
            continue  # a front view may explain it
        likely *= consistency(tracked.series) * min(1.0, 2 * tracked.covered) * (1 - tracked.torn)
        if tracked.coherence < COHERENT:
            likely *= max(0.0, tracked.coherence) / COHERENT
        if likely >= SURE:
            report = _report(tracked.series, found, table, likely, (int(t[0]), int(t[-1])))
            if report["confidence"] >= SURE:
                return report
            sure, why = report["confidence"], report["why"]
            continue
        sure = likely
        why = "several speeds explain the events equally well" if tracked.torn > 0.5 else "no speed that lasts"
        if tracked.coherence < COHERENT:
            why = INCOHERENT
    return nothing(why) | {"confidence": round(sure, 3), "candidates": candidates(table, None)}


def _stretched(report: dict[str, Any], first_ns: int) -> dict[str, Any]:
    """Converts the report of events whose times were divided by _SLOW to true time."""
    period = report["period_s"]
    return report | {
        "omega_rad_s": report["omega_rad_s"] / _SLOW,
        "period_s": None if period is None else period * _SLOW,
        "candidates": [
            peak | {name: peak[name] / _SLOW for name in ("frequency_hz", "omega_rad_s")}
            for peak in report["candidates"]
        ],
        "series": [[first_ns + (at - first_ns) * _SLOW, round(omega / _SLOW, 4)] for at, omega in report["series"]],
    }


def nothing(why: str) -> dict[str, Any]:
    """Returns the report of a stream without a rotation."""
    return {
        "omega_rad_s": None, "confidence": 0.0, "steady": None, "direction": None, "reverses": None, "method": None,
        "pivot_px": None, "tilt_deg": None, "period_s": None, "revolutions": 0.0, "candidates": [], "ambiguity": None,
        "series": [], "why": why,
    }  # fmt: skip


def _report(series: Track, found: Found, table: np.ndarray, sure: float, span: tuple[int, int]) -> dict[str, Any]:
    angle = series.angle
    sign = 1.0 if np.median(series.omega) >= 0 else -1.0
    mean = mean_speed(series, angle)
    again = recurrence(table, 2 * np.pi / mean) if mean > 0 else None
    steady = is_steady(series, angle)
    method, omega = "tracked angle", mean
    if steady and again is not None and again.correlation > 0.2:
        method, omega = "periodicity", 2 * np.pi / again.period_s
        sure = max(sure, min(1.0, again.correlation + 0.3))
    turned = _way(series, angle, span) / (2 * np.pi)
    both = bool((series.omega * sign < -0.1 * np.abs(series.omega).max()).mean() > 0.02)
    listed, why = candidates(table, omega), None
    if steady and turned >= 1.5 and off_orders(listed, omega) > _OFF:
        sure, why = 0.4 * sure, "the peaks of the spectrum are no multiples of the speed that was followed"
    return {
        "omega_rad_s": float(omega),
        "confidence": round(float(sure), 3),
        "steady": steady,
        "direction": "clockwise" if sign > 0 else "counterclockwise",
        "reverses": both,
        "method": method,
        "pivot_px": [round(float(v), 1) for v in found.plane.pivot],
        "tilt_deg": round(float(np.degrees(found.plane.tilt_rad)), 1),
        "period_s": again.period_s if method == "periodicity" and again is not None else None,
        "revolutions": round(turned, 3),
        "candidates": listed,
        "ambiguity": _ambiguity(listed, turned, method),
        "series": [[int(t), round(float(sign * w), 4)] for t, w in zip(series.t_ns, series.omega)],
        "why": why,
    }


def _way(series: Track, angle: np.ndarray, span: tuple[int, int]) -> float:
    """Computes the angle turned [rad] from the first to the last event of `span` [ns].

    A series begins and ends half a window inside its events: the speeds there are taken for that half, no longer.
    """
    if len(series) < 2:
        return 0.0
    before, after = (
        float(np.clip(ns, 0, _EDGE_NS)) * 1e-9 for ns in (series.t_ns[0] - span[0], span[1] - series.t_ns[-1])
    )
    inner = float(np.abs(np.diff(angle)).sum())
    return inner + before * abs(float(series.omega[0])) + after * abs(float(series.omega[-1]))


def mean_speed(series: Track, angle: np.ndarray) -> float:
    """Computes the angle covered over time [rad/s]; of whole revolutions where there are any, which is free of the sway
    that a tilt makes.
    """
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(angle)))])
    whole = 2 * np.pi * np.floor(way[-1] / (2 * np.pi))
    end = float(np.interp(whole, way, series.t_ns - series.t_ns[0])) if whole else float(np.ptp(series.t_ns))
    return float((whole or way[-1]) / max(end * 1e-9, 1e-12))


def is_steady(series: Track, angle: np.ndarray) -> bool:
    """Tells whether the revolutions (or what there is of one) all take equally long."""
    way = np.abs(angle - angle[0])
    turns = int(way[-1] // (2 * np.pi))
    if turns < 2 or (np.diff(angle) * np.sign(angle[-1]) < 0).mean() > 0.02:
        smooth = np.std(series.omega) / max(abs(np.mean(series.omega)), 1e-9)
        # less than two revolutions: tilt sways the speed by up to a fifth at 35 degrees, a drift goes one way
        drift = np.polynomial.polynomial.polyfit(np.linspace(-0.5, 0.5, len(series)), series.omega, 1)[1]
        return bool(smooth < 0.25 and abs(drift) < 0.15 * abs(np.mean(series.omega)))
    passed = np.interp(2 * np.pi * np.arange(turns + 1), way, (series.t_ns - series.t_ns[0]) * 1e-9)
    took = np.diff(passed)
    return bool(np.std(took) < _STEADY * np.mean(took))


def _ambiguity(listed: list[dict[str, Any]], turned: float, method: str) -> str:
    text = "the spectrum alone leaves the order of its peaks open; the angle followed from window to window resolves it"
    if listed and listed[0]["order"] and listed[0]["order"] > 1:
        text = f"the strongest peak passes {listed[0]['order']} times per revolution; " + text
    if turned < 1:
        text += "; less than one revolution was seen, so that no period confirms it"
    elif method != "periodicity":
        text += "; the speed changes, so that no period confirms it"
    return text
