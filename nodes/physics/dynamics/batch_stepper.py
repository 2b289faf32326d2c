"""Chooses what takes the steps of several environments of a model in one batch: MuJoCo's threads or MuJoCo Warp."""

from __future__ import annotations

from typing import Any, Protocol

from evis.scene.model import Scene
from nodes.physics.dynamics.mujoco_threads import MujocoThreads
from nodes.physics.dynamics.stepped_states import CalmTest, SteppedStates
from nodes.physics.precision.tolerance import Tolerance


class BatchStepper(Protocol):
    """Takes the steps of environments that were requested in one batch; row: number of an environment in it."""

    def request(self, row: int, data: Any, grid: range) -> None:
        """Requests steps of an environment from the state in its MjData, one from each time of `grid` [ns]."""

    def result(self, row: int) -> SteppedStates | None:
        """Gives the states after the requested steps; None where MuJoCo must take them, with a check of each state."""

    def write_state(self, row: int, data: Any) -> None:
        """Writes the state after the last of these steps into an MjData."""


def why_not_batched(scene: Scene, tolerance: Tolerance | None) -> str:
    """Says why environments cannot take their steps in one batch, "" where they can."""
    if tolerance is not None:
        return "physics_tolerance cuts the steps of each environment by itself"
    if any(body.follows is not None for body in scene.bodies):
        return "cameras or lights of the model follow a body"
    return ""


def make_batch_stepper(model: Any, envs: int, threads: int, warp: str | None, calm: CalmTest) -> BatchStepper:
    """Makes what steps the environments of a model: MuJoCo's threads, or MuJoCo Warp on the device `warp`.

    calm: see CalmTest. Raises Unsupported for a model that MuJoCo Warp cannot take.
    """
    if warp is None:
        return MujocoThreads(model, envs, threads, calm)
    from nodes.physics.dynamics.warp_worlds import WarpWorlds

    return WarpWorlds(model, envs, warp, calm)
