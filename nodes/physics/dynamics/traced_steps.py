"""Takes many steps of one environment in a row, and records its states after each of them.

Reading a state from Python costs ten times as much as a step of a small model. The raw states are therefore copied as
MuJoCo has them, and poses and velocities computed of all steps at once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import mujoco
import numpy as np

from nodes.physics.dynamics.batch.stepped_states import JOINTS, PLACES, Records, SteppedStates
from nodes.physics.dynamics.sleep import fell_asleep, sleeps
from nodes.physics.dynamics.states import State

MOST_KEPT = 16
"""Numbers of steps of which arrays are kept."""


@dataclass(frozen=True)
class Trace:
    """Holds the arrays that the states of one environment are copied to.

    records: of it alone. nearest: float64 [S] m, as of SteppedStates, of each step. rows: of each step the parts of the
    records, in the order of PLACES and JOINTS: to find them takes longer than to write to them.
    """

    records: Records
    nearest: np.ndarray
    rows: list[tuple[np.ndarray, ...]]


class TracedSteps:
    """Takes steps of environments of a model, one environment at a time.

    whole: whether a step is a single one of MuJoCo's, of another integrator than RK4. Then it leaves places as they
    were before it, which are those after the step before, and nothing is computed twice. The model's last sensor is
    that of `add_deepest` in that case.
    """

    def __init__(self, model: Any, whole: bool) -> None:
        self.model, self.whole = model, whole
        self._traces: dict[int, Trace] = {}
        if whole:
            model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_SENSOR)

    def take(self, data: Any, grid: Sequence[int], step: Callable[[Any, Any], None]) -> SteppedStates:
        """Takes a step from each time of `grid` [ns] by `step`; gives the states, as those of a batch of one, in arrays
        that the next call of as many steps writes to again."""
        trace = self._traces.get(len(grid))
        if trace is None:
            if len(self._traces) >= MOST_KEPT:
                self._traces.clear()
            trace = self._traces[len(grid)] = self._made(data, len(grid))
        take_steps(self.model, data, grid, trace, step)
        seen = (np.array([value]) for value in (trace.nearest.min(), bool(data.nefc)))
        nearest, constrained = seen
        part: Callable[[slice], State] = partial(trace.records.states, self.model)
        warnings, lost = np.array(data.warning.number)[None], np.zeros(1, bool)
        return SteppedStates(nearest, warnings, constrained, part, lost, trace.records, np.zeros(1, np.int32))

    def _made(self, data: Any, steps: int) -> Trace:
        shapes = {name: getattr(data, name).shape for name in (*PLACES, *JOINTS)}
        each = {name: np.empty((1, steps, *shape)) for name, shape in shapes.items()}
        now = {name: np.empty((1, *shapes[name])) for name in PLACES} if self.whole else None
        rows = list(zip(*(each[name][0] for name in (*PLACES, *JOINTS)), strict=True))
        return Trace(Records(each, now), np.empty(steps), rows)


def take_steps(model: Any, data: Any, grid: Sequence[int], trace: Trace, step: Callable[[Any, Any], None]) -> None:
    """Takes a step from each time of `grid` [ns] by `step`, and copies the states to `trace`."""
    now, nearest = trace.records.now, trace.nearest
    kinematics, mass, velocities = mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_comVel
    own_xpos, own_xquat, own_cvel, own_com = (getattr(data, name) for name in PLACES)
    own_qpos, own_qvel, sensors = data.qpos, data.qvel, data.sensordata
    # The velocity before the step in which something falls asleep is told to be none: by itself where that is recorded.
    asleep = np.array(data.tree_asleep) if now is None and sleeps(model) else None
    for i, (xpos, xquat, cvel, com, qpos, qvel) in enumerate(trace.rows):
        # MuJoCo adds up its time in floating point; ours is exact.
        data.time = grid[i] * 1e-9
        step(model, data)
        if now is None:
            kinematics(model, data)
            mass(model, data)
            velocities(model, data)
            nearest[i] = data.contact.dist.min() if data.ncon else np.inf
            if asleep is not None and not np.array_equal(asleep, data.tree_asleep):
                if i:
                    trace.rows[i - 1][2][fell_asleep(model, asleep, data.tree_asleep)] = 0.0
                asleep[:] = data.tree_asleep
        else:
            nearest[i] = sensors[-1]
        xpos[...] = own_xpos
        xquat[...] = own_xquat
        cvel[...] = own_cvel
        com[...] = own_com
        qpos[...] = own_qpos
        qvel[...] = own_qvel
    if now is not None:
        kinematics(model, data)
        mass(model, data)
        velocities(model, data)
        for name, values in now.items():
            values[0] = getattr(data, name)
