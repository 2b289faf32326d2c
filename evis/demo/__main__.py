"""Makes a spinning disk's bag, animation, picture and summary: `python -m evis.demo --out demo`.

With VIEW=1 in the environment the disk then goes on, with its live page, until Ctrl-C.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from evis.console.printable import printable

SCENE = "spinning_disk"
DURATION_S = 1.0
SHOWN_MS = (100.0, 400.0)
"""Part of the run that the animation shows: more than two turns of the disk."""
LAUNCH = [sys.executable, "-m", "evis", "launch", SCENE]


class LaunchFailed(Exception):
    """Reports that the graph did not run; the launcher has said why."""


def simulate(bag: Path, duration_s: float) -> dict[str, Any]:
    """Runs the scene into a bag, and returns the run's summary. Raises LaunchFailed."""
    words = [
        "--duration",
        str(duration_s),
        "--record",
        str(bag),
        "--record-topics",
        "/cam0/keyframe",
        "--no-view",
        "--json",
    ]
    done = subprocess.run([*LAUNCH, *words], stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode != 0:
        raise LaunchFailed
    return json.loads(done.stdout.splitlines()[-1])


def draw(bag: Path, animation: Path, still: Path) -> None:
    """Draws the animation and the picture of a bag."""
    from evis.demo.footage import from_bag
    from evis.media.pictures.footage import make_animation, make_still

    footage = from_bag(bag)
    first, last = footage.span_ns
    start, end = (first + round(ms * 1e6) for ms in SHOWN_MS)
    if end > last:
        start, end = first, last
    make_animation(footage, animation, from_ns=start, to_ns=end)
    make_still(footage, still, at_ns=end)


def summary(report: dict[str, Any], files: Sequence[Path]) -> str:
    """Writes what the demo prints."""
    rate = report["events"] / report["sim_s"] if report["sim_s"] else 0.0
    lines = [
        f"{report['sim_s']:g} s simulated in {report['wall_s']:.2f} s: {report['rtf']:.2f} times real time "
        f"(start-up {report['startup_s']:.1f} s, once)",
        f"{report['events']:,} events, {rate / 1e6:.2f} million per second; {report['keyframes']} keyframes, "
        f"{report['frames']} frames, {report['drops']} drops",
        "",
        "left out, because nothing here needs it:",
        *(f"  {item['what']}: {item['why']}" for item in report["left_out"]),
        "",
        "made:",
        *(f"  {path}  {path.stat().st_size / 1e6:.1f} MB" for path in files),
    ]
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    """Makes the demonstration. Exit status 0, or 1 with one line on stderr."""
    parser = argparse.ArgumentParser(prog="python -m evis.demo", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("demo"), metavar="DIR", help="folder for the files (demo)")
    parser.add_argument("--duration", type=float, default=DURATION_S, metavar="S", help="simulated time (1)")
    args = parser.parse_args(argv)
    files = [args.out / f"{SCENE}{ending}" for ending in (".mcap", ".gif", ".png")]
    try:
        args.out.mkdir(parents=True, exist_ok=True)
        print(f"simulating {args.duration:g} s of a {SCENE.replace('_', ' ')} (kernels are compiled the first time)")
        report = simulate(files[0], args.duration)
        draw(*files)
        (args.out / "summary.json").write_text(json.dumps(report, indent=1) + "\n")
        print(summary(report, [*files, args.out / "summary.json"]))
    except LaunchFailed:
        return 1
    except (OSError, ValueError) as error:
        print(f"evis.demo: {printable(error)}", file=sys.stderr)
        return 1
    if os.environ.get("VIEW", "") in ("", "0"):
        print("\n`evis launch spinning_disk`, or `VIEW=1 make demo` in a checkout, shows it live in a browser.")
        return 0
    print("\nthe disk goes on until Ctrl-C; open the address below in a browser", flush=True)
    try:
        return subprocess.run(LAUNCH, check=False).returncode
    except KeyboardInterrupt:
        return 0


if __name__ == "__main__":
    sys.exit(main())
