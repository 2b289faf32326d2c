"""Audits one camera without bus and files: it takes frames and states, and estimates the error of the events."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from evis.geometry import se3
from evis.scene.model import Camera, Scene
from msgs.header import Header
from msgs.world import WorldState
from nodes.audit.brightness import log_level
from nodes.audit.brute_force.instants import Samples, Sampling, base_stamps, lamp_stamps, sample
from nodes.audit.brute_force.motion import Motion
from nodes.audit.brute_force.pixel_luminance import PixelLuminance
from nodes.audit.comparison import Comparison, Train
from nodes.audit.drawing import Drawing
from nodes.audit.report import AuditReport, Units
from nodes.audit.run_events import NONE, Gap, RunEvents
from nodes.audit.sampled_sensor import SampledSensor
from nodes.event_sensor.input.further import Further
from nodes.event_sensor.parameters import thresholds_of
from nodes.event_sensor.sensor import EventSensor

if TYPE_CHECKING:
    from nodes.renderer.paths.paths import PathOptions

BATCH_NS = 1_000_000_000
"""Time that is worked on at once: many instants cost little more than a few."""


@dataclass(frozen=True)
class AuditOptions:
    """Holds the options of an audit.

    pixels: N, over all environments. seed: of environment 0. sensor: resolved parameters of the run's sensor, of which
    thresholds, dark level and crossing count. horizon_ns: how far ahead motion in closed form is looked at before
    pixels are drawn. samples, light_samples, paths, device: those of the renderer. slots: instants that are placed at
    once, None: as many as the scene makes room for. between: the run has samples of single pixels between frames, so
    that the error of its frames alone is told too. sampling: how densely brute force looks.
    """

    pixels: int
    envs: int = 1
    seed: int = 0
    sensor: Mapping[str, Any] = field(default_factory=dict)
    horizon_ns: int = 1_000_000_000
    samples: int = 1
    light_samples: int = 16
    paths: PathOptions | None = None
    device: str = "cpu"
    slots: int | None = None
    between: bool = False
    sampling: Sampling = Sampling()


class Audit:
    """Keeps pixels for an episode and compares the events of the run's luminance there with those of brute force."""

    def __init__(self, scene: Scene, camera: Camera, options: AuditOptions) -> None:
        self._options, self._scene, o = options, scene, options
        self.drawing = Drawing(scene, camera, o.pixels, o.envs, o.seed)
        envs, each = self.drawing.envs, self.drawing.each
        self._motion = Motion(scene, envs)
        how = {"samples": o.samples, "light_samples": o.light_samples, "paths": o.paths, "device": o.device}
        self._look = PixelLuminance(scene, camera, len(envs), each, self._motion, slots=o.slots, **how)
        p = {"threshold_on": None, "threshold_off": None, "dark_level": 0.0, "threshold": 0.2, **o.sensor}
        on, off = thresholds_of(p)
        ideal: dict[str, Any] = {"threshold_on": on, "threshold_off": off, "dark_level": p["dark_level"]}
        ideal["crossing"] = p.get("crossing", "linear")
        self._ideal = ideal
        self._made = [
            RunEvents(len(envs), each, ideal, samples) for samples in ((True, False) if o.between else (True,))
        ]
        self._parameters = self._made[0].sensor.parameters
        self._truth = SampledSensor(len(envs) * each, self._parameters)
        self._threshold = min(on, off)
        self._change = np.zeros((2, len(envs) * each))
        self._largest = np.zeros(len(envs) * each)
        self._instance = np.full(len(envs) * each, -1)
        self._last = Samples.none()
        self._episodes: np.ndarray | None = None
        self._stamps: list[int] = []
        self._gaps: list[Gap] = []
        self._units: list[Units] = []

    @property
    def looks(self) -> int:
        """Returns how often brute force has computed a pixel."""
        return self._look.looks

    def push(
        self,
        luminance: Any,
        t: np.ndarray,
        episodes: np.ndarray,
        state: WorldState,
        margin: int = 0,
        further: Further | None = None,
    ) -> bool:
        """Takes the frames of a gap and the states within it; True when there is something new to report.

        luminance: [E, K, h, w(, 3)], numpy or an array of a device. t: int64 [K] ns. episodes: int [E]. margin: pixels
        beyond the image on every side. further: samples of single pixels between the frames.
        """
        mine = np.asarray(episodes)[self.drawing.envs]
        fresh = np.ones(len(mine), bool) if self._episodes is None else mine != self._episodes
        if fresh.any():
            self._work(None)
            self._end(fresh)
        self._motion.add(state)
        if fresh.any():
            self._begin(fresh, mine, int(t[-1]))
        size = luminance.shape[2], luminance.shape[3]
        between = None if further is None else self.drawing.between(further, *size)
        self._gaps.append(Gap(self.drawing.values(luminance, margin), np.array(t, np.int64), between))
        self._stamps.append(int(t[-1]))
        if fresh.any():
            self._work(fresh)
        elif self._stamps[-1] - self._stamps[0] >= BATCH_NS:
            self._work(None)
        else:
            return False
        return True

    def prepare(self) -> None:
        """Compiles and loads all kernels; where all motion is in closed form, finds where the picture will change."""
        envs, bodies = self._options.envs, self._scene.bodies
        start = np.zeros(1, np.int64)
        pose = [se3.IDENTITY if body.trajectory is None else body.trajectory.pose(start)[0] for body in bodies]
        poses = np.tile(np.array(pose, np.float64), (envs, 1, 1, 1))
        twists, episodes = np.zeros((*poses.shape[:3], 6)), np.zeros(envs, np.int32)
        self._motion.add(WorldState.dense(Header(0), start, poses, twists, episodes))
        self.drawing.scan(self._look, 0, self._options.horizon_ns, self._threshold)
        if any(body.trajectory is None for body in bodies):
            self.drawing.forget()
        self._motion.clear()
        two = np.arange(2)
        events = SampledSensor(1, self._parameters).sense(two * 0, two, np.array([1, 9], np.float32))
        Comparison(1).add(events, events, 1 << 60)
        sensor = EventSensor(1, self.drawing.each, len(self.drawing.envs), **self._ideal)
        light = np.ones((len(self.drawing.envs), 2, 1, self.drawing.each), np.float32)
        sensor.process(light, two, np.zeros(len(self.drawing.envs), np.int32))

    def finish(self) -> None:
        """Computes what is left, at the end of a run; `push` may begin another episode."""
        self._work(None)
        self._end(np.ones(len(self.drawing.envs), bool))
        self._episodes = None

    def units(self) -> Units:
        """Returns the errors of each pixel of each episode so far."""
        parts = [*self._units, *([] if self._episodes is None else [self._present(self.drawing.valid)])]
        return Units.joined(parts)

    def report(self) -> AuditReport:
        """Gives the estimate so far; before any frame there is none."""
        return AuditReport.of(self.units(), self.drawing.count, self._look.nonfinite)

    def _begin(self, fresh: np.ndarray, episodes: np.ndarray, stamp: int) -> None:
        """Draws pixels of environments that begin an episode."""
        self._episodes = episodes.copy()
        self.drawing.begin(fresh, episodes, self._look, stamp, self._options.horizon_ns, self._threshold)
        self._look.choose(self.drawing.pixels)

    def _work(self, fresh: np.ndarray | None) -> None:
        """Compares what has come since the last time; fresh: bool [A], environments whose first frame is the last."""
        if not self._gaps or self._episodes is None:
            return
        each, valid = self.drawing.each, self.drawing.valid
        begins = np.zeros(len(valid), bool) if fresh is None else np.repeat(fresh, each) & valid
        going = valid & ~begins & (np.isin(np.arange(len(valid)), self._last.pixel))
        last = int(self._gaps[-1].t[-1])
        run = [made.events(self._gaps, np.asarray(self._episodes, np.int32)) for made in self._made]
        start = self._last.only(going[self._last.pixel])
        if len(start.pixel):
            stamps = base_stamps(
                np.array([int(start.t[0]), *[s for s in self._stamps if s > start.t[0]]]), self._options.sampling.base
            )
            waveforms = (light.waveform for light in self._scene.lights)
            stamps = np.union1d(stamps, lamp_stamps(waveforms, int(start.t[0]), int(stamps.max(initial=0))))
            found = sample(self._look, start, stamps, self._options.sampling, self._threshold)
            truth = self._truth.sense(found.pixel, found.t, found.luminance)
            self._explain(start, found)
            for made, events in zip(self._made, run):
                made.comparison.add(self._only(events, going), truth, min(made.sensor.stamp, last))
            self._last = found.only(np.append(np.diff(found.pixel) != 0, True))
        if begins.any():
            which = np.flatnonzero(begins)
            at = np.full(len(which), last)
            first = Samples(which, at, *self._look(which, at))
            self._truth.begin(begins)
            self._truth.sense(which, at, first.luminance)
            self._last = Samples.joined([self._last, first])
        self._gaps, self._stamps = [], self._stamps[-1:]
        self._motion.forget()

    def _only(self, train: Train, which: np.ndarray) -> Train:
        kept = which[train[0]]
        return train[0][kept], train[1][kept], train[2][kept]

    def _explain(self, start: Samples, found: Samples) -> None:
        """Notes how much of the change of a pixel happened while one thing was seen, and of what the most was seen."""
        both = Samples.joined([start, found])
        same = np.diff(both.pixel) == 0
        step = np.abs(np.diff(log_level(both.luminance))) * same
        other = np.diff(both.instance) != 0
        pixel = both.pixel[1:]
        np.add.at(self._change[0], pixel[~other], step[~other])
        np.add.at(self._change[1], pixel[other], step[other])
        begins = np.flatnonzero(np.append(True, both.pixel[1:] != both.pixel[:-1]))
        number, most = both.pixel[begins], np.maximum.reduceat(np.append(0.0, step), begins)
        # The first place where the most is.
        at = np.flatnonzero(step == np.repeat(most, np.diff(np.append(begins, len(both.pixel))))[1:])[::-1]
        where = np.zeros(len(self._largest), np.int64)
        where[pixel[at]] = at
        more = most > self._largest[number]
        self._largest[number[more]] = most[more]
        self._instance[number[more]] = both.instance[1:][where[number[more]]]

    def _end(self, fresh: np.ndarray) -> None:
        """Keeps what was found of pixels whose episode has ended."""
        if self._episodes is None:
            return
        ended = np.repeat(fresh, self.drawing.each) & self.drawing.valid
        for made in self._made:
            if fresh.all():
                made.comparison.add(self._only(made.rest(), ended), NONE, made.sensor.stamp)
            made.comparison.finish(ended)
        self._units.append(self._present(ended))
        for made in self._made:
            made.comparison.clear(ended)
        self._change[:, ended], self._largest[ended], self._instance[ended] = 0.0, 0.0, -1
        self._last = self._last.only(~np.repeat(fresh, self.drawing.each)[self._last.pixel])
        self._motion.clear()

    def _present(self, which: np.ndarray) -> Units:
        """What is known of the pixels of the present episodes."""
        d, c, alone = self.drawing, self._made[0].comparison, self._made[-1].comparison
        x, y = d.pixels.reshape(-1, 2)[which].T
        env = np.repeat(d.envs, d.each)[which]
        own = self._change[0] / np.maximum(self._change.sum(0), 1e-300)
        return Units(
            env, x, y, d.chance[which], c.vp[which].copy(), c.unpaired[which].copy(), c.events[which].copy(),
            self._instance[which].copy(), own[which], alone.vp[which].copy(), alone.events[which].copy(),
        )  # fmt: skip
