"""Which environments of a model take their steps together, and by what."""

from __future__ import annotations

from typing import Any, Protocol

from evis.scene.model import Scene
from nodes.physics.dynamics.side_by_side import SideBySide
from nodes.physics.dynamics.strides import Judge, Strode
from nodes.physics.precision.tolerance import Tolerance


class Together(Protocol):
    """Takes the steps of environments that were asked for, all at once; each is called by its row."""

    def ask(self, row: int, data: Any, grid: range) -> None:
        """Asks for steps of an environment, from its MjData on, that start at the times of `grid` [ns]."""

    def trace(self, row: int) -> Strode | None:
        """Gives what they left; None where MuJoCo must take them, with a look at each state."""

    def bring(self, row: int, data: Any) -> None:
        """Writes the state after them into an MjData."""


def stepped_apart(scene: Scene, tolerance: Tolerance | None) -> str:
    """Says why environments cannot take their steps together, "" where they can."""
    if tolerance is not None:
        return "physics_tolerance cuts the steps of each environment by itself"
    if any(body.follows is not None for body in scene.bodies):
        return "cameras or lights of the model follow a body"
    return ""


def together(model: Any, envs: int, threads: int, warp: str | None, judge: Judge) -> Together:
    """Makes what steps environments of a model: MuJoCo's threads, or MuJoCo Warp on the device `warp`.

    judge: tells which of them have nothing to tell. Raises Unsupported for a model that MuJoCo Warp cannot take.
    """
    if warp is None:
        return SideBySide(model, envs, threads, judge)
    from nodes.physics.dynamics.warp_worlds import WarpWorlds

    return WarpWorlds(model, envs, warp, judge)
