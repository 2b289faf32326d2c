"""How far the events of each method are from those of dense rendering, in a cut-out of the image, for the probe."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from bench.metrics import Stream, victor_purpura
from bench.probe_setting import Grid, Setting, Way, make_interpolator, make_renderer
from bench.world import World
from evis.clock import NS
from evis.geometry.interpolate import state_at
from nodes.event_sensor.sensor import EventSensor
from nodes.interpolator.interpolator import NEEDS
from nodes.interpolator.keyframe import States, device_named
from nodes.interpolator.luminance import luminance_of

MARGIN = 12
"""Pixels about the cut-out that keyframes have, so that what enters is known as it is inside the whole image."""
ORIGIN = NS
"""Start of the windows' common time [ns], late enough that there is time before it."""
SUBSTEP_NS = 1_000_000


class Windows:
    """A cut-out of the image over several short times at once: dense frames, and what each method makes.

    Each window is an environment; all have the stamps of a window that starts at ORIGIN.
    """

    def __init__(self, s: Setting, world: World, starts: list[int], cut: tuple[int, int, int, int]) -> None:
        left, top, width, height = cut
        k = np.array(s.camera.k, np.float64)
        k[0, 2] -= left
        k[1, 2] -= top
        self._camera = replace(s.camera, width=width, height=height, k=k)
        self._setting = s.shifted()
        self._world, self._starts = world, starts
        self._how: dict[str, Any] = {"envs": len(starts), "device": s.device, "threads": s.threads}
        self._renderers: dict[bool, Any] = {}

    def seconds_per_step(self) -> float:
        """What a frame of all windows takes to render; the first two compile and place what stands still."""
        took = []
        for step in range(4):
            began = self._setting.clock()
            self._render("none", [start + step * SUBSTEP_NS for start in self._starts], None, {"radiance"}, ORIGIN)
            took.append(self._setting.clock() - began)
        return min(took[2:])

    def draw(self, grid: Grid) -> None:
        """The reference, at the stamps of the grid."""
        self._grid = grid
        self._dense = {}
        for step in range(grid.gap + 1):
            images = self._render("none", self._times(step), None, {"radiance"}, grid.stamp(ORIGIN, step))
            whole = luminance_of(images["radiance"], device_named(self._setting.device)).numpy()
            self._dense[step] = whole[:, MARGIN:-MARGIN, MARGIN:-MARGIN].copy()
        self._truth = self._events(self._dense, 1)

    def errors(self, ways: list[Way]) -> list[float]:
        """Spike-train distances to the reference of ways with one method and, unless dense, one keyframe rate."""
        method, rate, _ = ways[0]
        frames = self._dense if method == "none" else self._warped(method, rate, max(k for _, _, k in ways))
        strides = [round(self._grid.base / (rate * k)) for _, rate, k in ways]
        return [victor_purpura(self._events(frames, stride), self._truth, 1.0) for stride in strides]

    def _warped(self, method: str, rate: float, k: int) -> dict[int, np.ndarray]:
        """Frames [E, h, w] of a method by step of the reference."""
        s, apart, envs = self._setting, round(self._grid.base / rate), len(self._starts)
        interpolator = make_interpolator(s, s.scene, self._camera, method, k)
        outputs = {"radiance"} | (NEEDS[method] & {"depth", "motion"})
        margin = MARGIN * (s.camera.supersampling if method == "rigid" else 1)
        frames: dict[int, np.ndarray] = {}
        for step in range(0, self._grid.gap + 1, apart):
            stamp, before = self._grid.stamp(ORIGIN, step), step - apart
            given = self._render(method, self._times(step), self._poses(self._times(before)), outputs, stamp)
            images = {n: v.copy() for n, v in given.items()}
            states = self._states(before, step) if "states" in NEEDS[method] else None
            t, out = interpolator.push(
                stamp, np.zeros(envs, np.int32), images["radiance"], images.get("depth"), images.get("motion"),
                margin, states=states,
            )  # fmt: skip
            for n in range(len(t)):
                frames[step - (len(t) - 1 - n) * (apart // k)] = out[:, n]
        return frames

    def _render(self, method: str, times: list[int], before: Any, outputs: set[str], stamp: int) -> dict[str, Any]:
        """Images of all windows at their own times [ns], margin included. stamp: of the windows' common time."""
        s = self._setting
        apart = method == "rigid" and s.camera.supersampling > 1
        if apart not in self._renderers:
            self._renderers[apart] = make_renderer(s, self._camera, method, margin=MARGIN, **self._how)
        return self._renderers[apart].render(self._poses(times), before, outputs, {}, stamp)

    def _times(self, step: int) -> list[int]:
        """Of all windows at a step of the reference; before the run begins, its first one [ns]."""
        return [max(self._grid.stamp(start, step), 0) for start in self._starts]

    def _poses(self, times: list[int]) -> np.ndarray:
        """Of all windows, float64 [E, N, 7]."""
        last = int(self._world.t[-1])
        return np.concatenate([self._world.poses(min(t, last)) for t in times])

    def _states(self, first: int, last: int) -> States:
        """Of all windows from one step to another, every millisecond or so."""
        start, end = (self._grid.stamp(ORIGIN, step) for step in (first, last))
        t = np.linspace(start, end, 2 + (end - start) // SUBSTEP_NS).round().astype(np.int64)
        found = []
        for window in self._starts:
            found.append(
                state_at(np.maximum(t - ORIGIN + window, 0), self._world.t, self._world.pose, self._world.twist)
            )
        return States(t, *(np.concatenate(parts) for parts in zip(*found)))

    def _events(self, frames: dict[int, np.ndarray], stride: int) -> Stream:
        """What the sensors make of every stride-th frame; the windows' images below each other."""
        steps = range(0, self._grid.gap + 1, stride)
        images = np.stack([frames[step] for step in steps], 1)
        t = np.array([self._grid.stamp(ORIGIN, step) for step in steps])
        envs, height, width = len(self._starts), self._camera.height, self._camera.width
        sensor = EventSensor(height, width, envs, **self._setting.sensor)
        parts = [sensor.process(images, t, np.zeros(envs, np.int32)), sensor.flush()]
        rows = [p.y + np.repeat(np.arange(envs) * height, np.diff(p.env_offsets)).astype(np.int64) for p in parts]
        t, x, p = (np.concatenate([getattr(part, name) for part in parts]) for name in "txp")
        return Stream(t, x, np.concatenate(rows), p, width, envs * height)
