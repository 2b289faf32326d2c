"""Defines what an observation of an agent is: one part, or several by name, each made of what a simulation gives."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box

Observed = Any
"""An array [E, ...], or a dict of such."""


@dataclass(frozen=True)
class Setting:
    """Describes what an observation is made from. names: of the bodies. joints: numbers of positions and velocities.

    action: the space of an action. apart: steps from one output of the camera to the next, more than 1 where it has a
    lower rate than the others.
    """

    envs: int
    height: int
    width: int
    rate: float
    names: tuple[str, ...]
    joints: tuple[int, int]
    action: Box
    apart: int = 1


@dataclass(frozen=True)
class Moment:
    """Holds what a step gave, for all environments. start_ns, stamp_ns: int64 [E], the interval of each.

    actions: float32 [E, nu] of the step as the agent gave them; after a reset those nearest to zero. fresh: bool [E],
    environments that the step is of: all, but after a reset of some only these.
    """

    step: Any
    start_ns: np.ndarray
    stamp_ns: np.ndarray
    actions: np.ndarray
    fresh: np.ndarray

    def camera(self, name: str) -> Any:
        """Returns the outputs of a camera, the first one if it has no name."""
        return self.step.cameras[name] if name else self.step


class Observation:
    """Makes one part of an observation. camera: which one it looks through; "" = the first."""

    camera: str = ""
    OUTPUT: ClassVar[str] = "events"
    """What the simulation must give."""
    ARGUMENTS: ClassVar[Mapping[str, Any]] = {}
    """Arguments of the launch file without which it does not."""

    @property
    def output(self) -> str:
        """Returns the name of the output of the simulation."""
        return f"{self.camera}.{self.OUTPUT}" if self.camera else self.OUTPUT

    def begin(self, setting: Setting) -> Box:
        """Takes note of what is observed, and returns the space of one environment. Raises ValueError."""
        raise NotImplementedError

    def forget(self, envs: np.ndarray) -> None:
        """Drops what was kept of environments that start anew; envs: their numbers."""

    def state(self) -> Any:
        """Returns a copy of what is kept of earlier steps: all attributes, unless a subclass knows which."""
        return copy.deepcopy(vars(self))

    def restore(self, state: Any) -> None:
        """Goes on from what `state` gave, which stays as it is."""
        vars(self).update(copy.deepcopy(state))

    def values(self, moment: Moment) -> np.ndarray:
        """Returns the values after a step, [E, ...] of the space's dtype, an array of its own.

        Rows of environments that are not `moment.fresh` are not used; what is kept of them has to stay as it is.
        """
        raise NotImplementedError


def by_name(observation: Any) -> dict[str, Observation]:
    """Names the parts of an observation; one alone has the name ''. Raises ValueError for what is no observation."""
    if isinstance(observation, Observation):
        return {"": observation}
    if not isinstance(observation, Mapping) or not all(
        isinstance(name, str) and name and isinstance(part, Observation) for name, part in observation.items()
    ):
        raise ValueError(f"observation is {observation!r:.80}; several are observations by name, no name being empty")
    if not observation:
        raise ValueError("nothing is observed; give one observation, or several by name")
    return dict(observation)


def needs_camera(part: Observation) -> bool:
    """Tells whether an observation is made through a camera: the state is not, and the graph may have none then."""
    return part.OUTPUT != "state"


def is_of_events(part: Observation) -> bool:
    """Tells whether an observation is made of events."""
    return part.OUTPUT == "events"


def row(observed: Observed, env: int) -> Observed:
    """Returns the observation of one environment."""
    return {name: value[env] for name, value in observed.items()} if isinstance(observed, dict) else observed[env]
