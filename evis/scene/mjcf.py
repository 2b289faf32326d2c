"""Bodies, geoms, cameras and lights of a MuJoCo model as parts of a Scene. Imported only for scenes with dynamics.

Only geom groups 0 to 2 are drawn (3 and up are collision shapes by custom), and nothing of alpha 0.

Light in MuJoCo has no units. The rule here: a light of diffuse d makes a white surface that faces it have the radiance
d. So a directional light gives an irradiance of pi d [W/m^2], and a point or spot light as much at the distance of the
model's centre, falling with the square; where a light has an `intensity`, that times d is its radiant intensity [W/sr].
A spot shines within its `cutoff`, and falls to half where cos^exponent does. The `ambient` of headlight and lights add
up to the environment's radiance.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from evis.geometry import pinhole, se3
from evis.scene.mjcf_geoms import GROUPS, add_geom
from evis.scene.model import WORLD, Body, Camera, Light, Scene
from evis.scene.motion import Prescribed
from evis.scene.reader import SceneError

_FLIP = np.array([1.0, 0.0, 0.0, 0.0])
"""MuJoCo's cameras look along -z with y up: half a turn about x."""
_FIXED = mujoco.mjtCamLight.mjCAMLIGHT_FIXED


def add_model(scene: Scene, size: tuple[int, int], *, own_cameras: bool, visuals: bool = True) -> Any:
    """Compile scene.mjcf and add what it has to the scene; its cameras only where the scene file lists none of its own.

    size: width and height of cameras [px]. visuals=False: no geoms. Returns the MjModel. Raises SceneError.
    """
    assert scene.mjcf is not None
    mujoco.set_mju_user_warning(lambda text: None)  # else MuJoCo writes a log file into the working directory
    try:
        model, shown = _compile(scene, scene.mjcf, visuals)
    except ValueError as error:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        raise SceneError(f"{scene.mjcf.name}: {'; '.join(lines)}") from None
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for i in range(1, model.nbody):
        pose = se3.make_pose(data.xpos[i], se3.from_mujoco(data.xquat[i]))
        welded = Prescribed(pose) if model.body_weldid[i] == 0 else None
        scene.bodies.append(Body(_name(model, mujoco.mjtObj.mjOBJ_BODY, i, "body"), welded))
    for geom in np.flatnonzero(shown).tolist():
        add_geom(scene, model, geom)
    if model.nflex or model.nskin:
        scene.notes.append("flexes and skins are simulated but not drawn")
    if not own_cameras:
        for i in range(model.ncam):
            _add_camera(scene, model, i, size)
    return model


def complete(scene: Scene, model: Any, arguments: Mapping[str, Any], *, lit: bool, sky: bool) -> None:
    """A default camera, the model's lights and its ambient light, each unless the scene file gave its own."""
    if not scene.cameras:
        width, height = int(arguments["width"]), int(arguments["height"])
        focal = pinhole.focal_from_fov(height, np.radians(model.vis.global_.fovy))
        centre, distance = np.array(model.stat.center), 2.5 * model.stat.extent
        start = se3.look_at(centre + distance * np.array([0.6, -0.7, 0.4]), centre)
        scene.bodies.append(Body("cam0", Prescribed(start)))
        scene.cameras.append(Camera("cam0", width, height, pinhole.intrinsics(width, height, focal)))
    head = model.vis.headlight
    ambient = np.array(head.ambient, np.float32) if head.active else np.zeros(3, np.float32)
    if not lit:
        for i in range(model.nlight):
            if model.light_active[i]:
                ambient = ambient + model.light_ambient[i]
                scene.lights.append(_light(scene, model, i))
        if not scene.lights and head.active:
            body = scene.body_index(scene.cameras[0].name)
            colour = np.pi * np.array(head.diffuse, np.float32)
            scene.lights.append(
                Light("headlight", "directional", colour, np.array([0.0, 0.0, 1.0]), body, shadows=False)
            )
    if not sky:
        scene.environment = np.asarray(ambient, np.float32)


def _compile(scene: Scene, path: Path, visuals: bool) -> tuple[Any, np.ndarray]:
    """The MjModel of an MJCF or URDF file, and which of its geoms are drawn, bool [ngeom]."""
    if path.suffix.lower() == ".urdf":
        from evis.scene.urdf import compile_urdf, drawn

        bare, full, note = compile_urdf(path)
        if note:
            scene.notes.append(note)
        return (full, drawn(full)) if visuals else (bare, np.zeros(bare.ngeom, bool))
    model = mujoco.MjModel.from_xml_path(str(path))
    return model, np.isin(model.geom_group, GROUPS) & visuals


def _add_camera(scene: Scene, model: Any, i: int, size: tuple[int, int]) -> None:
    name = _name(model, mujoco.mjtObj.mjOBJ_CAMERA, i, "camera")
    if model.cam_mode[i] != _FIXED:
        mode = mujoco.mjtCamLight(model.cam_mode[i]).name.removeprefix("mjCAMLIGHT_").lower()
        scene.notes.append(f"camera '{name}' is left out: mode {mode} is not rigid; fixed cameras are simulated")
        return
    if model.cam_projection[i] != mujoco.mjtProjection.mjPROJ_PERSPECTIVE:
        scene.notes.append(f"camera '{name}' is left out: it is orthographic")
        return
    width, height = size
    k = pinhole.intrinsics(width, height, pinhole.focal_from_fov(height, np.radians(model.cam_fovy[i])))
    if model.cam_sensorsize[i, 1] > 0:
        k[[0, 1], [0, 1]] = model.cam_intrinsic[i, :2] / model.cam_sensorsize[i] * size
    offset = se3.make_pose(model.cam_pos[i], se3.multiply(se3.from_mujoco(model.cam_quat[i]), _FLIP))
    if any(body.name == name for body in scene.bodies):
        name = f"{name}_camera"
    parent = int(model.cam_bodyid[i]) - 1
    outer = scene.bodies[parent].trajectory if parent != WORLD else None
    if parent == WORLD or outer is not None:
        assert outer is None or isinstance(outer, Prescribed)
        scene.bodies.append(Body(name, Prescribed(offset, parent=outer)))
    else:
        scene.bodies.append(Body(name, None, mount=(parent, offset)))
    scene.cameras.append(Camera(name, width, height, k))


def _light(scene: Scene, model: Any, i: int) -> Light:
    name = _name(model, mujoco.mjtObj.mjOBJ_LIGHT, i, "light")
    if model.light_mode[i] != _FIXED:
        scene.notes.append(f"light '{name}' follows a body in MuJoCo; here it is fixed to its own")
    body, diffuse = int(model.light_bodyid[i]) - 1, np.array(model.light_diffuse[i], np.float32)
    shadows = bool(model.light_castshadow[i])
    if model.light_type[i] == mujoco.mjtLightType.mjLIGHT_DIRECTIONAL:
        return Light(name, "directional", np.pi * diffuse, np.array(model.light_dir[i], np.float64), body, shadows)
    position = np.array(model.light_pos[i], np.float64)
    square = float(np.sum((model.light_pos0[i] + _origin(model, body) - model.stat.center) ** 2))
    strength = float(model.light_intensity[i]) or np.pi * max(square, 1e-6)
    colour = np.float32(strength) * diffuse
    if model.light_type[i] != mujoco.mjtLightType.mjLIGHT_SPOT or model.light_cutoff[i] >= 90:
        return Light(name, "point", colour, position, body, shadows)
    cone = _cone(float(np.radians(model.light_cutoff[i])), float(model.light_exponent[i]))
    return Light(name, "spot", colour, position, body, shadows, np.array(model.light_dir[i], np.float64), cone)


def _cone(cutoff: float, exponent: float) -> tuple[float, float]:
    """Half-angles of a cone whose smooth step in the cosine is half where cos^exponent is, if that is within `cutoff`.

    A step that begins on the axis ends before `cutoff` where the power falls fast.
    """
    half = 0.5 ** (1 / exponent) if exponent > 0 else 0.0
    edge = max(float(np.cos(cutoff)), 2 * half - 1)
    full = max(2 * half - edge, edge)
    return float(np.arccos(min(full, 1.0))), float(np.arccos(edge))


def _origin(model: Any, body: int) -> np.ndarray:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return np.array(data.xpos[body + 1])


def _name(model: Any, kind: Any, i: int, default: str) -> str:
    return mujoco.mj_id2name(model, kind, i) or f"{default}{i}"
