"""Draws z-buffers of the sub-frames between two keyframes in every way, and measures how long each takes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import warp as wp

from bench.visibility.forward import FOOTPRINTS, Forward
from evis.gpu.cuda_graph import CudaGraphs
from evis.runtime.clock import subframe_stamps
from evis.scene.model import Scene
from nodes.interpolator.auto.world import World
from nodes.interpolator.keyframe import States
from nodes.renderer.raster.visibility import Visibility


@dataclass
class Gap:
    """Holds one gap of a scene on a device, for both ways of drawing from the same poses.

    poses: float64 [K, N, 7], of keyframe B and then of the K - 1 sub-frames, as `rigid` has them. keyframes: z-buffer
    uint64 [1, H, W] and poses transformd [1, N] of A and B.
    """

    scene: Scene
    device: str
    stamps: np.ndarray
    poses: np.ndarray
    before: np.ndarray
    states: tuple[States, States]
    keyframes: list[tuple[wp.array, wp.array]]

    @staticmethod
    def of(world: World, rate: float, k: int, end_ns: int, device: str) -> Gap:
        """Makes the gap of 1 / rate seconds that ends at end_ns."""
        start = end_ns - round(1e9 / rate)
        stamps = subframe_stamps(start, end_ns, k)
        poses = np.concatenate([world.poses(int(t)) for t in (end_ns, *stamps[:-1])])
        one = Visibility(world.scene, world.scene.cameras[0], device=device, layered=False)
        keyframes = []
        for stamp in (start, end_ns):
            one.update(world.poses(stamp))
            keyframes.append((wp.clone(one.packed), wp.clone(one.poses)))
        states = States(*world.states(max(2 * start - end_ns, 0), start)), States(*world.states(start, end_ns))
        return Gap(world.scene, device, stamps, poses, world.poses(start), states, keyframes)


class Ways:
    """Draws the z-buffers of a gap's sub-frames in every way, and measures how long each takes."""

    def __init__(self, gap: Gap) -> None:
        g, k = self._gap, self._k = gap, len(gap.stamps)
        self.visibility = v = Visibility(g.scene, g.scene.cameras[0], k, device=g.device)
        self._frames = v.instance_poses(g.poses)
        self._graphs = CudaGraphs(v.device)
        self.draw: dict[str, Callable[[], wp.array]] = {"raster": self._raster}
        for footprint in FOOTPRINTS:
            forward = Forward(v, k, footprint)
            self.draw[f"keyframes, {footprint}"] = partial(self._move, footprint, forward)

    def seen(self, way: str) -> np.ndarray:
        """Draws z-buffers uint64 [K - 1, H, W] of the sub-frames."""
        return self.draw[way]().numpy()[1:]

    def milliseconds(self, repeats: int) -> dict[str, float]:
        """Measures the least time per slot [ms], all ways in turn."""
        times: dict[str, list[float]] = {way: [] for way in self.draw}
        for _ in range(repeats):
            for way, draw in self.draw.items():
                began = self._clock()
                draw()
                times[way].append(self._clock() - began)
        # The first ones compile and are recorded.
        return {way: 1e3 * min(spent[2:]) / self._k for way, spent in times.items()}

    def _clock(self) -> float:
        if self.visibility.device.is_cpu:
            return time.process_time()
        wp.synchronize_device(self.visibility.device)
        return time.perf_counter()

    def _raster(self) -> wp.array:
        v = self.visibility
        v.place(self._frames)
        self._graphs.run(("raster", v.still_moved), v.draw)
        v.drawn()
        return v.packed

    def _move(self, name: str, forward: Forward) -> wp.array:
        v = self.visibility
        v.place(self._frames)
        self._graphs.run(name, lambda: forward.draw(v.poses, self._gap.keyframes))
        return forward.packed
