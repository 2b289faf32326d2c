"""Keeps the MjData of each environment, which a batch steps without them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from nodes.physics.dynamics.batch.batch_stepper import BatchStepper
from nodes.physics.dynamics.batch.mujoco_threads import MujocoThreads
from nodes.physics.dynamics.kept_data import KeptData
from nodes.physics.dynamics.sleep import wake


@dataclass
class _Own:
    """Holds the MjData of an environment. row: its number in the batch.

    behind: whether the batch has taken steps that are not in it. given: whether it was given to somebody since, who may
    have changed it.
    """

    data: Any
    row: int
    behind: bool = False
    given: bool = True


class EnvironmentData:
    """Gives the MjData of environments, brought up to date from the batch when it is asked for.

    To copy a state costs more than some steps of a small model, and most are never looked at.
    """

    def __init__(self, model: Any, envs: int, batch: BatchStepper | None) -> None:
        """Makes the data of each environment. batch: what steps them, None = each is stepped by itself."""
        self._model, self._batch = model, batch
        self._all = [_Own(mujoco.MjData(model), row) for row in range(envs)]

    def __len__(self) -> int:
        return len(self._all)

    def __getitem__(self, env: int) -> Any:
        self._all[env].given = True
        return self.look(env)

    def look(self, env: int) -> Any:
        """Gives the MjData of an environment to who changes nothing in it: the batch need not take it over again."""
        own = self._all[env]
        if own.behind:
            assert self._batch is not None
            self._batch.write_state(own.row, own.data)
            own.behind = False
        return own.data

    def __iter__(self) -> Iterator[Any]:
        return (self[env] for env in range(len(self._all)))

    def of(self, envs: Sequence[int]) -> EnvironmentData:
        """Selects the data of some environments, in this order."""
        part = EnvironmentData.__new__(EnvironmentData)
        part._model, part._batch, part._all = self._model, self._batch, [self._all[env] for env in envs]
        return part

    def row(self, env: int) -> int:
        """Gives the number of an environment in the batch."""
        return self._all[env].row

    def control(self, envs: Sequence[int], values: np.ndarray) -> None:
        """Sets the controls [n, nu] of n environments, for all steps from now on, and wakes their bodies."""
        rows, places = [], []
        for place, env in enumerate(envs):
            own = self._all[env]
            if own.given:
                wake(self._model, self[env])
                self[env].ctrl[:] = values[place]
            else:
                rows.append(own.row)
                places.append(place)
        if rows:
            assert self._batch is not None
            self._batch.control(rows, values[places])

    def request(self, envs: Iterable[int], grid: range) -> None:
        """Requests steps of environments of the batch, one from each time of `grid` [ns]."""
        assert self._batch is not None
        rows = []
        for env in envs:
            own = self._all[env]
            rows.append(own.row)
            if own.given:
                self._batch.put(own.row, self[env])
                own.given = False
        if rows:
            self._batch.request(rows, grid)

    def cancel(self, envs: Iterable[int]) -> None:
        """Takes back the steps that were requested of environments, also where they were taken or have begun."""
        assert self._batch is not None
        self._batch.cancel([self._all[env].row for env in envs])

    def stepped(self, envs: Iterable[int]) -> None:
        """Notes that the batch has taken the steps requested of environments."""
        for env in envs:
            self._all[env].behind = True

    def keep(self, env: int) -> KeptData:
        """Copies where an environment is, without the steps that were requested and whose result nobody has fetched.

        Of a batch MuJoCo's threads alone can.
        """
        own = self._all[env]
        if not own.behind:
            return KeptData.of(self._model, own.data)
        assert isinstance(self._batch, MujocoThreads)
        return self._batch.keep(own.row)

    def put_back(self, env: int, kept: KeptData) -> None:
        """Puts an environment to where `keep` has copied it."""
        own = self._all[env]
        kept.write(self._model, own.data)
        own.behind, own.given = False, True

    def restore_before_steps(self, env: int) -> None:
        """Puts the MjData of an environment to its state before the steps that the batch took last."""
        own = self._all[env]
        if self._batch is not None:
            self._batch.write_state_before(own.row, own.data)
            own.behind, own.given = False, True
