"""Moves environments whose worlds move differently: an engine for each, and their states as one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from nodes.physics.actuators import check_controls
from nodes.physics.engines.engine import Engine, prepares
from nodes.physics.interval import Contacts, Interval


class SeparateEngines:
    """Moves environment k by engine k, an engine of one environment, as each would by itself."""

    def __init__(self, engines: Sequence[Engine]) -> None:
        """Raises ValueError where the engines have not the same actuators."""
        self.engines = list(engines)
        self.actuators = self.engines[0].actuators
        self.step_ns = max(engine.step_ns for engine in self.engines)
        for env, engine in enumerate(self.engines):
            if engine.actuators.count != self.actuators.count:
                raise ValueError(
                    f"environment {env} has {engine.actuators.count} actuators, environment 0 has "
                    f"{self.actuators.count}; "
                    "worlds side by side need the same ones"
                )

    def start(self) -> Interval:
        """Gives the state at stamp 0."""
        return merged([engine.start() for engine in self.engines])

    def prepare(self, to_ns: int, controls: np.ndarray | None = None) -> None:
        """Hands the controls on. Raises ValueError for controls of a wrong shape or not finite."""
        if controls is not None:
            check_controls(controls, len(self.engines), self.actuators)
        for k, engine in enumerate(self.engines):
            if prepares(engine):
                engine.prepare(to_ns, None if controls is None else controls[k : k + 1])

    def foresee(self, to_ns: int) -> None:
        """Does nothing: each engine moves one environment, and waits until it is to."""

    def begin(self) -> None:
        """Does nothing, for `foresee` asks for no steps here."""

    def advance(self, to_ns: int, controls: np.ndarray | None = None, then_ns: int | None = None) -> Interval:
        """Gives the states up to a stamp; nothing begins ahead, as of `foresee`.

        Raises ValueError for controls of a wrong shape or not finite.
        """
        if controls is not None:
            self.prepare(to_ns, controls)
        return merged([engine.advance(to_ns) for engine in self.engines])

    def rewind(self, seed: int) -> None:
        """Goes back to stamp 0, engine k with seed + k."""
        for k, engine in enumerate(self.engines):
            engine.rewind(seed + k)

    def leave(self, env: int) -> None:
        """Leaves an environment where it is from now on."""
        self.engines[env].leave(0)

    def missed(self) -> int:
        """Counts the steps that were less exact than was asked for."""
        return sum(engine.missed() for engine in self.engines)

    def anew(self, envs: Sequence[int], seeds: Sequence[int | None], numbers: Sequence[int]) -> Engine:
        """Makes an engine of these environments alone, at their start and stamp 0, as Engine.anew does."""
        made = [self.engines[k].anew([0], [seed], [number]) for k, seed, number in zip(envs, seeds, numbers)]
        return made[0] if len(made) == 1 else SeparateEngines(made)

    def part(self, envs: Sequence[int]) -> Engine:
        """Makes an engine of these environments alone, for `restore`."""
        made = [self.engines[k].part([0]) for k in envs]
        return made[0] if len(made) == 1 else SeparateEngines(made)

    def state(self) -> list[Any] | None:
        """Gives where each environment is, as copies; None where an engine cannot tell."""
        states = [engine.state() for engine in self.engines]
        return None if any(state is None for state in states) else states

    def restore(self, state: Sequence[Any]) -> None:
        """Goes on from what `state` gave."""
        for engine, own in zip(self.engines, state, strict=True):
            engine.restore(own)


def merged(parts: Sequence[Interval]) -> Interval:
    """Puts the intervals of environments of one each together, environment k from part k.

    A body that moves in one of them is among the moving ones of all. Raises ValueError where the times differ.
    """
    t = max((part.t for part in parts), key=len)
    moving = np.unique(np.concatenate([part.moving for part in parts])).astype(np.int32)
    end = np.concatenate([part.end_pose for part in parts])
    pose = np.repeat(end[:, None, moving], len(t), axis=1)
    twist = np.zeros((*pose.shape[:3], 6))
    for env, part in enumerate(parts):
        if not len(part.moving):  # nothing moves, so there may be no sub-steps
            continue
        if not np.array_equal(part.t, t):
            raise ValueError(f"environment {env} has other sub-steps than others; worlds side by side need the same")
        columns = np.searchsorted(moving, part.moving)
        pose[env, :, columns] = np.swapaxes(part.moving_pose[0], 0, 1)
        twist[env, :, columns] = np.swapaxes(part.moving_twist[0], 0, 1)
    result = Interval(t, end, moving, pose, twist)
    result.again = sum(part.again for part in parts)
    for env, part in enumerate(parts):
        result.faults += [(env, text) for _, text in part.faults]
        result.warnings += [(env, text) for _, text in part.warnings]
    for name in ("qpos", "qvel", "acceleration", "gravity"):
        rows = [value for part in parts if (value := getattr(part, name)) is not None]
        if name in ("qpos", "qvel"):  # where nothing moves there may be no sub-steps
            rows = [row if row.shape[1] == len(t) else np.repeat(row[:, -1:], len(t), axis=1) for row in rows]
        if len(rows) == len(parts):
            setattr(result, name, np.concatenate(rows))
    contacts = [part.contacts for part in parts if part.contacts is not None]
    if len(contacts) == len(parts):
        result.contacts = Contacts.joined(contacts, [[env] for env in range(len(parts))])
    return result
