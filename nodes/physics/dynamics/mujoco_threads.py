"""Steps many environments of a model at once on MuJoCo's own threads (mujoco.batch).

Each environment takes all its steps up to the next stamp on one thread, without Python. Its MjData remains its state:
it is copied to the batch before the steps and written back after them, unless something went wrong. An environment is
never split over threads, so that their number changes no bit.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch

from nodes.physics.dynamics.stepped_states import CalmTest, SteppedStates, by_environment
from nodes.physics.dynamics.traced_steps import STATE, twist_and_pose

_PLACES = ("xpos", "xquat", "cvel", "subtree_com")
"""Fields that a step leaves as they were before it, as `twist_and_pose` takes them."""
_JOINTS = ("qpos", "qvel")


def threads_for(asked: int, envs: int) -> int:
    """Gives how many threads share environments. asked: by the user; 0 = one per core that the process may use."""
    return min(asked or len(os.sched_getaffinity(0)), envs)


@dataclass
class Request:
    """Holds a request: the MjData of an environment, and the times [ns] from which it takes a step each."""

    data: Any
    grid: range


class MujocoThreads:
    """Steps environments of one model, whose last sensor is that of `with_deepest`."""

    def __init__(self, model: Any, count: int, threads: int, calm: CalmTest) -> None:
        """count: of environments. threads: how many share them. calm: see CalmTest."""
        model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
        self._model, self._count, self._threads, self._calm = model, count, threads, calm
        # RK4 leaves positions from within its step, and delays and plugins read the time, which is exact only when set.
        plain = model.opt.integrator != mujoco.mjtIntegrator.mjINT_RK4 and not model.nhistory and not model.nplugin
        self._whole = plain
        """Whether all steps up to a stamp may be taken by one call; otherwise each by a call of its own."""
        self._batch: Batch | None = None
        self._asked: dict[int, Request] = {}
        self._found: dict[int, SteppedStates] = {}

    def request(self, row: int, data: Any, grid: range) -> None:
        """Requests steps of an environment, which are taken together with those of all others requested."""
        self._asked[row] = Request(data, grid)
        self._found.pop(row, None)

    def result(self, row: int) -> SteppedStates:
        """Gives the states after the requested steps, which are taken at the first call."""
        if row not in self._found:
            self._found |= self._take(self._asked)
            self._asked = {}
        return self._found.pop(row)

    def write_state(self, row: int, data: Any) -> None:
        """Writes the state after the steps that were taken last into an MjData."""
        assert self._batch is not None
        self._batch.get_data(row, data)

    def _take(self, asked: dict[int, Request]) -> dict[int, SteppedStates]:
        """Takes all requested steps, in one call for all environments with as many steps."""
        batch = self._made()
        found: dict[int, SteppedStates] = {}
        for row, task in asked.items():
            mujoco.mj_getState(self._model, task.data, batch.state[row], STATE)
            batch.warning[row, :, 0], batch.warning[row, :, 1] = task.data.warning.lastinfo, task.data.warning.number
        for count in sorted({len(task.grid) for task in asked.values()}):
            rows = np.array([row for row, task in sorted(asked.items()) if len(task.grid) == count], np.int32)
            found |= self._step(batch, rows, [asked[row] for row in rows.tolist()], count)
        return found

    def _step(self, batch: Batch, rows: np.ndarray, tasks: list[Request], count: int) -> dict[int, SteppedStates]:
        """Steps environments `count` times, and gives their states by row."""
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
        return dict(
            zip(rows.tolist(), by_environment((pose, twist, *joints), nearest, warnings, constrained, self._calm))
        )

    def _made(self) -> Batch:
        """The batch, made when it is first needed: it copies the model."""
        if self._batch is None:
            self._batch = Batch(self._model, self._count, self._threads, persistent=True)
        return self._batch
