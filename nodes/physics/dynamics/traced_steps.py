"""Takes many steps of MuJoCo in a row, and computes poses and velocities of all of them in one pass.

Reading a state from Python costs ten times as much as a step of a small model. The raw states after the steps are
therefore copied, and poses and velocities computed by array arithmetic over all steps, by the same formulas.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

from nodes.physics.dynamics.batch.stepped_states import SteppedStates
from nodes.physics.dynamics.sleep import fell_asleep, sleeps
from nodes.physics.dynamics.states import twist_and_pose


@dataclass
class Trace:
    """Holds an environment's raw states after each of n steps, as MuJoCo has them."""

    xpos: np.ndarray
    xquat: np.ndarray
    cvel: np.ndarray
    com: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    nearest: float = np.inf
    """Least distance of a contact in any of them [m]; negative = overlap."""
    warnings: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int32))
    """How often MuJoCo had warned of each of its warnings, after them."""
    constrained: bool = False
    """Whether anything was touched or limited at the start of the last step."""

    @classmethod
    def empty(cls, model: Any, steps: int) -> Trace:
        """Makes room for `steps` states."""
        bodies = model.nbody
        shapes = ((bodies, 3), (bodies, 4), (bodies, 6), (bodies, 3), (model.nq,), (model.nv,))
        xpos, xquat, cvel, com, qpos, qvel = (np.empty((steps, *shape)) for shape in shapes)
        return cls(xpos, xquat, cvel, com, qpos, qvel)

    def twist_and_pose(self, model: Any) -> tuple[np.ndarray, np.ndarray]:
        """Computes twists [n, bodies, 6] and poses [n, bodies, 7] of all bodies but the world, in the world."""
        return twist_and_pose(model, self.xpos, self.xquat, self.cvel, self.com)


def take_steps(
    model: Any, data: Any, grid: Sequence[int], trace: Trace, step: Callable[[Any, Any], None] = mujoco.mj_step
) -> None:
    """Takes a step from each time of `grid` [ns] by `step`, and copies the state after it to `trace`."""
    xpos, xquat, cvel, com = data.xpos, data.xquat, data.cvel, data.subtree_com
    qpos, qvel = data.qpos, data.qvel
    kinematics, places, velocities = mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_comVel
    asleep = np.array(data.tree_asleep) if sleeps(model) else None
    for i, t in enumerate(grid):
        # MuJoCo adds up its time in floating point; ours is exact.
        data.time = t * 1e-9
        step(model, data)
        # mj_step leaves poses and velocities of the state before the step.
        kinematics(model, data)
        places(model, data)
        velocities(model, data)
        if asleep is not None and not np.array_equal(asleep, data.tree_asleep):
            if i:
                trace.cvel[i - 1][fell_asleep(model, asleep, data.tree_asleep)] = 0.0
            asleep[:] = data.tree_asleep
        trace.xpos[i], trace.xquat[i], trace.cvel[i], trace.com[i] = xpos, xquat, cvel, com
        trace.qpos[i], trace.qvel[i] = qpos, qvel
        if data.ncon:
            trace.nearest = min(trace.nearest, float(data.contact.dist.min()))
    trace.warnings, trace.constrained = np.array(data.warning.number), bool(data.nefc)


def steps_alone(model: Any, data: Any, grid: Sequence[int], step: Callable[[Any, Any], None]) -> SteppedStates:
    """Takes the steps of one environment as `take_steps` does; gives them as those of a batch of one."""
    trace = Trace.empty(model, len(grid))
    take_steps(model, data, grid, trace, step)
    twist, pose = trace.twist_and_pose(model)
    state = {"pose": pose, "twist": twist, "qpos": trace.qpos, "qvel": trace.qvel}
    nearest, warnings, constrained = (np.array([value]) for value in (trace.nearest, trace.warnings, trace.constrained))
    part = lambda which: {name: values[None] for name, values in state.items()}
    return SteppedStates(nearest, warnings, constrained, part, np.zeros(1, bool))
