"""Adds bodies, geoms, cameras and lights of a MuJoCo model to a Scene. Imported only for scenes with dynamics.

Only geom groups 0 to 2 are drawn (3 and up are collision shapes by custom), and nothing of alpha 0; of a body under a
skin, which is not drawn, its collision shapes where it has no others.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from evis.config.suggestions import nearest
from evis.files.allowance import Allowance, AllowanceError
from evis.geometry import se3
from evis.scene.errors import SceneError
from evis.scene.mjcf.cameras import add_cameras, add_default
from evis.scene.mjcf.compiling.compile import compile_drawn, compile_mjcf
from evis.scene.mjcf.compiling.urdf import compile_urdf, drawn, unused_textures
from evis.scene.mjcf.dynamics import folders_of
from evis.scene.mjcf.frames import at_rest, name_of
from evis.scene.mjcf.geoms import GROUPS, add_geom
from evis.scene.mjcf.lights import add_lights, head_ambient
from evis.scene.mjcf.sky import skybox
from evis.scene.mjcf.undrawn import looks_otherwise, undrawn
from evis.scene.model import Body, Scene
from evis.scene.motion import Prescribed

HOME = "home"
"""Keyframe that is the start unless the scene names another: so the robots of MuJoCo Menagerie call theirs."""
DRAWN = 2 << 30
"""Memory for the shapes of a model, more where its files are large [bytes]."""


def add_model(scene: Scene, size: tuple[int, int], *, own_cameras: bool, visuals: bool = True) -> Any:
    """Compiles scene.mjcf and adds what it has to the scene; its cameras only where the scene file lists none of its
    own.

    size: width and height of cameras [px]. visuals=False: no geoms. Returns the MjModel. Raises SceneError.
    """
    assert scene.mjcf is not None
    mujoco.set_mju_user_warning(lambda text: None)  # else MuJoCo writes a log file into the working directory
    model, shown = _compile(scene, scene.mjcf, visuals)
    data = at_rest(model)
    for i in range(1, model.nbody):
        pose = se3.make_pose(data.xpos[i], se3.from_mujoco(data.xquat[i]))
        welded = Prescribed(pose) if model.body_weldid[i] == 0 else None
        scene.bodies.append(Body(name_of(model, mujoco.mjtObj.mjOBJ_BODY, i, "body"), welded))
    allowance = Allowance(scene.mjcf.stat().st_size, base=DRAWN)
    textures: dict[int, np.ndarray] = {}
    for geom in np.flatnonzero(shown).tolist():
        try:
            allowance.take(add_geom(scene, model, geom, textures))
        except AllowanceError as error:
            raise SceneError(f"{scene.mjcf.name}: its shapes are too large to be drawn: {error}") from None
    scene.notes += undrawn(model)
    if visuals:
        scene.left_out += looks_otherwise(model, shown)
    if asleep := _asleep(model):
        scene.notes.append(f'sleep="init" counts as sleep="allowed", so at the start {asleep} may move')
    if not own_cameras:
        add_cameras(scene, model, data, size)
    return model


def complete(
    scene: Scene, model: Any, arguments: Mapping[str, Any], *, lit: bool, sky: bool, visuals: bool = True
) -> None:
    """Adds a default camera, the model's lights, its ambient light and skybox, each unless the scene file gave its own.

    visuals=False: no skybox.
    """
    if not scene.cameras:
        add_default(scene, model, (int(arguments["width"]), int(arguments["height"])))
    ambient = head_ambient(model) if lit else add_lights(scene, model)
    if not sky:
        scene.environment = ambient
        if visuals:
            scene.environment_map = skybox(model)
            scene.sky_lights = scene.environment_map is None


def keyframe_of(model: Any, wanted: str) -> int:
    """Returns the number of the keyframe with this name, or else with this number; of `home`, if there is one, for
    `auto`; -1 for `none`.

    Raises ValueError with what there is.
    """
    names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_KEY, i) for i in range(model.nkey)]
    if wanted in names:
        return names.index(wanted)
    if wanted in ("auto", "none"):
        return names.index(HOME) if wanted == "auto" and HOME in names else -1
    numbers = [str(i) for i in range(model.nkey)]
    if wanted in numbers:
        return int(wanted)
    known = [name or number for name, number in zip(names, numbers)]
    if not names:
        hint = "the model has no keyframe"
    elif wanted.removeprefix("-").isdecimal():
        hint = f"its keyframes are numbered 0 to {model.nkey - 1}"
    else:
        hint = nearest(wanted, [*known, "auto", "none"])
    raise ValueError(f"is '{wanted}'; {hint}")


def unused_keyframe(model: Any) -> str:
    """Tells that a model with keyframes starts at none of them, and how to start at one."""
    name = name_of(model, mujoco.mjtObj.mjOBJ_KEY, 0, "")
    return f"no keyframe is named '{HOME}', so the model starts in its reference pose; there is keyframe:={name}"


def _compile(scene: Scene, path: Path, visuals: bool) -> tuple[Any, np.ndarray]:
    """The MjModel of an MJCF or URDF file, and which of its geoms are drawn, bool [ngeom]."""
    if path.suffix.lower() == ".urdf":
        bare, full, note = compile_urdf(path, folders_of(scene))
        scene.notes += [told for told in (note, unused_textures(path)) if told]
        return (full, drawn(full)) if visuals else (bare, np.zeros(bare.ngeom, bool))
    model = (compile_drawn if visuals else compile_mjcf)(path, folders_of(scene))
    shown = np.isin(model.geom_group, GROUPS)
    return model, (shown | _under_skins(model, shown)) & visuals


def _asleep(model: Any) -> str:
    """Names the bodies that the model has sleep until they are touched, as a text; "" for none."""
    if not model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_SLEEP:
        return ""
    trees = np.flatnonzero(model.tree_sleep_policy == mujoco.mjtSleepPolicy.mjSLEEP_INIT)
    bodies = [int(np.argmax(model.body_treeid == tree)) for tree in trees]
    names = [f"'{name_of(model, mujoco.mjtObj.mjOBJ_BODY, body, 'body')}'" for body in bodies]
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return f"body {', '.join(names[:3])}{more}" if names else ""


def _under_skins(model: Any, shown: np.ndarray) -> np.ndarray:
    """Geoms of bodies under a skin that have nothing else to be seen: of each the lowest group, bool [ngeom]."""
    bodies = np.setdiff1d(model.skin_bonebodyid, model.geom_bodyid[shown])
    lowest = np.full(model.nbody, np.iinfo(np.int32).max)
    np.minimum.at(lowest, model.geom_bodyid, model.geom_group)
    return np.isin(model.geom_bodyid, bodies) & (model.geom_group == lowest[model.geom_bodyid])
