"""Cost and error of every way to run a scene, from a few windows of its motion, before a run starts.

The error is that of the events against dense rendering at a high rate, in a cut-out of the camera's image where there
is change: a smaller camera with its principal point moved, so that pixels move as they do in the whole image. The
windows are the environments of one rendering. Frames at lower rates and smaller K are among those of the highest, so
that each method runs once per keyframe rate; beyond 1000 frames per second it runs only where more frames still help
and dense rendering is not as good at the same cost, the other candidates being left out. The cost is measured at the
full size: keyframes with what each method reads of them, a gap of each method, the sensor's frames; how it grows with
the length of a gap is taken from the cut-out.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import warp as wp

from bench.metrics import Stream, victor_purpura
from bench.world import World
from evis.clock import NS
from evis.geometry.interpolate import state_at
from evis.scene.model import Camera, Scene
from nodes.event_sensor.sensor import EventSensor
from nodes.interpolator.choice import BASE_RATE, Candidate
from nodes.interpolator.interpolator import NEEDS, Interpolator
from nodes.interpolator.keyframe import States, device_named
from nodes.interpolator.luminance import luminance_of
from nodes.renderer.renderer import Renderer
from nodes.renderer.supersampling import SupersampledRenderer

METHODS = ("none", "splat", "rigid")
RATES = {"none": (250.0,), "splat": (31.25, 62.5, 125.0, 250.0), "rigid": (31.25, 62.5, 125.0)}
"""Keyframe rates [Hz] that are tried where the user gives none; that of `none` where K is given."""
FRAME_RATES = (500, 1000, 2000, 4000)
"""Frames per second, about, that are tried with every keyframe rate; for dense rendering also half and a quarter."""
DEAR_S = 0.02
"""Cost of a keyframe from which on the reference has half the rate [s]."""
REFERENCE_HZ = {False: 8000, True: 4000}
WINDOWS = 2
CUT = (80, 60)
"""Width and height of the cut-out [px]."""
MARGIN = 12
"""Pixels about the cut-out that keyframes have, so that what enters is known as it is inside the whole image."""
GAP_FRAMES = 8
"""K of the gap that is measured at the full size."""

MIDDLE_RATE = 62.5
"""Its keyframe rate [Hz]."""
MOST = 0.7
"""Share of a method's error that must be dense rendering's for more frames to help."""

ORIGIN = NS
"""Start of the windows' common time [ns], late enough that there is time before it."""
SUBSTEP_NS = 1_000_000

Say = Callable[[str], None]
Way = tuple[str, float, int]
"""Method, keyframe rate [Hz], K."""


@dataclass
class Setting:
    """How a scene is going to be run: what of it decides cost and error.

    keyframe_rate, upsampling: the user's own, or None. sensor: parameters of EventSensor without noise. light: options
    of the renderer (light_samples, paths). tolerance: that of `rigid`.
    """

    scene: Scene
    camera: Camera
    duration_ns: int
    seed: int = 0
    device: str = "cpu"
    envs: int = 1
    threads: int = 1
    margin: int = 0
    keyframe_rate: float | None = None
    upsampling: int | None = None
    sensor: dict[str, Any] = field(default_factory=dict)
    light: dict[str, Any] = field(default_factory=dict)
    tolerance: float = 0.1

    def clock(self) -> float:
        """CPU time where one thread does all the work, for others may be at work here; else wall time [s]."""
        if self.device.startswith("cuda"):
            wp.synchronize_device(self.device)
            return time.perf_counter()
        return time.process_time() if self.threads == 1 else time.perf_counter()


@dataclass
class Grid:
    """Rates that fit each other: every frame of a candidate is at a stamp of the reference.

    base: reference [Hz]. ways: (method, keyframe rate, K).
    """

    base: float
    ways: list[Way]

    @staticmethod
    def of(setting: Setting, dear: bool = False) -> Grid:
        """What the user's keyframe rate and K leave. dear: keyframes cost DEAR_S or more."""
        rates = [f for f in FRAME_RATES if 2 * f <= REFERENCE_HZ[dear]]
        rate, given = setting.keyframe_rate, setting.upsampling
        odd = given // (given & -given) if given else 1
        base = (rate or RATES["splat"][0]) * odd
        while base * np.sqrt(2) < REFERENCE_HZ[dear]:
            base *= 2
        shortest = 0.999 * NS / setting.duration_ns
        ks = [given] if given else [2**n for n in range(8)]
        ways = set()
        for method in METHODS:
            fitting = [r for r in RATES[method] if r >= shortest] or [RATES["splat"][-1]]
            for r in [rate] if rate else fitting:
                for k in ks:
                    fits = given or any(abs(np.log2(r * k / f)) <= 0.5 for f in rates)
                    if method == "none" and (rate or given) and (given or r * k <= base / 2):
                        ways.add((method, r, k))
                    elif method != "none" and k > 1 and fits:
                        ways.add((method, r, k))
        if not rate and not given:
            ways |= {("none", float(f), 1) for f in (rates[0] / 4, rates[0] / 2, *rates)}
        top = max(r * k for _, r, k in ways)
        while base < 2 * top:
            base *= 2
        return Grid(base, sorted(ways))

    @property
    def gap(self) -> int:
        """Steps of the reference in the longest gap between keyframes."""
        return max(round(self.base / r) for _, r, k in self.ways)

    @property
    def length(self) -> int:
        """Time of that gap [ns]."""
        return self.stamp(0, self.gap)

    def stamp(self, start_ns: int, step: int) -> int:
        """Time of a step of the reference after the start of a window [ns]."""
        return start_ns + round(step * NS / self.base)


def probe(setting: Setting, say: Say = lambda line: None) -> list[Candidate]:
    """All candidates with their cost and error. say: told what is being done, for a terminal."""
    length = Grid.of(setting).length
    end = max(setting.duration_ns, length)
    say("moving the scene")
    started = setting.clock()
    world = World(setting.scene, end, setting.seed)
    moving = (setting.clock() - started) / (end / NS) if setting.scene.dynamic else 0.0
    say("costs at full size")
    starts = starts_of(setting, end - length)
    full = FullSize(setting, world, starts, length)
    costs = full.measure() | {"moving": moving}
    dear = costs["key none"] > DEAR_S
    grid = Grid.of(setting, dear)
    say("dense frames")
    windows = Windows(setting, world, grid, starts, full.cut())
    low = [way for way in grid.ways if way[0] == "none" or way[1] * way[2] <= 1.5 * BASE_RATE]
    found: list[Candidate] = []
    for ways in (low, sorted(set(grid.ways) - set(low))):
        ways = [way for way in ways if way in low or _worth(way, found)]
        for line in windows.compare(ways):
            say(line)
        found += [_candidate(setting, way, windows, costs) for way in ways]
    return found


def starts_of(setting: Setting, last: int) -> list[int]:
    """Where windows begin, evenly from 0 to `last` [ns]: at sub-steps, for an impact lies between two of them."""
    step = setting.scene.timestep_ns
    return sorted({round(t) // step * step for t in np.linspace(0, last, WINDOWS)})


def _candidate(setting: Setting, way: Way, windows: Windows, costs: dict[str, float]) -> Candidate:
    """What was found about one way."""
    method, rate, k = way
    frames = rate * k
    seconds = (frames if method == "none" else rate) * costs["key " + method] + frames * costs["sense"]
    seconds += costs["events"]
    if method != "none":
        # A sub-frame at this keyframe rate, by what one costs at the rate that was measured at full size.
        per = {r: seconds for (m, r), seconds in windows.spent.items() if m == method}
        middle = min(per, key=lambda r: abs(r - MIDDLE_RATE))
        seconds += frames * costs["frame " + method] * per[rate] / per[middle]
    seconds = costs["moving"] + seconds * setting.envs
    return Candidate(method, rate, k, round(windows.error[way], 6), round(float(seconds), 6))


def _worth(way: Way, found: list[Candidate]) -> bool:
    """Whether a method at a keyframe rate may gain from more frames: most of its error until now is that of dense
    rendering of as many frames, and dense rendering at the same cost is worse."""
    method, rate, _ = way
    last = max((c for c in found if (c.method, c.keyframe_rate) == (method, rate)), key=lambda c: c.upsampling)
    dense = sorted((c for c in found if c.method == "none"), key=lambda c: c.seconds)
    same = [c.error for c in dense if abs(c.frame_rate / last.frame_rate - 1) < 0.01]
    if same and same[0] < MOST * last.error:
        return False
    cost, error = (np.log([max(v, 1e-9) for v in values]) for values in zip(*((c.seconds, c.error) for c in dense)))
    return last.seconds < dense[0].seconds or last.error < np.exp(np.interp(np.log(last.seconds), cost, error))


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
            pairs = []
            for start in self._starts if method == "none" else self._starts[: 0 if alike else 1]:
                for stamp in (start, start + NS // 1000):
                    began = s.clock()
                    images = renderer.render(self._poses(stamp), self._poses(start), outputs, {}, stamp)
                    took.append(s.clock() - began)
                    if method == "none":
                        pairs.append(luminance_of(images["radiance"].copy(), device_named(s.device)).numpy()[inner])
            # The first drawing compiles and places what stands still.
            costs["key " + method] = costs["key none"] if alike else float(np.mean(took[1:])) / s.envs
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
        still, events, busy, stamp = [], 0, 0.0, 0
        for n, (before, after) in enumerate(zip(frames[::2], frames[1::2], strict=True)):
            with np.errstate(divide="ignore", invalid="ignore"):
                change = np.abs(np.log(after[0]) - np.log(before[0]))
            self._changes.append(np.nan_to_num(change, nan=0.0, posinf=0.0))
            for frame in (before, before, after):
                given = np.repeat(frame[:, None], 2, 1)
                t = np.array([stamp + NS // 1000, stamp + NS // 500])
                began = s.clock()
                made = sensor.process(given, t, episodes + n)
                took = s.clock() - began
                stamp = int(t[-1])
                if frame is after:
                    events += len(made.t)
                    busy += took
                else:
                    still.append(took)
        quiet = float(np.min(still)) / 2 / s.envs
        busy = max(busy / len(self._starts) / s.envs - 2 * quiet, 0.0)
        return {"sense": quiet, "events": busy * 1000}

    def _gap(self, method: str, renderer: Any, outputs: set[str]) -> float:
        """Seconds per sub-frame of a gap, the gap's own share included; the least of two."""
        s = self._setting
        gap = min(round(NS / MIDDLE_RATE), self._length)
        interpolator = Interpolator(
            method,
            GAP_FRAMES,
            scene=s.scene,
            camera=s.camera,
            device=s.device,
            threads=s.threads,
            tolerance=s.tolerance,
            **s.light,
        )
        took = []
        start = self._starts[len(self._starts) // 2]
        previous = None
        for n in range(3):
            # There and back again, for the run may be no longer than one gap.
            before, now = (start, start) if n == 0 else (start, start + gap) if n == 1 else (start + gap, start)
            poses = self._poses(now)
            images = {k: v.copy() for k, v in renderer.render(poses, previous, outputs, {}, now).items()}
            states = self._states(method, before, now, n * gap)
            began = s.clock()
            interpolator.push(
                n * gap, np.zeros(s.envs, np.int32), images["radiance"], images.get("depth"), images.get("motion"),
                s.margin, states=states,
            )  # fmt: skip
            if n:
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
        return np.repeat(self._world.poses(stamp), self._setting.envs, 0)

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
        # Times are shifted, so that poses come from the states alone and not from the bodies' paths.
        bodies = [
            b if b.trajectory and b.trajectory.is_static() else replace(b, trajectory=None) for b in s.scene.bodies
        ]
        self._setting = s = replace(s, scene=replace(s.scene, bodies=bodies))
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


def make_renderer(s: Setting, camera: Camera, method: str, **how: Any) -> Renderer | SupersampledRenderer:
    """The renderer as the graph would have it before a method."""
    if camera.supersampling > 1:
        apart = method == "rigid"
        return SupersampledRenderer(s.scene, camera, camera.supersampling, **how, **s.light, apart=apart)
    return Renderer(s.scene, camera, **how, **s.light)
