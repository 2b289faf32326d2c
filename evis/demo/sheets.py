"""Makes contact sheets of the recipes for the documentation: `python -m evis.demo.sheets --out docs/recipes [RECIPE
...]`.

Of every recipe the first sequences are made and verified as a user would, and `evis dataset show` draws them. A table
of what that took goes to the standard output, as Markdown.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

MAX_BYTES = 290_000
"""A larger picture is reduced, in quality and then in size."""


def run(*words: object) -> dict[str, Any]:
    """Runs `evis dataset ... --json` and returns what it told. Raises RuntimeError with what it said otherwise."""
    command = [sys.executable, "-m", "evis", "dataset", *map(str, words), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command[2:])}: {(done.stderr or done.stdout).strip()}")
    told: dict[str, Any] = json.loads(done.stdout)
    return told


def cpu_seconds() -> float:
    """Returns the CPU time of all processes that have been waited for, those of their own among them [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def make_sheet(recipe: str, count: int, out: Path) -> str:
    """Writes OUT/RECIPE.jpg; returns the row of the table: length, CPU time, events and bytes of a sequence."""
    name = Path(recipe).stem
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / name
        before = cpu_seconds()
        made = run("make", recipe, "--count", count, "--out", folder)
        seconds = cpu_seconds() - before
        wrong = run("verify", folder)["wrong"]
        if wrong:
            raise RuntimeError(f"{recipe}: {wrong[0]}")
        size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
        duration = sum(entry["duration_s"] for entry in json.loads((folder / "dataset.json").read_text())["sequences"])
        run("show", folder)
        reduce(folder / "contact_sheet.png", out / f"{name}.jpg")
    return (
        f"| {name} | {duration / count:g} s | {seconds / count:.0f} s | {made['events'] / count / 1e6:.1f} M "
        f"| {size / count / 1e6:.0f} MB |"
    )


def reduce(source: Path, out: Path) -> None:
    """Writes a picture again as JPEG, of less quality and then smaller until it has at most MAX_BYTES."""
    from PIL import Image

    with Image.open(source) as file:
        picture = file.convert("RGB")
    quality, scale = 92, 1.0
    while True:
        size = (round(picture.width * scale), round(picture.height * scale))
        picture.resize(size, Image.Resampling.LANCZOS).save(out, "JPEG", quality=quality, subsampling=0, optimize=True)
        if out.stat().st_size <= MAX_BYTES:
            return
        quality, scale = (quality - 4, scale) if quality > 80 else (quality, 0.9 * scale)


def main() -> None:
    """Runs the command."""
    from evis.config.paths import names

    parser = argparse.ArgumentParser(prog="python -m evis.demo.sheets", description="Contact sheets of the recipes.")
    parser.add_argument("recipes", nargs="*", help="which recipes, all by default")
    parser.add_argument("--out", type=Path, default=Path("docs/recipes"), help="folder for the pictures")
    parser.add_argument("--count", type=int, default=4, help="sequences of each")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    print("| recipe | length | CPU time | events | size |\n|---|---|---|---|---|")
    for recipe in options.recipes or names("recipes"):
        print(make_sheet(recipe, options.count, options.out), flush=True)


if __name__ == "__main__":
    main()
