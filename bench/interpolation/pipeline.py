"""Runs renderer, interpolator and event sensor in one process without the bus, to measure what a method alone costs."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from evis.events.measure.distance import EventStream, log_error
from evis.runtime.clock import NS, keyframe_count, keyframe_stamp
from evis.scene.model import Camera, Scene
from nodes.event_sensor.input.further import Further
from nodes.event_sensor.sensor import EventSensor
from nodes.interpolator.auto.setting import LIGHT
from nodes.interpolator.auto.world import World
from nodes.interpolator.interpolator import Interpolator
from nodes.interpolator.keyframe import Report, States
from nodes.interpolator.methods import reads
from nodes.interpolator.samples import Further as Samples
from nodes.interpolator.warm_up import LONGEST
from nodes.interpolator.warm_up import images as made_up
from nodes.renderer.geometry.triangles import is_static
from nodes.renderer.renderer import Renderer

THRESHOLD = 0.2
FEW_GAPS = 2
"""Gaps up to which one alone counts for so much that what else the machine does would show."""
FOUND_IN = 1
"""Gaps whose time does not count, for in them memory is found and touched for the first time, if there are more."""


@dataclass
class Run:
    """Holds a run's events by crossing method, and the CPU time [s] of its stages, without what is made once.

    shaded: pixels of keyframes and those shaded between them. remembered: those of them whose light the renderer can
    remember from the keyframe before. reshaded, filled: pixels of sub-frames that were shaded anew, and guessed, of
    `samples` in all. refined: samples of single pixels between them. frame_errors: root mean squares of ln I against
    dense rendering, of each sub-frame that was compared, in thresholds.
    """

    streams: dict[str, EventStream]
    sense_s: dict[str, float]
    render_s: float = 0.0
    interpolate_s: float = 0.0
    shaded: int = 0
    remembered: int = 0
    reshaded: int = 0
    filled: int = 0
    refined: int = 0
    samples: int = 0
    frame_errors: list[float] = field(default_factory=list)

    def add(self, report: Report, pixels: int, samples: int) -> None:
        """Counts a gap. report: of its interpolation. pixels: of its keyframe. samples: pixels of all its frames."""
        self.shaded += pixels + report.reshaded
        self.reshaded += report.reshaded
        self.filled += report.filled
        self.refined += report.refined
        self.samples += samples

    def seconds(self, crossing: str) -> float:
        """Adds up the CPU time of all three stages."""
        return self.render_s + self.interpolate_s + self.sense_s[crossing]

    @property
    def frame_error(self) -> float:
        """Computes the root mean square over all compared sub-frames."""
        return float(np.sqrt(np.mean(np.square(self.frame_errors)))) if self.frame_errors else 0.0


class Sensors:
    """Runs event sensors that differ in their crossing method on the same frames."""

    def __init__(self, height: int, width: int, crossings: Sequence[str]) -> None:
        self._size = (width, height)
        self._sensors = {c: EventSensor(height, width, threshold=THRESHOLD, crossing=c) for c in crossings}
        self._parts: dict[str, list] = {c: [] for c in crossings}
        self.seconds = dict.fromkeys(crossings, 0.0)

    def process(self, frames: np.ndarray, t: np.ndarray, share: float = 1.0, between: Samples | None = None) -> None:
        """Runs the sensors on frames float32 [1, K, H, W] at stamps int64 [K] ns.

        share: by how much their time counts. between: samples of single pixels.
        """
        further = None if between is None else Further(*between.arrays(False))
        for crossing, sensor in self._sensors.items():
            start = time.process_time()
            self._parts[crossing].append(sensor.process(frames, t, np.zeros(1, np.int32), further=further))
            self.seconds[crossing] += (time.process_time() - start) * share

    def streams(self) -> dict[str, EventStream]:
        """Returns all events, also those that look-ahead held back."""
        result = {}
        for crossing, sensor in self._sensors.items():
            parts = [*self._parts[crossing], sensor.flush()]
            t, x, y, p = (np.concatenate([getattr(e, name) for e in parts]) for name in "txyp")
            result[crossing] = EventStream(t, x, y, p, *self._size)
        return result


def simulate(
    world: World,
    method: str,
    keyframe_rate: float,
    upsampling: int,
    duration_ns: int,
    crossings: Sequence[str] = ("linear",),
    truth: Mapping[int, np.ndarray] | None = None,
    light: Mapping[str, Any] | None = None,
    warp: Mapping[str, Any] | None = None,
    rehearsed: bool = False,
) -> Run:
    """Simulates one environment of a scene from t = 0, seen by cam0.

    What has few gaps is run twice, and the less of each stage's time is taken.

    Args:
        world: the scene and its states.
        method: of interpolation.
        keyframe_rate: keyframes per second [Hz].
        upsampling: frames of a gap, K.
        duration_ns: simulated time [ns].
        crossings: crossing methods of the sensors.
        truth: luminance float32 [H, W] by stamp, of dense rendering; sub-frames at these stamps are compared with it.
        light: options of renderer and interpolator (light_samples, paths).
        warp: options of the interpolator alone.
        rehearsed: whether its gaps are made once before they count.
    """
    given = (world, method, keyframe_rate, upsampling, duration_ns, crossings)
    run = _once(*given, truth, light or {}, warp or {}, rehearsed)
    if keyframe_count(duration_ns, keyframe_rate) - 1 <= FEW_GAPS:
        again = _once(*given, None, light or {}, warp or {}, rehearsed)
        run.render_s = min(run.render_s, again.render_s)
        run.interpolate_s = min(run.interpolate_s, again.interpolate_s)
        run.sense_s = {c: min(spent, again.sense_s[c]) for c, spent in run.sense_s.items()}
    return run


def _once(
    world: World,
    method: str,
    keyframe_rate: float,
    upsampling: int,
    duration_ns: int,
    crossings: Sequence[str],
    truth: Mapping[int, np.ndarray] | None,
    light: Mapping[str, Any],
    warp: Mapping[str, Any],
    rehearsed: bool,
) -> Run:
    """Simulates once; arguments as of `simulate`."""
    scene = world.scene
    camera = scene.camera("cam0")
    renderer = Renderer(scene, camera, **light)
    how: dict[str, Any] = {"scene": scene, "camera": camera, **light, **warp}
    interpolator = Interpolator(method, upsampling, **how)
    sensors = Sensors(camera.height, camera.width, crossings)
    needs = reads(method)
    outputs = {LIGHT} | (needs & {"depth", "motion"})
    renderer.prepare(outputs)
    _warm_up(interpolator, world, camera, needs)
    if rehearsed and "state" in needs:
        _rehearse(renderer, interpolator, world, keyframe_rate, duration_ns)
    memory = Memory(scene, camera)
    run = Run({}, sensors.seconds)
    episodes = np.zeros(1, np.int32)
    before = 0
    previous = None
    last = keyframe_count(duration_ns, keyframe_rate) - 1
    skipped = min(FOUND_IN, last - 1)
    # Those that count stand for all.
    share = last / max(last - skipped, 1)
    for k in range(last + 1):
        stamp = keyframe_stamp(k, keyframe_rate)
        poses = world.poses(stamp)
        states = States(*world.states(before, stamp)) if "state" in needs else None
        clock = [time.process_time()]
        images = renderer.render(poses, previous, outputs, {}, stamp)
        clock.append(time.process_time())
        image, depth, motion = (_own(images, name) for name in (LIGHT, "depth", "motion"))
        assert image is not None
        t, frames = interpolator.push(stamp, episodes, image, depth, motion, states=states)
        clock.append(time.process_time())
        remembered = memory.of(poses)
        if k > skipped:
            run.render_s += (clock[1] - clock[0]) * share
            run.interpolate_s += (clock[2] - clock[1]) * share
        if k:
            run.remembered += remembered
            run.add(interpolator.report, camera.height * camera.width, frames.size)
        sensors.process(frames, t, share * (k > skipped), interpolator.further)
        for i, at in enumerate(t.tolist()):
            if truth is not None and at in truth:
                run.frame_errors.append(log_error(frames[0, i], truth[at], THRESHOLD))
        previous, before = poses, stamp
    run.streams = sensors.streams()
    return run


class Memory:
    """Counts the pixels of a keyframe whose light can be remembered.

    Where camera and lights stand still these are the pixels of bodies that never move, if they show the same instance
    as in the keyframe before.
    """

    def __init__(self, scene: Scene, camera: Camera) -> None:
        bodies = [next(n for n, body in enumerate(scene.bodies) if body.name == camera.name)]
        bodies += [light.body for light in scene.lights]
        self._still = np.array([True, *(is_static(scene, i.body) for i in scene.instances)])
        self._renderer = Renderer(scene, camera) if all(is_static(scene, body) for body in bodies) else None
        self._ids: np.ndarray | None = None

    def of(self, poses: np.ndarray) -> int:
        """Counts the pixels of the next keyframe whose light can be remembered, for body poses [1, N, 7]."""
        if self._renderer is None:
            return 0
        ids = self._renderer.render(poses, None, ("ids",))["ids"].copy()
        before, self._ids = self._ids, ids
        return 0 if before is None else int((self._still[ids] & (ids == before)).sum())


def _warm_up(interpolator: Interpolator, world: World, camera: Camera, needs: frozenset[str]) -> None:
    """What a method makes once, in its first gap, is no part of a run's cost: it is made here."""
    interpolator.warm_up_for(1, camera.height, camera.width)
    if interpolator.upsampling <= LONGEST:
        return
    # A gap as long as that is left out there. One in which nothing moves is soon made.
    poses = world.poses(0)
    for stamp in (0, NS // 1000):
        t = np.array([stamp]) if not stamp else np.array([0, stamp])
        twist = np.zeros((1, len(t), poses.shape[1], 6))
        states = States(t, np.repeat(poses[:, None], len(t), 1), twist) if "state" in needs else None
        interpolator.push(stamp, np.full(1, -1, np.int32), *made_up(1, camera.height, camera.width), states=states)


def _rehearse(
    renderer: Renderer, interpolator: Interpolator, world: World, keyframe_rate: float, duration_ns: int
) -> None:
    """Makes the gaps of a run once, in an episode before it: some are the first to need a kernel, or z-buffers."""
    before = 0
    for k in range(keyframe_count(duration_ns, keyframe_rate)):
        stamp = keyframe_stamp(k, keyframe_rate)
        image = _own(renderer.render(world.poses(stamp), None, {LIGHT}, {}, stamp), LIGHT)
        assert image is not None
        states = States(*world.states(before, stamp))
        interpolator.push(stamp, np.full(1, -2, np.int32), image, None, None, states=states)
        before = stamp


def visibility_seconds(world: World, rate: float, duration_ns: int) -> float:
    """Measures the CPU time [s] per keyframe of finding out what cam0 sees, without any light."""
    renderer = Renderer(world.scene, world.scene.camera("cam0"))
    spent, count = 0.0, 0
    for k in range(keyframe_count(duration_ns, rate)):
        poses = world.poses(keyframe_stamp(k, rate))
        began = time.process_time()
        renderer.render(poses, None, ("ids",))
        # The first one places what stands still.
        spent += (time.process_time() - began) * (k > 0)
        count += k > 0
    return spent / max(count, 1)


def reference(
    world: World, rate: float, duration_ns: int, keep_every_ns: int, light: Mapping[str, Any] | None = None
) -> tuple[EventStream, EventStream, dict[int, np.ndarray]]:
    """Renders densely: events at `rate`, events of every second frame, and frames by stamp.

    Frames are kept where the stamp is a multiple of keep_every_ns. Crossing times are linear, for at these rates they
    are the same by any method.
    """
    camera = world.scene.camera("cam0")
    renderer = Renderer(world.scene, camera, **(light or {}))
    full, half = (Sensors(camera.height, camera.width, ["linear"]) for _ in range(2))
    kept = {}
    for k in range(keyframe_count(duration_ns, rate)):
        stamp = keyframe_stamp(k, rate)
        image = renderer.render(world.poses(stamp), None, {LIGHT}, {}, stamp)[LIGHT]
        frame = image.copy()[:, None]
        t = np.array([stamp])
        full.process(frame, t)
        if k % 2 == 0:
            half.process(frame, t)
        if stamp % keep_every_ns == 0:
            kept[stamp] = frame[0, 0].copy()
    return full.streams()["linear"], half.streams()["linear"], kept


def _own(images: Mapping[str, np.ndarray], name: str) -> np.ndarray | None:
    """A copy: the renderer writes its next image into the same memory, and the interpolator remembers this one."""
    return images[name].copy() if name in images else None
