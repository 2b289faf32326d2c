"""Compiles the MuJoCo model of a scene and sets it up for steps on a fixed grid of time."""

from __future__ import annotations

from typing import Any

import mujoco

from evis.scene.errors import SceneError
from evis.scene.mjcf.compiling.delays import delayed
from evis.scene.mjcf.dynamics import compile_model
from evis.scene.model import Scene
from nodes.physics.dynamics.sleep import keep_awake, start_awake
from nodes.physics.precision.sub_steps import take_best_integrator
from nodes.physics.precision.tolerance import Tolerance

MAX_STEP_NS = 1_000_000
"""Longest sub-step [ns]; a model with a longer timestep is stepped in equal parts of it."""


def step_length(model_timestep: float, asked: float | None) -> int:
    """Computes the sub-step [ns] of a model with this timestep [s], unless another was asked for."""
    if asked is not None:
        return max(1, round(asked * 1e9))
    timestep = max(1, round(model_timestep * 1e9))
    parts = -(-timestep // MAX_STEP_NS)
    # One part more where only that makes whole ns of each: 2.5 ms are 4 x 625 us, and no whole number of 833,333 ns,
    # of which none would begin at a keyframe and an action.
    parts += bool(timestep % parts and not timestep % (parts + 1))
    return round(timestep / parts)


def prepared_model(scene: Scene, timestep: float | None, tolerance: Tolerance | None, deepest: bool) -> tuple[Any, int]:
    """Compiles the model of a scene and sets it up for steps on a grid; returns it and the sub-step [ns].

    timestep: sub-step [s]; None = the model's own. deepest: whether it has the sensor of `add_deepest`. Raises
    SceneError for a model that cannot be compiled or whose controls are delayed beside a tolerance.
    """
    model = compile_model(scene, deepest=deepest, step_of=lambda own: step_length(own, timestep) * 1e-9)
    if tolerance is not None and (name := delayed(model)) is not None:
        assert scene.mjcf is not None
        raise SceneError(
            f"{scene.mjcf.name}: actuator '{name}' has a delay, which is not kept in steps of different "
            "lengths; leave physics_tolerance out"
        )
    # MuJoCo would put a diverged state back to its start and go on as if nothing had happened.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    start_awake(model)
    if tolerance is not None or timestep is not None:
        # MuJoCo puts to sleep what was slow for ten steps: of a few us, what has just been let go.
        keep_awake(model)
    step_ns = step_length(model.opt.timestep, timestep)
    model.opt.timestep = step_ns * 1e-9
    if tolerance is not None:
        take_best_integrator(model)
    return model, step_ns
