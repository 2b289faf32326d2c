"""Measures whole runs on one device: speed, how busy the device is, time of the host, memory, first event.

    python -m bench.gpu_graph [--quick] [--rows WORD,...] [--json] [--out FILE] [--device cuda]

Every row is a run of `evis launch --compose --no-view` in a process of its own. Windows of some tenths of a second are
measured in it after its first gaps; afterwards all that a GPU does is recorded for some gaps (by CUPTI where PyTorch is
installed). Without a GPU it measures the CPU. --rows warehouse,60x4 takes the rows with these words in their names.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import warp as wp

from bench import command
from bench.interpolation.between import draw
from bench.roofline.plot import plot_roofline
from bench.throughput.attempts import Limits
from bench.throughput.cases import CASES
from bench.throughput.errors import RATE
from bench.throughput.sections import SECTIONS, Measurement
from evis.config.suggestions import nearest

COMMAND = "evis bench gpu_graph"


def measure(
    quick: bool = False,
    device: str = "auto",
    rows: Sequence[str] = (),
    sections: Sequence[str] = tuple(SECTIONS),
    timeout: float = 0.0,
    budget: float = 3600.0,
    add: Path | None = None,
) -> dict[str, Any]:
    """Measures the runs.

    Args:
        quick: fewer rows, one run of each.
        device: `auto` is a GPU where there is one, otherwise the CPU.
        rows: words of the rows that are wanted.
        sections: names of the tables that are wanted.
        timeout: seconds that a run may take, 0 = 60 (180 when not quick).
        budget: seconds after which no other run is begun.
        add: report of an earlier part of the measurement, whose rows are kept where none is measured now.
    """
    device = ("cuda" if wp.is_cuda_available() else "cpu") if device == "auto" else device
    before = None if add is None else _earlier(add, device)
    until = time.monotonic() + budget
    limits = Limits(timeout or (60.0 if quick else 180.0), until, *((1, 5, 0.25) if quick else (3, 3, 0.5)))
    made: dict[str, Any] = {}
    for name in sections:
        made |= SECTIONS[name](Measurement(device, rows, quick, limits))
    made = {key: section | {"command": COMMAND} for key, section in made.items() if section["rows"]}
    return made if before is None else with_rows_of(made, before)


def _earlier(report: Path, device: str) -> dict[str, Any]:
    """Reads the sections of an earlier part. Raises SystemExit, before anything is measured to be put beside them."""
    try:
        found: dict[str, Any] = json.loads(report.read_text())["subjects"]["gpu_graph"]
    except (OSError, ValueError) as error:
        raise SystemExit(f"--add {report}: {error}") from None
    except (KeyError, TypeError):
        raise SystemExit(f"--add {report}: it has no figures of gpu_graph; name a report of it") from None
    here = wp.get_device(device).name
    for section in found.values():
        if not section["title"].endswith(here):
            raise SystemExit(f"--add {report}: it is of '{section['title']}', and this device is {here}")
    return found


def with_rows_of(made: dict[str, Any], before: dict[str, Any]) -> dict[str, Any]:
    """Puts the rows of runs that only an earlier part has before those of this one; a run without figures counts not.

    Raises ValueError where the earlier part is of another device.
    """
    whole, order = dict(before), {case.name: i for i, case in enumerate(CASES)}
    for key, section in made.items():
        rows, old = section["rows"], before.get(key, {"rows": [], "title": section["title"]})
        if old["title"] != section["title"]:
            raise ValueError(f"the earlier report is of '{old['title']}', this one of '{section['title']}'")
        now = {row.get("run") for row in rows if not row.get("not measured")}
        kept = [row for row in old["rows"] if row.get("run") not in now and not row.get("not measured")]
        there = {row.get("run") for row in kept}
        both = kept + [row for row in rows if row.get("run") not in there]
        whole[key] = section | {"rows": sorted(both, key=lambda row: order.get(row.get("run"), 0))}
    return whole


def plot(sections: dict[str, Any], out: Path) -> list[Path]:
    """Writes roofline.png, where kernels were counted, and errors.png, where events were compared."""
    made = [plot_roofline(sections, out)] if "roofline" in sections else []
    if "errors" in sections:
        label = f"run time [ms per {1e3 / RATE:.0f} ms]"
        made.append(draw(sections["errors"]["rows"], "run time [ms]", label, out / "errors.png"))
    return made


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declares the options that choose rows and bound the time."""
    parser.add_argument(
        "--rows", type=_words, default=(), metavar="WORD,...", help="rows with one of these in their name"
    )
    parser.add_argument(
        "--sections", type=_sections, default=tuple(SECTIONS), metavar="NAME,...", help=f"of {', '.join(SECTIONS)}"
    )
    parser.add_argument("--timeout", type=float, default=0.0, metavar="S", help="seconds that one run may take")
    parser.add_argument("--budget", type=float, default=3600.0, metavar="S", help="seconds after which no run is begun")
    parser.add_argument(
        "--add", type=Path, metavar="FILE", help="report of an earlier part, to put its rows beside these"
    )


def _words(text: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in text.split(",") if word.strip())


def _sections(text: str) -> tuple[str, ...]:
    for name in _words(text):
        if name not in SECTIONS:
            raise argparse.ArgumentTypeError(f"no section '{name}'; {nearest(name, SECTIONS)}")
    return _words(text)


if __name__ == "__main__":
    command.run(measure, __doc__ or "", device="auto", options=add_options)
