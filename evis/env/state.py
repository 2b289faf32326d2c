"""Holds what a reward and a termination are computed from: the state of all environments after a step."""

from __future__ import annotations

import numpy as np

from evis.config.suggestions import nearest
from msgs.world import WorldState


class State:
    """Gives the bodies of all environments by name; the leading axis of every array is that of the environments.

    seconds: time since each environment's reset, float64 [E] s. controls: float64 [E, nu] of the last step, in the
    units of the actuators.
    """

    def __init__(self, message: WorldState, seconds: np.ndarray, controls: np.ndarray) -> None:
        """Takes what is known at the end of a step. message: the state over the interval of the step."""
        self.message, self.seconds, self.controls = message, seconds, controls

    def _body(self, name: str) -> int:
        try:
            return self.message.names.index(name)
        except ValueError:
            raise KeyError(f"no body '{name}'; {nearest(name, self.message.names)}") from None

    def pose(self, body: str) -> np.ndarray:
        """Returns position [m] and quaternion x y z w of a body in the world, float64 [E, 7]. Raises KeyError."""
        return self.message.end_pose[:, self._body(body)]

    def twist(self, body: str, *, at_start: bool = False) -> np.ndarray:
        """Returns the linear [m/s] and angular [rad/s] velocity of a body in the world, float64 [E, 6].

        at_start: of the step, not at its end. Raises KeyError.
        """
        _, twist = self.message.rows([self._body(body)])
        return twist[:, 0 if at_start else -1, 0]

    @property
    def joints(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns positions [E, nq] and velocities [E, nv] of the joints.

        Raises ValueError where they were not asked for.
        """
        if self.message.qpos is None or self.message.qvel is None:
            raise ValueError("the state has no joints; give the task or the environment joints=True")
        return self.message.qpos[:, -1], self.message.qvel[:, -1]
