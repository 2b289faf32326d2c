"""Environments whose worlds move differently: an engine for each, and their states as one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from nodes.physics.interval import Contacts, Engine, Interval


class SeparateEngines:
    """Moves environment k by engine k, an engine of one environment, as each would by itself."""

    def __init__(self, engines: Sequence[Engine]) -> None:
        """Raises ValueError where the engines have not the same actuators."""
        self.engines = list(engines)
        self.controls = self.engines[0].controls
        for env, engine in enumerate(self.engines):
            if engine.controls != self.controls:
                raise ValueError(
                    f"environment {env} has {engine.controls} actuators, environment 0 has {self.controls}; "
                    "worlds side by side need the same ones"
                )

    def start(self) -> Interval:
        """Gives the state at stamp 0."""
        return merged([engine.start() for engine in self.engines])

    def advance(self, to_ns: int, controls: np.ndarray | None = None) -> Interval:
        """Gives the states up to a stamp. Raises ValueError for controls of a wrong shape or not finite."""
        if controls is not None and controls.shape != (len(self.engines), self.controls):
            raise ValueError(
                f"an action has controls {list(controls.shape)}, the model takes "
                f"[{len(self.engines)}, {self.controls}] (environments, actuators)"
            )
        own = [None if controls is None else controls[k : k + 1] for k in range(len(self.engines))]
        return merged([engine.advance(to_ns, action) for engine, action in zip(self.engines, own)])


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
    for env, part in enumerate(parts):
        result.faults += [(env, text) for _, text in part.faults]
        result.warnings += [(env, text) for _, text in part.warnings]
    for name in ("qpos", "qvel"):
        rows = [value for part in parts if (value := getattr(part, name)) is not None]
        if len(rows) == len(parts):
            setattr(result, name, np.concatenate(rows))
    contacts = [part.contacts for part in parts if part.contacts is not None]
    if len(contacts) == len(parts):
        for env, one in enumerate(contacts):
            one.env = np.full_like(one.env, env)
        joined = {f.name: np.concatenate([getattr(one, f.name) for one in contacts]) for f in fields(Contacts)}
        result.contacts = Contacts(**joined)
    return result
