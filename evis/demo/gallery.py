"""Draws pictures of the scenes for the documentation: `python -m evis.demo.gallery --out docs/scenes [SCENE ...]`.

Every scene is run for a moment and its first camera recorded; the picture is a keyframe, tone-mapped, beside the events
of the last 4 ms. A table of what was measured goes to the standard output, as Markdown.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evis.media.colour import REC709

MAX_BYTES = 150_000
"""A larger picture is reduced to 256 colours."""


@dataclass
class Entry:
    """Holds a scene's row in the gallery's table.

    range_db: 20 log10 of the brightest over the darkest pixel that is not black.
    """

    name: str
    bodies: int
    triangles: int
    lights: int
    range_db: float
    event_rate: float
    """Events per second of the first camera."""
    seconds_to_load: float

    def row(self) -> str:
        """Writes the entry as a line of the Markdown table."""
        return (
            f"| {self.name} | {self.bodies} | {self.triangles:,} | {self.lights} | {self.range_db:.0f} dB "
            f"| {self.event_rate / 1e6:.1f} M/s | {self.seconds_to_load:.1f} s |"
        )


def light_range(radiance: np.ndarray) -> float:
    """Returns 20 log10 of the brightest over the darkest luminance above 0 [dB], of an image [..., 3]; 0 if black."""
    luminance = np.asarray(radiance, np.float64) @ np.array(REC709)
    lit = luminance[np.isfinite(luminance) & (luminance > 0)]
    return float(20 * np.log10(lit.max() / lit.min())) if len(lit) else 0.0


def record(scene: str, camera: str, seconds: float, bag: Path) -> None:
    """Runs a scene and records a camera's keyframes and events. Raises RuntimeError with what the run said."""
    command = [sys.executable, "-m", "evis", "launch", scene, "--duration", str(seconds), "--no-view"]
    command += ["--record", str(bag), "--record-topics", f"/{camera}/keyframe,/{camera}/events"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{scene}: {(done.stderr or done.stdout).strip()}")


def make_picture(scene: str, folder: Path, seconds: float = 0.4) -> Entry:
    """Writes folder/SCENE.png from a run of `seconds`, at seven eighths of it."""
    from PIL import Image

    from evis.bag.reader import BagReader
    from evis.demo.footage import from_bag
    from evis.media.pictures.footage import make_still
    from evis.scene import load_scene
    from msgs.camera import Keyframe

    start = time.perf_counter()
    world = load_scene(scene)
    loading = time.perf_counter() - start
    camera = world.cameras[0].name
    path = folder / f"{scene}.png"
    with tempfile.TemporaryDirectory() as temporary:
        bag = Path(temporary) / "run.mcap"
        record(scene, camera, seconds, bag)
        footage = from_bag(bag, camera)
        make_still(footage, path, at_ns=round(seconds * 0.875e9), scale=1)
        with BagReader(bag) as reader:
            ranges = [
                light_range(message.rgb[0])
                for _, message in reader.messages([f"/{camera}/keyframe"])
                if isinstance(message, Keyframe)
            ]
    if path.stat().st_size > MAX_BYTES:
        with Image.open(path) as picture:
            # The method that keeps a small thing's own colour; the default one takes an average.
            small = picture.convert("RGB").quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
        small.save(path, "PNG", optimize=True)
    triangles = sum(len(instance.mesh.faces) for instance in world.instances)
    rate = len(footage.t) / seconds
    return Entry(scene, len(world.bodies), triangles, len(world.lights), max(ranges), rate, loading)


def main() -> None:
    """Runs the command."""
    from evis.config.paths import names

    parser = argparse.ArgumentParser(prog="python -m evis.demo.gallery", description="Pictures of the scenes.")
    parser.add_argument("scenes", nargs="*", help="which scenes, all by default")
    parser.add_argument("--out", type=Path, default=Path("docs/scenes"), help="folder for the pictures")
    parser.add_argument("--duration", type=float, default=0.4, help="how long each scene runs [s]")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    print("| scene | bodies | triangles | lights | range of light | events | load |\n|---|---|---|---|---|---|---|")
    for scene in options.scenes or names("scenes"):
        print(make_picture(scene, options.out, options.duration).row(), flush=True)


if __name__ == "__main__":
    main()
