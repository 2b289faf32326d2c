"""Computes a scene's motion over a run once, so that every method and rate is shown the very same world."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from evis.geometry.interpolate import state_at
from evis.scene.model import Scene
from nodes.physics.engines.prescribed import PrescribedStates
from nodes.physics.interval import grid_inside

STEP_NS = 1_000_000
"""Interval that a dynamics engine is asked for at once; it takes sub-steps of its own inside."""


class World:
    """Computes the states of one environment from t = 0 to duration_ns: exact for prescribed motion, at sub-steps for
    dynamics."""

    def __init__(self, scene: Scene, duration_ns: int, seed: int = 0) -> None:
        self.scene, self.end_ns = scene, duration_ns
        self._at = _in_steps(scene, duration_ns, seed) if scene.dynamic else PrescribedStates(scene).at

    def states(self, start_ns: int, end_ns: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gives what a /state message holds of an interval: t int64 [S] ns, pose [1, S, N, 7], twist [1, S, N, 6]."""
        inner = np.array([start_ns, *grid_inside(start_ns, end_ns, self.scene.timestep_ns), end_ns])
        t = np.unique(inner)
        return t, *self.states_at(t)

    def states_at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gives pose [1, S, N, 7] and twist [1, S, N, 6] at times int64 [S] ns."""
        pose, twist = self._at(t)
        return pose[None], twist[None]

    def poses(self, stamp_ns: int) -> np.ndarray:
        """Gives body poses float64 [1, N, 7] at one stamp."""
        return self._at(np.array([stamp_ns]))[0]


def _in_steps(scene: Scene, duration_ns: int, seed: int) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Makes what gives poses [S, N, 7] and twists [S, N, 6] at times int64 [S] ns, from sub-steps of a dynamics
    engine."""
    from nodes.physics.engines.mujoco_engine import MujocoEngine

    engine = MujocoEngine(scene, seed, 1)
    parts = [engine.start()]
    for stamp in (*range(STEP_NS, duration_ns, STEP_NS), duration_ns):
        parts.append(engine.advance(stamp))
    if any(p.faults for p in parts):
        raise ValueError(f"scene {scene.name} diverged within {duration_ns * 1e-9:g} s")
    # Each interval begins with the last state of the one before.
    t = np.concatenate([parts[0].t, *(p.t[1:] for p in parts[1:])])
    pose = np.concatenate([parts[0].pose[0], *(p.pose[0, 1:] for p in parts[1:])])
    twist = np.concatenate([parts[0].twist[0], *(p.twist[0, 1:] for p in parts[1:])])

    def at(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        poses, twists = state_at(times, t, pose[None], twist[None])
        return poses[0], twists[0]

    return at
