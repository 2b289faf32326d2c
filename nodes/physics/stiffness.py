"""How fast the fastest things of a model are, against what its integrator can follow at its timestep."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

_STABLE = {
    mujoco.mjtIntegrator.mjINT_EULER: ("Euler", 2.0),
    mujoco.mjtIntegrator.mjINT_RK4: ("RK4", 2.78),
    mujoco.mjtIntegrator.mjINT_IMPLICIT: ("implicit", 2.0),
    mujoco.mjtIntegrator.mjINT_IMPLICITFAST: ("implicitfast", 2.0),
}
_GEOM = mujoco.mjtGeom


def integrator_limit(model: Any) -> tuple[str, float]:
    """Name of the integrator, and the omega*dt beyond which an undamped oscillator grows under it.

    MuJoCo's implicit integrators are implicit in velocity only; `discrete` is stable for any spring.
    """
    return _STABLE.get(mujoco.mjtIntegrator(model.opt.integrator), ("discrete", np.inf))


def rates(model: Any) -> list[tuple[float, str]]:
    """Rates [1/s] of joint springs, position servos and contacts with a direct solref, with what they belong to."""
    result = []
    springs = np.asarray(model.jnt_stiffness).reshape(model.njnt, -1)[:, 0] if model.njnt else np.zeros(0)
    for joint in np.flatnonzero(springs > 0).tolist():
        rate = _frequency(model, float(springs[joint]), int(model.jnt_dofadr[joint]))
        result.append((rate, f"the spring of {_joint(model, joint)}"))
    for actuator in np.flatnonzero(model.actuator_biastype == mujoco.mjtBias.mjBIAS_AFFINE).tolist():
        if model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT:
            joint = int(model.actuator_trnid[actuator, 0])
            stiffness = -float(model.actuator_biasprm[actuator, 1]) * float(model.actuator_gear[actuator, 0]) ** 2
            if stiffness > 0:
                rate = _frequency(model, stiffness, int(model.jnt_dofadr[joint]))
                result.append((rate, f"the servo of {_joint(model, joint)}"))
    for geom in np.flatnonzero(model.geom_solref[:, 0] < 0).tolist():
        # solref = (-stiffness, -damping): the reference acceleration is -damping v - stiffness r
        stiffness, damping = -model.geom_solref[geom]
        result.append((float(max(np.sqrt(stiffness), damping)), f"the direct solref of {_name(model, geom)}"))
    return result


def thinnest_geom(model: Any) -> tuple[str, float]:
    """Name and thickness [m] of the thinnest geom that collides; planes have no thickness to pass through."""
    best = ("", np.inf)
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
        if 2 * half < best[1]:
            best = (_name(model, geom), 2 * float(half))
    return best


def _frequency(model: Any, stiffness: float, dof: int) -> float:
    return float(np.sqrt(stiffness / max(float(model.dof_M0[dof]), 1e-300)))


def _joint(model: Any, joint: int) -> str:
    return f"joint '{mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, joint) or f'joint{joint}'}'"


def _name(model: Any, geom: int) -> str:
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, geom)
    body = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, model.geom_bodyid[geom])
    return f"geom '{name}'" if name else f"geom {geom} of body '{body}'"
