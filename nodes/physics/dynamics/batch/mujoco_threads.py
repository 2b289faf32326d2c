"""Takes the steps of many environments on MuJoCo's threads.

MuJoCo keeps an MjData per environment and takes up to all steps to a stamp in one call, with the interpreter's lock
released. Its state stays there; who wants to read or change an environment has it copied to another MjData. An
environment is never split over threads, so that their number changes no bit.
"""

from __future__ import annotations

import contextlib
import math
import os
import sys
import threading
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch

from msgs.world import EVERY
from nodes.physics.dynamics.batch.forked import keep_when_forked
from nodes.physics.dynamics.batch.stepped_states import JOINTS, PLACES, Records, SteppedStates
from nodes.physics.dynamics.kept_data import KeptData, TakenSteps
from nodes.physics.dynamics.saved_state import STATE, SavedState
from nodes.physics.dynamics.sleep import AWAKE, fell_asleep, sleeps
from nodes.physics.dynamics.states import State

_RECORDED = (*PLACES, *JOINTS, "sensordata", "nefc")
_NOW = "now_"
"""Begins the name of an array of places after the last step."""

Fields = dict[str, np.ndarray]

MOST_KEPT = 16
"""Shapes of records that are kept."""
NICER = 5
"""By how much nicer (see nice(1)) MuJoCo's threads are than others: these get three times the time of a core that is
shared."""


def threads_for(asked: int, envs: int) -> int:
    """Gives how many threads share environments. asked: by the user; 0 = one per core that the process may use."""
    return min(asked or len(os.sched_getaffinity(0)), envs)


def stand_back() -> None:
    """Lowers the priority of the calling thread, and of those that it begins, where the system has one for each.

    Steps are taken ahead, while others work on what was asked for before: these go first where cores are few.
    """
    if sys.platform == "linux":
        with contextlib.suppress(OSError):  # a sandbox may forbid it: then all are alike
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), os.getpriority(os.PRIO_PROCESS, 0) + NICER)


@dataclass
class _Taken:
    """Holds the steps that one call of MuJoCo took of n environments.

    number: of the arrays that it was recorded in. rows: int [n], ascending, which they are. left: those of them whose
    result was not fetched yet. nearest, constrained: as of SteppedStates.
    """

    number: int
    rows: np.ndarray
    left: set[int]
    records: Records
    nearest: np.ndarray
    constrained: np.ndarray

    def part(self, model: Any, places: np.ndarray, which: slice) -> State:
        """Computes the states of some environments. places: of those that were asked for, in `rows`."""
        return self.records.states(model, places[which])

    def alone(self, model: Any, row: int, warnings: np.ndarray) -> SteppedStates:
        """Copies the states of one environment. warnings: int [W], as of SteppedStates."""
        place = int(np.searchsorted(self.rows, row))
        own = slice(place, place + 1)
        each = {name: self.records.each[name][own].copy() for name in (*PLACES, *JOINTS)}
        now = None if self.records.now is None else {n: values[own].copy() for n, values in self.records.now.items()}
        records = Records(each, now)
        seen = self.nearest[own].copy(), warnings[None].copy(), self.constrained[own].copy()
        lost, places = np.zeros(1, bool), np.zeros(1, np.int32)
        return SteppedStates(*seen, partial(records.states, model), lost, records, places)


class MujocoThreads:
    """Steps environments of one model, whose last sensor is that of `add_deepest`."""

    def __init__(self, model: Any, count: int, threads: int) -> None:
        """Takes a model. count: of environments. threads: how many share them."""
        model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
        self._model, self._count, self._threads = model, count, threads
        # RK4 leaves positions from within its step, and delays and plugins read the time, which is exact only when set.
        plain = model.opt.integrator != mujoco.mjtIntegrator.mjINT_RK4 and not model.nhistory and not model.nplugin
        self._whole = plain
        """Whether all steps up to a stamp may be taken by one call; otherwise each by a call of its own."""
        self._sleeps = sleeps(model)
        self._batch: Batch | None = None
        self._asked: dict[int, range] = {}
        self._taken: list[_Taken] = []
        self._given: _Taken | None = None
        """That of which `result` gave a part last."""
        self._held: _Taken | None = None
        """What is kept as it is while the next steps are taken."""
        self._room: dict[int, Fields] = {}
        """Arrays of the calls taken together, which later ones write into."""
        self._kept: dict[tuple[int, int, int], Records] = {}
        """Of a call, so many environments and so many steps: who reads records again and again knows them again."""
        self._beside = ThreadPoolExecutor(1, "ahead", stand_back)
        self._ahead: Future[None] | None = None
        """The steps that are taken while others work."""
        self._cancelled: list[int] = []
        """Environments whose steps are to be taken back once those that have begun are done."""

    def put(self, row: int, data: Any) -> None:
        """Implements `BatchStepper.put`."""
        batch = self._made()
        if self._sleeps and not np.array_equal(data.tree_asleep, self._asleep[row]):
            self._wake([row])
        mujoco.mj_getState(self._model, data, batch.state[row], STATE)
        batch.warning[row, :, 0], batch.warning[row, :, 1] = data.warning.lastinfo, data.warning.number

    def request(self, rows: Sequence[int], grid: range) -> None:
        """Implements `BatchStepper.request`."""
        self._made()
        self._forget(rows)
        self._asked |= dict.fromkeys(rows, grid)

    def control(self, rows: Sequence[int], values: np.ndarray) -> None:
        """Implements `BatchStepper.control`."""
        batch = self._made()
        self._wake(rows)
        batch.bind("ctrl")[list(rows)] = values

    def begin(self, keep: bool = False) -> None:
        """Implements `BatchStepper.begin`."""
        self._made()
        self._held = self._given if keep else None
        self._ahead = self._beside.submit(self._take)

    def cancel(self, rows: Sequence[int]) -> None:
        """Implements `BatchStepper.cancel`."""
        self._cancelled += rows
        if self._ahead is None:
            self._take_back()

    def _take_back(self) -> None:
        """Puts environments whose steps were cancelled to where they were before these."""
        cancelled, self._cancelled = self._cancelled, []
        for row in cancelled:
            if self._asked.pop(row, None) is None:
                self._wake([row])
                self._made().state[row], self._made().warning[row] = self._before[row], self._warned[row]
        self._forget(cancelled)

    def result(self, rows: Sequence[int]) -> SteppedStates:
        """Implements `BatchStepper.result`; the requested steps are taken at the first call, unless they have begun."""
        batch = self._made()
        if self._asked:
            self._take()
        wanted = np.asarray(rows)
        taken = next(one for one in self._taken if rows[0] in one.left)
        taken.left.difference_update(rows)
        self._given = taken
        each = EVERY if len(rows) == self._count else wanted
        self._left_state[each], self._left_warning[each] = self._before[each], self._warned[each]
        places = np.searchsorted(taken.rows, wanted)
        part = partial(taken.part, self._model, places)
        seen = taken.nearest[places], batch.warning[wanted, :, 1], taken.constrained[places]
        return SteppedStates(*seen, part, np.zeros(len(wanted), bool), taken.records, places)

    def write_state(self, row: int, data: Any) -> None:
        """Implements `BatchStepper.write_state`."""
        self._made().get_data(row, data)

    def write_state_before(self, row: int, data: Any) -> None:
        """Implements `BatchStepper.write_state_before`."""
        mujoco.mj_setState(self._model, data, self._left_state[row], STATE)
        data.warning.number[:] = self._left_warning[row, :, 1]

    def keep(self, row: int) -> KeptData:
        """Copies where an environment is, without requested steps whose result nobody has fetched.

        Of bodies that sleep, or are about to, MuJoCo's states say nothing, and the MjData from before steps that have
        begun is gone: of such the one after them is copied, and what they gave.
        """
        batch = self._made()
        taken = next((one for one in self._taken if row in one.left), None)
        now, before = (batch.state, batch.warning, self._asleep), (self._before, self._warned, self._slept)
        state, warning, asleep = (values[row] for values in (now if taken is None else before))
        saved = SavedState.of(state, warning[:, 1])
        if not self._sleeps or (asleep == AWAKE).all():
            return KeptData(saved)
        data = batch.get_data(row)
        if taken is None:
            return KeptData(data=data)
        return KeptData(data=data, taken=TakenSteps(saved, taken.alone(self._model, row, batch.warning[row, :, 1])))

    def _wake(self, rows: Sequence[int]) -> None:
        """Wakes all bodies of environments, as `sleep.wake` does."""
        if not self._sleeps:
            return
        batch, chosen = self._made(), np.array(rows, np.int32)
        chosen = chosen[(self._asleep[chosen] != AWAKE).any(axis=1)]
        if len(chosen):
            state, warning = batch.state[chosen], batch.warning[chosen]
            batch.reset(chosen, stage=mujoco.mjtStage.mjSTAGE_NONE)
            batch.state[chosen], batch.warning[chosen] = state, warning

    def _forget(self, rows: Sequence[int]) -> None:
        """Drops results that nobody has fetched."""
        for taken in self._taken:
            taken.left.difference_update(rows)

    def _take(self) -> None:
        """Takes all requested steps, in one call for all environments with as many steps."""
        batch, asked = self._batch, self._asked
        assert batch is not None
        rows = np.array(sorted(asked), np.int32)
        each = EVERY if len(rows) == self._count else rows
        self._before[each], self._warned[each] = batch.state[each], batch.warning[each]
        self._slept[each] = self._asleep[each]
        self._asked, self._taken = {}, [taken for taken in self._taken if taken.left or taken is self._held]
        for count in sorted({len(grid) for grid in asked.values()}):
            alike = np.array([row for row in rows.tolist() if len(asked[row]) == count], np.int32)
            self._taken.append(self._step(batch, alike, [asked[row] for row in alike.tolist()], count))

    def _step(self, batch: Batch, rows: np.ndarray, grids: list[range], count: int) -> _Taken:
        """Steps environments `count` times. grids: times of their steps."""
        number = next(n for n in range(len(self._taken) + 1) if all(taken.number != n for taken in self._taken))
        kept = self._records(batch, number, len(rows), count)
        records = kept.each
        if kept.now is not None:
            self._roll(batch, rows, grids, 0, records)
            nearest = records["sensordata"][:, :, -1].min(axis=1)
            for name, values in kept.now.items():
                np.take(batch.bind(name), rows, axis=0, out=values)
            constrained = records["nefc"].reshape(len(rows), -1)[:, -1] > 0
            return _Taken(number, rows, {*rows.tolist()}, kept, nearest, constrained)
        nearest, constrained = np.full(len(rows), np.inf), np.zeros(len(rows), bool)
        one = self._records(batch, -1, len(rows), 1).each
        every = len(rows) == self._count
        places = {name: batch.bind(name) for name in PLACES}
        for n in range(count):
            asleep = self._asleep[rows]
            self._roll(batch, rows, grids, n, one)
            if self._sleeps and n:
                records["cvel"][:, n - 1][fell_asleep(self._model, asleep, self._asleep[rows])] = 0.0
            nearest = np.minimum(nearest, one["sensordata"][:, 0, -1])
            constrained = one["nefc"].reshape(len(rows), -1)[:, -1] > 0
            for name in PLACES:
                records[name][:, n] = places[name] if every else places[name][rows]
            for name in JOINTS:
                records[name][:, n] = one[name][:, 0]
        return _Taken(number, rows, {*rows.tolist()}, kept, nearest, constrained)

    def _roll(self, batch: Batch, rows: np.ndarray, grids: list[range], first: int, records: Fields) -> None:
        """Takes as many steps as there is room for in `records` from step `first`, and computes places after them."""
        # MuJoCo adds up its time in floating point; ours is exact.
        batch.bind("time")[rows] = [grid[first] * 1e-9 for grid in grids]
        # Of all at once nobody has to look at their numbers.
        ids = None if len(rows) == self._count else rows
        batch.rollout(records["qpos"].shape[1], record=_RECORDED, ids=ids, out=records)
        batch.forward(ids, mujoco.mjtStage.mjSTAGE_VEL)

    def _records(self, batch: Batch, number: int, rows: int, steps: int) -> Records:
        """Gives the arrays of the call with this number of those taken together; kept, for new memory is slow."""
        key = number, rows, steps
        if key in self._kept:
            return self._kept[key]
        shapes = {name: (rows, steps, *batch.bind(name).shape[1:]) for name in _RECORDED}
        late = self._whole and number >= 0
        shapes |= {_NOW + name: (rows, *batch.bind(name).shape[1:]) for name in PLACES if late}
        room, found = self._room.setdefault(number, {}), {}
        for name, shape in shapes.items():
            size = math.prod(shape)
            if name not in room or room[name].size < size:
                room[name] = np.empty(size, batch.bind(name.removeprefix(_NOW)).dtype)
                # Of the arrays before it nobody is to hold a part any more.
                self._kept = {k: records for k, records in self._kept.items() if k[0] != number}
            found[name] = room[name][:size].reshape(shape)
        if len(self._kept) >= MOST_KEPT:
            self._kept.clear()
        now = {name: found.pop(_NOW + name) for name in PLACES} if late else None
        self._kept[key] = Records(found, now)
        return self._kept[key]

    def _made(self) -> Batch:
        """Gives the batch, after steps that were begun; made when it is first needed, for it copies the model."""
        if self._ahead is not None:
            ahead, self._ahead = self._ahead, None
            ahead.result()
            self._take_back()
        if self._batch is None:
            # MuJoCo's threads have the priority of the one that makes them.
            self._batch = self._beside.submit(Batch, self._model, self._count, self._threads, persistent=True).result()
            keep_when_forked(self._batch)
            self._before, self._warned = self._batch.state.copy(), self._batch.warning.copy()
            # Before the steps whose result was given last, while others may be under way.
            self._left_state, self._left_warning = self._before.copy(), self._warned.copy()
            self._asleep = self._batch.bind("tree_asleep")
            self._slept = self._asleep.copy()
        return self._batch
