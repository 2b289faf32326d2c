"""Notices a simulation that has diverged, and says where, when and why."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from nodes.physics.dynamics.touching import flex_name, touching_bodies
from nodes.physics.mujoco_warnings import BAD, LOST
from nodes.physics.precision.reach import Reach
from nodes.physics.precision.sub_steps import FINEST
from nodes.physics.stiffness import FOLLOWED, Mode, geom_name, integrator_of, modes, thicknesses

SHOWN = 1.0
"""omega*dt up to which poses between two steps follow an oscillation, to 0.3 % of it."""
NAMED = 3
"""Others that a line on what cannot be followed names beside the worst; it counts the rest."""
SHORTEST = 1e-7
"""Shortest timestep that the node takes [s]."""


class Limits:
    """Holds the limits by which states of a model are judged: speed, reach and thickness of its bodies."""

    def __init__(self, model: Any, speed_limit: float, finest: float) -> None:
        """Computes the limits of a model. speed_limit: of a body [m/s]. finest: shortest step that the engine may take
        [s]."""
        self.model, self.speed_limit, self.finest = model, speed_limit, finest
        self.tolerant = finest < model.opt.timestep
        """Whether steps are taken in parts already, so that a tolerance is nothing to advise."""
        self.reach = Reach(model)
        self.thicknesses = thicknesses(model)
        if int(np.count_nonzero(model.geom_contype | model.geom_conaffinity)) < 2:
            self.thicknesses[:] = np.inf  # there is nothing to pass through
        self.thin = int(np.argmin(self.thicknesses)) if len(self.thicknesses) else -1
        self.thickness = float(self.thicknesses[self.thin]) if len(self.thicknesses) else np.inf

    def risks(self) -> list[str]:
        """Finds what in the model the integrator cannot follow at this timestep, or the poses of whole steps cannot,
        before the first step: a line for all to which the same remedy applies, which is that of the worst."""
        dt, whole, found = self.finest, self.model.opt.timestep, modes(self.model)
        said = []
        for some in _alike([mode for mode in found if mode.grows(dt)], dt):
            worst = _first(some, lambda mode: 1 / mode.rate if mode.contact else mode.longest_step(dt))
            remedy = _remedy(worst, dt, self.tolerant)
            said.append(f"{_growth(worst, dt)}{_others(some, worst)}; expect it to diverge, or {remedy}")
        hidden = [mode for mode in found if mode.oscillates and not mode.contact and mode.rate * whole > SHOWN]
        if self.tolerant and hidden:
            worst = _first(hidden, lambda mode: 1 / mode.rate)
            said.append(
                f"{worst.source} swings by {worst.rate * whole:.3g} rad in a step of {whole:g} s, which "
                "physics_tolerance follows, but poses are published once a step, and between steps bodies are up to "
                f"{_between_steps(worst.rate * whole):.2g} of the swing off{_others(hidden, worst)}; "
                f"timestep:={max(_rounded_down(0.5 / worst.rate), SHORTEST):g} shows it"
            )
        return said


class Watchdog:
    """Checks one environment after every step: finite, within the speed limit, in time, no warning counter rising."""

    def __init__(self, limits: Limits, counts: np.ndarray, spins: np.ndarray) -> None:
        """Takes the arrays to write to. counts: int [len(BAD)], how often MjData has warned of BAD. spins: float64
        [nbody], how fast bodies turned when all was well [rad/s], the last, or the first that was too fast."""
        self.model, self._limits = limits.model, limits
        self.keep_in(counts, spins)
        self._time = -1.0
        self._said: set[str] = set()

    def keep_in(self, counts: np.ndarray, spins: np.ndarray) -> None:
        """Replaces the arrays to write to by others, which hold the same values."""
        self._counts, self._spins = counts, spins

    def state(self) -> tuple[float, frozenset[str]]:
        """Gives what is not in the arrays: the time [s] of the last step, and what was told."""
        return self._time, frozenset(self._said)

    def restore(self, state: tuple[float, frozenset[str]]) -> None:
        """Goes on from what `state` gave."""
        self._time, self._said = state[0], set(state[1])

    def restart(self, data: Any) -> None:
        """Begins anew from the state of `data`."""
        self._counts[:] = [data.warning[w].number for w in BAD]
        self._time = -1.0
        self._spins[:] = np.linalg.norm(data.cvel[:, :3], axis=-1)

    def check(self, data: Any, twist: np.ndarray) -> str | None:
        """Finds what is wrong after a step, as one line, or None.

        twist: float64 [bodies without the world, 6] of `data`.
        """
        sign = self._sign(data, twist)
        forward = data.time > self._time
        self._time = data.time
        counts = [data.warning[w].number for w in BAD]
        if sign is None and counts == self._counts.tolist() and forward:
            return None
        body, what = sign or (self._warned_body(data, counts), "the acceleration is not finite or huge")
        if sign is None and not forward:
            what = "its time did not go forward"
        self._counts[:] = counts
        cause = self._cause(body)
        return f"body '{self._body(body)}' diverged at t = {data.time:.6g} s: {what}; likely cause: {cause}"

    def unremarkable(self, state: Mapping[str, np.ndarray], nearest: float) -> bool:
        """Tells whether the states after some steps give no reason for a warning.

        state: pose, twist, qpos and qvel, [n, ...] after each. nearest: least distance of a contact [m].
        """
        limits, pose, twist = self._limits, state["pose"], state["twist"]
        if not np.isfinite(state["qpos"].sum() + state["qvel"].sum() + twist.sum()):
            return False
        fastest = float(np.sqrt((twist[..., :3] ** 2).sum(axis=-1).max(initial=0.0)))
        if fastest > limits.speed_limit:
            return False
        if "through" in self._said:  # it is told once
            return True
        slow = 0.5 * limits.thickness / self.model.opt.timestep
        if limits.reach.bound(twist) > slow and limits.reach.fastest(pose, twist).max(initial=0.0) > slow:
            return False
        return nearest > -0.5 * limits.thickness

    def passed(self, time: float) -> None:
        """Takes note of the time [s], after steps in which nothing was wrong."""
        self._time = time

    def _sign(self, data: Any, twist: np.ndarray) -> tuple[int, str] | None:
        """Finds the body that shows that the state has diverged, and how."""
        # A sum is finite only if everything in it is, but for overflow, which is no better.
        if not np.isfinite(data.qpos.sum() + data.qvel.sum() + twist.sum()):
            bad = ~np.isfinite(data.qvel)
            dof = int(np.argmax(bad)) if bad.any() else 0
            return int(self.model.dof_bodyid[dof]), "its state is not finite"
        square = (twist[:, :3] ** 2).sum(axis=-1)
        body = int(np.argmax(square)) if len(square) else 0
        if len(square) and square[body] > self._limits.speed_limit**2:
            speed = float(np.sqrt(square[body]))
            return (
                body + 1,
                f"its speed is {speed:.4g} m/s, the limit is {self._limits.speed_limit:g} m/s (what is meant to be "
                "faster is given speed_limit:=N)",
            )
        return None

    def _warned_body(self, data: Any, counts: list[int]) -> int:
        for w, before, now in zip(BAD, self._counts, counts):
            index = data.warning[w].lastinfo
            if now > before:
                if w == mujoco.mjtWarning.mjWARN_BADQPOS:
                    joint = int(np.searchsorted(self.model.jnt_qposadr, index, side="right")) - 1
                    return int(self.model.jnt_bodyid[joint])
                return int(self.model.dof_bodyid[index])
        return 0

    def notices(self, data: Any, pose: np.ndarray, twist: np.ndarray) -> list[str]:
        """Finds what is suspicious after a step that has not diverged; tells each thing once per environment.

        pose, twist: float64 [bodies without the world, 7] and [..., 6] of `data`.
        """
        found = {str(w): text for w, text in LOST.items() if data.warning[w].number}
        limits = self._limits
        slow = 0.5 * limits.thickness / self.model.opt.timestep
        speeds = limits.reach.fastest(pose, twist) if limits.reach.bound(twist) > slow else np.zeros(len(twist))
        if len(speeds) and speeds.max() > slow:
            body = int(np.argmax(speeds))
            dt, thickness = self.model.opt.timestep, limits.thickness
            far = "the farthest point of " if speeds[body] > 1.01 * np.linalg.norm(twist[body, :3]) else ""
            found["through"] = (
                f"{far}body '{self._body(body + 1)}' goes {speeds[body] * dt:.3g} m in one step, "
                f"more than half the thickness of {geom_name(self.model, limits.thin)} ({thickness:.3g} m), which "
                f"it may pass through unnoticed; {_firmer(thickness / speeds[body], dt)}"
            )
        if "through" not in found and (deep := self._deep(data, pose, twist)):
            found["through"] = deep
        fresh = [text for key, text in found.items() if key not in self._said]
        self._said |= set(found)
        return fresh

    def _body(self, body: int) -> str:
        return mujoco.mj_id2name(self.model, mujoco.mjtObj.mjOBJ_BODY, body) or f"body{body}"

    def _deep(self, data: Any, pose: np.ndarray, twist: np.ndarray) -> str | None:
        """Finds a contact so deep that what touches may come out on the other side."""
        contact = data.contact
        if not data.ncon or (distance := contact.dist).min() > -0.5 * self._limits.thickness:
            return None
        n = int(np.argmin(distance))
        pair, flexes = contact.geom[n].tolist(), contact.flex[n].tolist()
        # A flex gives way; it has no thickness of its own.
        thickness, thin = min((self._limits.thicknesses[geom] if geom >= 0 else np.inf, geom) for geom in pair)
        if -distance[n] <= 0.5 * thickness:
            return None
        one, other = (
            geom_name(self.model, geom) if geom >= 0 else flex_name(self.model, flex)
            for geom, flex in zip(pair, flexes)
        )
        bodies = touching_bodies(self.model, data)[n]
        speeds = np.append(0.0, self._limits.reach.fastest(pose, twist))[bodies]
        constant = _time_constant(contact.solref[n], self.model.opt.timestep)
        # What stops goes as deep as its speed times the constant, what is pressed as its square.
        firm = min(thickness / max(speeds.max(), 1e-12), 0.5 * constant * np.sqrt(-0.25 * thickness / distance[n]))
        return (
            f"{one} and {other} overlap by {-distance[n]:.3g} m, more than half the thickness of "
            f"{geom_name(self.model, thin)} ({thickness:.3g} m), and may pass through each other unnoticed; "
            f"{_firmer(firm, self.model.opt.timestep)}"
        )

    def _cause(self, body: int) -> str:
        """Compares the stiffest thing of the model with what the integrator can follow."""
        dt, name, tolerant = self._limits.finest, integrator_of(self.model), self._limits.tolerant
        found = modes(self.model)
        growing = [mode for mode in found if mode.grows(dt)]
        if growing:
            worst = min(growing, key=lambda mode: mode.longest_step(dt))
            return f"{_growth(worst, dt)}; {_remedy(worst, dt, tolerant)}"
        spin = float(self._spins[body])
        if spin * dt > FOLLOWED:
            exact = "" if tolerant else "use physics_tolerance:=0.001,0.001, which follows it; "
            return (
                f"it turned {spin * dt:.3g} rad in one step of {dt:g} s; {exact}"
                f"stable, but not exact, is a timestep below {0.1 * FOLLOWED / spin:.2g} s"
            )
        fastest = max(found, key=lambda mode: mode.rate, default=None)
        if fastest is not None and fastest.rate * dt > 1.0:
            return (
                f"{fastest.source} has omega*dt = {fastest.rate * dt:.3g}, which {name} follows roughly at best; "
                f"use a timestep below {FOLLOWED / fastest.rate:.2g} s"
            )
        return (
            "strong forces, deep penetration or a long fall; a shorter timestep tells whether the step is to blame or "
            "the model"
        )


def _alike(growing: Sequence[Mode], dt: float) -> list[list[Mode]]:
    """Groups modes with the same remedy: a cable has hundreds of joints."""
    groups: dict[tuple[bool, ...], list[Mode]] = {}
    for mode in growing:
        alike = mode.contact, mode.activation, mode.oscillates, mode.grows(dt / 2**FINEST)
        groups.setdefault(alike, []).append(mode)
    return list(groups.values())


def _first(some: Sequence[Mode], step: Callable[[Mode], float]) -> Mode:
    """Returns the one that needs the shortest step, of equal ones the first: their inertias differ by rounding."""
    return min(some, key=lambda mode: float(f"{step(mode):.9g}"))


def _others(some: Sequence[Mode], told: Mode) -> str:
    others = [mode.source for mode in some if mode is not told]
    names = ", ".join(others[:NAMED]) + (", ..." if len(others) > NAMED else "")
    return f" (and {len(others)} more like it: {names})" if others else ""


def _growth(mode: Mode, dt: float) -> str:
    step, limit = mode.rate * dt, mode.rate * mode.longest_step(dt)
    digits = 3 if f"{step:.3g}" != f"{limit:.3g}" else 6
    return f"{mode.source} has omega*dt = {step:.{digits}g} and {mode.integrator} is stable below {limit:.{digits}g}"


def _remedy(mode: Mode, dt: float, tolerant: bool) -> str:
    """Words the remedies for an unstable mode: what follows its motion, what keeps it stable, and what that costs.

    tolerant: as of `Limits`.
    """
    followed = not tolerant and not mode.grows(dt / 2**FINEST)
    exact = "use physics_tolerance:=0.001,0.001, which follows it; " if followed else ""
    if mode.contact:  # a bounce of few steps gains or loses energy, however stable they are
        close = f"a timestep below {FOLLOWED / mode.rate:.2g} s does so nearly"
        return f'{exact}{close}; integrator="discrete" is stable, and erases its bounce'
    longest = _rounded_down(mode.longest_step(dt))
    if mode.activation:
        exactly = 'dyntype="filterexact" with an integrator other than RK4'
        return f"{exact}stable are a timestep below {longest:g} s, which is not exact, and {exactly}, which nearly is"
    erased = "which erases its oscillation" if mode.oscillates else "which erases what is faster than a step"
    return f'{exact}stable, but not exact, are a timestep below {longest:g} s and integrator="discrete", {erased}'


def _between_steps(turn: float) -> float:
    """Computes how far, of its amplitude, the cubic through both ends of a step of `turn` rad may be from x = cos.

    In its middle it is at (x0 + x1) / 2 + dt (v0 - v1) / 8, the truth at a peak there at 1.
    """
    return abs(1 - np.cos(0.5 * turn) - turn / 4 * np.sin(0.5 * turn)) if turn < np.pi else 1 + turn / 4


def _rounded_down(value: float) -> float:
    """Rounds a bound above 0 down to two digits: rounded up it would be none, at worst the step that is too long."""
    unit = 10.0 ** (np.floor(np.log10(max(value, 1e-300))) - 1)
    return float(f"{np.floor(value / unit + 1e-6) * unit:.1e}")


def _time_constant(solref: np.ndarray, dt: float) -> float:
    """Gives the time [s] in which a contact gives way and comes back; MuJoCo makes it two steps at least."""
    return max(float(solref[0]), 2 * dt) if solref[0] > 0 else float(1 / np.sqrt(max(-solref[0], 1e-300)))


def _firmer(constant: float, dt: float) -> str:
    """Words the parameters with which contacts stop geoms within their thickness.

    MuJoCo takes no time constant below two steps.
    """
    constant = float(f"{constant:.1e}")
    shorter = f"a timestep below {0.5 * constant:.2g} s and " if 0.5 * constant <= dt else ""
    return f'use {shorter}solref="{constant:.2g} 1" solimp="0.99 0.999 0.001" for both geoms'
