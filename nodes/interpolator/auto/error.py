"""Measures how far the events of each method are from those of dense rendering, in a cut-out of the image, for the
probe."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from evis.events.measure.distance import EventStream, victor_purpura
from evis.runtime.clock import NS
from nodes.event_sensor.sensor import EventSensor
from nodes.interpolator.auto.setting import LIGHT, Grid, Renderers, Setting, Way, make_interpolator
from nodes.interpolator.auto.world import STEP_NS, World
from nodes.interpolator.keyframe import States
from nodes.interpolator.methods import reads

MARGIN = 12
"""Pixels about the cut-out that keyframes have, so that what enters is known as it is inside the whole image."""
ORIGIN = NS
"""Start of the windows' common time [ns], late enough that there is time before it."""


class Window:
    """Renders a cut-out of the image over a short time: dense frames, and the frames of each method.

    All windows have the stamps of one that starts at ORIGIN.
    """

    def __init__(self, s: Setting, world: World, start: int, cut: tuple[int, int, int, int]) -> None:
        """Cuts a window out of a setting. s: with bodies that are placed by their states alone (Setting.shifted). start
        [ns]; cut: left, top, width, height [px]."""
        left, top, width, height = cut
        k = np.array(s.camera.k, np.float64)
        k[0, 2] -= left
        k[1, 2] -= top
        self._camera = replace(s.camera, width=width, height=height, k=k)
        self._setting, self._world, self._start = s, world, start
        self._renderers = Renderers(s, self._camera, device=s.device, threads=s.threads, margin=MARGIN)

    def frame(self, step_ns: int, stamp: int) -> np.ndarray:
        """Renders the cut-out [1, h, w] at step_ns after the start. stamp: in the windows' common time [ns]."""
        image = self._render("none", self._poses(self._start + step_ns), None, {LIGHT}, stamp)[LIGHT]
        return image[:, MARGIN:-MARGIN, MARGIN:-MARGIN].copy()

    def warped(self, grid: Grid, method: str, rate: float, k: int) -> dict[int, np.ndarray]:
        """Makes the frames [1, h, w] of a method, by step of the reference. rate: keyframes [Hz]."""
        s, apart = self._setting, round(grid.base / rate)
        interpolator = make_interpolator(s, s.scene, self._camera, method, k)
        outputs = {LIGHT} | (reads(method) & {"depth", "motion"})
        margin = MARGIN * s.samples(method)
        frames: dict[int, np.ndarray] = {}
        for step in range(0, grid.gap + 1, apart):
            stamp, before = grid.stamp(ORIGIN, step), step - apart
            now, last = (self._poses(grid.stamp(self._start, n)) for n in (step, before))
            images = {n: v.copy() for n, v in self._render(method, now, last, outputs, stamp).items()}
            states = self._states(grid, before, step) if "state" in reads(method) else None
            t, out = interpolator.push(
                stamp, np.zeros(1, np.int32), images[LIGHT], images.get("depth"), images.get("motion"), margin,
                states=states,
            )  # fmt: skip
            for n in range(len(t)):
                frames[step - (len(t) - 1 - n) * (apart // k)] = out[:, n]
        return frames

    def _render(self, method: str, poses: np.ndarray, before: Any, outputs: set[str], stamp: int) -> dict[str, Any]:
        """Renders images, margin included."""
        return self._renderers.before(method).render(poses, before, outputs, {}, stamp)

    def _poses(self, time: int) -> np.ndarray:
        """Gives poses float64 [1, N, 7] at a time of the world [ns], clamped to its first and last moment."""
        return self._world.poses(min(max(time, 0), self._world.end_ns))

    def _states(self, grid: Grid, first: int, last: int) -> States:
        """Gives the states from one step to another, about every millisecond."""
        start, end = (grid.stamp(ORIGIN, step) for step in (first, last))
        t = np.linspace(start, end, 2 + (end - start) // STEP_NS).round().astype(np.int64)
        return States(t, *self._world.states_at(np.maximum(t - ORIGIN + self._start, 0)))


class Windows:
    """Holds all windows at once: one sensor sees their images below each other."""

    def __init__(self, s: Setting, world: World, starts: list[int], cuts: list[tuple[int, int, int, int]]) -> None:
        """Takes the windows' places. starts and cuts: of each window; cuts are of one size."""
        self._setting, shifted = s, s.shifted()
        self._windows = [Window(shifted, world, start, cut) for start, cut in zip(starts, cuts, strict=True)]
        self._size = cuts[0][2:]

    def seconds_per_step(self) -> float:
        """Measures how long a frame of all windows takes to render [s]; the first two are left out, as they compile
        kernels and place what stands still."""
        took = []
        for step in range(4):
            began = self._setting.clock()
            for window in self._windows:
                window.frame(step * STEP_NS, ORIGIN)
            took.append(self._setting.clock() - began)
        return min(took[2:])

    def draw(self, grid: Grid) -> None:
        """Renders the reference at the stamps of the grid."""
        self._grid = grid
        self._dense = {
            step: np.concatenate([w.frame(grid.stamp(0, step), grid.stamp(ORIGIN, step)) for w in self._windows])
            for step in range(grid.gap + 1)
        }
        self._truth = self._events(self._dense, 1)

    def errors(self, ways: list[Way]) -> list[float]:
        """Computes the spike-train distance to the reference of each way; all have one method and, unless dense, one
        keyframe rate."""
        method, rate, _ = ways[0]
        frames = self._dense
        if method != "none":
            most = max(k for _, _, k in ways)
            parts = [window.warped(self._grid, method, rate, most) for window in self._windows]
            frames = {step: np.concatenate([part[step] for part in parts]) for step in parts[0]}
        strides = [round(self._grid.base / (rate * k)) for _, rate, k in ways]
        return [victor_purpura(self._events(frames, stride), self._truth, 1.0) for stride in strides]

    def _events(self, frames: dict[int, np.ndarray], stride: int) -> EventStream:
        """Senses every stride-th frame."""
        steps = range(0, self._grid.gap + 1, stride)
        images = np.stack([frames[step] for step in steps], 1)
        t = np.array([self._grid.stamp(ORIGIN, step) for step in steps])
        envs, (width, height) = len(self._windows), self._size
        sensor = EventSensor(height, width, envs, **self._setting.sensor)
        parts = [sensor.process(images, t, np.zeros(envs, np.int32)), sensor.flush()]
        rows = [p.y + np.repeat(np.arange(envs) * height, np.diff(p.env_offsets)).astype(np.int64) for p in parts]
        t, x, p = (np.concatenate([getattr(part, name) for part in parts]) for name in "txp")
        return EventStream(t, x, np.concatenate(rows), p, width, envs * height)
