"""Steps many environments of a model at once by MuJoCo Warp: float32, on a GPU, or slowly on Warp's CPU.

It is a BatchStepper as MujocoThreads is: states are copied to the device before the steps and back after them.
An environment that diverges, or loses contacts for lack of room, is stepped again by MuJoCo itself, which tells why.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from functools import partial
from typing import Any

import mujoco
import numpy as np
import warp as wp

from evis.gpu.building import build_together
from nodes.physics.dynamics.batch import warp_kernels as kernels
from nodes.physics.dynamics.batch.stepped_states import SteppedStates
from nodes.physics.dynamics.batch.unsupported import Unsupported
from nodes.physics.dynamics.batch.warp_launches import launches
from nodes.physics.dynamics.sleep import keep_awake
from nodes.physics.dynamics.states import State

_STATE = ("qpos", "qvel", "act", "qacc_warmstart")
_GIVEN = ("ctrl", "eq_active", "mocap_pos", "mocap_quat")


_MOST = 8192
"""Contacts and constraints of a world for which there is room at most."""
_DENSE = 60
"""Degrees of freedom up to which MuJoCo Warp takes dense matrices. By itself it takes sparse ones from 33 on, whose
sums depend on the order of threads: its deterministic mode sorts all their terms, in GB of memory."""


class WarpWorlds:
    """Steps environments of one model on a device."""

    def __init__(self, model: Any, count: int, device: str) -> None:
        """Puts `count` worlds of a model on a device. Raises Unsupported for a model that MuJoCo Warp cannot take."""
        try:
            import mujoco_warp
        except ImportError:
            raise Unsupported('it is not installed; pip install "evis[gpu]" brings it') from None
        self._engine, self._device = mujoco_warp, wp.get_device(device)
        self._host = _for_warp(model)
        self._bodies = model.nbody - 1
        if model.nhistory or model.nplugin:
            raise Unsupported("the model has " + ("delays" if model.nhistory else "plugins"))
        try:
            with wp.ScopedDevice(self._device):
                self._model = mujoco_warp.put_model(self._host)
                # Overflows are read below, and such steps are taken again.
                self._model.opt.warn_overflow = False
                # The same seed gives the same bytes.
                self._model.opt.deterministic = True
                self._data = mujoco_warp.make_data(self._host, nworld=count)
                self._contacts, self._constraints = self._data.naconmax // count, self._data.njmax
        except (NotImplementedError, ValueError) as error:
            raise Unsupported(" ".join(str(error).split()).rstrip(".")) from None
        kinds = mujoco_warp.OverflowType
        self._loss = int(kinds.ALL & ~(kinds.ITERATIONS | kinds.LS_ITERATIONS | kinds.TACTILE | kinds.CONTACT_MATCH))
        """What of a world's contacts or constraints was left out; MuJoCo too ends its iterations at their limit."""
        self._worlds = count
        make = self._made
        self._kept = {name: make(getattr(self._data, name).shape, float) for name in _STATE}
        self._step, self._count, self._diverged, self._constrained = (make(n, int) for n in (1, count, count, count))
        self._nearest = make(count, float)
        self._root: wp.array = wp.array(model.body_rootid.astype(np.int32), dtype=int, device=self._device)
        self._staged = {name: np.array(getattr(self._data, name).numpy()) for name in (*_STATE, *_GIVEN)}
        self._room = 0
        self._graph: Any = None
        self._warned = np.zeros((count, mujoco.mjtWarning.mjNWARNING), np.int32)
        self._ends = np.zeros(count)
        self._asked: dict[int, range] = {}
        # Kernels are compiled before the start.
        self._make_room(1)
        with wp.ScopedDevice(self._device):
            build_together(self._device, launches(self._launch))
        try:
            self._step_worlds()
        except (ValueError, RuntimeError, MemoryError) as error:
            raise Unsupported(f"{count} of its worlds cannot be stepped: {' '.join(str(error).split())}") from None

    def put(self, row: int, data: Any) -> None:
        """Implements `BatchStepper.put`."""
        self._warned[row] = data.warning.number
        for name, values in self._staged.items():
            values[row] = getattr(data, name)

    def request(self, rows: Sequence[int], grid: range) -> None:
        """Implements `BatchStepper.request`."""
        self._asked |= dict.fromkeys(rows, grid)

    def control(self, rows: Sequence[int], values: np.ndarray) -> None:
        """Implements `BatchStepper.control`."""
        self._staged["ctrl"][list(rows)] = values

    def begin(self, keep: bool = False) -> None:
        """Does nothing: the steps are taken when their result is asked for."""

    def cancel(self, rows: Sequence[int]) -> None:
        """Implements `BatchStepper.cancel`."""
        for row in rows:
            self._asked.pop(row, None)

    def result(self, rows: Sequence[int]) -> SteppedStates:
        """Implements `BatchStepper.result`; the requested steps are taken at the first call."""
        if self._asked:
            self._take()
        wanted = np.asarray(rows)
        nearest, constrained, lost = (values[wanted] for values in self._seen)
        return SteppedStates(nearest, self._warned[wanted], constrained, partial(self._part, wanted), lost)

    def write_state(self, row: int, data: Any) -> None:
        """Implements `BatchStepper.write_state`."""
        self._write(self._staged, row, data)
        data.time = self._ends[row]

    def write_state_before(self, row: int, data: Any) -> None:
        """Implements `BatchStepper.write_state_before`."""
        self._write(self._before, row, data)

    def _write(self, states: dict[str, np.ndarray], row: int, data: Any) -> None:
        for name, values in states.items():
            getattr(data, name)[:] = values[row]

    def _take(self) -> None:
        """Takes all requested steps."""
        asked, self._asked = self._asked, {}
        counts, times = np.zeros(self._worlds, np.int32), np.zeros(self._worlds)
        for row, grid in asked.items():
            counts[row], times[row], self._ends[row] = len(grid), grid[0] * 1e-9, (grid[-1] + grid.step) * 1e-9
        for name, values in self._staged.items():
            getattr(self._data, name).assign(values)
        self._before = dict(self._staged)
        for name, kept in self._kept.items():
            wp.copy(kept, getattr(self._data, name))
        self._data.time.assign(times.astype(np.float32))
        self._count.assign(counts)
        for array, value in ((self._step, 0), (self._diverged, 0), (self._constrained, 0), (self._nearest, np.inf)):
            array.fill_(value)
        self._data.overflow.zero_()
        self._make_room(int(counts.max()))
        for _ in range(int(counts.max())):
            self._step_worlds()
        # On a CPU `numpy` gives the memory that the next steps write into.
        self._staged |= {name: np.array(kept.numpy()) for name, kept in self._kept.items()}
        overflow = self._data.overflow.numpy()
        lost = (self._diverged.numpy() != 0) | (overflow & self._loss != 0)
        self._seen = np.array(self._nearest.numpy()), self._constrained.numpy() != 0, lost
        made = (self._pose, self._twist, self._qpos, self._qvel)
        self._found = dict(zip(("pose", "twist", "qpos", "qvel"), (array.numpy() for array in made)))
        self._steps = counts
        if (overflow & self._loss).any() and max(self._contacts, self._constraints) < _MOST:
            self._grow()

    def _part(self, rows: np.ndarray, which: slice) -> State:
        """Gives the states of some of these rows, which took as many steps each."""
        chosen, steps = rows[which], self._steps[rows[0]]
        return {name: values[chosen, :steps].astype(np.float64) for name, values in self._found.items()}

    def _made(self, shape: Any, dtype: Any) -> wp.array:
        return wp.zeros(shape, dtype=dtype, device=self._device)

    def _grow(self) -> None:
        """Makes twice the room for contacts and constraints; states come from the host at the next steps."""
        self._contacts, self._constraints = 2 * self._contacts, 2 * self._constraints
        with wp.ScopedDevice(self._device):
            self._data = self._engine.make_data(
                self._host, nworld=self._worlds, nconmax=self._contacts, njmax=self._constraints
            )
        self._graph = None

    def _make_room(self, steps: int) -> None:
        """Makes arrays for so many steps, and the graph that writes into them."""
        if steps <= self._room:
            return
        self._room, worlds, make = steps, self._worlds, self._made
        self._pose, self._twist = (make((worlds, steps, self._bodies, n), float) for n in (7, 6))
        self._qpos, self._qvel = (make((worlds, steps, n), float) for n in (self._host.nq, self._host.nv))
        self._graph = None

    def _step_worlds(self) -> None:
        """Steps all worlds once: the first time launch by launch, which compiles kernels, then as a CUDA graph."""
        if self._graph is not None:
            wp.capture_launch(self._graph)
            return
        with wp.ScopedDevice(self._device):
            if not self._device.is_cuda:
                self._launch()
                return
            self._launch()
            with wp.ScopedCapture(self._device) as capture:
                self._launch()
            self._graph = capture.graph

    def _launch(self) -> None:
        engine, m, d = self._engine, self._model, self._data
        engine.step(m, d)
        live = [getattr(d, name) for name in _STATE]
        seen = [self._count, self._diverged, self._constrained]
        wp.launch(kernels.settle, self._worlds, [self._step, d.nefc, *seen, *live, *self._kept.values()])
        wp.launch(kernels.deepest, d.naconmax, [d.nacon, d.contact.worldid, d.contact.dist, self._nearest])
        for renew in (engine.kinematics, engine.com_pos, engine.com_vel):
            renew(m, d)
        places = [self._root, d.xpos, d.xquat, d.cvel, d.subtree_com, d.qpos, d.qvel]
        outputs = [self._pose, self._twist, self._qpos, self._qvel]
        wp.launch(kernels.record, (self._worlds, self._bodies), [self._step, *places, *outputs])
        wp.launch(kernels.go_on, 1, [self._step])


def _for_warp(model: Any) -> Any:
    """Copies a model, without resets of diverged states, which MuJoCo Warp never does, and dense where it can be.

    Its bodies do not sleep: which do is no part of the states that are copied to the device.
    """
    result = copy.copy(model)
    keep_awake(result)
    result.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    if model.nv <= _DENSE:
        result.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    return result
