"""Builds a Scene from what a scene file says: cameras, bodies and their motion, shapes, materials, lights.

The file is YAML; every key is optional but `cameras` (an MJCF may do without). Angles are radians, or texts as
`40 deg`; colours are linear Rec. 709, one number is a grey; a value may be drawn by the environment's seed, see
`drawing`; `${...}` is arithmetic over the arguments.

    description: one line for whoever reads the file
    args:       {NAME: {type: float|int|str|bool|vector|folder, default, min, max, choices, unit, help}};
                width, height: always
    cameras:    {NAME: FRAME + {fov (vertical) | focal (px), width, height, near, supersampling,
                rate (keyframes per second), distortion: {model: plumb_bob|equidistant, coefficients}}}
    bodies:     {NAME: FRAME + {motion: [MOTION], shapes: [SHAPE], semantic}}
    world:      [SHAPE], static
    materials:  {NAME: {albedo, emission, roughness, metallic, two_sided, texture: {kind: image, file} or
                {kind: blobs|noise|leaves|checker|bricks|planks, size, low, high, seed, feature, colour,
                cells, joint, wedge: {angle, value}}, where folder: DIR draws a picture of DIR in its place}}
    lights:     {NAME: {kind: directional, direction, irradiance} | {kind: point, position, intensity}
                | {kind: spot, position, direction|look_at, intensity, cone, full: half-angles}
                | {kind: area, position, direction|look_at, up, size, radiance}; all: body, shadows,
                flicker: {kind: sine|square, frequency, depth, phase (periods), duty}}
    environment: radiance of the sky
    environment_map: FILE.exr | {kind: sky, rows, zenith, horizon, ground, sun: {towards, irradiance, size}}
                | {kind: studio, wall, panels: [{towards, size: [width, height], radiance}]}
                | {kind: tunnel, wall, outside, towards, size}
    include:    a file with materials, world, bodies, lights and environment that several scenes share
    timestep:   sub-step of prescribed motion [s]
    sensor:     {threshold, leak_rate, ...}: parameters of the event sensor, over those of its preset
    mjcf:       a MuJoCo model or URDF with the bodies that move by dynamics;  initial_spread: {position, rotation}
    initial_joints: {JOINT: {position, velocity}} of hinges and slides of the model, each a number or [least, most],
                drawn by the seed at every start
    assets:     [FOLDER], from which the files named here (mjcf, meshes) may take theirs, beside their own folders
    keyframe:   of the model, where it starts: a name, a number, none; auto (the default): `home`, if it has that
    model:      what of it is other than its file says, by name, where * stands for any letters: {gravity,
                bodies: {NAME: {mass, friction, shift, turn: {axis, angle}}}, geoms: {NAME: {friction}},
                joints: {NAME: {position, shift, velocity, damping, stiffness, friction, armature}},
                actuators: {NAME: {gain}}, materials: {NAME: {albedo, emission, roughness, metallic}},
                lights: {NAME: {strength}}}; X_scale in place of X: a factor
    actuators:  {JOINT: {kind: position (gain, damping) | velocity (gain) | motor (gain), range: [least, most]}}, which
                hinges and slides of the model have beside its own

    FRAME:  position and rotation: {axis, angle} (or a list) | quaternion | look_at (with up), in the frame of `parent`;
            or view: {camera, offset, depth}, a place in a camera's image
            or trajectory: {file, unit: s|ms|us|ns, quaternion: xyzw|wxyz}, poses over time in the frame of `parent`
    MOTION: in the parent's frame, added up: {kind: linear, velocity} | {kind: sinusoid, amplitude, frequency, phase}
            | {kind: path, times, points, loop, start_velocity, end_velocity}, a spline
            in the body's frame, chained: {kind: spin, axis, rate} | {kind: swing, axis, amplitude, frequency, phase}
            | {kind: turn, axis, times, angles, loop, start_rate, end_rate}, a spline
    SHAPE:  {shape: box (size, edge: radius of round edges | tile) | sphere (radius) | ellipsoid (radii)
            | cylinder (radius, height) | capsule (radius, height of the part between its ends) | disk (radius)
            | torus (radius, tube) | rock (radius, rough, seed)
            | plane (size, repeat | tile, cells) | mesh (vertices, faces), material, name, position, rotation}
            or {shape: mesh, file: X.obj|ply|stl|gltf|glb, scale, up: y|z, crease}, with the file's own materials
            folder: DIR draws a mesh of DIR in the shape's place
            semantic: the class of the thing; else its body's, its name or its body's name, without what copies add

Entries of bodies, cameras, lights, world, shapes and materials may have `copies:` and stand for many, see `copies`.
Paths are relative to the scene file.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from evis.config.document import Table
from evis.files.allowance import Allowance
from evis.scene.draws import Draws
from evis.scene.errors import SceneError
from evis.scene.folders import Folders
from evis.scene.images.made_pictures import MadePictures
from evis.scene.images.sky import mean_radiance, read_environment_map
from evis.scene.model import MODELS, WORLD, Scene
from evis.scene.yaml.copies import Copies
from evis.scene.yaml.dynamics import Dynamics
from evis.scene.yaml.frames import Frames
from evis.scene.yaml.lights import read_light
from evis.scene.yaml.reader import Fields
from evis.scene.yaml.shapes import Shapes

MADE = 2 << 30
"""What a scene file may make of a few lines by code, meshes and textures [bytes]; 100 times its size comes to it."""


def build(
    table: Table,
    path: Path,
    arguments: Mapping[str, Any],
    textures: bool = True,
    visuals: bool = True,
    draws: Draws | None = None,
    made: dict[Any, Any] | None = None,
) -> Scene:
    """Builds the Scene of a checked argument set. textures, visuals: as in `load_scene`. draws: of its world, in which
    those of arguments are already. made: meshes and textures of worlds built before, which it shares.
    Raises SceneError.
    """
    draws = draws or Draws(0)
    scene = Scene(path.stem, [], [], [], [], [], np.zeros(3, np.float32))
    top = Fields(table, f"scene {path.stem}", arguments, draws)
    pictures = MadePictures()
    try:
        _read(scene, top, path, textures, visuals, {} if made is None else made, pictures)
    finally:
        pictures.wait()
    scene.drawn = list(draws.made.values())
    return scene


def _read(
    scene: Scene,
    top: Fields,
    path: Path,
    textures: bool,
    visuals: bool,
    made: dict[Any, Any],
    pictures: MadePictures,
) -> None:
    """Reads all that the file says into an empty scene."""
    folders, copies = _folders(top, path), Copies()
    for key in ("args", "include"):  # read already
        top.has(key)
    top.text("description", "")
    dynamics = Dynamics(scene, top, folders, visuals)
    frames = Frames(scene, top, copies, folders.home)
    _sensor(scene, top)
    shapes = None
    if visuals:
        shapes = Shapes(scene, folders, textures, made, pictures, Allowance(path.stat().st_size, base=MADE), copies)
        shapes.add_materials(top.sections("materials", "material"))
        shapes.add(WORLD, "world", top.items("world", "shape"))
        for name, fields in frames.bodies.items():
            shared = fields.text("semantic", "")
            shapes.add(frames.index[name], name, fields.items("shapes", "shape"), shared, frames.stems[name])
        _lights(scene, top, frames, copies)
        _sky(scene, top, folders)
        for fields in (*frames.bodies.values(), *frames.cameras.values(), top):
            fields.done()
    if dynamics.model is not None:
        dynamics.complete()
    elif not any(top.has(key) for key in ("lights", "environment", "environment_map")):
        if not (_mentions(top.table, "emission") or _mentions(top.table, "file")):  # a mesh may glow
            scene.notes.append("nothing gives light, so every image is black: add `lights:` or `environment:`")
    _check_cameras(scene, path.name)
    if shapes is not None:
        dynamics.make_finer(partial(shapes.take, fields=top), made)
    _name_cam0(scene, path.name, frames, dynamics)


def _sensor(scene: Scene, top: Fields) -> None:
    """Reads what of the event sensor is other than its preset says: numbers, texts and flags by name."""
    section = top.section("sensor", "sensor")
    for key in section.table if section else ():
        assert section is not None
        value = section.raw(key)
        if not isinstance(value, (int, float, str)):
            raise section.error(key, f"is {value!r:.60}; it must be a number, a text, or true or false")
        scene.sensor[key] = value


def _lights(scene: Scene, top: Fields, frames: Frames, copies: Copies) -> None:
    for base, section in top.sections("lights", "light").items():
        for ending, fields in copies.of(section):
            body = frames.reference(fields, "body") if fields.has("body") else WORLD
            scene.lights.append(read_light(base + ending, fields, body))


def _sky(scene: Scene, top: Fields, folders: Folders) -> None:
    """Reads `environment` and `environment_map`; without the former it is the mean of the map."""
    if top.has("environment_map"):
        scene.environment_map = read_environment_map(top, folders.home)
        scene.environment = mean_radiance(scene.environment_map)
    if top.has("environment"):
        scene.environment = top.colour("environment")


def _check_cameras(scene: Scene, file: str) -> None:
    """Raises SceneError for a scene without a camera."""
    if not scene.cameras:
        raise SceneError(f"{file}: scene {scene.name} has no camera; add `cameras: {{cam0: {{fov: 40 deg}}}}`")


def _name_cam0(scene: Scene, file: str, frames: Frames, dynamics: Dynamics) -> None:
    """Leaves no scene without a cam0. Raises SceneError."""
    # The only camera, or a model's first one, is found without its name; several keep those of the file.
    named = frames.cameras and len(scene.cameras) > 1
    if not named and all(camera.name != "cam0" for camera in scene.cameras):
        # A link of a model gives way to the camera; a body of the scene file is a mistake.
        if "cam0" in frames.index and not dynamics.free("cam0", frames.index["cam0"]):
            raise SceneError(f"{file}: 'cam0' is the name of the first camera, but here it is a body; rename it")
        first = scene.cameras[0]
        scene.bodies[scene.body_index(first.name)].name = "cam0"
        first.name = "cam0"


def _folders(top: Fields, path: Path) -> Folders:
    """The scene's folder, and those of `assets`: relative to the scene file, or to where a model by itself is
    launched. Raises SceneError for one that is not there."""
    stated = top.plain("assets", [])
    names = [name.strip() for name in stated.split(",") if name.strip()] if isinstance(stated, str) else stated
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise top.error("assets", f"is {stated!r:.60}; it must be a list of folders")
    bare = path.suffix.lower() in MODELS
    folders = tuple(Path(name).expanduser() if bare else path.parent / name for name in names)
    for folder in folders:
        if not folder.is_dir():
            raise top.error("assets", f"names {folder}, which is no folder")
    return Folders(path.parent, folders, bare)


def _mentions(value: Any, key: str) -> bool:
    """Whether a map in `value` has this key."""
    if isinstance(value, dict):
        return key in value or any(_mentions(inner, key) for inner in value.values())
    return isinstance(value, list) and any(_mentions(inner, key) for inner in value)
