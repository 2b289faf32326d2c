"""What keyframes, sub-frames and the sensor cost at the true size, for the probe."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.probe_setting import METHODS, Setting, Way, make_interpolator, make_renderer
from bench.world import World
from evis.clock import NS
from nodes.event_sensor.sensor import EventSensor
from nodes.interpolator.interpolator import NEEDS, Interpolator
from nodes.interpolator.keyframe import States, device_named
from nodes.interpolator.luminance import luminance_of
from nodes.interpolator.rehearsal import LONGEST

GAP_FRAMES = (8, 32)
"""K of the gaps that are measured: the first at every keyframe rate, the other at one, for what K does not change."""
MOST_SAMPLES = 1 << 27
"""Pixels of a gap's frames, of all environments, up to which the second K is measured: what memory surely holds."""
MOST_SHARE = 4.0
"""What K does not change, over the cost of the gap of the first K without it, at most: the rest is noise."""
SLOW_S = 0.03
"""Cost of a keyframe from which on gaps are measured in one window only [s]."""


@dataclass(frozen=True)
class GapCost:
    """Seconds of a gap: fixed + K x per frame."""

    fixed: float
    frame: float


class FullSize:
    """What keyframes, sub-frames and the sensor's frames cost at the true size, and where in the image events are.

    On a CPU environments cost the same each, so that one is measured; on a GPU all at once.
    """

    def __init__(self, setting: Setting, world: World, starts: list[int]) -> None:
        s = self._setting = setting
        self._shifted = s.shifted().scene
        self._world, self._starts = world, starts
        self._envs = s.envs if s.device.startswith("cuda") else 1
        self._changes: list[np.ndarray] = []
        self._slow = False
        self._renderers: dict[bool, Any] = {}
        self._methods: dict[str, list[Interpolator]] = {}
        self._shares: dict[str, float] = {}
        """Of a method: what does not grow with K, in frames."""
        self.keyframe: dict[str, float] = {}
        """Seconds per keyframe and environment, by the method that reads it."""
        self.sense = self.events = 0.0
        """The sensor's seconds per frame, and per simulated second for its events, of an environment."""
        self.gaps: dict[tuple[str, float], GapCost] = {}
        """By method and keyframe rate, of an environment."""

    def measure_keyframes(self) -> None:
        """Sets `keyframe`, `sense` and `events`."""
        s, m = self._setting, self._setting.margin
        inner = (..., slice(m, m + s.camera.height), slice(m, m + s.camera.width))
        frames: list[np.ndarray] = []
        for method in METHODS:
            # Keyframes of `rigid` are those of dense rendering unless it averages their samples itself.
            if method == "rigid" and s.camera.supersampling == 1:
                self.keyframe[method] = self.keyframe["none"]
                continue
            outputs, renderer = self._outputs(method), self._renderer(method)
            renderer.prepare(outputs)
            took: list[float] = []
            for start in self._starts if method == "none" else self._starts[:1]:
                times = []
                for stamp in (start, start + NS // 1000, start + NS // 500)[: 2 if self._slow else 3]:
                    began = s.clock()
                    images = renderer.render(self._poses(stamp), self._poses(start), outputs, {}, stamp)
                    times.append(s.clock() - began)
                    if method == "none" and len(times) < 3:
                        frames.append(luminance_of(images["radiance"].copy(), device_named(s.device)).numpy()[inner])
                    self._slow |= len(times) > 1 and times[1] > SLOW_S
                # The first drawing places what stands still.
                took.append(min(times[1:]))
            self.keyframe[method] = float(np.mean(took)) / self._envs
        self._measure_sensor(frames)

    def _measure_sensor(self, frames: list[np.ndarray]) -> None:
        """Cost of a frame in which nothing happens, and of the events per simulated second."""
        s, envs = self._setting, self._envs
        sensor = EventSensor(s.camera.height, s.camera.width, envs, device=s.device, **s.sensor)
        episodes = np.zeros(envs, np.int32)
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
        self.sense = float(np.min(still)) / 2 / envs
        # A millisecond's events, and two frames.
        self.events = max(float(np.mean(busy)) / envs - 2 * self.sense, 0.0) * 1000

    def measure_gap(self, method: str, rate: float) -> None:
        """Sets `gaps` of a method and keyframe rate [Hz]."""
        counts = self._counts()
        if method not in self._methods:
            made = self._methods[method] = [self._interpolator(method, k) for k in counts]
            spent = [self._gap(method, interpolator, rate) for interpolator in made]
            if len(counts) > 1:
                frame = (spent[1] - spent[0]) / (counts[1] - counts[0])
                # Of a gap's frames one is the keyframe itself, which is nearly free.
                self._shares[method] = float(
                    np.clip(spent[0] / max(frame, 1e-9) - counts[0], -1, MOST_SHARE * counts[0])
                )
        else:
            spent = [self._gap(method, self._methods[method][0], rate)]
        share = self._shares.get(method, 0.0)
        frame = spent[0] / (counts[0] + share)
        self.gaps[method, rate] = GapCost(share * frame, frame)

    def _counts(self) -> tuple[int, ...]:
        """K of the gaps to be measured: the user's own, if it is given and not too long."""
        s = self._setting
        if s.upsampling and s.upsampling <= LONGEST:
            return (s.upsampling,)
        samples = self._envs * s.camera.width * s.camera.height * s.camera.supersampling**2
        return GAP_FRAMES if samples * GAP_FRAMES[1] <= MOST_SAMPLES else GAP_FRAMES[:1]

    def seconds(self, way: Way) -> float | None:
        """Run time per simulated second of one environment, physics not included; None as long as it is not known.

        A keyframe rate that was not measured costs what lies between those of the method that were, frame by frame,
        or what the nearest one does.
        """
        method, rate, k = way
        frames = rate * k
        seconds = (frames if method == "none" else rate) * self.keyframe[method] + frames * self.sense + self.events
        if method == "none":
            return seconds
        known = sorted(r for m, r in self.gaps if m == method)
        if not known:
            return None
        at = np.log(known)
        fixed, frame = (
            float(np.interp(np.log(rate), at, values))
            for values in zip(*((g.fixed, g.frame) for g in (self.gaps[method, r] for r in known)))
        )
        return seconds + rate * (fixed + k * frame)

    def cut(self, size: tuple[int, int]) -> tuple[int, int, int, int]:
        """Left, top, width and height of a cut-out no larger than `size`: half of all change is above its middle, half
        left of it."""
        change = np.sum(self._changes, axis=0)
        height, width = change.shape
        w, h = min(size[0], width), min(size[1], height)
        found = []
        for axis, n, total in ((0, w, width), (1, h, height)):
            summed = np.cumsum(change.sum(axis=axis))
            middle = int(np.searchsorted(summed, summed[-1] / 2)) if summed[-1] > 0 else total // 2
            found.append(int(np.clip(middle - n // 2, 0, total - n)))
        return found[0], found[1], w, h

    def _outputs(self, method: str) -> set[str]:
        return {"radiance"} | (NEEDS[method] & {"depth", "motion"})

    def _renderer(self, method: str) -> Any:
        s = self._setting
        apart = self._samples(method) > 1
        if apart not in self._renderers:
            how = {"envs": self._envs, "margin": s.margin, "device": s.device, "threads": s.threads}
            self._renderers[apart] = make_renderer(s, s.camera, method, **how)
        return self._renderers[apart]

    def _interpolator(self, method: str, k: int) -> Interpolator:
        """One that has everything: what is made in the first gap is no part of a run's cost."""
        interpolator = make_interpolator(self._setting, self._shifted, self._setting.camera, method, k)
        camera, n, m = self._setting.camera, self._samples(method), self._setting.margin
        interpolator.rehearse(self._envs, (camera.height + 2 * m) * n, (camera.width + 2 * m) * n, m * n)
        return interpolator

    def _samples(self, method: str) -> int:
        """Samples per pixel and axis that keyframes have when the method gets them."""
        return self._setting.camera.supersampling if method == "rigid" else 1

    def _gap(self, method: str, interpolator: Interpolator, rate: float) -> float:
        """Seconds of a gap, the less of there and back, the mean over the windows."""
        end = int(self._world.t[-1])
        gap = min(round(NS / rate), end)
        found = []
        # The last window first: in the first one things may still be at rest.
        for n, start in enumerate(self._starts[::-1][: 1 if self._slow else None]):
            start = min(start, end - gap)
            times = [start, start + gap, start]
            found.append(min(self._push(interpolator, method, times, gap, round(rate * 1000) + n)))
        return float(np.mean(found)) / self._envs

    def _push(self, interpolator: Interpolator, method: str, times: list[int], gap: int, episode: int) -> list[float]:
        """Seconds of every gap between keyframes at these times of the world, which the method takes for `gap` ns
        apart, in an episode of their own."""
        s, took = self._setting, []
        outputs, renderer = self._outputs(method), self._renderer(method)
        for n, now in enumerate(times):
            before = times[max(n - 1, 0)]
            drawn = renderer.render(self._poses(now), self._poses(before), outputs, {}, now)
            images = {name: image.copy() for name, image in drawn.items()}
            states = self._states(before, now, n * gap, gap) if "states" in NEEDS[method] else None
            began = s.clock()
            interpolator.push(
                n * gap, np.full(self._envs, episode, np.int32), images["radiance"], images.get("depth"),
                images.get("motion"), s.margin * self._samples(method), states=states,
            )  # fmt: skip
            if n:
                took.append(s.clock() - began)
        return took

    def _states(self, before: int, now: int, stamp: int, gap: int) -> States:
        """From one time of the world to another, which may be the earlier one or the same, as if `gap` ns apart."""
        if before == now:
            t, pose, twist = np.array([0, gap]), self._poses(now)[:, None].repeat(2, 1), None
            twist = np.zeros((self._envs, 2, pose.shape[2], 6))
            return States(t + stamp - gap, pose, twist)
        t, pose, twist = self._world.states(min(before, now), max(before, now))
        if now < before:
            t, pose, twist = (before + now - t)[::-1], pose[:, ::-1], -twist[:, ::-1]
        pose, twist = (np.repeat(a, self._envs, 0) for a in (pose, twist))
        return States(t - t[0] + stamp - gap, pose, twist)

    def _poses(self, stamp: int) -> np.ndarray:
        return np.repeat(self._world.poses(min(stamp, int(self._world.t[-1]))), self._envs, 0)
