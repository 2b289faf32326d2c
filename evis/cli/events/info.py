"""Implements `evis events info`, which describes what a recording holds."""

from __future__ import annotations

import argparse
import sys
from typing import Any

from evis.cli.events.files import add_input, open_input
from evis.cli.events.progress import percent
from evis.events.stretches import Stretches
from evis.events.time_histogram import TimeHistogram

HELP = "what a recording holds; times as stored, in ns"
RATE_BINS, FIRST_BIN_NS = 64, 1000
_BARS = "▁▂▃▄▅▆▇█"
_PLAIN_BARS = "_.-:=+*#"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the action's arguments."""
    add_input(parser)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Reads a recording once and reports what it holds."""
    n = on = triggers = imu = frames = 0
    first: int | None = None
    last: int | None = None
    rate, stretches = TimeHistogram(RATE_BINS, FIRST_BIN_NS), Stretches()
    with open_input(args, args.recording) as recording, percent(recording, "reading") as step:
        for events in recording.blocks():
            if len(events):
                first = int(events.t[0]) if first is None else first
                last = int(events.t[-1])
            n, on, triggers = n + len(events), on + int(events.p.sum(dtype=int)), triggers + len(events.triggers)
            imu, frames = imu + len(events.imu), frames + len(events.frames)
            for _, t, _ in stretches.parts(events.t):
                rate.add(t)
            step()
        about, dropped = recording.info, recording.counters()
    anew = {"times_begun_anew": stretches.begun_anew} if stretches.begun_anew else {}
    return {
        "format": about.format, "encoding": about.encoding, "width": about.width, "height": about.height,
        "events": n, "t_first_ns": first, "t_last_ns": last, "on": on, "off": n - on, "triggers": triggers,
        "imu_samples": imu, "frames": frames,
        "rate_histogram": {"bin_ns": rate.bin_ns, "counts": rate.counts()},
        "geometry_from": about.geometry_from, "serial": about.serial, "sensor": about.sensor,
        "truncated": about.truncated, "warnings": about.warnings, **anew, **dropped,
    }  # fmt: skip


def for_people(result: dict[str, Any]) -> dict[str, Any]:
    """Draws the histogram as a line of bars."""
    result = dict(result)
    histogram = result.pop("rate_histogram")
    shown = {}
    for name, value in result.items():
        shown[name] = value
        if name == "frames":
            shown["rate"] = _bars(histogram["counts"], histogram["bin_ns"])
    return shown


def _bars(counts: list[int], bin_ns: int) -> str:
    if not counts:
        return ""
    try:
        _BARS.encode(sys.stdout.encoding or "ascii")
        bars = _BARS
    except (UnicodeEncodeError, LookupError):
        bars = _PLAIN_BARS
    most = max(counts)
    # a bin with any event is never as low as an empty one
    line = "".join(" " if not c else bars[min(len(bars) - 1, c * len(bars) // (most + 1))] for c in counts)
    return f"|{line}| at most {_engineering(most * 1e9 / bin_ns)}ev/s, a bar is {_engineering(bin_ns * 1e-9)}s"


def _engineering(value: float) -> str:
    for factor, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1, ""), (1e-3, "m"), (1e-6, "u")):
        if value >= factor:
            return f"{value / factor:.3g} {prefix}"
    return f"{value * 1e9:.3g} n"
