"""Combines the audits of a run into one result for its summary."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from evis.runtime.plan import Plan

NUMBERS = ("vp", "vp_low", "vp_high", "events_wrong")
FRAMES = "vp_frames"
"""The error of the frames alone, where single pixels are evaluated between them."""

WIDEST = 0.5
"""Width of an interval from which on its pixels count as too few to tell the error."""

MORE, ENOUGH = 4, 64
"""Advice for more audited pixels: the factor, and the least number."""

HIGH = 0.1
"""Error from which on (with the lower end of its interval) the line says what lowers it."""
FINER = "time_tolerance:=0.0003"


def joined(nodes: Mapping[str, Any], plan: Plan) -> dict[str, Any] | None:
    """Combines the counters of the nodes that audited a camera; None where none did.

    Gives pixels, and vp, vp_low, vp_high, events_wrong, which are None where there were no events to tell them from; of
    several cameras `cameras` too, the same of each. Each camera counts by the events that its whole image is estimated
    to have; their pixels are drawn independently, so that the widths of their intervals add up by squares. Where single
    pixels are evaluated between frames there is vp_frames too.
    """
    counters = {name: node.get("counters", {}) for name, node in nodes.items()}
    audits = {_camera_of(name, plan): c for name, c in counters.items() if "audit_pixels" in c}
    if not audits:
        return None
    result = _combine(list(audits.values()))
    if len(audits) > 1:
        result["cameras"] = {camera: _combine([c]) for camera, c in audits.items()}
    return result


def _camera_of(node: str, plan: Plan) -> str:
    """Returns the camera of a node, by its topics."""
    return plan.nodes[node].outputs["audit"].rpartition("/")[0].strip("/") if node in plan.nodes else node


def _combine(audits: list[Mapping[str, Any]]) -> dict[str, Any]:
    """Combines the counters of some audits to one result."""
    told: dict[str, Any] = {"pixels": int(sum(c["audit_pixels"] for c in audits)), **dict.fromkeys(NUMBERS)}
    known = [c for c in audits if "vp" in c and c.get("audit_events", 0) > 0]
    if not known:
        return told
    total = sum(c["audit_events"] for c in known)
    share = [c["audit_events"] / total for c in known]
    if all(FRAMES in c for c in known):
        told[FRAMES] = round(sum(s * c[FRAMES] for s, c in zip(share, known)), 6)
    if len(known) == 1:
        return told | {name: round(float(known[0].get(name, 0.0)), 6) for name in NUMBERS}
    vp, wrong = (sum(s * c.get(name, 0.0) for s, c in zip(share, known)) for name in ("vp", "events_wrong"))
    below = math.hypot(*(s * (c.get("vp", 0.0) - c.get("vp_low", 0.0)) for s, c in zip(share, known)))
    above = math.hypot(*(s * (c.get("vp_high", 0.0) - c.get("vp", 0.0)) for s, c in zip(share, known)))
    values = (vp, max(0.0, vp - below), min(1.0, vp + above), wrong)
    return told | {name: round(value, 6) for name, value in zip(NUMBERS, values)}


def lines(summary: Mapping[str, Any]) -> list[str]:
    """Words the error beside the run time for a person, or why there is none; of several cameras each."""
    audit, sim_s = summary.get("audit"), summary["sim_s"]
    if audit is None:
        why = _why_left_out(summary)
        return [f"no error to tell: the audit is left out, for {why}"] if why else []
    took = f", run time {summary['wall_s'] / sim_s:.2g} s per s" if sim_s > 0 else ""
    cameras = audit.get("cameras", {})
    told = [f"{_worded(audit, summary['events'], max(len(cameras), 1))}{took}{_remedy(audit, summary['args'])}"]
    return told + [f"  {camera}: {_worded(each, 0)}" for camera, each in cameras.items()]


def _worded(audit: Mapping[str, Any], events: int, cameras: int = 1) -> str:
    """Words the error. events: of the whole run. cameras: among which the pixels are shared."""
    count = audit["pixels"]
    pixels, more = f"{count} pixel{'s' * (count != 1)}", f"audit:={max(MORE * count // cameras, ENOUGH)}"
    if audit["vp"] is None:
        seek = f"; {more} may have some" if events else ""
        return f"no error to tell: no events at these pixels (audit of {pixels}{seek})"
    low, high = audit["vp_low"], audit["vp_high"]
    alone = f", {audit[FRAMES]:.2f} by the frames alone" if FRAMES in audit else ""
    if high - low > WIDEST:
        few = "is" if count == 1 else "are"
        return f"error unknown: {pixels} {few} too few for it ({low:.2f} to {high:.2f}), {more} would do"
    reach = max(high - audit["vp"], audit["vp"] - low)
    if reach > min(audit["vp"], 1 - audit["vp"]):
        return f"error {audit['vp']:.2f}, {low:.2f} to {high:.2f} (audit of {pixels}{alone})"
    return f"error {audit['vp']:.2f} +- {reach:.2f} (audit of {pixels}{alone})"


def _remedy(audit: Mapping[str, Any], args: Mapping[str, Any]) -> str:
    """Words what lowers a high error of frames alone, where single pixels could be evaluated between them."""
    frames_alone = (
        args.get("interpolator") == "rigid" and args.get("time_tolerance") == 0 and args.get("upsampling") != 1
    )
    by_paths = args.get("bounces") or args.get("sky_occlusion")
    high = audit["vp_low"] is not None and audit["vp_low"] > HIGH and audit["vp_high"] - audit["vp_low"] <= WIDEST
    return f"; {FINER} lowers it, at a longer run time" if frames_alone and high and not by_paths else ""


def _why_left_out(summary: Mapping[str, Any]) -> str:
    """Returns why there is no audit, "" where nobody wants one."""
    if summary["args"].get("audit") == 0:
        return ""
    items = (item for item in summary["left_out"] if item["what"].rpartition("/")[2].partition("_")[0] == "audit")
    return next((item["why"] for item in items), "")
