"""Notices a simulation that has diverged, and says where, when and why."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from nodes.physics.stiffness import integrator_limit, rates, thinnest_geom

_BAD = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
_LOST = {
    mujoco.mjtWarning.mjWARN_CONTACTFULL: "the contact buffer is full and contacts are lost; raise <size memory>",
    mujoco.mjtWarning.mjWARN_CNSTRFULL: "the constraint buffer is full and constraints are lost; raise <size memory>",
    mujoco.mjtWarning.mjWARN_INERTIA: "the inertia matrix is nearly singular; give light bodies inertia or armature",
    mujoco.mjtWarning.mjWARN_BADCTRL: "a control is not finite and was taken as zero",
}


class Watchdog:
    """Checks one environment after every step: finite, within the speed limit, in time, no warning counter rising."""

    def __init__(self, model: Any, speed_limit: float) -> None:
        self.model = model
        self.speed_limit = speed_limit
        self._counts = [0, 0, 0]
        self._time = -1.0
        self._said: set[str] = set()
        self._thin, self._thickness = thinnest_geom(model)

    def restart(self, data: Any) -> None:
        """Begin anew from the state of `data`."""
        self._counts = [data.warning[w].number for w in _BAD]
        self._time = -1.0

    def check(self, data: Any, twist: np.ndarray) -> str | None:
        """What is wrong after a step, as one line, or None. twist: float64 [bodies without the world, 6] of `data`."""
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
        """What in the model the integrator cannot follow at this timestep, known before the first step."""
        dt, (name, limit) = self.model.opt.timestep, integrator_limit(self.model)
        return [
            f"{source} has omega*dt = {rate * dt:.3g} and {name} is stable below {limit:g}; expect it to diverge, "
            f'or use integrator="discrete" or a timestep below {limit / rate:.2g} s'
            for rate, source in rates(self.model)
            if rate * dt > limit
        ]

    def notices(self, data: Any, twist: np.ndarray) -> list[str]:
        """What is suspicious after a step that has not diverged; each thing once per environment."""
        found = {str(w): text for w, text in _LOST.items() if data.warning[w].number}
        if len(twist):
            square = (twist[:, :3] ** 2).sum(axis=-1)
            body = int(np.argmax(square))
            step = float(np.sqrt(square[body])) * self.model.opt.timestep
            if step > 0.5 * self._thickness:
                found["thin"] = (
                    f"body '{self._body(body + 1)}' goes {step:.3g} m in one step, more than half the thickness of "
                    f"{self._thin} ({self._thickness:.3g} m), which it may pass through unnoticed; "
                    f"use a timestep below {0.5 * self._thickness / np.sqrt(square[body]):.2g} s"
                )
        fresh = [text for key, text in found.items() if key not in self._said]
        self._said |= set(found)
        return fresh

    def _body(self, body: int) -> str:
        return mujoco.mj_id2name(self.model, mujoco.mjtObj.mjOBJ_BODY, body) or f"body{body}"

    def _cause(self, data: Any, body: int) -> str:
        """The stiffest thing of the model against what the integrator can follow."""
        dt = self.model.opt.timestep
        name, limit = integrator_limit(self.model)
        rate, source = max(rates(self.model), default=(0.0, ""))
        if rate * dt > limit:
            return (
                f"{source} has omega*dt = {rate * dt:.3g} and {name} is stable below {limit:g}; "
                f'use integrator="discrete" or a timestep below {limit / rate:.2g} s'
            )
        spin = float(np.linalg.norm(data.cvel[body, :3]))
        if np.isfinite(spin) and spin * dt > 1.0 and name != "discrete":
            return f"it turns {spin * dt:.3g} rad in one step of {dt:g} s; use a timestep below {0.3 / spin:.2g} s"
        if rate * dt > 1.0:
            return f"{source} has omega*dt = {rate * dt:.3g}; use a shorter timestep or softer contacts"
        return "strong forces or deep penetration; use a shorter timestep, softer contacts, or smaller controls"
