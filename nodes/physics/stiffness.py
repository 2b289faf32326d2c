"""Compares the fastest modes of a model with what its integrator can follow at its timestep."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

_NAMES = {
    mujoco.mjtIntegrator.mjINT_EULER: "Euler",
    mujoco.mjtIntegrator.mjINT_RK4: "RK4",
    mujoco.mjtIntegrator.mjINT_IMPLICIT: "implicit",
    mujoco.mjtIntegrator.mjINT_IMPLICITFAST: "implicitfast",
}
_GEOM = mujoco.mjtGeom
FOLLOWED = 0.2
"""omega*dt up to which every integrator follows an oscillation."""
_GROWTH = 1e-6
"""Growth of a step that is rounding: an undamped oscillator keeps its amplitude."""


def integrator_of(model: Any) -> str:
    """Gives the name of a model's integrator, as in MJCF; `discrete` is stable for any spring."""
    return _NAMES.get(mujoco.mjtIntegrator(model.opt.integrator), "discrete")


@dataclass(frozen=True)
class Mode:
    """Describes one joint, tendon, limit, equality or contact by itself: x'' = -stiffness x - (implicit + explicit) x'.

    source: what it belongs to. stiffness [1/s^2]; implicit, explicit: damping [1/s] that the integrator takes at the
    end and at the beginning of its step. MuJoCo takes that of joints at the end with Euler, that of actuators too with
    `implicit` and `implicitfast`, none with RK4; springs always at the beginning, but with `discrete`.
    contact: it acts while things touch, or a joint or tendon is at its limit. activation: x' is that of an actuator,
    which decays, and which `discrete` takes a step of as Euler does.
    """

    source: str
    integrator: str
    stiffness: float
    implicit: float
    explicit: float
    contact: bool = False
    activation: bool = False

    @property
    def rate(self) -> float:
        """Gives the faster of oscillation and decay [1/s]."""
        return max(np.sqrt(self.stiffness), self.implicit + self.explicit)

    def grows(self, dt: float) -> bool:
        """Tells whether a step of dt [s] makes a small disturbance larger."""
        always = self.integrator == "discrete" and not self.activation
        return not always and _spectral_radius(self._step(dt)) > 1 + _GROWTH

    @property
    def oscillates(self) -> bool:
        """Tells whether it swings before it comes to rest, so that `discrete` erases something of it."""
        return self.implicit + self.explicit < 2 * np.sqrt(self.stiffness)

    def too_fast(self, dt: float) -> bool:
        """Tells whether it oscillates too fast for steps of dt [s] to show how."""
        return self.oscillates and np.sqrt(self.stiffness) * dt > FOLLOWED

    def longest_step(self, dt: float) -> float:
        """Finds the longest stable step [s] below dt [s], at which it grows."""
        low, high = 0.0, dt
        for _ in range(40):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if self.grows(middle) else (middle, high)
        return low

    def _step(self, dt: float) -> np.ndarray:
        """Computes the matrix [2, 2] of a step, on (x, x')."""
        k, c = dt * self.stiffness, dt * self.explicit
        if self.integrator == "RK4":
            a = np.array([[0.0, dt], [-k, -c - dt * self.implicit]])
            return np.eye(2) + a @ (np.eye(2) + a @ (np.eye(2) / 2 + a @ (np.eye(2) / 6 + a / 24)))
        # The velocity first, then the position by the new velocity.
        velocity = np.array([-k, 1 - c]) / (1 + dt * self.implicit)
        return np.array([np.array([1.0, 0.0]) + dt * velocity, velocity])


def modes(model: Any) -> list[Mode]:
    """Finds the joints and tendons with springs, dampers and servos, contacts, limits and equalities with a direct
    solref, and actuators with a filter.
    """
    return [*_joints(model), *_tendons(model), *_direct(model), *_filters(model)]


def _joints(model: Any) -> Iterator[Mode]:
    integrator = integrator_of(model)
    late = integrator in ("implicit", "implicitfast")
    euler = integrator == "Euler" and not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_EULERDAMP
    springs = np.asarray(model.jnt_stiffness).reshape(model.njnt, -1)[:, 0] if model.njnt else np.zeros(0)
    damping = np.asarray(model.dof_damping).reshape(model.nv, -1)[:, 0] if model.nv else np.zeros(0)
    servos = _servos(model, mujoco.mjtTrn.mjTRN_JOINT)
    for joint in range(model.njnt):
        dof = int(model.jnt_dofadr[joint])
        inertia = max(float(model.dof_M0[dof]), 1e-300)
        stiffness, drag = servos.get(joint, (0.0, 0.0))
        parts = {"spring": float(springs[joint]), "damping": float(damping[dof]), "servo": stiffness + drag}
        if not any(parts.values()):
            continue
        speeds = {
            "spring": np.sqrt(parts["spring"] / inertia),
            "damping": parts["damping"] / inertia,
            "servo": max(np.sqrt(stiffness / inertia), drag / inertia),
        }
        joint_damping, servo_damping = parts["damping"] / inertia, drag / inertia
        implicit = (joint_damping if late or euler else 0.0) + (servo_damping if late else 0.0)
        yield Mode(
            f"the {max(speeds, key=lambda part: speeds[part])} of {_joint(model, joint)}",
            integrator,
            (parts["spring"] + stiffness) / inertia,
            implicit,
            joint_damping + servo_damping - implicit,
        )


def _tendons(model: Any) -> Iterator[Mode]:
    integrator = integrator_of(model)
    late = integrator in ("implicit", "implicitfast")
    servos = _servos(model, mujoco.mjtTrn.mjTRN_TENDON)
    for tendon in range(model.ntendon):
        # J M^-1 J^T of the tendon's length at the start: what a force along it accelerates.
        mobility = float(model.tendon_invweight0[tendon])
        stiffness, drag = servos.get(tendon, (0.0, 0.0))
        spring, damping = (float(values[tendon]) for values in (model.tendon_stiffness, model.tendon_damping))
        parts = {"spring": np.sqrt(spring * mobility), "damping": damping * mobility}
        parts["servo"] = max(np.sqrt(stiffness * mobility), drag * mobility)
        if any(parts.values()):
            drags = (damping + drag) * mobility
            yield Mode(
                f"the {max(parts, key=lambda part: parts[part])} of {_tendon(model, tendon)}",
                integrator,
                (spring + stiffness) * mobility,
                drags if late else 0.0,
                0.0 if late else drags,
            )


def _servos(model: Any, transmission: mujoco.mjtTrn) -> dict[int, tuple[float, float]]:
    """Finds the stiffness and damping that actuators with an affine bias give what they move, by its number."""
    found: dict[int, tuple[float, float]] = {}
    for actuator in np.flatnonzero(model.actuator_biastype == mujoco.mjtBias.mjBIAS_AFFINE).tolist():
        if model.actuator_trntype[actuator] == transmission:
            joint = int(model.actuator_trnid[actuator, 0])
            square = float(model.actuator_gear[model.actuator_outadr[actuator], 0]) ** 2
            stiffness, damping = (max(-float(p) * square, 0.0) for p in model.actuator_biasprm[actuator, 1:3])
            before = found.get(joint, (0.0, 0.0))
            found[joint] = (before[0] + stiffness, before[1] + damping)
    return found


def _direct(model: Any) -> Iterator[Mode]:
    """Yields the modes of constraints whose solref = (-stiffness, -damping): their reference acceleration is -damping v
    - stiffness r, of the step's start."""
    found: list[tuple[str, np.ndarray, bool]] = [
        (geom_name(model, geom), model.geom_solref[geom], True) for geom in range(model.ngeom)
    ]
    limits = np.flatnonzero(model.jnt_limited).tolist()
    found += [(f"the limit of {_joint(model, joint)}", model.jnt_solref[joint], True) for joint in limits]
    limits = np.flatnonzero(model.tendon_limited).tolist()
    found += [(f"the limit of {_tendon(model, tendon)}", model.tendon_solref_lim[tendon], True) for tendon in limits]
    found += [(_equality(model, n), model.eq_solref[n], False) for n in np.flatnonzero(model.eq_active0).tolist()]
    for source, solref, contact in found:
        if solref[0] < 0:
            stiffness, damping = (-float(value) for value in solref)
            yield Mode(f"the direct solref of {source}", integrator_of(model), stiffness, 0.0, damping, contact)


def _filters(model: Any) -> Iterator[Mode]:
    """Yields the modes of actuators whose activation follows the control with a time constant: act' = (control - act) /
    dynprm[0].

    `filterexact` is a step's exponential, which nothing makes grow; but RK4 takes it of the mean of its four rates,
    which grows as they do.
    """
    integrator = integrator_of(model)
    explicit = [mujoco.mjtDyn.mjDYN_FILTER] + [mujoco.mjtDyn.mjDYN_FILTEREXACT] * (integrator == "RK4")
    for actuator in np.flatnonzero(np.isin(model.actuator_dyntype, explicit)).tolist():
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, actuator) or f"actuator{actuator}"
        rate = 1 / max(float(model.actuator_dynprm[actuator, 0]), mujoco.mjMINVAL)
        yield Mode(f"the activation of actuator '{name}'", integrator, 0.0, 0.0, rate, activation=True)


def thicknesses(model: Any) -> np.ndarray:
    """Finds how thick every geom is where it is thinnest, float64 [geoms] m.

    inf for what does not collide, and for planes and height fields, which have no other side.
    """
    found = np.full(model.ngeom, np.inf)
    for geom in range(model.ngeom):
        kind, size = model.geom_type[geom], model.geom_size[geom]
        if not (model.geom_contype[geom] or model.geom_conaffinity[geom]) or kind in (
            _GEOM.mjGEOM_PLANE,
            _GEOM.mjGEOM_HFIELD,
        ):
            continue
        if kind in (_GEOM.mjGEOM_SPHERE, _GEOM.mjGEOM_CAPSULE):
            half = size[0]
        elif kind == _GEOM.mjGEOM_CYLINDER:
            half = min(size[:2])
        elif kind in (_GEOM.mjGEOM_BOX, _GEOM.mjGEOM_ELLIPSOID):
            half = min(size)
        else:
            half = min(model.geom_aabb[geom, 3:])
        found[geom] = 2 * float(half)
    return found


def geom_name(model: Any, geom: int) -> str:
    """Names a geom in a message."""
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, geom)
    number = int(model.geom_bodyid[geom])
    body = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, number) or f"body{number}"
    return f"geom '{name}'" if name else f"geom {geom} of body '{body}'"


def _joint(model: Any, joint: int) -> str:
    return f"joint '{mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, joint) or f'joint{joint}'}'"


def _tendon(model: Any, tendon: int) -> str:
    return f"tendon '{mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TENDON, tendon) or f'tendon{tendon}'}'"


def _equality(model: Any, number: int) -> str:
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_EQUALITY, number) or f"equality{number}"
    return f"equality '{name}'"


def _spectral_radius(matrix: np.ndarray) -> float:
    return float(np.abs(np.linalg.eigvals(matrix)).max()) if np.isfinite(matrix).all() else np.inf
