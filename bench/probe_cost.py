"""What keyframes, sub-frames and the sensor cost at the true size, for the probe."""

from __future__ import annotations

from typing import Any

import numpy as np

from bench.probe_setting import METHODS, Setting, make_renderer
from bench.world import World
from evis.clock import NS
from nodes.event_sensor.sensor import EventSensor
from nodes.interpolator.interpolator import NEEDS, Interpolator
from nodes.interpolator.keyframe import States, device_named
from nodes.interpolator.luminance import luminance_of

CUT = (80, 60)
"""Width and height of the cut-out [px]."""
GAP_FRAMES = 8
"""K of the gap that is measured at the full size."""
MIDDLE_RATE = 62.5
"""Its keyframe rate [Hz]."""


class FullSize:
    """What keyframes, sub-frames and the sensor's frames cost at the true size, and where in the image events are."""

    def __init__(self, setting: Setting, world: World, starts: list[int], length: int) -> None:
        self._setting, self._world, self._starts, self._length = setting, world, starts, length
        s = setting
        self._how = {"envs": s.envs, "margin": s.margin, "device": s.device, "threads": s.threads}
        self._changes: list[np.ndarray] = []

    def measure(self) -> dict[str, float]:
        """Seconds: `key` METHOD per keyframe and environment, `frame` METHOD per sub-frame, `sense` per frame, and
        `events` per simulated second."""
        s = self._setting
        costs: dict[str, float] = {}
        pairs: list[np.ndarray] = []
        m = s.margin
        inner = (..., slice(m, m + s.camera.height), slice(m, m + s.camera.width))
        for method in METHODS:
            # Keyframes of `rigid` are those of dense rendering unless it averages their samples itself.
            alike = method == "rigid" and s.camera.supersampling == 1
            if method == "none" or s.camera.supersampling > 1:
                renderer = make_renderer(s, s.camera, method, **self._how)
            outputs = {"radiance"} | (NEEDS[method] & {"depth", "motion"})
            renderer.prepare(outputs)
            took = []
            for start in self._starts if method == "none" else self._starts[: 0 if alike else 1]:
                times = []
                for stamp in (start, start + NS // 1000, start + NS // 500):
                    began = s.clock()
                    images = renderer.render(self._poses(stamp), self._poses(start), outputs, {}, stamp)
                    times.append(s.clock() - began)
                    if method == "none" and len(times) < 3:
                        pairs.append(luminance_of(images["radiance"].copy(), device_named(s.device)).numpy()[inner])
                # The first drawing compiles and places what stands still.
                took.append(min(times[1:]))
            costs["key " + method] = costs["key none"] if alike else float(np.mean(took)) / s.envs
            if method == "none":
                costs |= self._sensor(pairs)
            else:
                costs["frame " + method] = self._gap(method, renderer, outputs)
        return costs

    def _sensor(self, frames: list[np.ndarray]) -> dict[str, float]:
        """Cost of a frame in which nothing happens, and of the events per simulated second."""
        s = self._setting
        sensor = EventSensor(s.camera.height, s.camera.width, s.envs, device=s.device, **s.sensor)
        episodes = np.zeros(s.envs, np.int32)
        still: list[float] = []
        busy: list[float] = []
        stamp = 0
        for n, (before, after) in enumerate(zip(frames[::2], frames[1::2], strict=True)):
            with np.errstate(divide="ignore", invalid="ignore"):
                change = np.abs(np.log(after[0]) - np.log(before[0]))
            self._changes.append(np.nan_to_num(change, nan=0.0, posinf=0.0))
            # There and back: the first time, memory for the events is found.
            changing: list[float] = []
            for k, frame in enumerate((before, before, after, before, after, before)):
                given = np.repeat(frame[:, None], 2, 1)
                t = np.array([stamp + NS // 1000, stamp + NS // 500])
                began = s.clock()
                sensor.process(given, t, episodes + n)
                took = s.clock() - began
                stamp = int(t[-1])
                (changing if k > 1 else still).append(took)
            busy.append(min(changing[1:]))
        quiet = float(np.min(still)) / 2 / s.envs
        # A millisecond's events, and two frames.
        events = max(float(np.mean(busy)) / s.envs - 2 * quiet, 0.0)
        return {"sense": quiet, "events": events * 1000}

    def _gap(self, method: str, renderer: Any, outputs: set[str]) -> float:
        """Seconds per sub-frame of a gap, the gap's own share included; the least of two after the first."""
        s = self._setting
        gap = min(round(NS / MIDDLE_RATE), self._length)
        interpolator = Interpolator(
            method,
            GAP_FRAMES,
            scene=s.shifted().scene,
            camera=s.camera,
            device=s.device,
            threads=s.threads,
            tolerance=s.tolerance,
            **s.light,
        )
        took = []
        start = self._starts[len(self._starts) // 2]
        previous = None
        for n in range(4):
            # There and back and there again, for the run may be no longer than one gap.
            before, now = start + gap * ((n - 1) % 2 if n else 0), start + gap * (n % 2)
            poses = self._poses(now)
            images = {k: v.copy() for k, v in renderer.render(poses, previous, outputs, {}, now).items()}
            states = self._states(method, before, now, n * gap)
            began = s.clock()
            interpolator.push(
                n * gap, np.zeros(s.envs, np.int32), images["radiance"], images.get("depth"), images.get("motion"),
                s.margin, states=states,
            )  # fmt: skip
            if n > 1:
                took.append(s.clock() - began)
            previous = poses
        return min(took) / GAP_FRAMES / s.envs

    def _states(self, method: str, before: int, now: int, stamp: int) -> States | None:
        if "states" not in NEEDS[method]:
            return None
        t, pose, twist = self._world.states(min(before, now), max(before, now))
        if now < before:
            t, pose, twist = (before + now - t)[::-1], pose[:, ::-1], -twist[:, ::-1]
        pose, twist = (np.repeat(a, self._setting.envs, 0) for a in (pose, twist))
        return States(t - min(before, now) + stamp - (t[-1] - t[0]), pose, twist)

    def _poses(self, stamp: int) -> np.ndarray:
        return np.repeat(self._world.poses(min(stamp, int(self._world.t[-1]))), self._setting.envs, 0)

    def cut(self) -> tuple[int, int, int, int]:
        """Left, top, width and height of the cut-out: half of all change is above its middle, half left of it."""
        change = np.sum(self._changes, axis=0)
        height, width = change.shape
        w, h = min(CUT[0], width), min(CUT[1], height)
        found = []
        for axis, n, size in ((0, w, width), (1, h, height)):
            total = np.cumsum(change.sum(axis=axis))
            middle = int(np.searchsorted(total, total[-1] / 2)) if total[-1] > 0 else size // 2
            found.append(int(np.clip(middle - n // 2, 0, size - n)))
        return found[0], found[1], w, h
