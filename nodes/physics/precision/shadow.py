"""Simulates an environment a second time in steps of twice the length, which tells how wrong the first simulation is.

Of a method of order p the error after a time is that of steps m times as long, divided by m^p, so that the difference
of both courses is (m^p - 1) times the error: propagated by the dynamics themselves, from the first step on. m is 2, and
4 for RK4, whose steps cost four times as much. Where such steps are too long, for they are unstable or their error no
longer small, half a step is taken from some keyframes before.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import mujoco
import numpy as np

from evis.geometry import se3
from nodes.physics.dynamics.kept_data import KeptData
from nodes.physics.dynamics.saved_state import STATE
from nodes.physics.mujoco_warnings import BAD
from nodes.physics.precision.errors import Errors, Kept
from nodes.physics.precision.order import RK4, order_of
from nodes.physics.precision.reach import Reach
from nodes.physics.stiffness import modes

_BAD = [int(warning) for warning in BAD]
LENGTH = {RK4: 4}
"""Steps of the environment that are one of its shadow's; 2 for the others."""
STEPS_BETWEEN_ACTIONS = 4
"""From so many steps on, an action that comes between two steps of twice the length is waited for with a single one."""
KEPT = 4
"""How many comparisons the course in half steps begins before that which gave rise to doubt."""
GROWTH, LARGE, TURNED = 4.0, 0.01, 0.5
"""What gives rise to doubt in free motion: a growth of the error within a keyframe, if it reaches so many metres; a
rotation [rad] that is no longer small."""

_KEPT = ("_behind", "_long", "_short", "_length", "_halved", "_smooth", "_off")


@dataclass
class Past:
    """Holds where an environment was at a comparison, where its shadow was from there, and what followed.

    state: of the environment. shift, drift: from its positions and velocities to the shadow's, float64 [nv]. errors:
    as they were. since: controls and number of steps of each interval from then on.
    """

    state: np.ndarray
    shift: np.ndarray
    drift: np.ndarray
    errors: Kept
    since: list[tuple[np.ndarray, int]] = field(default_factory=list)


class Shadow:
    """Simulates an environment a second time, and records in `errors` how far the first simulation is off."""

    def __init__(self, model: Any, errors: Errors) -> None:
        self._model, self._errors = model, errors
        self._data = mujoco.MjData(model)
        self._smooth_order = order_of(model)
        self.reach = Reach(model).of_body[1:]
        self._length, dt = LENGTH.get(model.opt.integrator, 2), model.opt.timestep
        errors.erased = [mode.source for mode in modes(model) if mode.integrator == "discrete" and mode.too_fast(dt)]
        self._too_long = any(mode.grows(self._length * model.opt.timestep) for mode in modes(model))

    def begin(self, data: Any) -> None:
        """Starts the second simulation from the present state of the environment."""
        mujoco.mj_copyData(self._data, self._model, data)
        self._behind = 0
        """Steps of the environment that are still to be followed, 0 or 1."""
        self._long, self._short = 0, 0
        """How many steps were followed in steps of the full length, and in steps of two, where fewer were to follow."""
        self._halved, self._smooth = self._too_long, True
        self._off = np.inf
        self._past: deque[Past] = deque(maxlen=KEPT)
        self._remember(data)

    def state(self) -> dict[str, Any]:
        """Gives where the second simulation is, as copies."""
        kept = {name: getattr(self, name) for name in _KEPT}
        past = [replace(one, since=[*one.since]) for one in self._past]
        return kept | {"data": KeptData.of(self._model, self._data), "past": past}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Goes on from what `state` gave."""
        for name in _KEPT:
            setattr(self, name, state[name])
        state["data"].write(self._model, self._data)
        self._past = deque((replace(one, since=[*one.since]) for one in state["past"]), maxlen=KEPT)

    def follow(
        self,
        data: Any,
        steps: int,
        before: np.ndarray,
        now: np.ndarray,
        constrained: bool,
        parts: Sequence[int] | None = None,
    ) -> None:
        """Follows some steps, which the environment took under the controls that it has now.

        data: of the environment after them. before, now: float64 [bodies, 7], poses after the last step but one and
        after the last. constrained: whether anything was touched or limited at the start of the last. parts: in how
        many parts each step was taken, None = they were whole.
        """
        if not steps:
            return
        if parts is not None:
            self._follow_parts(data, parts, now, constrained)
            return
        dt, shadow = self._model.opt.timestep, self._data
        self._smooth = self._smooth and not constrained
        for past in self._past:
            past.since.append((np.array(data.ctrl), steps))
        if self._behind and steps >= STEPS_BETWEEN_ACTIONS and not np.array_equal(shadow.ctrl, data.ctrl):
            self._step(1, dt)
            self._behind = 0
        shadow.ctrl[:] = data.ctrl
        if self._halved:
            self._step(2 * steps, 0.5 * dt)
        else:
            long, rest = divmod(steps + self._behind, self._length)
            self._step(long, self._length * dt)
            self._step(rest // 2, 2 * dt)
            self._behind = rest % 2
            self._long, self._short = self._long + long * self._length, self._short + rest - self._behind
        if not self._sound():
            self._halve(data)
        else:
            position, rotation = self._apart(before if self._behind else now)
            off = float((position + 2 * np.sin(0.5 * rotation) * self.reach).max(initial=0.0))
            grown = off > max(LARGE, GROWTH * self._off) or rotation.max(initial=0.0) > TURNED
            if grown and self._smooth and not self._halved:
                self._halve(data)
                position, rotation = self._apart(now)
            self._off = off
            self._errors.take(position, rotation, self.reach)
            if not self._behind and not self._halved:
                self._remember(data)

    def _follow_parts(self, data: Any, parts: Sequence[int], now: np.ndarray, constrained: bool) -> None:
        """Takes each step in half as many parts."""
        self._length, self._smooth = 2, self._smooth and not constrained
        self._data.ctrl[:] = data.ctrl
        for count in parts:
            self._step(count // 2, 2 * self._model.opt.timestep / count)
        if self._sound():
            self._errors.take(*self._apart(now), self.reach)
        else:
            self.begin(data)

    def _halve(self, data: Any) -> None:
        """Follows in half steps from now on, and from some keyframes before, where the two were still close."""
        if self._halved:  # the environment itself is at its limit
            self.begin(data)
            self._halved = True
            return
        self._halved, self._behind = True, 0
        past = self._past[0]
        self._errors.restore(past.errors)
        shadow = self._data
        share = (1 - 0.5 ** self._order()) * self._scale()
        mujoco.mj_resetData(self._model, shadow)
        mujoco.mj_setState(self._model, shadow, past.state, STATE)
        mujoco.mj_integratePos(self._model, shadow.qpos, past.shift, -share)
        shadow.qvel[:] -= share * past.drift
        for controls, steps in past.since:
            shadow.ctrl[:] = controls
            self._step(2 * steps, 0.5 * self._model.opt.timestep)
        self._past.clear()
        if not self._sound():
            self.begin(data)
            self._halved = True

    def _step(self, count: int, length: float) -> None:
        if count:
            option = self._model.opt
            before, option.timestep = option.timestep, length
            mujoco.mj_step(self._model, self._data, count)
            option.timestep = before

    def _sound(self) -> bool:
        data = self._data
        finite = math.isfinite(data.qpos.sum() + data.qvel.sum())
        return finite and not data.warning.number[_BAD].any()

    def _order(self) -> int:
        """Gives the order of the steps, which is 1 of every integrator where constraints come and go."""
        return self._smooth_order if self._smooth else 1

    def _scale(self) -> float:
        """Gives the error over the difference to longer steps. Where constraints come and go it is taken whole."""
        if not self._smooth:
            return 1.0
        long, short = (length ** self._order() - 1 for length in (self._length, 2))
        # At many keyframes a second few steps come at once, and those of two make less of a difference.
        total = self._long + self._short
        return total / (self._long * long + self._short * short) if total else 1 / long

    def _apart(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Estimates the errors of bodies at these poses: position [m] and rotation [rad]."""
        data = self._data
        mujoco.mj_kinematics(self._model, data)
        position = np.linalg.norm(pose[:, :3] - data.xpos[1:], axis=-1)
        turn = se3.multiply(se3.conjugate(pose[:, 3:]), se3.from_mujoco(data.xquat[1:]))
        scale = 1 / (1 - 0.5 ** self._order()) if self._halved else self._scale()
        return scale * position, np.minimum(scale * se3.angle(turn), np.pi)

    def _remember(self, data: Any) -> None:
        """Keeps the present state, for the course in half steps to begin at."""
        model = self._model
        past = Past(
            np.empty(mujoco.mj_stateSize(model, STATE)), np.empty(model.nv), np.array(self._data.qvel - data.qvel),
            self._errors.snapshot(),
        )  # fmt: skip
        mujoco.mj_getState(model, data, past.state, STATE)
        mujoco.mj_differentiatePos(model, past.shift, 1.0, data.qpos, self._data.qpos)
        self._past.append(past)
