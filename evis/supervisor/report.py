"""Summarises a run: its numbers, as JSON and as a short table."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from evis.runtime.plan import Plan
from evis.supervisor import audits, paces

DROP_COUNTERS = ("drops", "dropped", "lost")
"""Counters that stand for data that did not arrive."""
AUDITED = "which pixels are audited"
"""Name of what the seed decides of a run's audit; no event depends on it."""
_BUS_KEYS = ("bus", "idle")


@dataclass
class Report:
    """Holds the outcome of a run. summary: what --json prints. failure: the one line of what went wrong."""

    summary: dict[str, Any]
    failure: str | None = None


def summarise(
    plan: Plan,
    parts: list[dict[str, Any]],
    *,
    startup_s: float,
    wall_s: float,
    failure: str | None,
    interrupted: bool,
) -> Report:
    """Combines the summaries of all processes.

    plan: what was run. parts: the summaries of its processes. startup_s: until all were ready [s]. wall_s: from
    there to the end [s]; rtf = sim_s / wall_s. failure: what went wrong, in one line. interrupted: it was asked to end,
    which is told of a run that had a duration.
    """
    plan = plan.redacted()
    nodes: dict[str, Any] = {}
    overhead: dict[str, float] = dict.fromkeys(_BUS_KEYS, 0.0)
    for part in parts:
        for name, values in part.get("nodes", {}).items():
            if name in _BUS_KEYS:
                overhead[name] += values.get("busy_s", 0.0)
            else:
                nodes[name] = values
    spans = [n["stamp_ns"] - n["first_stamp_ns"] for n in nodes.values() if n.get("first_stamp_ns") is not None]
    sim_s = max(spans, default=0) / 1e9
    summary = {
        "sim_s": sim_s,
        "startup_s": round(startup_s, 6),
        "wall_s": round(wall_s, 6),
        "rtf": round(sim_s / wall_s, 6) if wall_s > 0 else 0.0,
        "events": _total(nodes, "events"),
        "keyframes": _total(nodes, "keyframes"),
        "frames": _total(nodes, "frames"),
        "drops": sum(n.get("counters", {}).get(key, 0) for n in nodes.values() for key in DROP_COUNTERS),
        "dropped_events": sum(n.get("counters", {}).get("dropped_events", 0) for n in nodes.values()),
        "nodes": nodes,
        "left_out": [{"what": item.what, "why": item.why} for item in plan.left_out],
        "bus_s": round(overhead["bus"], 6),
        "idle_s": round(overhead["idle"], 6),
        "cpu_s": round(sum(part.get("cpu_s", 0.0) for part in parts), 6),
        "rss_mb": round(sum(part.get("rss_mb", 0.0) for part in parts), 1),
        "args": plan.args,
        "random": plan.random,
    }
    if (audit := audits.joined(nodes, plan)) is not None:
        summary["audit"] = audit
    for node in nodes.values():
        summary |= node.pop("results", {})
    if "pace" in summary:
        summary["pace"] = paces.with_verdict(summary["pace"], nodes, plan)
    if plan.chosen:
        summary["chosen"] = plan.chosen
    if interrupted and plan.duration_s is not None:
        summary["interrupted"] = f"it was asked to end before its {plan.duration_s:g} s were over"
    if failure is not None:
        summary["error"] = failure
    return Report(summary, failure)


def _total(nodes: dict[str, Any], key: str) -> int:
    return int(sum(node.get(key, 0) for node in nodes.values()))


def as_table(report: Report) -> str:
    """Writes the summary as text for a person."""
    s = report.summary
    width = max(19, *map(len, s["nodes"])) + 1 if s["nodes"] else 20
    lines = [
        f"{s['sim_s']:.3f} s in {s['wall_s']:.2f} s (real-time factor {s['rtf']:.3f}), start-up {s['startup_s']:.2f} s",
        f"{s['events']:,} events, {s['keyframes']:,} keyframes, {s['frames']:,} frames, "
        f"{s['drops']:,} messages and {s['dropped_events']:,} events dropped",
        *([f"interrupted: {s['interrupted']}"] if "interrupted" in s else []),
        *paces.lines(s),
        *audits.lines(s),
        *_physics_error(s),
        *_seed_unused(s),
        "",
        f"{'node':<{width}}{'updates':>10}{'ms/update':>12}{'busy s':>10}  counters",
    ]
    for name, node in s["nodes"].items():
        counters = ", ".join(
            f"{k}={v:,}" if isinstance(v, int) else f"{k}={v:,.10g}" for k, v in node.get("counters", {}).items()
        )
        lines.append(
            f"{name:<{width}}{node.get('updates', 0):>10}{node.get('ms_per_update', 0.0):>12.3f}"
            f"{node.get('busy_s', 0.0):>10.3f}  {counters}".rstrip()
        )
    return "\n".join(lines)


def _physics_error(summary: dict[str, Any]) -> list[str]:
    """Words the error of the body that physics has furthest off, if there is one."""
    error = summary.get("physics_error")
    if error is None:
        return []
    off = f"{error['position_m']:.2g} m and {math.degrees(error['rotation_rad']):.2g} degrees"
    return [f"physics: body '{error['body']}' at most {off} off (estimated)"]


def _seed_unused(summary: dict[str, Any]) -> list[str]:
    """Words that a seed was given and decides nothing, or only what is audited."""
    seed, drawn = summary["args"].get("seed"), {what for parts in summary["random"].values() for what in parts}
    if not seed or not summary["random"] or not drawn <= {AUDITED}:
        return []
    if drawn:
        return [f"nothing in this run is random but the choice of audited pixels: seed {seed} changes no event"]
    return [f"nothing in this run is random: seed {seed} changes nothing"]
