"""Chooses the stepper that takes the steps of several environments in one batch: MuJoCo's threads or MuJoCo Warp."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from evis.scene.model import Scene
from nodes.physics.dynamics.batch.mujoco_threads import MujocoThreads
from nodes.physics.dynamics.batch.stepped_states import SteppedStates
from nodes.physics.precision.tolerance import Tolerance


class BatchStepper(Protocol):
    """Takes the steps of environments that were requested in one batch; row: number of an environment in it."""

    def put(self, row: int, data: Any) -> None:
        """Sets the state of an environment to that of an MjData."""

    def request(self, rows: Sequence[int], grid: range) -> None:
        """Requests steps of environments, one from each time of `grid` [ns], from the state that was put, or from that
        after their last steps."""

    def control(self, rows: Sequence[int], values: np.ndarray) -> None:
        """Sets the controls [n, nu] of environments whose next steps are taken from the state after their last ones,
        and wakes their bodies."""

    def begin(self, keep: bool = False) -> None:
        """Begins to take the requested steps while others work; no other call needs to know of it. keep: what `result`
        gave last stays as it is meanwhile, until the next one."""

    def cancel(self, rows: Sequence[int]) -> None:
        """Puts environments to where they were when their steps were requested, for whoever asked for the result has
        no use for it; does not wait for steps that have begun."""

    def result(self, rows: Sequence[int]) -> SteppedStates:
        """Gives the states of environments after the requested steps, as many of each, in the order of `rows`."""

    def write_state(self, row: int, data: Any) -> None:
        """Writes the state after the steps taken last into an MjData."""

    def write_state_before(self, row: int, data: Any) -> None:
        """Writes the state before the steps whose result was given last into an MjData."""


def why_not_batched(scene: Scene, tolerance: Tolerance | None) -> str:
    """Says why environments cannot take their steps in one batch, "" where they can."""
    if tolerance is not None:
        return "physics_tolerance cuts the steps of each environment by itself"
    if any(body.follows is not None for body in scene.bodies):
        return "cameras or lights of the model follow a body"
    return ""


def make_batch_stepper(model: Any, envs: int, threads: int, warp: str | None) -> BatchStepper:
    """Makes the stepper of the environments of a model: MuJoCo's threads, or MuJoCo Warp on the device `warp`.

    Raises Unsupported for a model that MuJoCo Warp cannot take.
    """
    if warp is None:
        return MujocoThreads(model, envs, threads)
    from nodes.physics.dynamics.batch.warp_worlds import WarpWorlds

    return WarpWorlds(model, envs, warp)
