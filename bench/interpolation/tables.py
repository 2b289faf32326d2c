"""Makes the tables of the runs of `bench.interpolation.methods`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.interpolation.pipeline import Run
from nodes.interpolator.auto.setting import METHODS

DENSE_HZ = (250, 500, 1000, 2000)
"""Rates of dense rendering [Hz]."""
ALONE_HZ = (31.25, 62.5, 125)
"""More of them: what keyframes give that nothing is put between."""
RATES = ((250, 4), (125, 8), (62.5, 16), (31.25, 32))
"""Keyframe rates [Hz] and K that give 1000 frames per second."""
MANY = ((250, 16), (125, 32), (62.5, 64), (31.25, 128))
"""The same shading and four times the frames: what shading does not limit."""
LOST = 0.02
"""Share of the pixels of a hard case, off by more than a threshold, from which on a method fails in it."""
PAPER = "frame"
"""Time stamps of the published method: those of the frames."""
SHADING_US = (1.0, 3.0, 10.0, 30.0)
"""Costs of shading a pixel [us] at which run times are compared."""
COSTS_US = np.geomspace(0.01, 1000, 401)
"""Those that are gone through for where an error falls to half."""
VP = "VP 1/ms"


@dataclass
class Row:
    """Holds the run and the errors of one method at one rate with one crossing method.

    time_tolerance [s]: of rigid, 0 without further samples.
    """

    method: str
    rate: float
    k: int
    time_tolerance: float
    crossing: str
    run: Run
    error: dict[str, float]

    @property
    def name(self) -> str:
        """Gives the method's name in the tables."""
        if self.time_tolerance:
            return f"{self.method}, further samples"
        return "dense" if self.method == "none" else self.method

    @property
    def label(self) -> str:
        """Gives keyframes per second x K, with the tolerance of time where there is one."""
        within = f", {1e3 * self.time_tolerance:g} ms" if self.time_tolerance else ""
        return f"{self.rate:g}x{self.k}{within}"

    def seconds(self, duration_s: float, extra_us: float = 0.0, remember: bool = False) -> float:
        """Computes the run time per simulated second if every shaded pixel cost extra_us more.

        remember: pixels whose light may be remembered cost no more.
        """
        pixels = self.run.shaded - self.run.remembered * remember
        return (self.run.seconds(self.crossing) + pixels * extra_us * 1e-6) / duration_s


def shown(row: Row, seconds: float) -> dict[str, Any]:
    """Makes a line of a scene's own table."""
    line: dict[str, Any] = {
        "method": row.name,
        "keyframes x K": row.label,
        "crossing": row.crossing,
        "run time [s/s]": round(row.seconds(seconds), 3),
        "events": len(row.run.streams[row.crossing].t),
    }
    line |= {name: round(value, 4 if value < 10 else 1) for name, value in row.error.items()}
    samples = max(row.run.samples, 1)
    return line | {
        "frames, ln I / C": round(row.run.frame_error, 3),
        "shaded anew [%]": round(100 * row.run.reshaded / samples, 2),
        "guessed [%]": round(100 * row.run.filled / samples, 2),
    }


def equal_time(name: str, rows: Sequence[Row], facts: dict[str, Any]) -> list[dict[str, Any]]:
    """Finds the least error of every method within the time of the paper's configuration, by cost of shading."""
    lines = []
    own = facts["shading_us"]
    for cost in (own, *(c for c in SHADING_US if c > own)):
        budget, fits = _within(rows, facts, cost)
        line: dict[str, Any] = {"scene": name, "shading [us/px]": round(cost, 2), "run time [s/s]": round(budget, 2)}
        for method in METHODS:
            best = _best(r for r in fits if r.method == method)
            line["dense" if method == "none" else method] = f"{best.error[VP]:.4f} ({best.label})" if best else "-"
        splat, rigid = (_best(r for r in fits if r.method == method) for method in ("splat", "rigid"))
        line["rigid / splat"] = round(rigid.error[VP] / splat.error[VP], 2) if rigid and splat else "-"
        lines.append(line)
    return lines


def half_error(name: str, rows: Sequence[Row], facts: dict[str, Any]) -> dict[str, Any]:
    """Finds the cost of shading from which on rigid, and rigid or dense rendering, have half of splat's error."""
    own = facts["shading_us"]
    line: dict[str, Any] = {"scene": name, "its own shading [us/px]": round(own, 3)}
    for shown_as, methods, remember in (
        ("rigid", ("rigid",), False),
        ("rigid or dense", ("rigid", "none"), False),
        ("rigid, still surfaces remembered,", ("rigid",), True),
    ):
        since = None
        for cost in (*(c for c in COSTS_US[::-1] if c > own), own):
            _, fits = _within(rows, facts, cost, remember)
            best, splat = (_best(r for r in fits if r.method in m) for m in (methods, ("splat",)))
            if best is None or splat is None or best.error[VP] > 0.5 * splat.error[VP]:
                break
            since = cost
        line[f"{shown_as} from [us/px]"] = "never" if since is None else "its own" if since == own else f"{since:.2g}"
    return line


def _within(
    rows: Sequence[Row], facts: dict[str, Any], cost_us: float, remember: bool = False
) -> tuple[float, list[Row]]:
    """Run time per simulated second of the paper's configuration where shading costs so much, and what is as fast."""
    extra, seconds = cost_us - facts["shading_us"], facts["seconds"]
    paper = next(r for r in rows if (r.method, r.rate, r.k, r.crossing) == ("splat", 125, 8, PAPER))
    budget = paper.seconds(seconds, extra, remember)
    return budget, [r for r in rows if r.seconds(seconds, extra, remember) <= 1.02 * budget]


def equal_shading(name: str, rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Compares the paper's method, the best K of splat and rigid, and dense rendering at each keyframe rate."""
    lines = []
    dense = {r.crossing: r.error[VP] for r in rows if r.method == "none" and r.rate == 1000}
    for rate, k in RATES:
        here = [r for r in rows if r.rate == rate]
        splat = [r for r in here if r.method == "splat"]
        paper = next(r for r in splat if r.k == k and r.crossing == PAPER)
        stamps, free, rigid = (
            _sure(kept)
            for kept in ([r for r in splat if r.crossing == PAPER], splat, [r for r in here if r.method == "rigid"])
        )
        least = max(rigid.error[VP], 1e-9)
        alone = next(r.error[VP] for r in here if r.method == "none" and r.crossing == "linear")
        line: dict[str, Any] = {
            "scene": name,
            "keyframes [Hz]": f"{rate:g}",
            "keyframes alone": f"{alone:.4f}",
            "paper": f"{paper.error[VP]:.4f} ({paper.label})",
            "splat, stamps of frames": f"{stamps.error[VP]:.4f} ({stamps.label})",
            "splat": f"{free.error[VP]:.4f} ({free.label} {free.crossing})",
            "rigid": f"{rigid.error[VP]:.4f} ({rigid.label} {rigid.crossing}{rigid.name.removeprefix('rigid')})",
            "times less": f"{paper.error[VP] / least:.1f}",
            "times less than keyframes alone": f"{alone / least:.1f}",
            "times less, K free for both": f"{stamps.error[VP] / least:.1f}",
        }
        for crossing in ("linear", "monotone"):
            excess = {
                m: next(r for r in _named(here, m) if (r.k, r.crossing) == (k, crossing)).error[VP] - dense[crossing]
                for m in ("splat", "rigid")
            }
            line[f"excess, {crossing}"] = round(excess["rigid"] / excess["splat"], 3) if excess["splat"] > 0 else ""
        lines.append(line)
    return lines


def failures(name: str, rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Lists the runs of warps at 1000 frames per second whose error is more than twice that of dense rendering.

    Those whose frames are off by more than a threshold, as a root mean square, are listed too.
    """
    dense = {r.crossing: r.error[VP] for r in rows if r.method == "none" and r.rate == 1000}
    true = next(len(r.run.streams[r.crossing].t) for r in rows if r.method == "none" and r.rate == 1000)
    lines = []
    for row in rows:
        if row.method == "none" or row.crossing != "linear" or (row.rate, row.k) not in RATES:
            continue
        times = row.error[VP] / max(dense[row.crossing], 1e-9)
        if times > 2 or row.run.frame_error > 1:
            lines.append({
                "scene": name, "method": row.name, "keyframes x K": row.label,
                "error over dense 1000x1": round(times, 1),
                "events over dense 1000x1": round(len(row.run.streams[row.crossing].t) / max(true, 1), 2),
                "frames, ln I / C": round(row.run.frame_error, 2),
            })  # fmt: skip
    return lines


def by_method(runs: Sequence[dict[str, Any]], cases: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Lists for each method the scenes and the hard cases in which it fails, a line for each.

    These are its runs among `failures`, and the cases (cases.py) in which more than LOST of its pixels are off.
    """
    names = list(dict.fromkeys([*(r["method"] for r in runs), *(m for c in cases for m in c["off"])]))
    lines = []
    for name in sorted(names):
        scenes: dict[str, list[str]] = {}
        for r in runs:
            if r["method"] == name:
                scenes.setdefault(r["scene"], []).append(r["keyframes x K"])
        hard = [f"{c['case']} ({100 * c['off'][name]:.0f} %)" for c in cases if c["off"].get(name, 0.0) > LOST]
        lines.append({
            "method": name,
            "fails on": "; ".join(f"{scene} at {', '.join(at)}" for scene, at in scenes.items()) or "no scene",
            "fails in": "; ".join(hard) or "no hard case",
        })  # fmt: skip
    return lines


def _named(rows: Iterable[Row], name: str) -> list[Row]:
    return [r for r in rows if r.name == name]


def _best(rows: Iterable[Row]) -> Row | None:
    return min(rows, key=lambda r: r.error[VP], default=None)


def _sure(rows: Iterable[Row]) -> Row:
    return min(rows, key=lambda r: r.error[VP])
