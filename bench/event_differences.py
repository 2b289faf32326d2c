"""Compares two files of bench/event_hashes.py, and measures by how much events differ where these were kept."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from evis.events.measure.distance import EventStream, count_error


def file_of(name: str) -> str:
    """Gives the name of the file that holds a row's events."""
    return name.replace("/", "-") + ".npz"


def differences(old: Path, new: Path, scenes: Sequence[str]) -> Iterator[tuple[str, str, str]]:
    """Compares every row of these scenes in two files: yields (row, `equal`, `different` or `missing`, remark).

    Raises ValueError where the two are not of the same size, duration and seed.
    """
    files = [json.loads(path.read_text()) for path in (old, new)]
    for key in ("size", "duration_s", "seed"):
        values = [file["about"][key] for file in files]
        if values[0] != values[1]:
            raise ValueError(f"{old} has {key} {values[0]}, {new} has {values[1]}: they cannot be compared")
    rows = [{name: row for name, row in f["cases"].items() if name.split("/")[0] in scenes} for f in files]
    for name in sorted(rows[0].keys() | rows[1].keys()):
        if not all(name in part for part in rows):
            yield name, "missing", f"only in {old if name in rows[0] else new}"
            continue
        pair = [part[name] for part in rows]
        if pair[0]["sha256"] == pair[1]["sha256"]:
            yield name, "equal", f"{pair[0]['events']:,} events"
        else:
            yield name, "different", _text(pair, [_kept(p, f, name) for p, f in zip((old, new), files)])


def _kept(file: Path, content: dict[str, Any], name: str) -> dict[str, np.ndarray] | None:
    """The events of a row, if they were kept."""
    path = file.parent / (content["events"] or "") / file_of(name)
    if not content["events"] or not path.is_file():
        return None
    with np.load(path) as arrays:
        return {key: arrays[key] for key in arrays.files}


def _text(rows: list[dict[str, Any]], kept: list[dict[str, np.ndarray] | None]) -> str:
    """Counts, and how far the times are apart where every pixel has the same events."""
    before, after = (row["events"] for row in rows)
    share = f" ({after / before - 1:+.4%})" if before and after != before else ""
    text = f"{before:,} -> {after:,} events{share}"
    for sign in ("on", "off"):
        if rows[0].get(sign) != rows[1].get(sign):
            text += f", {sign} {rows[0].get(sign, 0):,} -> {rows[1].get(sign, 0):,}"
    columns = rows[0]["sha256"].keys() | rows[1]["sha256"].keys()
    text += f", columns {' '.join(c for c in 'txypc' if c in columns and _differs(rows, c))} differ"
    if kept[0] is None or kept[1] is None:
        return text + "; times unknown (run both with --events)"
    return text + "; " + sized(kept[0], kept[1])


def _differs(rows: list[dict[str, Any]], column: str) -> bool:
    return rows[0]["sha256"].get(column) != rows[1]["sha256"].get(column)


def sized(before: dict[str, np.ndarray], after: dict[str, np.ndarray]) -> str:
    """Says what differs between the events of two runs: the times, or the number of events by pixel."""
    if not before or not after or not len(before["t"]) or not len(after["t"]):
        return "one has no events"
    width, height = (1 + max(int(a[axis].max()) for a in (before, after)) for axis in "xy")
    streams = [EventStream(a["t"], a["x"], a["y"], a["p"], width, height) for a in (before, after)]
    (t_before, n_before), (t_after, n_after) = (s.trains() for s in streams)
    if not np.array_equal(n_before, n_after):
        return f"{count_error(streams[1], streams[0]):.4%} of the events have no partner in their pixel and polarity"
    apart = np.abs(t_after - t_before)
    moved = f"{np.count_nonzero(apart):,} times differ, by up to {int(apart.max()):,} ns"
    same_order = all(np.array_equal(before[axis], after[axis]) for axis in "xyp")
    return f"every pixel has the same events, {moved}" + ("" if same_order else ", and so does their order")
