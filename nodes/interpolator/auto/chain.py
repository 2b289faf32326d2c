"""Runs renderer, interpolator and sensor in a row for some gaps of a scene, to measure what a candidate really
costs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from evis.runtime.clock import keyframe_count, keyframe_stamp
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
from nodes.renderer.renderer import LAST

LONG_S = 0.1
"""Time that one round of a trial counts, about [s]; the same is done again until twice as much is counted, and the
shortest round is taken."""
MOST = 40
"""Gaps that a round counts at most; the one before them, in which memory is found, is left out."""
ROUNDS = 4
"""Most rounds, where a run has few gaps."""


class Chain:
    """Runs renderer, interpolator and sensor one after the other, as a graph does, on the scene itself, and times them.

    On a CPU every environment costs the same, so only one is run; on a GPU all run at once.
    """

    def __init__(self, setting: Setting, world: World | None = None) -> None:
        """Makes the nodes of a chain. world: the scene's motion, if it is known already."""
        self._setting = setting
        self._envs = setting.envs if setting.on_gpu else 1
        self._world = world
        how = {"margin": setting.margin, "device": setting.device, "threads": setting.threads}
        self._renderers = Renderers(setting, setting.camera, envs=self._envs, **how)
        self._interpolators: dict[tuple[str, int], Interpolator] = {}
        self._episode = 0

    def gaps(self, way: Way, seconds: float) -> int:
        """Finds how many gaps of a way are timed in a round; 0 where the run has too few.

        seconds: its expected run time [s per simulated s].
        """
        rate, _ = self._rate(way)
        wanted = math.ceil(LONG_S * rate / max(seconds, 1e-9))
        return max(min(wanted, MOST, keyframe_count(self._setting.duration_ns, rate) - 2), 0)

    def rounds(self, way: Way, seconds: float) -> int:
        """Finds how many rounds a way is timed for; the shortest one counts. seconds: as of gaps."""
        counted = self.gaps(way, seconds) * seconds / self._rate(way)[0]
        return min(math.ceil(2 * LONG_S / max(counted, 1e-9)), ROUNDS)

    def takes(self, way: Way, seconds: float) -> float:
        """Estimates how long a trial takes [s]: the gaps that count, two more in every round, and one at first."""
        gaps, rounds = self.gaps(way, seconds), self.rounds(way, seconds)
        return (rounds * (gaps + 2) + 1) * seconds / self._rate(way)[0]

    def seconds(self, way: Way, seconds: float) -> float:
        """Measures the run time of a way [s per simulated s], physics not included. seconds: its expected run time."""
        found = [self.gap(way, self.gaps(way, seconds)) for _ in range(self.rounds(way, seconds))]
        # Trials differ in K, and the frames of many environments are large.
        self._interpolators.clear()
        return min(found) * self._rate(way)[0] * self._setting.envs

    def gap(self, way: Way, gaps: int) -> float:
        """Measures the mean time of a gap [s] of one environment, with its keyframe and its events, over the last gaps
        of the run; the one before them is left out. gaps: how many; 0 = the run's only one."""
        s = self._setting
        method, (rate, k) = way[0], self._rate(way)
        if self._world is None:
            self._world = World(s.scene, s.duration_ns, s.seed)
        samples = s.samples(method)
        renderer, interpolator = self._renderers.before(method), self._interpolator(method, k, samples)
        first = keyframe_count(self._world.end_ns, rate) - 2 - gaps
        stamps = [keyframe_stamp(first + n, rate) for n in range(gaps + 2)]
        self._episode += 1
        took = self._round(renderer, interpolator, reads(method), s.margin * samples, stamps, self._episode)
        return float(np.mean(took[min(gaps, 1) + 1 :])) / self._envs

    def _interpolator(self, method: str, k: int, samples: int) -> Interpolator:
        """Gives an interpolator that is warmed up: what is built in the first gap is not counted as cost of a run."""
        if (method, k) not in self._interpolators:
            s, margin = self._setting, self._setting.margin * samples
            made = self._interpolators[method, k] = make_interpolator(s, s.scene, s.camera, method, k)
            size = (s.camera.height * samples + 2 * margin, s.camera.width * samples + 2 * margin)
            made.warm_up_for(self._envs, *size, margin)
        return self._interpolators[method, k]

    def _round(
        self,
        renderer: Any,
        interpolator: Interpolator,
        needs: frozenset[str],
        margin: int,
        stamps: list[int],
        episode: int,
    ) -> list[float]:
        """Measures the time [s] of each keyframe at these stamps; all but the first include the gap before it."""
        s, envs, world = self._setting, self._envs, self._world
        assert world is not None
        sensor = EventSensor(s.camera.height, s.camera.width, envs, device=s.device, **s.sensor)
        episodes = np.full(envs, episode, np.int32)
        outputs = {LIGHT} | (needs & {"depth", "motion"})
        last, took = stamps[0], list[float]()
        for stamp in stamps:
            poses = np.repeat(world.poses(stamp), envs, 0)
            states = None
            if "state" in needs:
                t, *both = world.states(last, stamp)
                states = States(t, *(np.repeat(values, envs, 0) for values in both))
            began = s.clock()
            images = copied(s, draw(s, renderer, poses, LAST if took else None, outputs, stamp))
            t, frames = interpolator.push(
                stamp, episodes, images[LIGHT], images.get("depth"), images.get("motion"), margin, frames_for(s), states
            )
            sensor.process(frames, t, episodes)
            took.append(s.clock() - began)
            last = stamp
        return took

    def _rate(self, way: Way) -> tuple[float, int]:
        """Gives keyframes per second and K; dense rendering has a keyframe for every frame."""
        method, rate, k = way
        return (rate * k, 1) if method == "none" else (rate, k)
