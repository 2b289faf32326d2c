"""A scene's motion over a run, worked out once, so that every method and rate is shown the very same world."""

from __future__ import annotations

import numpy as np

from evis.geometry.interpolate import state_at
from evis.scene.model import Scene
from nodes.physics.interval import Engine, grid_inside

STEP_NS = 1_000_000
"""Interval that a dynamics engine is asked for at once; it takes sub-steps of its own inside."""


class World:
    """Computes the states of one environment from t = 0 to duration_ns: exact for prescribed motion, at sub-steps for
    dynamics."""

    def __init__(self, scene: Scene, duration_ns: int, seed: int = 0) -> None:
        engine: Engine
        if scene.dynamic:
            from nodes.physics.mujoco_engine import MujocoEngine

            engine = MujocoEngine(scene, seed, 1)
        else:
            from nodes.physics.prescribed import PrescribedEngine

            engine = PrescribedEngine(scene, 1)
        parts = [engine.start()]
        step_ns = STEP_NS if scene.dynamic else duration_ns
        for stamp in (*range(step_ns, duration_ns, step_ns), duration_ns):
            parts.append(engine.advance(stamp))
        # Each interval begins with the last state of the one before.
        self.scene = scene
        self.t = np.concatenate([parts[0].t, *(p.t[1:] for p in parts[1:])])
        self.pose = np.concatenate([parts[0].pose, *(p.pose[:, 1:] for p in parts[1:])], axis=1)
        self.twist = np.concatenate([parts[0].twist, *(p.twist[:, 1:] for p in parts[1:])], axis=1)
        if scene.dynamic and any(p.faults for p in parts):
            raise ValueError(f"scene {scene.name} diverged within {duration_ns * 1e-9:g} s")

    def states(self, start_ns: int, end_ns: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gives what a /state message holds of an interval: t int64 [S] ns, pose [1, S, N, 7], twist [1, S, N, 6]."""
        inner = np.array([start_ns, *grid_inside(start_ns, end_ns, self.scene.timestep_ns), end_ns])
        t = np.unique(inner)
        pose, twist = state_at(t, self.t, self.pose, self.twist)
        return t, pose, twist

    def poses(self, stamp_ns: int) -> np.ndarray:
        """Gives body poses float64 [1, N, 7] at one stamp."""
        return state_at(stamp_ns, self.t, self.pose, self.twist)[0]
