"""Builds a Scene from what a scene file says: cameras, bodies and their motion, shapes, materials, lights.

The file is YAML; every key is optional but `cameras` (an MJCF may do without). Angles are radians, or texts as
`40 deg`; colours are linear Rec. 709, one number is a grey; a value may be drawn by the environment's seed, see
`drawing`; `${...}` is arithmetic over the arguments.

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

import re
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from evis.config.document import Table
from evis.config.suggestions import nearest
from evis.files.allowance import Allowance, AllowanceError
from evis.geometry import distortion, pinhole, se3
from evis.geometry.distortion import Lens
from evis.scene import motion
from evis.scene.draws import Draws
from evis.scene.errors import SceneError
from evis.scene.folders import Folders
from evis.scene.images.sky import mean_radiance, read_environment_map
from evis.scene.model import MODELS, WORLD, Body, Scene
from evis.scene.view.fineness import make_finer
from evis.scene.yaml.cameras import read_camera
from evis.scene.yaml.copies import MAX_COPIES, copies
from evis.scene.yaml.lights import read_light
from evis.scene.yaml.made_pictures import MadePictures
from evis.scene.yaml.motion import read_motion
from evis.scene.yaml.reader import Fields
from evis.scene.yaml.seen import Seen

SUBSTEP_NS = 1_000_000
"""Sub-step of /state unless the scene says otherwise [ns]: the 1 kHz that controllers and inertial sensors use."""

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
    scene = _Builder(table, path, arguments, textures, visuals, draws, {} if made is None else made).scene
    scene.drawn = list(draws.made.values())
    return scene


class _Builder:
    def __init__(
        self,
        table: Table,
        path: Path,
        arguments: Mapping[str, Any],
        textures: bool,
        visuals: bool,
        draws: Draws,
        made: dict[Any, Any],
    ) -> None:
        self.top = Fields(table, f"scene {path.stem}", arguments, draws)
        self.arguments, self.folder, self.textures, self.visuals = arguments, path.parent, textures, visuals
        self.folders = _folders(self.top, path)
        self.allowance = Allowance(path.stat().st_size, base=MADE)
        self.entries = 0
        self.scene = Scene(path.stem, [], [], [], [], [], np.zeros(3, np.float32))
        self.made = made
        self.pictures = MadePictures()
        try:
            self._read(path)
        finally:
            self.pictures.wait()

    def _read(self, path: Path) -> None:
        """Reads all that the file says."""
        self.top.has("args")
        self.top.has("include")
        self.top.text("description", "")
        self._physics(path)
        self._frames()
        self._sensor()
        if self.visuals:
            seen = Seen(self.scene, self.folders, self.textures, self.pictures, self.made, self._copies, self._take)
            seen.read_materials(self.top.sections("materials", "material"))
            seen.read_shapes(WORLD, "world", self.top.items("world", "shape"))
            for name, fields in self.bodies.items():
                shared = fields.text("semantic", "")
                seen.read_shapes(self.index[name], name, fields.items("shapes", "shape"), shared, self.stems[name])
            self._lights()
            self._sky()
            for fields in (*self.bodies.values(), *self.cameras.values(), self.top):
                fields.done()
        self._settle(path)

    def _physics(self, path: Path) -> None:
        """The MJCF, if there is one: its bodies come first, so that body n of the engine is body n here."""
        scene = self.scene
        scene.timestep_ns = round(self.top.number("timestep", SUBSTEP_NS * 1e-9, above=1e-7) * 1e9)
        spread = self.top.section("initial_spread", "initial_spread")
        if spread:
            scene.initial_spread = (spread.number("position", 0.0, minimum=0), spread.angle("rotation", 0.0))
            spread.done()
        starts = self.top.sections("initial_joints", "joint")
        self.model: Any = None
        if self.top.has("mjcf"):
            from evis.scene.mjcf.joints import read_starts
            from evis.scene.mjcf.model import add_model, keyframe_of, unused_keyframe

            scene.mjcf = (path.parent / self.top.text("mjcf")).resolve()
            if not scene.mjcf.is_file():
                raise self.top.error("mjcf", f"names {scene.mjcf.name}, which is not in {path.parent or '.'}")
            scene.folders = self.folders.beside(scene.mjcf)
            size = (int(self.arguments["width"]), int(self.arguments["height"]))
            self.model = add_model(scene, size, own_cameras="cameras" in self.top.table, visuals=self.visuals)
            self.of_model = len(scene.instances)
            scene.initial_joints = read_starts(self.model, starts)
            try:
                wanted = self.top.text("keyframe", "auto")
                scene.keyframe = keyframe_of(self.model, wanted)
                if wanted == "auto" and scene.keyframe < 0 and self.model.nkey:
                    scene.notes.append(unused_keyframe(self.model))
            except ValueError as error:
                if isinstance(error, SceneError):
                    raise
                raise self.top.error("keyframe", str(error)) from None
            self._change_model()
            return
        for key in ("initial_spread", "initial_joints", "keyframe", "model", "actuators"):
            if self.top.has(key):
                raise self.top.error(key, "is for scenes with an mjcf; prescribed motion starts where it says")

    def _change_model(self) -> None:
        """What of the model is other than its file says, but for what is seen of it, which is not there yet."""
        section = self.top.section("model", "model")
        if section:
            from evis.scene.mjcf.changes import read_changes

            self.scene.changes = read_changes(section, self.model)
        self.changes = section
        if self.top.has("actuators"):
            from evis.scene.mjcf.added_actuators import read_actuators

            self.scene.actuators = read_actuators(self.top, self.model)

    def _sensor(self) -> None:
        """What of the event sensor is other than its preset says: numbers, texts and flags by name."""
        section = self.top.section("sensor", "sensor")
        for key in section.table if section else ():
            assert section is not None
            value = section.raw(key)
            if not isinstance(value, (int, float, str)):
                raise section.error(key, f"is {value!r:.60}; it must be a number, a text, or true or false")
            self.scene.sensor[key] = value

    def _frames(self) -> None:
        """Bodies and cameras: numbered first, then placed, since each may stand on another."""
        bodies = self.top.sections("bodies", "body")
        copied = [(base, ending, copy) for base, entry in bodies.items() for ending, copy in self._copies(entry)]
        self.stems = {base + ending: base for base, ending, _ in copied}
        self.bodies = {base + ending: copy for base, ending, copy in copied}
        self.cameras = {
            base + ending: copy
            for base, entry in self.top.sections("cameras", "camera").items()
            for ending, copy in self._copies(entry)
        }
        self.index = {body.name: i for i, body in enumerate(self.scene.bodies)}
        for name, fields in (*self.bodies.items(), *self.cameras.items()):
            if name in self.index or name == "world":
                raise fields.error(None, "has a name that is taken already")
            self.index[name] = len(self.scene.bodies)
            self.scene.bodies.append(Body(name, None))
        for name, fields in self.cameras.items():
            if not re.fullmatch(r"[\w.-]+", name):  # it is part of the names of topics
                raise fields.error(None, f"has the name '{name}'; take letters, digits, _ . and -")
            self.scene.cameras.append(read_camera(name, fields, self.arguments))
        self._placed: dict[str, bool] = {}
        for name in (*self.cameras, *self.bodies):
            self._place(name)

    def _copies(self, entry: Fields) -> list[tuple[str, Fields]]:
        """What an entry stands for; copies within copies are counted together."""
        made = copies(entry)
        self.entries += len(made)
        if self.entries > MAX_COPIES:
            raise entry.error(
                "copies", f"makes more than {MAX_COPIES} bodies, shapes, lights and cameras in this scene"
            )
        return made

    def _take(self, size: int, fields: Fields) -> None:
        """Count what is made of a few lines. Raises SceneError at the one that is too much."""
        try:
            self.allowance.take(size)
        except AllowanceError as error:
            raise fields.error(None, f"is too large with what stands before it: {error}") from None

    def _place(self, name: str) -> None:
        """Give body `name` its trajectory, after the one of the body it stands on."""
        if self._placed.get(name):
            return
        fields = self.bodies.get(name) or self.cameras[name]
        if name in self._placed:
            raise fields.error("parent", "leads back to the body itself")
        self._placed[name] = False
        body = self.scene.bodies[self.index[name]]
        parent = self._reference(fields, "parent") if fields.has("parent") else None
        start = self._start(fields)
        motions = [read_motion(m) for m in fields.items("motion", "motion")]
        above = self.scene.bodies[parent] if parent is not None else None
        if above is None or above.trajectory is not None:
            outer = above.trajectory if above else None
            assert outer is None or isinstance(outer, motion.Prescribed)
            body.trajectory = motion.Prescribed(start, motions, outer)
        elif motions:
            raise fields.error("motion", f"is not possible on '{above.name}', which the physics engine moves")
        else:
            assert parent is not None
            root, offset = above.mount or (parent, se3.IDENTITY)
            body.mount = (root, se3.compose(offset, start))
        self._placed[name] = True

    def _start(self, fields: Fields) -> np.ndarray:
        if fields.has("look_at"):
            if fields.has("rotation") or fields.has("quaternion"):
                raise fields.error("look_at", "and a rotation are given; leave one out")
            try:
                return se3.look_at(
                    fields.place("position"), fields.vector("look_at"), fields.vector("up", 3, [0, 0, 1])
                )
            except ValueError as error:
                if isinstance(error, SceneError):
                    raise
                raise fields.error("look_at", f"cannot be followed: {error}") from None
        view = fields.section("view", "view")
        if view is None:
            return se3.make_pose(fields.place("position"), fields.rotation())
        if fields.has("position"):
            raise fields.error("view", "and position are given; leave one out")
        return se3.make_pose(self._in_view(view), fields.rotation())

    def _in_view(self, view: Fields) -> np.ndarray:
        """The point at `depth` m that is seen, at t = 0, `offset` off the middle (fractions of the frame)."""
        name = view.text("camera", "cam0")
        if name not in self.cameras:
            raise view.error("camera", f"is '{name}'; {nearest(name, self.cameras)}")
        camera = self.scene.camera(name)
        self._place(name)
        trajectory = self.scene.bodies[self.index[name]].trajectory
        if trajectory is None:
            raise view.error("camera", f"is '{name}', which the physics engine moves")
        offset, depth = view.vector("offset", 2, [0, 0]), view.number("depth", above=0.0)
        size = np.array([camera.width, camera.height])
        pixel = (size - 1) / 2 + offset * size
        if camera.distortion_model == "none":
            point = pinhole.unproject(camera.k, pixel, np.array(depth))
        else:
            ray = distortion.unproject(camera.k, Lens.of(camera.distortion_model, camera.distortion), pixel)
            if not ray[2] > 0.0:
                raise view.error(
                    "offset",
                    f"is {offset.tolist()}, where '{name}' sees nothing ahead of it; take one nearer its middle",
                )
            point = ray * (depth / ray[2])
        view.done()
        return se3.transform(trajectory.pose(np.zeros(1, np.int64))[0], point)

    def _reference(self, fields: Fields, key: str) -> int:
        name = fields.text(key)
        if name not in self.index:
            raise fields.error(key, f"is '{name}'; {nearest(name, self.index)}")
        if name in self.bodies or name in self.cameras:
            self._place(name)
        return self.index[name]

    def _lights(self) -> None:
        for base, section in self.top.sections("lights", "light").items():
            for ending, fields in self._copies(section):
                body = self._reference(fields, "body") if fields.has("body") else WORLD
                self.scene.lights.append(read_light(base + ending, fields, body))

    def _sky(self) -> None:
        """`environment` and `environment_map`; without the former it is the mean of the map."""
        if self.top.has("environment_map"):
            self.scene.environment_map = read_environment_map(self.top, self.folder)
            self.scene.environment = mean_radiance(self.scene.environment_map)
        if self.top.has("environment"):
            self.scene.environment = self.top.colour("environment")

    def _settle(self, path: Path) -> None:
        """Leave no scene without a camera, a cam0, or light."""
        scene = self.scene
        if self.model is not None:
            from evis.scene.mjcf.model import complete

            sky = self.top.has("environment") or self.top.has("environment_map")
            complete(scene, self.model, self.arguments, lit=self.top.has("lights"), sky=sky, visuals=self.visuals)
            if self.changes and self.visuals:
                from evis.scene.mjcf.changes import change_looks

                change_looks(self.changes, scene)
                self.changes.done()
        elif not any(self.top.has(key) for key in ("lights", "environment", "environment_map")):
            if not (_mentions(self.top.table, "emission") or _mentions(self.top.table, "file")):  # a mesh may glow
                scene.notes.append("nothing gives light, so every image is black: add `lights:` or `environment:`")
        if not scene.cameras:
            raise SceneError(f"{path.name}: scene {scene.name} has no camera; add `cameras: {{cam0: {{fov: 40 deg}}}}`")
        if self.visuals:
            self._make_finer()
        # The only camera, or a model's first one, is found without its name; several keep those of the file.
        named = self.cameras and len(scene.cameras) > 1
        if not named and all(camera.name != "cam0" for camera in scene.cameras):
            self._free_cam0(path)
            first = scene.cameras[0]
            scene.bodies[scene.body_index(first.name)].name = "cam0"
            first.name = "cam0"

    def _make_finer(self) -> None:
        """Round shapes with as many sides as are seen."""
        take = partial(self._take, fields=self.top)
        if self.model is None:
            make_finer(self.scene, None, take, self.made.setdefault(make_finer, {}))
            return
        from evis.scene.mjcf.frames import rest_poses

        make_finer(self.scene, rest_poses(self.model), take, {})
        for instance in self.scene.instances[: self.of_model]:
            instance.mesh.round = None  # it would keep the model

    def _free_cam0(self, path: Path) -> None:
        """A link of a model that is called cam0 gives way to the camera; a body of the scene file is a mistake."""
        if "cam0" not in self.index:
            return
        number = self.index["cam0"]
        if self.model is None or number >= self.model.nbody - 1:
            raise SceneError(f"{path.name}: 'cam0' is the name of the first camera, but here it is a body; rename it")
        from evis.scene.mjcf.frames import free_name

        self.scene.bodies[number].name = free_name(self.scene, "cam0", "body")


def _folders(top: Fields, path: Path) -> Folders:
    """The scene's folder, and those of `assets`: relative to the scene file, or to where a model by itself is
    launched. Raises SceneError for one that is not there."""
    stated = top.plain("assets", [])
    names = [name.strip() for name in stated.split(",") if name.strip()] if isinstance(stated, str) else stated
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise top.error("assets", f"is {stated!r:.60}; it must be a list of folders")
    bare = path.suffix in MODELS
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
