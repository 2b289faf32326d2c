"""Measures run times with path tracing, where shading is dear, beside a prediction from the number of shaded pixels."""

from __future__ import annotations

from typing import Any

from bench.interpolation.pipeline import Run, simulate, visibility_seconds
from evis.runtime.clock import NS
from evis.scene import load_scene
from nodes.interpolator.auto.world import World
from nodes.renderer.paths.paths import PathOptions

SCENE = "drone"
SIZE = {"width": 173, "height": 130}
DURATION_NS = 64_000_000
WAYS = (("none", 250.0, 1), ("splat", 125.0, 8), ("rigid", 31.25, 16), ("rigid", 62.5, 16))
PATHS = PathOptions(bounces=1, samples=4)


def rows() -> list[dict[str, Any]]:
    """Measures run times [s per simulated s] of a few methods with and without paths."""
    world = World(load_scene(SCENE, SIZE), DURATION_NS)
    pixels = SIZE["width"] * SIZE["height"]
    runs: list[dict[tuple[str, float, int], Run]] = []
    shading_s = []
    for light in ({}, {"paths": PATHS}):
        found = {way: simulate(world, *way, DURATION_NS, light=light) for way in WAYS}
        dense = found[WAYS[0]]
        keyframes = dense.shaded / pixels
        seen = visibility_seconds(world, WAYS[0][1], DURATION_NS)
        shading_s.append((dense.render_s / keyframes - seen) / pixels)
        runs.append(found)
    lines = []
    for way in WAYS:
        method, rate, k = way
        plain, traced = (found[way] for found in runs)
        seconds = [run.seconds("linear") * NS / DURATION_NS for run in (plain, traced)]
        follows = seconds[0] + plain.shaded * (shading_s[1] - shading_s[0]) * NS / DURATION_NS
        lines.append({
            "method": "dense" if method == "none" else method,
            "keyframes x K": f"{rate:g}x{k}",
            "without paths [s/s]": round(seconds[0], 2),
            "follows [s/s]": round(follows, 2),
            "measured [s/s]": round(seconds[1], 2),
            "shading [us/px]": f"{shading_s[0] * 1e6:.2f} -> {shading_s[1] * 1e6:.2f}",
            "shaded anew [%]": " -> ".join(f"{100 * r.reshaded / max(r.samples, 1):.1f}" for r in (plain, traced)),
        })  # fmt: skip
    return lines
