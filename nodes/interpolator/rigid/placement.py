"""Computes where the bodies are at the sub-frames: in closed form where that is known, else between the sub-steps of
/state."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise

import numpy as np
import warp as wp

from evis.geometry.interpolate import NS as SECONDS
from evis.geometry.interpolate import step_before
from evis.geometry.interpolate_kernels import place_between
from evis.gpu.exchange import cpu_array
from evis.runtime.clock import NS, keyframe_stamp, subframe_stamps
from evis.runtime.workers import Workers, edges_of
from evis.scene.model import Scene, Trajectory
from evis.scene.motion import Prescribed
from evis.scene.prescribed_batch import PrescribedBatch
from nodes.interpolator.keyframe import States
from nodes.renderer.geometry.poses import POSE_BYTES, of_bodies

AHEAD = 1 << 17
"""Bytes of poses that are computed ahead at once, at most, where FEWEST gaps have fewer."""
FEWEST = 2
"""Gaps that are computed ahead at least: a call for one takes hardly less time."""
APART = 16
"""Fewest environments that are worth a thread."""


class Placement:
    """Works out the poses of a scene's bodies at any time of a gap. Only those that may move, `movers` int64 [M], cost
    anything."""

    def __init__(self, scene: Scene, worlds: Sequence[Scene] = (), envs: int = 1, threads: int = 1) -> None:
        """Finds which bodies move, and how. worlds: the scene of each environment, where bodies do not move alike in
        all; the same ones move in all. threads: that share the `envs` environments, where physics moves the bodies."""
        self.worlds = worlds
        paths = [body.trajectory for body in scene.bodies]
        self.movers = np.array([n for n, path in enumerate(paths) if path is None or not path.is_static()], np.int64)
        moving = [(m, paths[n]) for m, n in enumerate(self.movers.tolist())]
        # Their places among the movers.
        self._driven = np.array([m for m, path in moving if path is None], np.int64)
        together = [m for m, path in moving if isinstance(path, Prescribed)]
        self._together = np.array(together, np.int64)
        # One world for all environments, or one for each; those of all worlds together, one world after the other.
        self._worlds = worlds or (scene,)
        self._prescribed = PrescribedBatch([path for world in self._worlds for path in self._paths(world, together)])
        self._alone: list[tuple[int, Trajectory]] = [
            (m, path) for m, path in moving if path is not None and not isinstance(path, Prescribed)
        ]
        # Of the gaps that are expected next, by the number of their stamps and then by these: [K - 1, 1 or E, bodies,
        # 7].
        self._ahead: dict[int, dict[bytes, np.ndarray]] = {}
        # How many gaps are computed ahead next, by the number of their stamps.
        self._gaps: dict[int, int] = {}
        self._parts = max(1, min(threads, envs // APART)) if len(self._driven) else 1
        self._pool = Workers(self._parts, "placement") if self._parts > 1 else None

    def _paths(self, world: Scene, which: list[int]) -> list[Prescribed]:
        """Makes the paths of the movers of these numbers. Raises ValueError where one is not in closed form in this
        world."""
        paths = [world.bodies[self.movers[m]].trajectory for m in which]
        known = [path for path in paths if isinstance(path, Prescribed)]
        if len(known) < len(paths):
            raise ValueError(f"scene {world.name}: worlds side by side must have the same bodies in closed form")
        return known

    def _known(self, stamps: np.ndarray) -> np.ndarray:
        """Computes the poses in closed form float64 [K, 1 or E, bodies, 7] at stamps int64 [K] ns."""
        poses = self._prescribed.poses_at(stamps)
        return poses.reshape(len(stamps), len(self._worlds), len(self._together), 7)

    def at(self, stamps: np.ndarray, states: States) -> np.ndarray:
        """Gives poses float64 [K, E, N, 7] at stamps int64 [K] ns within the interval of `states`; the last stamp is
        its end.

        Raises ValueError where the states do not reach back to the first stamp.
        """
        poses = np.repeat(states.end_pose[None], len(stamps), axis=0)
        poses[:, :, self.movers] = self.moved(stamps, states)
        return poses

    def moved(self, stamps: np.ndarray, states: States, envs: np.ndarray | None = None) -> np.ndarray:
        """Gives poses of the `movers` alone, as `at` does, float64 [K, E, M, 7].

        envs: int64 [n], the environments that `states` are of; None = all.
        """
        last = of_bodies(states.end_pose, self.movers)
        poses = np.empty((len(stamps), *last.shape))
        # The others are written below.
        poses[-1 if len(self._together) == len(self.movers) else slice(None)] = last
        if len(stamps) == 1:
            return poses
        if len(self._together):
            known = self._ahead.get(len(stamps), {}).get(stamps[:-1].tobytes())
            known = self._known(stamps[:-1]) if known is None else known
            # Worlds that move alike have one row in common.
            known = known if envs is None or known.shape[1] == 1 else known[:, envs]
            poses[:-1, :, self._together] = known
        for m, path in self._alone:
            poses[:-1, :, m] = path.pose(stamps[:-1])[:, None]
        if len(self._driven):
            self._drive(stamps[:-1], states, poses[:-1])
        return poses

    def expect(self, stamps: np.ndarray) -> None:
        """Computes ahead, while a device works on the gap with these stamps int64 [K], the poses of those of the same
        length that come right after it: of 2, 4, 8, ... gaps, for many times take hardly longer than a few."""
        if not len(self._together) or len(stamps) < 2:
            return
        start, count = int(stamps[-1]), len(stamps)
        # The gap began where its first frame is a K-th of it after.
        length = round((start - int(stamps[0])) * count / (count - 1))
        one = len(self._worlds) * len(self._together) * (count - 1) * POSE_BYTES
        (following,) = _sub_frames(_next_gaps(start, length, 1)[:1], count)
        if following.tobytes() in self._ahead.get(count, {}):
            return
        gaps = self._gaps.get(count, FEWEST)
        nexts = _sub_frames(_next_gaps(start, length, gaps), count)
        self._gaps[count] = max(min(2 * gaps, AHEAD // one), FEWEST)
        parts = np.split(self._known(nexts.reshape(-1)), len(nexts))
        self._ahead[count] = {t.tobytes(): part for t, part in zip(nexts, parts)}

    @property
    def in_closed_form(self) -> bool:
        """Tells whether all that moves is in closed form, one scene's in all environments."""
        return len(self._worlds) == 1 and len(self._together) == len(self.movers)

    def closed_form(self, stamps: np.ndarray) -> np.ndarray:
        """Computes poses of the movers, all `in_closed_form`: float64 [G, K, M, 7], at stamps int64 [G, K] ns."""
        return self._prescribed.poses_at(stamps.reshape(-1)).reshape(*stamps.shape, len(self.movers), 7)

    def foresee(self, stamps: np.ndarray) -> None:
        """Computes at once the poses of several gaps with sub-frames at stamps int64 [gaps, K] ns, for `moved`."""
        if len(self._together) and stamps.shape[1] > 1:
            parts = np.split(self._known(stamps[:, :-1].reshape(-1)), len(stamps))
            self._ahead[stamps.shape[1]] = {t[:-1].tobytes(): part for t, part in zip(stamps, parts)}

    def _drive(self, stamps: np.ndarray, states: States, poses: np.ndarray) -> None:
        """Writes the poses of those that physics moves in this interval, between the sub-steps about the stamps; poses
        [.., E, M, 7]."""
        place = states.places(self.movers[self._driven])
        columns, place = self._driven[place >= 0], place[place >= 0]
        before = step_before(stamps, states.t)
        if not len(columns):
            return
        length = np.diff(states.t)[before] if len(states.t) > 1 else np.ones(len(stamps))
        given = [np.ascontiguousarray(values, np.float64) for values in (states.pose, states.twist)]
        given += [values.astype(np.int32) for values in (place, columns, before)]
        given += [(stamps - states.t[before]) / length, length * SECONDS]
        arrays = [cpu_array(values) for values in (*given, poses)]

        def work(ends: tuple[int, int]) -> None:
            wp.launch(place_between, ends[1] - ends[0], [ends[0], *arrays], device="cpu")

        parts = min(self._parts, poses.shape[1])
        edges = edges_of(poses.shape[1], parts)
        for _done in (map if self._pool is None else self._pool.map)(work, pairwise(edges)):
            pass


def _next_gaps(start: int, length: int, count: int) -> list[tuple[int, int]]:
    """Predicts first and last stamp of `count` gaps that may come after one of this length [ns] that ends at `start`.

    Where its rate cannot be told, of the next one alone, a nanosecond shorter and longer, for stamps are rounded.
    """
    rate = _rate(length)
    k = round(start * rate / NS)
    # A gap's length that was told from rounded sub-frames may be off by a nanosecond.
    if not rate or keyframe_stamp(k, rate) != start or abs(keyframe_stamp(k - 1, rate) - start + length) > 1:
        return [(start, start + length + off) for off in (-1, 0, 1)]
    return list(pairwise(keyframe_stamp(k + i, rate) for i in range(count + 1)))


def _sub_frames(gaps: list[tuple[int, int]], count: int) -> np.ndarray:
    """Gives the stamps of the sub-frames of gaps without those at their ends, int64 [gaps, count - 1]."""
    ends = np.array(gaps, np.int64)
    return subframe_stamps(ends[:, :1], ends[:, 1:], count)[:, :-1]


@lru_cache
def _rate(length: int) -> float:
    """Finds the simplest rate [Hz] of gaps of a length [ns]; 0 of very long ones."""
    return float(Fraction(NS, length).limit_denominator(1000))
