"""Notices a simulation that has diverged, and says where, when and why."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from nodes.physics.stiffness import Mode, geom_name, integrator_of, modes, thicknesses

_BAD = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
_LOST = {
    mujoco.mjtWarning.mjWARN_CONTACTFULL: "the contact buffer is full and contacts are lost; raise <size memory>",
    mujoco.mjtWarning.mjWARN_CNSTRFULL: "the constraint buffer is full and constraints are lost; raise <size memory>",
    mujoco.mjtWarning.mjWARN_INERTIA: "the inertia matrix is nearly singular; give light bodies inertia or armature",
    mujoco.mjtWarning.mjWARN_BADCTRL: "a control is not finite and was taken as zero",
}


class Watchdog:
    """Checks one environment after every step: finite, within the speed limit, in time, no warning counter rising."""

    def __init__(self, model: Any, speed_limit: float, finest: float) -> None:
        """speed_limit: of a body [m/s]. finest: shortest step that the engine may take [s]."""
        self.model = model
        self._finest = finest
        self.speed_limit = speed_limit
        self._counts = [0, 0, 0]
        self._time = -1.0
        self._said: set[str] = set()
        self._thicknesses = thicknesses(model)
        self._thin = int(np.argmin(self._thicknesses)) if len(self._thicknesses) else -1
        self._thickness = float(self._thicknesses[self._thin]) if len(self._thicknesses) else np.inf

    def restart(self, data: Any) -> None:
        """Begins anew from the state of `data`."""
        self._counts = [data.warning[w].number for w in _BAD]
        self._time = -1.0

    def check(self, data: Any, twist: np.ndarray) -> str | None:
        """Finds what is wrong after a step, as one line, or None.

        twist: float64 [bodies without the world, 6] of `data`.
        """
        sign = self._sign(data, twist)
        forward = data.time > self._time
        self._time = data.time
        counts = [data.warning[w].number for w in _BAD]
        if sign is None and counts == self._counts and forward:
            return None
        body, what = sign or (self._warned_body(data, counts), "the acceleration is not finite or huge")
        if sign is None and not forward:
            what = "its time did not go forward"
        self._counts = counts
        cause = self._cause(data, body)
        return f"body '{self._body(body)}' diverged at t = {data.time:.6g} s: {what}; likely cause: {cause}"

    def quiet(self, data: Any, qpos: np.ndarray, qvel: np.ndarray, twist: np.ndarray, nearest: float) -> bool:
        """Says that `check` and `notices` would find nothing after any of n steps.

        qpos, qvel, twist: [n, ...] after each of them. nearest: least distance of a contact [m].
        """
        # A counter that rose stays risen; a sum is finite only if everything in it is.
        numbers = data.warning.number
        if [numbers[w] for w in _BAD] != self._counts or any(numbers[w] for w in _LOST):
            return False
        if not np.isfinite(qpos.sum() + qvel.sum() + twist.sum()):
            return False
        fastest = float(np.sqrt((twist[..., :3] ** 2).sum(axis=-1).max(initial=0.0)))
        if fastest > self.speed_limit or fastest * self.model.opt.timestep > 0.5 * self._thickness:
            return False
        return nearest > -0.5 * self._thickness

    def passed(self, data: Any) -> None:
        """Takes note of the time, after steps in which nothing was wrong."""
        self._time = data.time

    def _sign(self, data: Any, twist: np.ndarray) -> tuple[int, str] | None:
        """The body that shows it, and how."""
        # A sum is finite only if everything in it is, but for overflow, which is no better.
        if not np.isfinite(data.qpos.sum() + data.qvel.sum() + twist.sum()):
            bad = ~np.isfinite(data.qvel)
            dof = int(np.argmax(bad)) if bad.any() else 0
            return int(self.model.dof_bodyid[dof]), "its state is not finite"
        square = (twist[:, :3] ** 2).sum(axis=-1)
        body = int(np.argmax(square)) if len(square) else 0
        if len(square) and square[body] > self.speed_limit**2:
            speed = float(np.sqrt(square[body]))
            return body + 1, f"its speed is {speed:.4g} m/s, the limit is {self.speed_limit:g} m/s (speed_limit)"
        return None

    def _warned_body(self, data: Any, counts: list[int]) -> int:
        for w, before, now in zip(_BAD, self._counts, counts):
            index = data.warning[w].lastinfo
            if now > before:
                if w == mujoco.mjtWarning.mjWARN_BADQPOS:
                    joint = int(np.searchsorted(self.model.jnt_qposadr, index, side="right")) - 1
                    return int(self.model.jnt_bodyid[joint])
                return int(self.model.dof_bodyid[index])
        return 0

    def risks(self) -> list[str]:
        """Finds what in the model the integrator cannot follow at this timestep, before the first step."""
        dt = self._finest
        return [
            f"{_growth(mode, dt)}; expect it to diverge, or {_remedy(mode, dt)}"
            for mode in modes(self.model)
            if mode.grows(dt)
        ]

    def notices(self, data: Any, twist: np.ndarray) -> list[str]:
        """Finds what is suspicious after a step that has not diverged; tells each thing once per environment."""
        found = {str(w): text for w, text in _LOST.items() if data.warning[w].number}
        if len(twist):
            square = (twist[:, :3] ** 2).sum(axis=-1)
            body = int(np.argmax(square))
            step = float(np.sqrt(square[body])) * self.model.opt.timestep
            if step > 0.5 * self._thickness:
                found["through"] = (
                    f"body '{self._body(body + 1)}' goes {step:.3g} m in one step, more than half the thickness of "
                    f"{geom_name(self.model, self._thin)} ({self._thickness:.3g} m), which it may pass through "
                    f"unnoticed; use a timestep below {0.5 * self._thickness / np.sqrt(square[body]):.2g} s"
                )
        if "through" not in found and (deep := self._deep(data)):
            found["through"] = deep
        fresh = [text for key, text in found.items() if key not in self._said]
        self._said |= set(found)
        return fresh

    def _body(self, body: int) -> str:
        return mujoco.mj_id2name(self.model, mujoco.mjtObj.mjOBJ_BODY, body) or f"body{body}"

    def _deep(self, data: Any) -> str | None:
        """A contact so deep that what touches may come out on the other side."""
        contact = data.contact
        if not data.ncon or (distance := contact.dist).min() > -0.5 * self._thickness:
            return None
        n = int(np.argmin(distance))
        pair = contact.geom[n]
        thin = int(pair[np.argmin(self._thicknesses[pair])])
        if -distance[n] <= 0.5 * self._thicknesses[thin]:
            return None
        one, other = (geom_name(self.model, geom) for geom in pair.tolist())
        return (
            f"{one} and {other} overlap by {-distance[n]:.3g} m, more than half the thickness of "
            f"{geom_name(self.model, thin)} ({self._thicknesses[thin]:.3g} m), and may pass through each other "
            "unnoticed; use a stiffer contact (a smaller time constant in solref) or a shorter timestep"
        )

    def _cause(self, data: Any, body: int) -> str:
        """The stiffest thing of the model against what the integrator can follow."""
        dt, name = self.model.opt.timestep, integrator_of(self.model)
        found = modes(self.model)
        growing = [mode for mode in found if mode.grows(dt)]
        if growing:
            worst = min(growing, key=lambda mode: mode.longest_step(dt))
            return f"{_growth(worst, dt)}; {_remedy(worst, dt)}"
        spin = float(np.linalg.norm(data.cvel[body, :3]))
        if np.isfinite(spin) and spin * dt > 1.0 and name != "discrete":
            return f"it turns {spin * dt:.3g} rad in one step of {dt:g} s; use a timestep below {0.3 / spin:.2g} s"
        fastest = max(found, key=lambda mode: mode.rate, default=None)
        if fastest is not None and fastest.rate * dt > 1.0:
            return f"{fastest.source} has omega*dt = {fastest.rate * dt:.3g}; use a shorter timestep or softer contacts"
        return "strong forces or deep penetration; use a shorter timestep, softer contacts, or smaller controls"


def _growth(mode: Mode, dt: float) -> str:
    limit = mode.rate * mode.longest_step(dt)
    return f"{mode.source} has omega*dt = {mode.rate * dt:.3g} and {mode.integrator} is stable below {limit:.3g}"


def _remedy(mode: Mode, dt: float) -> str:
    return f'use integrator="discrete" or a timestep below {mode.longest_step(dt):.2g} s'
