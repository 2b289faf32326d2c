"""Defines the errors and warnings that a simulation raises."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from evis.simulation.step import Step


class SimulationError(ValueError):
    """Reports in one line what is wrong with what a Simulation was asked for, or with its run, and what to do."""


class Diverged(SimulationError):
    """Reports that environments have diverged and begin their next episode; the simulation can go on.

    step: what the step gave all the same, in which these environments are at their start. envs: which they are.
    """

    def __init__(self, text: str, step: Step, envs: list[int]) -> None:
        super().__init__(text)
        self.step = step
        self.envs = envs


class SimulationWarning(UserWarning):
    """Passes on what a node warns of: a light that flickers faster than frames, a body about to diverge."""
