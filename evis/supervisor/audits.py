"""What the audits of a run found, as one result for its summary."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

NUMBERS = ("vp", "vp_low", "vp_high", "events_wrong")


def joined(nodes: Mapping[str, Any]) -> dict[str, Any] | None:
    """Joins the counters of the nodes that audited a camera; None where none did.

    Gives pixels, and vp, vp_low, vp_high, events_wrong, which are None where there were no events to tell them from.
    Each camera counts by the events that its whole image is estimated to have; their pixels are drawn independently, so
    that the widths of their intervals add up by squares.
    """
    audits = [c for c in (node.get("counters", {}) for node in nodes.values()) if "audit_pixels" in c]
    if not audits:
        return None
    told: dict[str, Any] = {"pixels": int(sum(c["audit_pixels"] for c in audits)), **dict.fromkeys(NUMBERS)}
    known = [c for c in audits if "vp" in c and c.get("audit_events", 0) > 0]
    if not known:
        return told
    if len(known) == 1:
        return told | {name: round(float(known[0].get(name, 0.0)), 6) for name in NUMBERS}
    total = sum(c["audit_events"] for c in known)
    share = [c["audit_events"] / total for c in known]
    vp, wrong = (sum(s * c.get(name, 0.0) for s, c in zip(share, known)) for name in ("vp", "events_wrong"))
    below = math.hypot(*(s * (c.get("vp", 0.0) - c.get("vp_low", 0.0)) for s, c in zip(share, known)))
    above = math.hypot(*(s * (c.get("vp_high", 0.0) - c.get("vp", 0.0)) for s, c in zip(share, known)))
    values = (vp, max(0.0, vp - below), min(1.0, vp + above), wrong)
    return told | {name: round(value, 6) for name, value in zip(NUMBERS, values)}


def line(audit: Mapping[str, Any], sim_s: float, wall_s: float) -> str:
    """Writes the error beside the run time, as a person reads it."""
    pixels = f"audit of {audit['pixels']} pixel{'s' * (audit['pixels'] != 1)}"
    took = f", run time {wall_s / sim_s:.2g} s per s" if sim_s > 0 else ""
    if audit["vp"] is None:
        return f"no error to tell: no events at these pixels ({pixels}){took}"
    reach = max(audit["vp_high"] - audit["vp"], audit["vp"] - audit["vp_low"])
    return f"error {audit['vp']:.2f} +- {reach:.2f} ({pixels}){took}"
