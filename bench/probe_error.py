"""How far the events of each method are from those of dense rendering, in a cut-out of the image, for the probe."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from bench.metrics import Stream, victor_purpura
from bench.probe_setting import Grid, Setting, Way, make_renderer
from bench.world import World
from evis.clock import NS
from evis.geometry.interpolate import state_at
from nodes.event_sensor.sensor import EventSensor
from nodes.interpolator.interpolator import NEEDS, Interpolator
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

    def __init__(self, s: Setting, world: World, grid: Grid, starts: list[int], cut: tuple[int, int, int, int]) -> None:
        left, top, width, height = cut
        k = np.array(s.camera.k, np.float64)
        k[0, 2] -= left
        k[1, 2] -= top
        self._camera = replace(s.camera, width=width, height=height, k=k)
        self._setting = s = s.shifted()
        self._world, self._grid, self._starts = world, grid, starts
        self._steps = grid.gap
        self._how: dict[str, Any] = {"envs": len(starts), "device": s.device, "threads": s.threads}
        renderer = make_renderer(s, self._camera, "none", **self._how)
        self._dense = {}
        for step in range(self._steps + 1):
            images = renderer.render(self._poses(step), None, {"radiance"}, {}, grid.stamp(ORIGIN, step))
            self._dense[step] = luminance_of(images["radiance"], device_named(s.device)).numpy().copy()
        self._truth = self._events(self._dense, 1)
        self.error: dict[Way, float] = {}
        """Spike-train distance to the reference."""
        self.spent: dict[tuple[str, float], float] = {}
        """Seconds per sub-frame by method and keyframe rate."""

    def compare(self, ways: list[Way]) -> Iterator[str]:
        """Sets `error` of these ways, and `spent` of their methods and keyframe rates. Tells what comes next."""
        base = self._grid.base
        for method, rate in sorted({(m, r if m != "none" else 0.0) for m, r, _ in ways}):
            yield f"errors of {method}" + (f" at {rate:g} keyframes per second" if rate else "")
            own = [way for way in ways if way[0] == method and rate in (way[1], 0.0)]
            frames = self._warped(method, rate, max(k for _, _, k in own)) if rate else self._dense
            for way in own:
                stream = self._events(frames, round(base / (way[1] * way[2])))
                self.error[way] = victor_purpura(stream, self._truth, 1.0)

    def _warped(self, method: str, rate: float, k: int) -> dict[int, np.ndarray]:
        """Frames [E, h, w] of a method by step of the reference."""
        s, apart, envs = self._setting, round(self._grid.base / rate), len(self._starts)
        renderer = make_renderer(s, self._camera, method, margin=MARGIN, **self._how)
        interpolator = Interpolator(
            method,
            k,
            scene=s.scene,
            camera=self._camera,
            device=s.device,
            threads=s.threads,
            tolerance=s.tolerance,
            **s.light,
        )
        outputs = {"radiance"} | (NEEDS[method] & {"depth", "motion"})
        frames: dict[int, np.ndarray] = {}
        seconds, count = 0.0, 0
        # The method is made in the first gap, which is no part of a run's cost: where there is no other one, twice.
        rounds = 2 if apart == self._steps else 1
        for turn, step in ((n, step) for n in range(rounds) for step in range(0, self._steps + 1, apart)):
            stamp, before = self._grid.stamp(ORIGIN, step), step - apart
            given = renderer.render(self._poses(step), self._poses(before), outputs, {}, stamp)
            images = {n: v.copy() for n, v in given.items()}
            states = self._states(before, step) if "states" in NEEDS[method] else None
            began = s.clock()
            t, out = interpolator.push(
                stamp, np.full(envs, turn, np.int32), images["radiance"], images.get("depth"), images.get("motion"),
                MARGIN, states=states,
            )  # fmt: skip
            if step > apart or (step and turn):
                seconds += s.clock() - began
                count += len(t)
            for n in range(len(t)):
                frames[step - (len(t) - 1 - n) * (apart // k)] = out[:, n]
        self.spent[method, rate] = seconds / count
        return frames

    def _poses(self, step: int) -> np.ndarray:
        """Of all windows [E, N, 7]; before the run begins, its first ones."""
        times = (max(self._grid.stamp(start, step), 0) for start in self._starts)
        return np.concatenate([self._world.poses(t) for t in times])

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
        steps = range(0, self._steps + 1, stride)
        images = np.stack([frames[step] for step in steps], 1)
        t = np.array([self._grid.stamp(ORIGIN, step) for step in steps])
        envs, height, width = len(self._starts), self._camera.height, self._camera.width
        sensor = EventSensor(height, width, envs, **self._setting.sensor)
        parts = [sensor.process(images, t, np.zeros(envs, np.int32)), sensor.flush()]
        rows = [p.y + np.repeat(np.arange(envs) * height, np.diff(p.env_offsets)).astype(np.int64) for p in parts]
        t, x, p = (np.concatenate([getattr(part, name) for part in parts]) for name in "txp")
        return Stream(t, x, np.concatenate(rows), p, width, envs * height)
