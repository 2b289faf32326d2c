"""Makes the tables of all trials: a row per case, a row per case and time step, counts, and every trial."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from bench.physics.case import INTEGRATORS, MS, TOLERANCES, Case
from bench.physics.trial import NAMES, RIGHT, Trial

COMMAND = "evis bench physics"
FIRST = (INTEGRATORS[0], MS)
"""What a model that says nothing of it gets: MuJoCo's default integrator, and the engine's longest step."""
GROUPS = {
    "free": "Free motion, pendulums, a chain",
    "springs": "Springs and servos",
    "contacts": "Bounces, slopes and blows",
    "piles": "What stands on each other",
}
FACTOR = 2
"""Within which an estimate of an error is right."""
MIDDLE = TOLERANCES[1]
"""The tolerance that the table of cases has."""
SAME = 1.3
"""Ratio of run times below which methods cost the same: they vary by as much."""
OUTCOMES = (RIGHT, "right, but warned of", "off, foretold", "off, said", "off, unsaid", "diverged, foretold",
            "diverged, said")  # fmt: skip


def sections(trials: Sequence[Trial]) -> dict[str, Any]:
    """Makes all tables of these trials, which are in the order of their cases."""
    cases = list({trial.case.name: trial.case for trial in trials}.values())
    by_case = {case.name: [trial for trial in trials if trial.case.name == case.name] for case in cases}
    found = {
        "cases": _section(
            "Every case: as a model gets it that says nothing, and the cheapest that is right",
            [_summary(case, by_case[case.name]) for case in cases],
            "right: the error is within the limit. Cheapest: the least CPU time of the integrators and steps that are "
            "right and nothing else was foretold, as all shorter steps of the same integrator are.",
        ),
        "outcomes": _section(
            "What came of all trials, by integrator",
            [_counts(name, [trial for trial in trials if trial.method.name == name]) for name in NAMES],
            "off: the error is above the limit. foretold: a warning before the first step; said: one in the run or at "
            "its end. estimated: trials whose estimate of their own error is within a factor of two of it.",
        ),
    }
    for group, title in GROUPS.items():
        rows = [row for case in cases if case.group == group for row in _errors(case, by_case[case.name])]
        if rows:
            found[f"errors_{group}"] = _section(f"{title}: error by time step and integrator", rows, "")
    bounded = {trial.case.name for trial in trials if trial.method.tolerance is not None}
    if bounded:
        found["tolerances"] = _section(
            "With physics_tolerance, of a model that says nothing else: error and run time",
            [_tolerances(case, by_case[case.name]) for case in cases if case.name in bounded],
            "Metres and radians that a body may gather in a simulated second.",
        )
    compared = [trial for trial in trials if trial.case.estimated]
    if compared:
        found["estimates"] = _section(
            "The error that a run says, divided by its error",
            [row for case in cases if case.estimated for row in _estimates(case, by_case[case.name])],
            "Blank where both are below a hundredth of the limit, or where the run diverged.",
        )
    found["trials"] = _section("Every trial", [_trial(trial) for trial in trials], "said: the first message.")
    return found


def _section(title: str, rows: list[dict[str, Any]], note: str) -> dict[str, Any]:
    return {"title": title, "command": COMMAND, "rows": rows, "note": note}


def reliable(trials: Sequence[Trial]) -> list[Trial]:
    """Finds the trials of one case that are right, without a warning beforehand, and right with all shorter steps too.

    One that is right where a shorter step of the same integrator is not was lucky.

    One that is right where a shorter step is not was lucky.
    """
    return [
        trial
        for trial in trials
        if trial.right and not trial.foretold
        and all(other.right for other in trials
                if other.method.name == trial.method.name and other.method.size < trial.method.size)
    ]  # fmt: skip


def cheapest(trials: Sequence[Trial]) -> Trial | None:
    """Finds the reliable trial of one case that costs least; of those that cost the same, the first of NAMES."""
    found = reliable(trials)
    least = min((trial.cpu for trial in found), default=0.0)
    found = [trial for trial in found if trial.cpu < SAME * least]
    return min(found, key=lambda trial: NAMES.index(trial.method.name), default=None)


def _summary(case: Case, trials: Sequence[Trial]) -> dict[str, Any]:
    first = next(t for t in trials if (t.method.name, t.method.step_ns) == FIRST)
    best = cheapest(trials)
    row = {
        "case": case.name,
        "truth": case.truth,
        "simulated [s]": case.seconds,
        "limit": f"{case.limit:.2g} {case.unit}",
        "Euler, 1 ms": _cell(first),
        "cheapest that is right": f"{best.method.name}, {best.method.step}" if best else "none of these",
    }
    row |= {"its error": f"{best.error:.2g}" if best else "", "CPU [s/s]": f"{best.cpu:.2g}" if best else ""}
    middle = [trial for trial in trials if trial.method.tolerance == MIDDLE]
    return row | {f"tolerance {MIDDLE:g}": _cell(middle[0]) if middle else ""}


def _counts(integrator: str, trials: Sequence[Trial]) -> dict[str, Any]:
    counts = Counter(trial.verdict for trial in trials)
    ratios = [trial.ratio for trial in trials if trial.ratio is not None]
    near = sum(1 / FACTOR <= ratio <= FACTOR for ratio in ratios)
    row = {"integrator": integrator, "trials": len(trials)} | {name: counts[name] for name in OUTCOMES}
    return row | {"estimated": f"{near} of {len(ratios)}"}


def _estimates(case: Case, trials: Sequence[Trial]) -> list[dict[str, Any]]:
    rows, stepped = [], [trial for trial in trials if trial.method.tolerance is None]
    for step in dict.fromkeys(trial.method.step for trial in stepped):
        row: dict[str, Any] = {"case": case.name, "time step": step}
        found = {trial.method.integrator: trial.ratio for trial in stepped if trial.method.step == step}
        ratios = {name: found.get(name) for name in INTEGRATORS}
        rows.append(row | {name: "" if ratio is None else f"{ratio:.2g}" for name, ratio in ratios.items()})
    return rows


def _errors(case: Case, trials: Sequence[Trial]) -> list[dict[str, Any]]:
    rows, stepped = [], [trial for trial in trials if trial.method.tolerance is None]
    for step in dict.fromkeys(trial.method.step for trial in stepped):
        row: dict[str, Any] = {"case": case.name, "limit": f"{case.limit:.2g} {case.unit}", "time step": step}
        found = {trial.method.integrator: trial for trial in stepped if trial.method.step == step}
        rows.append(row | {name: _cell(found[name]) if name in found else "" for name in INTEGRATORS})
    return rows


def _tolerances(case: Case, trials: Sequence[Trial]) -> dict[str, Any]:
    found = {trial.method.tolerance: trial for trial in trials}
    row: dict[str, Any] = {"case": case.name, "limit": f"{case.limit:.2g} {case.unit}"}
    for tolerance in TOLERANCES:
        trial = found.get(tolerance)
        row |= {
            f"{tolerance:g}": _cell(trial) if trial else "",
            f"CPU at {tolerance:g} [s/s]": f"{trial.cpu:.2g}" if trial else "",
        }
    return row


def _cell(trial: Trial) -> str:
    """The error and what is to be known of it; nothing more where it is right and nothing was said."""
    if trial.fault:
        return trial.verdict
    error = f"{trial.error:.2g}"
    return error if trial.verdict == RIGHT else f"{error} ({trial.verdict})"


def _trial(trial: Trial) -> dict[str, Any]:
    messages = (*trial.foretold, *trial.said, *([trial.fault] if trial.fault else []))
    return {
        "case": trial.case.name,
        "group": trial.case.group,
        "integrator": trial.method.name,
        "time step": trial.method.step,
        "error": None if trial.fault else trial.error,
        "estimated": trial.estimated,
        "unit": trial.case.unit,
        "limit": trial.case.limit,
        "CPU [s/s]": float(f"{trial.cpu:.3g}"),
        "verdict": trial.verdict,
        "said": messages[0] if messages else None,
    }
