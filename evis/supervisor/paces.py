"""Judges whether a run kept the pace that was asked for, and says what to change where it did not."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from evis.runtime.plan import Plan

TOLERATED_MS = 100
"""A pace that was never later than this, in the wall's time and the stamps', was kept: less is the jitter of a machine
that does other things too [ms]."""
FASTER = (
    "fewer pixels (width, height), instants (keyframe_rate, upsampling, time_tolerance) or labels, and --compose, make "
    "it faster"
)
SLOWER = "a lower pace, as pace:=0.5, or fewer who read the topics, can be kept"


def with_verdict(pace: Mapping[str, Any], nodes: Mapping[str, Any], plan: Plan) -> dict[str, Any]:
    """Adds `not_kept` to the measures of a paced source that came later than TOLERATED_MS: one line with the remedy.

    pace: wanted and reached speed, late_ms_max. nodes: the summaries of a run's nodes by their names.
    """
    if pace["late_ms_max"] * max(pace["wanted"], 1) <= TOLERATED_MS:
        return dict(pace)
    busiest = max(nodes, key=lambda name: nodes[name].get("busy_s", 0.0))
    speed = f"real-time factor {pace['reached']:.2g}" + (
        f" in place of {pace['wanted']:g}" if pace["wanted"] != 1 else ""
    )
    # The graph itself is paced in this mode, and a replayer by itself in any other.
    remedy = FASTER if plan.mode == "realtime" else SLOWER
    return {**pace, "not_kept": f"{speed}, up to {pace['late_ms_max']:,} ms late; {busiest} took longest; {remedy}"}


def lines(summary: Mapping[str, Any]) -> list[str]:
    """Words for a person that the pace was not kept; empty where it was."""
    text = summary.get("pace", {}).get("not_kept")
    return [f"pace not kept: {text}"] if text else []
