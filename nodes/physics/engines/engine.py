"""Defines the interface of a physics engine: what moves the bodies of a scene from one stamp to the next.

`prescribed.py` computes motion in closed form, `mujoco_engine.py` integrates that of an MJCF model; `separate.py` makes
one engine of several. `choice.py` makes the one that a run asks for, and `environments/` moves environments by it
that are reset at different times.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, TypeGuard

import numpy as np

from nodes.physics.actuators import Actuators
from nodes.physics.interval import Interval


class Engine(Protocol):
    """Moves the bodies of a scene in E environments.

    An environment that diverges is put back to its start, and Interval.faults says so.
    """

    actuators: Actuators
    """Of each environment; none where nothing can be driven."""

    step_ns: int
    """Length of a step [ns], of several models the longest; 0 where motion is in closed form."""

    def start(self) -> Interval:
        """Gives the state at stamp 0, S = 1."""

    def advance(self, to_ns: int, controls: np.ndarray | None = None) -> Interval:
        """Moves on to stamp `to_ns` [ns] under controls float64 [E, nu] (None: as before)."""

    def rewind(self, seed: int) -> None:
        """Goes back to stamp 0, as it is made with this seed."""

    def leave(self, env: int) -> None:
        """Leaves an environment where it is from now on, for nobody wants its states any more."""

    def missed(self) -> int:
        """Counts the steps that were less exact than was asked for."""

    def anew(self, envs: Sequence[int], seeds: Sequence[int | None], numbers: Sequence[int]) -> Engine:
        """Makes an engine of these environments alone, at their start and stamp 0.

        seeds: of each, None = its own of now. numbers: how often each has begun anew since it got its seed.
        """

    def part(self, envs: Sequence[int]) -> Engine:
        """Makes an engine of these environments alone, for `restore`: it stands nowhere yet."""

    def state(self) -> Any:
        """Gives where its environments are, as copies, or None where that cannot be copied."""

    def restore(self, state: Any) -> None:
        """Goes on from what `state` gave of as many environments of the same scene, as if nothing had happened since;
        any number of times."""


class Preparing(Engine, Protocol):
    """Defines an engine that steps its environments in one batch with those of other engines."""

    def advance(self, to_ns: int, controls: np.ndarray | None = None, then_ns: int | None = None) -> Interval:
        """Moves on as of Engine.

        then_ns: stamp [ns] to which the steps after it begin, as of `foresee` and `begin`, once nothing of this one
        needs the batch any more; None = none do. No other engine may share the batch then.
        """

    def prepare(self, to_ns: int, controls: np.ndarray | None = None) -> None:
        """Takes the controls up to a stamp, and requests the steps that engines which belong together take at once;
        `advance` to it, without controls, then waits for that.
        """

    def foresee(self, to_ns: int) -> None:
        """Asks for the steps to a stamp under the present controls, before it is known whether they will be wanted."""

    def begin(self) -> None:
        """Begins the steps asked for by `foresee`, of this engine and of those that share a batch with it, while others
        work.
        """


def prepares(engine: Engine) -> TypeGuard[Preparing]:
    """Tells whether an engine is a Preparing one, without a look at all methods of the protocol as isinstance has."""
    return hasattr(engine, "prepare")
