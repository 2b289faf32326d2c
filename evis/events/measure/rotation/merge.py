"""Merges the rotations of consecutive stretches of a stream into one."""

from __future__ import annotations

from typing import Any

import numpy as np

from evis.events.measure.rotation.rotation import SURE, nothing

_SAME = 0.03
"""Stretches with speeds this close [share] belong to one steady rotation."""


def merge(segments: list[dict[str, Any]]) -> dict[str, Any]:
    """Merges the reports of stretches into one: speeds averaged by the length of the stretches that have one, series
    joined.
    """
    with_speed = [s for s in segments if s["omega_rad_s"] is not None]
    if not segments:
        return nothing("no events")
    if not with_speed:
        best = max(segments, key=lambda s: s["confidence"])
        return {name: value for name, value in best.items() if name != "events"}
    if len(segments) == 1:
        return {name: value for name, value in segments[0].items() if name != "events"}
    spans = np.array([max(s["series"][-1][0] - s["series"][0][0], 1) for s in with_speed], float)
    speeds = np.array([s["omega_rad_s"] for s in with_speed])
    longest = with_speed[int(spans.argmax())]
    # a stretch's series is positive along its own direction
    signs = [_sign(s) * _sign(longest) for s in with_speed]
    even = all(s["steady"] for s in with_speed) and np.ptp(speeds) <= _SAME * speeds.mean() and len(set(signs)) == 1
    weights = spans / spans.sum()
    listened = sum(s["events"] for s in segments)
    heard = sum(s["events"] for s in with_speed)
    sure = float((np.array([s["confidence"] for s in with_speed]) * weights).sum())
    confidence = round(sure * heard / max(listened, 1), 3)
    if confidence < SURE:
        why = "a rotation in a part of the recording only; measure that part"
        return nothing(why) | {"confidence": confidence, "candidates": longest["candidates"]}
    result = dict(longest)
    result |= {
        "omega_rad_s": float((speeds * weights).sum()),
        "confidence": confidence,
        "steady": bool(even),
        "reverses": len(set(signs)) > 1 or any(s["reverses"] for s in with_speed),
        "revolutions": round(sum(s["revolutions"] for s in with_speed), 3),
        "series": [[t, sign * w] for s, sign in zip(with_speed, signs) for t, w in s["series"]],
    }
    if not even:
        result |= {"period_s": None, "method": "tracked angle"}
    del result["events"]
    return result


def _sign(segment: dict[str, Any]) -> float:
    return -1.0 if segment["direction"] == "counterclockwise" else 1.0
