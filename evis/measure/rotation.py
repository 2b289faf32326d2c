"""Rotation of what a stream of events shows: is there one, how fast, about which pivot, and how that changes."""

from __future__ import annotations

from typing import Any

import numpy as np

from evis.measure.periodicity import candidates, descriptors, off_orders, recurrence
from evis.measure.pivot import Found, find_pivot, pick_windows
from evis.measure.polar import STEP_NS
from evis.measure.tracking import Track, consistency, track

SURE = 0.5
"""Confidence from which a speed is reported."""
_OFF = 0.15
"""Mean distance of the spectrum's peaks from whole orders from which a steady speed is not believed."""
_STEADY = 0.03
"""Largest standard deviation of the mean speeds of the revolutions, over the mean."""


def measure_rotation(t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray) -> dict[str, Any]:
    """Rotation of one stretch of events: t int64 [n, ns] ascending, x, y [n, px], p [n].

    Keys as `evis events measure` reports them; `omega_rad_s` is None where `confidence` is below 0.5.
    """
    windows = pick_windows(t, x, y, p) if len(t) else []
    if len(windows) < 3:
        return nothing("too few events")
    found = find_pivot(windows)
    fastest = 1.4 * float(np.abs(found.omegas).max()) + 20
    steps = int((t[-1] - t[0]) // STEP_NS) + 1
    table = descriptors(t, x, y, p, int(t[0]), steps)
    if found.gain < 0.02:
        return nothing("turning explains the events no better than sliding or standing still") | {
            "confidence": round(found.gain / (found.gain + 0.05), 3),
            "candidates": candidates(table, None),
        }
    series, covered, torn = track(t, x, y, p, found.pivot, fastest)
    sure = found.gain / (found.gain + 0.05) * consistency(series) * min(1.0, 2 * covered) * (1 - torn)
    why = "several speeds explain the events equally well" if torn > 0.5 else "no speed that lasts"
    if sure >= SURE:
        report = _report(series, found, table, sure)
        if report["confidence"] >= SURE:
            return report
        sure, why = report["confidence"], report["why"]
    return nothing(why) | {"confidence": round(sure, 3), "candidates": candidates(table, None)}


def nothing(why: str) -> dict[str, Any]:
    """The report of a stream without a rotation."""
    return {
        "omega_rad_s": None, "confidence": 0.0, "steady": None, "direction": None, "reverses": None, "method": None,
        "pivot_px": None, "period_s": None, "revolutions": 0.0, "candidates": [], "ambiguity": None, "series": [],
        "why": why,
    }  # fmt: skip


def _report(series: Track, found: Found, table: np.ndarray, sure: float) -> dict[str, Any]:
    angle = angle_of(series)
    sign = 1.0 if np.median(series.omega) >= 0 else -1.0
    mean = mean_speed(series, angle)
    again = recurrence(table, 2 * np.pi / mean) if mean > 0 else None
    steady = is_steady(series, angle)
    method, omega = "tracked angle", mean
    if steady and again is not None and again.correlation > 0.2:
        method, omega = "periodicity", 2 * np.pi / again.period_s
        sure = max(sure, min(1.0, again.correlation + 0.3))
    turned = float(np.abs(np.diff(angle)).sum() / (2 * np.pi)) if len(angle) > 1 else 0.0
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
        "pivot_px": [round(float(v), 1) for v in found.pivot],
        "period_s": again.period_s if method == "periodicity" and again is not None else None,
        "revolutions": round(turned, 3),
        "candidates": listed,
        "ambiguity": _ambiguity(listed, turned, method),
        "series": [[int(t), round(float(sign * w), 4)] for t, w in zip(series.t_ns, series.omega)],
        "why": why,
    }


def angle_of(series: Track) -> np.ndarray:
    """The tracked angle [n, rad], 0 at the first point; gaps in the series are bridged by the mean of their ends."""
    if len(series) < 2:
        return np.zeros(len(series))
    step = np.diff(series.t_ns) * 1e-9
    return np.concatenate([[0.0], np.cumsum((series.omega[1:] + series.omega[:-1]) / 2 * step)])


def mean_speed(series: Track, angle: np.ndarray) -> float:
    """Way over time [rad/s]; of whole revolutions where there are any, which is free of the sway that a tilt makes."""
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(angle)))])
    whole = 2 * np.pi * np.floor(way[-1] / (2 * np.pi))
    end = float(np.interp(whole, way, series.t_ns - series.t_ns[0])) if whole else float(np.ptp(series.t_ns))
    return float((whole or way[-1]) / max(end * 1e-9, 1e-12))


def is_steady(series: Track, angle: np.ndarray) -> bool:
    """Whether the revolutions (or what there is of one) all take equally long."""
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
