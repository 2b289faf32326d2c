"""What a scene file says, made into a Scene: cameras, bodies and their motion, shapes, materials, lights.

The file is YAML; every key is optional but `cameras` (an MJCF may do without). Angles are radians, or texts as
`40 deg`; colours are linear Rec. 709, one number is a grey; `${...}` is arithmetic over the arguments.

    args:       {NAME: {type: float|int|str|bool|vector, default, min, max, choices, unit, help}}; width, height: always
    cameras:    {NAME: FRAME + {fov (vertical) | focal (px), width, height, near}}
    bodies:     {NAME: FRAME + {motion: [MOTION], shapes: [SHAPE]}}
    world:      [SHAPE], static
    materials:  {NAME: {albedo, emission, roughness, metallic, two_sided, texture: {kind: blobs|noise|checker, size,
                seed, feature, low, high, cells, wedge: {angle, value}}}}
    lights:     {NAME: {kind: directional, direction, irradiance} or {kind: point, position, intensity}, body, shadows}
    environment: radiance of the sky;  timestep: sub-step of prescribed motion [s]
    mjcf:       a MuJoCo model with the bodies that move by dynamics;  initial_spread: {position, rotation}

    FRAME:  position and rotation: {axis, angle} (or a list) | quaternion | look_at (with up), in the frame of `parent`;
            or view: {camera, offset, depth}, a place in a camera's image
    MOTION: {kind: linear, velocity} | {kind: sinusoid, amplitude, frequency, phase}   in the parent's frame, added up
            {kind: spin, axis, rate} | {kind: swing, axis, amplitude, frequency, phase} in the body's frame, chained
    SHAPE:  {shape: box|sphere|ellipsoid|cylinder|capsule|plane|disk|mesh, sizes, material, name, position, rotation}
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from evis.geometry import pinhole, se3
from evis.launch.document import Table, nearest
from evis.scene import motion
from evis.scene.materials import read_material
from evis.scene.model import WORLD, Body, Camera, Instance, Light, Material, Scene
from evis.scene.reader import Fields, SceneError
from evis.scene.tessellate import read_shape

SUBSTEP_NS = 1_000_000
"""Sub-step of /state unless the scene says otherwise [ns]: the 1 kHz that controllers and inertial sensors use."""


def build(table: Table, path: Path, arguments: Mapping[str, Any], textures: bool = True) -> Scene:
    """The Scene of a checked argument set. textures=False leaves their making out. Raises SceneError."""
    return _Builder(table, path, arguments, textures).scene


class _Builder:
    def __init__(self, table: Table, path: Path, arguments: Mapping[str, Any], textures: bool) -> None:
        self.top = Fields(table, f"scene {path.stem}", arguments)
        self.arguments = arguments
        self.scene = Scene(path.stem, [], [], [], [], [], np.zeros(3, np.float32))
        self.top.has("args")
        self.top.text("description", "")
        self._physics(path)
        for name, fields in self.top.sections("materials", "material").items():
            self._add_material(read_material(name, fields, textures), fields)
        self._frames()
        self._shapes(WORLD, "world", self.top.items("world", "shape"))
        for name, fields in self.bodies.items():
            self._shapes(self.index[name], name, fields.items("shapes", "shape"))
        for name, fields in self.top.sections("lights", "light").items():
            self.scene.lights.append(self._light(name, fields))
        if self.top.has("environment"):
            self.scene.environment = self.top.colour("environment")
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
        self.model: Any = None
        if self.top.has("mjcf"):
            from evis.scene.mjcf import add_model

            scene.mjcf = (path.parent / self.top.text("mjcf")).resolve()
            if not scene.mjcf.is_file():
                raise self.top.error("mjcf", f"names {scene.mjcf.name}, which is not in {path.parent or '.'}")
            size = (int(self.arguments["width"]), int(self.arguments["height"]))
            self.model = add_model(scene, size, own_cameras="cameras" in self.top.table)
        elif spread:
            raise self.top.error("initial_spread", "is for scenes with an mjcf; prescribed motion has no random start")

    def _frames(self) -> None:
        """Bodies and cameras: numbered first, then placed, since each may stand on another."""
        self.bodies = self.top.sections("bodies", "body")
        self.cameras = self.top.sections("cameras", "camera")
        self.index = {body.name: i for i, body in enumerate(self.scene.bodies)}
        for name, fields in (*self.bodies.items(), *self.cameras.items()):
            if name in self.index or name == "world":
                raise fields.error(None, "has a name that is taken already")
            self.index[name] = len(self.scene.bodies)
            self.scene.bodies.append(Body(name, None))
        for name, fields in self.cameras.items():
            self.scene.cameras.append(self._camera(name, fields))
        self._placed: dict[str, bool] = {}
        for name in (*self.cameras, *self.bodies):
            self._place(name)

    def _camera(self, name: str, fields: Fields) -> Camera:
        width = fields.whole("width", self.arguments["width"], minimum=1)
        height = fields.whole("height", self.arguments["height"], minimum=1)
        if fields.has("focal") and fields.has("fov"):
            raise fields.error("focal", "and fov are given; leave one out")
        if fields.has("focal"):
            focal = fields.number("focal", above=0.0)
        else:
            fov = fields.angle("fov")
            if not 0.0 < fov < np.pi:
                raise fields.error("fov", f"is {fov:g} rad; it must lie between 0 and 180 deg")
            focal = pinhole.focal_from_fov(height, fov)
        near = fields.number("near", 1e-3, above=0.0)
        return Camera(name, width, height, pinhole.intrinsics(width, height, focal), near)

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
                    fields.vector("position", 3, [0, 0, 0]), fields.vector("look_at"), fields.vector("up", 3, [0, 0, 1])
                )
            except ValueError as error:
                if isinstance(error, SceneError):
                    raise
                raise fields.error("look_at", f"cannot be followed: {error}") from None
        view = fields.section("view", "view")
        if view is None:
            return se3.make_pose(fields.vector("position", 3, [0, 0, 0]), fields.rotation())
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
        view.done()
        size = np.array([camera.width, camera.height])
        point = pinhole.unproject(camera.k, (size - 1) / 2 + offset * size, np.array(depth))
        return se3.transform(trajectory.pose(np.zeros(1, np.int64))[0], point)

    def _reference(self, fields: Fields, key: str) -> int:
        name = fields.text(key)
        if name not in self.index:
            raise fields.error(key, f"is '{name}'; {nearest(name, self.index)}")
        if name in self.bodies or name in self.cameras:
            self._place(name)
        return self.index[name]

    def _add_material(self, material: Material, fields: Fields) -> None:
        if any(m.name == material.name for m in self.scene.materials):
            raise fields.error(None, "has a name that the MJCF uses already")
        self.scene.materials.append(material)

    def _shapes(self, body: int, name: str, shapes: list[Fields]) -> None:
        for i, fields in enumerate(shapes):
            material = fields.text("material")
            known = [m.name for m in self.scene.materials]
            if material not in known:
                raise fields.error("material", f"is '{material}'; {nearest(material, known)}")
            label = fields.text("name", name if len(shapes) == 1 else f"{name}_{i}")
            if any(instance.name == label for instance in self.scene.instances):
                raise fields.error("name", f"'{label}' is taken already")
            pose = se3.make_pose(fields.vector("position", 3, [0, 0, 0]), fields.rotation())
            self.scene.instances.append(Instance(label, body, read_shape(fields), known.index(material), pose))
            fields.done()

    def _light(self, name: str, fields: Fields) -> Light:
        kind = fields.text("kind", choices=("directional", "point"))
        body = self._reference(fields, "body") if fields.has("body") else WORLD
        shadows = fields.flag("shadows", True)
        if kind == "directional":
            light = Light(name, kind, fields.colour("irradiance"), fields.direction("direction"), body, shadows)
        else:
            light = Light(name, kind, fields.colour("intensity"), fields.vector("position"), body, shadows)
        fields.done()
        return light

    def _settle(self, path: Path) -> None:
        """Leave no scene without a camera, a cam0, or light."""
        scene = self.scene
        if self.model is not None:
            from evis.scene.mjcf import complete

            complete(scene, self.model, self.arguments, lit=self.top.has("lights"), sky=self.top.has("environment"))
        if not scene.cameras:
            raise SceneError(f"{path.name}: scene {scene.name} has no camera; add `cameras: {{cam0: {{fov: 40 deg}}}}`")
        if all(camera.name != "cam0" for camera in scene.cameras):
            if "cam0" in self.index:
                raise SceneError(f"{path.name}: 'cam0' is the name of the first camera, but here it is a body")
            first = scene.cameras[0]
            scene.bodies[scene.body_index(first.name)].name = "cam0"
            first.name = "cam0"


def read_motion(fields: Fields) -> motion.Linear | motion.Sinusoid | motion.Spin | motion.Swing:
    """One entry of `motion:`."""
    kind = fields.text("kind", choices=("linear", "sinusoid", "spin", "swing"))
    result: motion.Linear | motion.Sinusoid | motion.Spin | motion.Swing
    if kind == "linear":
        result = motion.Linear(fields.vector("velocity"))
    elif kind == "spin":
        result = motion.Spin(fields.direction("axis"), fields.number("rate"))
    elif kind == "sinusoid":
        result = motion.Sinusoid(
            fields.vector("amplitude"), fields.number("frequency", minimum=0.0), fields.angle("phase", 0.0)
        )
    else:
        result = motion.Swing(
            fields.direction("axis"), fields.angle("amplitude"), fields.number("frequency", minimum=0.0),
            fields.angle("phase", 0.0),
        )  # fmt: skip
    fields.done()
    return result
