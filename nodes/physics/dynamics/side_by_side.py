"""Steps of many environments of a model at once, by MuJoCo's own threads (mujoco.batch).

Each environment takes all its steps up to the next stamp on one thread, without Python. The states of MjData stay what
counts: they go in before the steps, and come out where nothing was wrong. Threads share environments, never one of
them, so that their number changes no bit.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch

from nodes.physics.dynamics.stride import STATE, twist_and_pose
from nodes.physics.dynamics.strides import Judge, Strode, strides

_PLACES = ("xpos", "xquat", "cvel", "subtree_com")
"""Fields that a step leaves as they were before it, as `twist_and_pose` takes them."""
_JOINTS = ("qpos", "qvel")


def threads_for(asked: int, envs: int) -> int:
    """Gives how many threads share environments. asked: by the user; 0 = one per core that the process may use."""
    return min(asked or len(os.sched_getaffinity(0)), envs)


@dataclass
class Asked:
    """Holds what is to be done: the MjData of an environment, and the times [ns] from which it takes steps."""

    data: Any
    grid: range


class SideBySide:
    """Steps environments of one model, whose last sensor is that of `with_deepest`."""

    def __init__(self, model: Any, count: int, threads: int, judge: Judge) -> None:
        """count: of environments. threads: that share them. judge: tells which of them have nothing to tell."""
        model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
        self._model, self._count, self._threads, self._judge = model, count, threads, judge
        # RK4 leaves places within its step; what looks at the time has it exact.
        plain = model.opt.integrator != mujoco.mjtIntegrator.mjINT_RK4 and not model.nhistory and not model.nplugin
        self._whole = plain
        """Whether all steps up to a stamp may be taken without a look at them."""
        self._batch: Batch | None = None
        self._asked: dict[int, Asked] = {}
        self._found: dict[int, Strode] = {}

    def ask(self, row: int, data: Any, grid: range) -> None:
        """Asks for steps of an environment, which are taken with those of all others that were asked for."""
        self._asked[row] = Asked(data, grid)
        self._found.pop(row, None)

    def trace(self, row: int) -> Strode:
        """Gives what the steps left that were asked for."""
        if row not in self._found:
            self._found |= self._take(self._asked)
            self._asked = {}
        return self._found.pop(row)

    def bring(self, row: int, data: Any) -> None:
        """Writes the state after the steps that were taken last into an MjData."""
        assert self._batch is not None
        self._batch.get_data(row, data)

    def _take(self, asked: dict[int, Asked]) -> dict[int, Strode]:
        """Takes all steps: together, what takes as many."""
        batch = self._made()
        found: dict[int, Strode] = {}
        for row, task in asked.items():
            mujoco.mj_getState(self._model, task.data, batch.state[row], STATE)
            batch.warning[row, :, 0], batch.warning[row, :, 1] = task.data.warning.lastinfo, task.data.warning.number
        for count in sorted({len(task.grid) for task in asked.values()}):
            rows = np.array([row for row, task in sorted(asked.items()) if len(task.grid) == count], np.int32)
            found |= self._traces(batch, rows, [asked[row] for row in rows.tolist()], count)
        return found

    def _traces(self, batch: Batch, rows: np.ndarray, tasks: list[Asked], count: int) -> dict[int, Strode]:
        """Has environments take `count` steps."""
        places = [batch.bind(name) for name in _PLACES]
        made = [np.empty((len(rows), count, *field.shape[1:])) for field in places]
        joints = [np.empty((len(rows), count, batch.bind(name).shape[1])) for name in _JOINTS]
        nearest, constrained = np.full(len(rows), np.inf), np.zeros(len(rows), bool)
        length = count if self._whole else 1
        for first in range(0, count, max(length, 1)):
            last = first + length - 1
            # MuJoCo adds up its time in floating point; ours is exact.
            batch.bind("time")[rows] = [task.grid[first] * 1e-9 for task in tasks]
            left = batch.rollout(length, record=(*_PLACES, *_JOINTS, "sensordata", "nefc"), ids=rows)
            batch.forward(rows, mujoco.mjtStage.mjSTAGE_VEL)
            for name, to, now in zip(_PLACES, made, places):
                to[:, first:last], to[:, last] = left[name][:, 1:], now[rows]
            for name, to in zip(_JOINTS, joints):
                to[:, first : last + 1] = left[name]
            nearest = np.minimum(nearest, left["sensordata"][:, :, -1].min(axis=1))
            constrained = left["nefc"].reshape(len(rows), -1)[:, -1] > 0
        twist, pose = twist_and_pose(self._model, *made)
        warnings = [np.array(batch.warning[row, :, 1]) for row in rows.tolist()]
        return dict(zip(rows.tolist(), strides((pose, twist, *joints), nearest, warnings, constrained, self._judge)))

    def _made(self) -> Batch:
        """The batch, made when it is first needed: it copies the model."""
        if self._batch is None:
            self._batch = Batch(self._model, self._count, self._threads, persistent=True)
        return self._batch
