"""Compares what sub-frames see by the raster and from keyframes' depth and ids: time, wrong pixels, errors.

    evis bench visibility [--quick]
    python -m bench.visibility.subframes --device cuda

Gaps of four scenes. The raster is what `rigid` uses. The other way moves every pixel of both keyframes with its body
to the sub-frame, exactly, and keeps the nearest point in every pixel: a point covers one pixel, 3x3, or those of 3x3
that no point falls on. Time is per sub-frame, all of a gap at once, the least of several runs in turn: CPU time of
one thread, or wall time of a GPU, whose launches are recorded as a graph. Poses are brought to the device by both.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from bench import command
from bench.interpolation.pipeline import THRESHOLD
from bench.visibility.forward import FOOTPRINTS, Forward
from bench.visibility.gap import Gap, Ways
from bench.visibility.kernels import HOLE
from evis.events.measure.distance import log_error
from evis.scene import load_scene
from nodes.interpolator.auto.world import World
from nodes.interpolator.keyframe import KeyframeView
from nodes.interpolator.luminance import luminance_of
from nodes.interpolator.rigid import Rigid, RigidOptions
from nodes.interpolator.rigid.look_up.look_up_kernels import SAME_POINT
from nodes.renderer.raster.entries import triangles_of
from nodes.renderer.renderer import Renderer

SCENES: dict[str, dict[str, object]] = {
    "spinning_disk": {"omega": 50.0},
    "falling_objects": {},
    "drone": {},
    "warehouse": {},
}
RATES = ((250.0, 4), (125.0, 8), (62.5, 16), (31.25, 32))
"""Keyframe rates [Hz] and K of 1000 frames per second; at 1000 x 1 there is nothing between keyframes."""
QUICK = RATES[1:2]
SIZE = {"cpu": (240, 180), "cuda": (640, 480)}
ENDS_NS = (256_000_000, 480_000_000)
"""Where the gaps end: things fall, and things collide."""
COMMAND = "evis bench visibility"


def compared(seen: np.ndarray, exact: np.ndarray, instance: np.ndarray) -> dict[str, float]:
    """Compares z-buffers uint64 [P, H, W] with those of the raster.

    As shares of pixels: holes; wrong instance (the sky is one); of the others that are no sky, depth off by more than
    `rigid` takes for the same point. And the median of that error. instance: of each triangle.
    """
    ids = np.append(instance, -1)
    hole = seen == np.uint64(HOLE)
    if not hole.any() or (exact[hole] == np.uint64(HOLE)).all():
        hole[...] = False
    mine, true = (ids[triangles_of(packed)] for packed in (seen, exact))
    wrong = (mine != true) & ~hole
    right = (mine == true) & ~hole & (true >= 0)
    far = [
        (p[right] >> np.uint64(32) & np.uint64(0x7FFFFFFF)).astype(np.uint32).view(np.float32) for p in (seen, exact)
    ]
    off = np.abs(far[0].astype(np.float64) / far[1] - 1)
    return {
        "holes": float(hole.mean()),
        "wrong instance": float(wrong.mean()),
        "depth off": float((off > float(SAME_POINT)).mean()) if off.size else 0.0,
        "median": float(np.median(off)) if off.size else 0.0,
    }


class Instead:
    """Draws the sub-frames of a `Rigid` from keyframes in place of its raster; holes are filled from that."""

    def __init__(self, rigid: Rigid, gap: Gap, footprint: str) -> None:
        v = self._v = rigid.visibility
        assert v.envs == len(gap.stamps), "the gap must be one portion"
        self._exact, self._keyframes = v.draw, gap.keyframes
        self._forward = Forward(v, v.envs, footprint)

    def __call__(self, placed: Callable[[], None] = lambda: None) -> None:
        """In place of Visibility.draw; the first slot is B itself."""
        v, made = self._v, self._forward
        self._exact(placed)
        made.draw(v.poses, self._keyframes)
        made.settle(v.packed)
        wp.copy(v.packed[1:], made.packed[1:])


def frame_errors(gap: Gap) -> dict[str, tuple[float, float]]:
    """Measures sub-frames of `rigid` by footprint, "" being the raster.

    Root mean square of ln I against dense rendering, in thresholds, and the share of pixels that it shades anew.
    """
    scene, camera, k = gap.scene, gap.scene.cameras[0], len(gap.stamps)
    renderer = Renderer(scene, camera, device=gap.device)

    def image(poses: np.ndarray, stamp: int) -> wp.array:
        return wp.clone(luminance_of(renderer.render(poses, None, {"radiance"}, {}, stamp)["radiance"], gap.device))

    start = int(2 * gap.stamps[0] - gap.stamps[1])
    dense = np.concatenate([image(p[None], int(t)).numpy() for p, t in zip(gap.poses[1:], gap.stamps)])
    ends = ((gap.before, start), (gap.poses[:1], int(gap.stamps[-1])))
    a, b = (KeyframeView(image(*end), states=states, stamp_ns=end[1]) for end, states in zip(ends, gap.states))
    found = {}
    for footprint in ("", *FOOTPRINTS):
        rigid = Rigid(scene, camera, 1, k, device=gap.device, options=RigidOptions(on_device=True))
        if footprint:
            rigid.visibility.draw = Instead(rigid, gap, footprint)  # type: ignore[method-assign]
        out = np.empty((1, k, camera.height, camera.width), np.float32)
        report = rigid.between(a, b, [False], out)
        found[footprint] = log_error(out[0, :-1], dense, THRESHOLD), report.reshaded / report.samples
    return found


def rows(name: str, rates: tuple[tuple[float, int], ...], device: str, repeats: int) -> list[dict[str, Any]]:
    """Measures a scene: a row per rate and way, means over its gaps."""
    width, height = SIZE[device.partition(":")[0]]
    scene = load_scene(name, {**SCENES[name], "width": width, "height": height})
    world = World(scene, max(ENDS_NS))
    lines = []
    for rate, k in rates:
        found: dict[str, list[dict[str, float]]] = {}
        for end_ns in ENDS_NS:
            gap = Gap.of(world, rate, k, end_ns, device)
            ways = Ways(gap)
            seen = {way: ways.seen(way).copy() for way in ways.draw}
            spent, errors = ways.milliseconds(repeats), frame_errors(gap)
            for way in ways.draw:
                one = compared(seen[way], seen["raster"], ways.visibility.geometry.triangle_instance)
                frames, reshaded = errors.get(way.partition(", ")[2], (np.nan, np.nan))
                one |= {"ms": spent[way], "frames": frames, "reshaded": reshaded}
                found.setdefault(way, []).append(one)
        for way, gaps in found.items():
            mean = {key: float(np.mean([one[key] for one in gaps])) for key in gaps[0]}
            least = float(np.mean([one["ms"] for one in found["raster"]]))
            lines.append({
                "scene": name,
                "keyframes x K": f"{rate:g}x{k}",
                "seen by": way,
                "ms per sub-frame": round(mean["ms"], 4),
                "of the raster's": round(mean["ms"] / least, 2),
                "wrong instance [%]": round(100 * mean["wrong instance"], 3),
                "holes [%]": round(100 * mean["holes"], 3),
                "depth off by 0.3 % [%]": round(100 * mean["depth off"], 2),
                "depth error, median [%]": round(100 * mean["median"], 4),
            })  # fmt: skip
            if not np.isnan(mean["frames"]):
                lines[-1]["frames, ln I / C"] = round(mean["frames"], 3)
                lines[-1]["shaded anew [%]"] = round(100 * mean["reshaded"], 2)
    return lines


def measure(quick: bool = False, device: str = "cpu") -> dict[str, Any]:
    """Measures the table."""
    size = "x".join(map(str, SIZE[device.partition(":")[0]]))
    rates, repeats = (QUICK, 6) if quick else (RATES, 10)
    return {
        "visibility": {
            "title": f"What sub-frames see, by the raster and from keyframes, {size}, {wp.get_device(device).name}",
            "command": COMMAND,
            "rows": [line for name in SCENES for line in rows(name, rates, device, repeats)],
            "note": "Pixels of sub-frames, beside the raster's. depth off: of those with the right instance. frames: "
            "root mean square of `rigid`'s sub-frames against dense rendering, every pixel looked up; holes are filled "
            "as the raster has them, as if a ray were cast for each at no cost. shaded anew: by `rigid`, for no "
            "keyframe shows the point that it is told of.",
        }
    }


if __name__ == "__main__":
    command.run(measure, __doc__ or "", device="cpu")
