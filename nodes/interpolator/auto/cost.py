"""Measures what keyframes, sub-frames and the sensor cost at the true size, for the probe."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evis.gpu.host_copies import host_array
from evis.runtime.clock import NS
from nodes.event_sensor.sensor import EventSensor
from nodes.interpolator.auto.setting import (
    LIGHT,
    Renderers,
    Setting,
    Way,
    copied,
    draw,
    frames_for,
    make_interpolator,
)
from nodes.interpolator.auto.world import World
from nodes.interpolator.interpolator import Interpolator
from nodes.interpolator.keyframe import States
from nodes.interpolator.methods import reads
from nodes.interpolator.warm_up import LONGEST
from nodes.renderer.renderer import LAST

STEP_NS = NS // 1000
"""Between two keyframes that are timed [ns]."""
SHARES = np.arange(1, 9, dtype=np.float32) / 8
"""Of a change, in the frames of a long call of the sensor."""
SAME = ([-1], [-1] * 8)
"""Frames of a short and of a long call in which nothing happens."""
REPEATS = 4
"""Calls of the sensor of which the shortest counts."""
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
    """Holds the cost of a gap with K frames, fixed + K frame [s]."""

    fixed: float
    frame: float


class FullSize:
    """Measures what keyframes, sub-frames and the sensor's frames cost at full size, and where the image changes.

    Stages are timed one by one, as they follow each other on a CPU. There every environment costs the same, so one is
    measured; on a GPU all are measured at once (`overlap`).
    """

    def __init__(self, setting: Setting, world: World, starts: list[int]) -> None:
        s = self._setting = setting
        self._shifted = s.shifted().scene
        self._world, self._starts = world, starts
        self._envs = s.envs if s.on_gpu else 1
        self._changes: list[np.ndarray] = []
        self._slow = False
        # The first times a GPU loads kernels and records what it does.
        self._more = 4 if s.on_gpu else 0
        how = {"margin": s.margin, "device": s.device, "threads": s.threads}
        self._renderers = Renderers(s, s.camera, envs=self._envs, **how)
        self._methods: dict[str, list[Interpolator]] = {}
        self._shares: dict[str, float] = {}
        """By method: the cost of a gap that does not grow with K, in units of a frame's cost."""
        self.keyframe: dict[str, float] = {}
        """Seconds per keyframe and environment, by the method that reads it."""
        self.pass_on = 0.0
        """Seconds in which a keyframe of dense rendering becomes a frame, of an environment."""
        self.call = self.sense = self.events = 0.0
        """The sensor's seconds per gap, per frame, and per simulated second for its events, of an environment."""
        self.gaps: dict[tuple[str, float], GapCost] = {}
        """By method and keyframe rate, of an environment."""

    def measure_keyframes(self) -> None:
        """Measures keyframes and the sensor: sets `keyframe`, `pass_on`, `call`, `sense` and `events`."""
        s, m = self._setting, self._setting.margin
        inner = (..., slice(m, m + s.camera.height), slice(m, m + s.camera.width))
        frames: list[np.ndarray] = []
        for method in s.measured_methods:
            # Keyframes of `rigid` are those of dense rendering unless it averages their samples itself.
            if method == "rigid" and s.camera.supersampling == 1:
                self.keyframe[method] = self.keyframe["none"]
                continue
            outputs, renderer = self._outputs(method), self._renderers.before(method)
            renderer.prepare(outputs)
            took: list[float] = []
            for start in self._starts if method == "none" else self._starts[:1]:
                times: list[float] = []
                for stamp in range(start, start + (2 if self._slow else 3 + self._more) * STEP_NS, STEP_NS):
                    began = s.clock()
                    images = draw(s, renderer, self._poses(stamp), LAST if times else None, outputs, stamp)
                    times.append(s.clock() - began)
                    if method == "none" and len(times) < 3:
                        frames.append(host_array(images[LIGHT])[inner].copy())
                    self._slow |= len(times) > 1 and times[1] > SLOW_S
                # The first drawing places what stands still.
                took.append(min(times[1:]))
            self.keyframe[method] = float(np.mean(took)) / self._envs
        pairs = list(zip(frames[::2], frames[1::2], strict=True))
        with np.errstate(divide="ignore", invalid="ignore"):
            changes = (np.abs(np.log(after[0]) - np.log(before[0])) for before, after in pairs)
            self._changes = [np.nan_to_num(change, nan=0.0, posinf=0.0) for change in changes]
        self._measure_others(pairs)

    def _measure_others(self, pairs: list[tuple[np.ndarray, np.ndarray]]) -> None:
        """Measures what dense rendering costs beside its keyframes. pairs: frames [E, h, w] a step apart."""
        again = self._starts[-1:] * 3
        self.pass_on = min(self._push(self._interpolator("none", 1), "none", again, STEP_NS, 0)) / self._envs
        self._measure_sensor(pairs)

    def _measure_sensor(self, pairs: list[tuple[np.ndarray, np.ndarray]]) -> None:
        """Measures the sensor's cost of a call, of a frame, and of the events per simulated second. pairs: as of
        _measure_others; a change makes as many events in one frame as in several."""
        s, envs = self._setting, self._envs
        sensor = EventSensor(s.camera.height, s.camera.width, envs, device=s.device, **s.sensor)
        stamp = 0

        def spent(given: np.ndarray) -> float:
            """Measures the time [s] of a call with frames [E, K, H, W], a millisecond apart."""
            nonlocal stamp
            t = stamp + STEP_NS * np.arange(1, given.shape[1] + 1)
            stamp = int(t[-1])
            began = s.clock()
            sensor.process(given, t, episodes)
            return s.clock() - began

        still, busy, step = [], [], []
        for n, (before, after) in enumerate(pairs):
            episodes = np.full(envs, n, np.int32)
            there = np.stack([before + share * (after - before) for share in SHARES], 1)
            back = np.stack([after + share * (before - after) for share in SHARES], 1)
            # There and back first: memory for the events is found.
            took = [(spent(there), spent(back)) for _ in range(1 + REPEATS)]
            busy.append(min(map(min, took[1:])))
            took = [(spent(there[:, -1:]), spent(back[:, -1:])) for _ in range(REPEATS)]
            step.append(min(map(min, took)))
            still.append([min(spent(back[:, ends]) for _ in range(REPEATS)) for ends in SAME])
        one, many = (min(times) / envs for times in zip(*still))
        call = max(one - (many - one) / (len(SAME[1]) - 1), 0.0)
        self.call, jump = call, float(np.mean(step)) / envs
        self.sense = max(float(np.mean(busy)) / envs - jump, 0.0) / (len(SHARES) - 1)
        # What changes in a millisecond.
        self.events = max(jump - call - self.sense, 0.0) * 1000

    def measure_gap(self, method: str, rate: float) -> None:
        """Measures a gap of a method at a keyframe rate [Hz] and keeps it in `gaps`."""
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
        """Gives the K of the gaps to be measured: the user's own, if it is given and not too large."""
        s = self._setting
        if s.upsampling and s.upsampling <= LONGEST:
            return (s.upsampling,)
        samples = self._envs * s.camera.width * s.camera.height * s.camera.supersampling**2
        return GAP_FRAMES if samples * GAP_FRAMES[1] <= MOST_SAMPLES else GAP_FRAMES[:1]

    def seconds(self, way: Way) -> float | None:
        """Predicts the run time of a way [s per simulated s] of one environment, physics not included; None where no
        gap of its method has been measured."""
        method, rate, k = way
        frames = rate * k
        keyframes = frames if method == "none" else rate
        seconds = keyframes * (self.keyframe[method] + self.call) + frames * self.sense + self.events
        if method == "none":
            return seconds + frames * self.pass_on
        gaps = self._of_gaps(way)
        return None if gaps is None else seconds + gaps

    def _of_gaps(self, way: Way) -> float | None:
        """Predicts what gaps alone cost [s per simulated s]; None where none of the method has been measured.

        A keyframe rate that was not measured costs what lies between those of the method that were, frame by frame,
        or what the nearest one does.
        """
        method, rate, k = way
        known = sorted(r for m, r in self.gaps if m == method)
        if not known:
            return None
        at = np.log(known)
        fixed, frame = (
            float(np.interp(np.log(rate), at, values))
            for values in zip(*((g.fixed, g.frame) for g in (self.gaps[method, r] for r in known)))
        )
        return rate * (fixed + k * frame)

    def cuts(self, size: tuple[int, int], count: int) -> list[tuple[int, int, int, int]]:
        """Places cut-outs of the image where it changes, and gives left, top, width and height of each [px].

        The columns are divided into `count` parts with equal shares of all change. A cut-out is centred on the median
        of its part's change in x and in y. size: largest width and height [px]."""
        change = np.sum(self._changes, axis=0)
        height, width = change.shape
        w, h = min(size[0], width), min(size[1], height)
        by_column = np.cumsum(change.sum(axis=0))
        edges = [int(np.searchsorted(by_column, by_column[-1] * n / count)) for n in range(1, count)]
        parts = zip([0, *edges], [*edges, width])
        found = []
        for left, right in parts if by_column[-1] > 0 else [(0, width)] * count:
            part = change[:, left : max(right, left + 1)]
            x, y = left + _middle(part.sum(axis=0)), _middle(part.sum(axis=1))
            found.append((int(np.clip(x - w // 2, 0, width - w)), int(np.clip(y - h // 2, 0, height - h)), w, h))
        return found

    def _outputs(self, method: str) -> set[str]:
        return {LIGHT} | (reads(method) & {"depth", "motion"})

    def _interpolator(self, method: str, k: int) -> Interpolator:
        """Gives an interpolator that is warmed up: what is built in the first gap is not counted as cost of a run."""
        interpolator = make_interpolator(self._setting, self._shifted, self._setting.camera, method, k)
        camera, n, m = self._setting.camera, self._setting.samples(method), self._setting.margin
        interpolator.warm_up_for(self._envs, (camera.height + 2 * m) * n, (camera.width + 2 * m) * n, m * n)
        return interpolator

    def _gap(self, method: str, interpolator: Interpolator, rate: float) -> float:
        """Measures the time of a gap [s]: the lesser of forth and back, averaged over the windows."""
        end = self._world.end_ns
        gap = min(round(NS / rate), end)
        found = []
        # The last window first: in the first one things may still be at rest.
        for n, start in enumerate(self._starts[::-1][: 1 if self._slow else None]):
            start = min(start, end - gap)
            times = [start, start + gap, start]
            found.append(min(self._push(interpolator, method, times, gap, round(rate * 1000) + n)))
        return float(np.mean(found)) / self._envs

    def _push(self, interpolator: Interpolator, method: str, times: list[int], gap: int, episode: int) -> list[float]:
        """Measures the time [s] of every gap between keyframes of the world at `times` [ns].

        Args:
            interpolator, method: what makes the frames.
            times: of the keyframes in the world [ns].
            gap: how far apart they are, as the method is told [ns].
            episode: number of the episode that they form.
        """
        s, took = self._setting, []
        outputs, renderer = self._outputs(method), self._renderers.before(method)
        for n, now in enumerate(times):
            before = times[max(n - 1, 0)]
            images = copied(s, draw(s, renderer, self._poses(now), self._poses(before), outputs, now))
            states = self._states(before, now, n * gap, gap) if "state" in reads(method) else None
            began = s.clock()
            interpolator.push(
                n * gap, np.full(self._envs, episode, np.int32), images[LIGHT], images.get("depth"),
                images.get("motion"), s.margin * self._setting.samples(method), frames_for(s), states,
            )  # fmt: skip
            if n:
                took.append(s.clock() - began)
        return took

    def _states(self, before: int, now: int, stamp: int, gap: int) -> States:
        """Gives the states from one time of the world to another, earlier or the same perhaps, as if `gap` ns apart."""
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
        return np.repeat(self._world.poses(min(stamp, self._world.end_ns)), self._envs, 0)


def _middle(values: np.ndarray) -> int:
    """Finds the index at which half of the sum is reached; the middle index where all values are zero."""
    summed = np.cumsum(values)
    return int(np.searchsorted(summed, summed[-1] / 2)) if summed[-1] > 0 else len(values) // 2
