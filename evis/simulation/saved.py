"""Holds the state of a simulation; of physics that cannot be copied it is what was done: that takes it through the run
once more."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Never, Protocol, Self, runtime_checkable

import numpy as np

from evis.runtime.node import Node
from evis.runtime.plan import Plan
from evis.simulation.errors import SimulationError
from evis.simulation.step import Step
from msgs.header import Header, Message
from msgs.world import Action

Kind = Mapping[str, tuple[str, Mapping[str, Any]]]
"""What a graph computes: node -> class, parameters."""


@dataclass(frozen=True)
class RunState:
    """Holds where a run of a graph is: what was done in it, as `evis.simulation.run.History` has it, and what its nodes
    go on from. kind: of the graph. k: number of the last keyframe. controls: in force there. last: the step that ends
    there. first: keyframe from which on all are made again. physics: a copy of physics at keyframe `first`, None = it
    takes the steps up to there again."""

    kind: Kind
    done: tuple[tuple[Any, ...], ...]
    size: int
    k: int
    over: bool
    controls: np.ndarray
    last: Step
    first: int
    physics: Any
    nodes: Mapping[str, Any]

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self  # nobody changes it

    def __reduce__(self) -> Never:
        raise SimulationError(
            "a state is not for files and other processes, and cannot be pickled; there, take the same actions again"
        )


@dataclass(frozen=True)
class SimulationState:
    """Holds the state of a simulation, which `Simulation.restore` goes on from, any number of times.

    stamp_ns: the simulated time [ns] at which it was taken.
    """

    stamp_ns: int
    _seed: int
    _seeds: Mapping[int, int]
    _run: RunState


def check_kind(given: Kind, own: Kind) -> None:
    """Raises SimulationError naming in what the graph of a state differs from that which is to go on from it."""

    def fails(why: str) -> SimulationError:
        return SimulationError(f"the state is of a simulation {why}; make one by the same arguments and outputs")

    if odd := sorted(set(given) ^ set(own)):
        how, here = ("with", "without") if odd[0] in given else ("without", "with")
        raise fails(f"{how} a node {odd[0]}, and this one is {here}")
    for name, (_, params) in given.items():
        _, mine = own[name]
        for key in sorted({*params, *mine}):
            if params.get(key) != mine.get(key):
                raise fails(f"with {key}={params.get(key)!r:.60} of {name}, and this one has {mine.get(key)!r:.60}")


class Physics(Protocol):
    """Defines what is asked of the node of physics: as PhysicsNode has it."""

    runtime: Any
    episodes: np.ndarray
    first: int

    def due(self) -> Mapping[str, int]:
        """Gives the stamps [ns] of the actions that the next step needs."""

    def step(self, inputs: Mapping[str, Message]) -> bool:
        """Moves on to the next keyframe."""

    def restart(self, envs: Sequence[int], seeds: Sequence[int]) -> None:
        """Begins environments anew at once."""

    def present(self) -> None:
        """Publishes the state of the stamp published last once more."""


@runtime_checkable
class Copied(Protocol):
    """Defines physics that can be copied, as PhysicsNode; a node of one's own need not."""

    def kept(self) -> Any:
        """Gives where physics is, as copies; None where it cannot be copied."""

    def go_on(self, state: Any) -> None:
        """Goes on from what `kept` gave, after a `rewind`."""


class Unheard:
    """Stands for the runtime of a node of whose messages, counts and words nobody is to hear."""

    plan = Plan("", "", "")
    """In which nobody works on what it publishes, so that nobody is asked about resets that have been before."""

    def wants(self, _node: Node, _port: str, _array: str = "") -> bool:
        """Tells that nobody reads anything."""
        return False

    def count(self, _node: Node, _name: str, _amount: float) -> None:
        """Counts nothing."""

    def diagnose(self, _node: Node, _level: str, _text: str) -> None:
        """Passes nothing on."""


def take_again(
    physics: Physics, done: Sequence[tuple[Any, ...]], last: int, start: np.ndarray, acts: bool
) -> np.ndarray:
    """Takes physics, which stands before keyframe 0, alone through what was done, up to keyframe `last`.

    Args:
        physics: the node; it publishes nothing, counts nothing and says nothing meanwhile, as it has done so before.
        done: what the caller did at keyframes up to `last`, in order.
        start: controls float64 [nu] that each environment begins with.
        acts: whether the caller's controls drive it.

    Returns the controls float64 [E, nu] in force there.
    """
    heard, physics.runtime = physics.runtime, Unheard()
    try:
        controls, k = np.tile(start, (len(physics.episodes), 1)), -1
        for entry in [*done, (last,)]:
            while k < entry[0]:
                due = physics.due() if acts else {}
                inputs = {port: Action(Header(stamp), controls=controls) for port, stamp in due.items()}
                before = physics.episodes.copy()
                physics.step(inputs)
                k += 1
                controls = np.where((physics.episodes != before)[:, None], start, controls)
            if len(entry) == 2:
                controls = entry[1]
            elif len(entry) == 3:
                physics.restart(entry[1], entry[2])
                k = max(k, 0)
                controls = np.array(controls)
                controls[entry[1]] = start
        return controls
    finally:
        physics.runtime = heard
