"""Places the bodies and cameras of a scene file, each in the frame of what it stands on."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from evis.config.suggestions import nearest
from evis.geometry import distortion, pinhole, se3
from evis.geometry.distortion import Lens
from evis.scene import motion
from evis.scene.errors import SceneError
from evis.scene.model import Body, Scene
from evis.scene.yaml.cameras import read_camera
from evis.scene.yaml.copies import Copies
from evis.scene.yaml.motion import read_motion
from evis.scene.yaml.reader import Fields
from evis.scene.yaml.trajectory import read_trajectory


class Frames:
    """Adds bodies and cameras to a scene: numbered first, then placed, since each may stand on another.

    bodies, cameras: their entries, by name with what copies add. stems: names of bodies without that. index: number of
    every body of the scene, by name.
    """

    def __init__(self, scene: Scene, top: Fields, copies: Copies, home: Path) -> None:
        """top: the file's own keys. home: its folder. Raises SceneError."""
        self._scene, self._home = scene, home
        bodies = top.sections("bodies", "body")
        copied = [(base, ending, copy) for base, entry in bodies.items() for ending, copy in copies.of(entry)]
        self.stems = {base + ending: base for base, ending, _ in copied}
        self.bodies = {base + ending: copy for base, ending, copy in copied}
        self.cameras = {
            base + ending: copy
            for base, entry in top.sections("cameras", "camera").items()
            for ending, copy in copies.of(entry)
        }
        self.index = {body.name: i for i, body in enumerate(scene.bodies)}
        for name, fields in (*self.bodies.items(), *self.cameras.items()):
            if name in self.index or name == "world":
                raise fields.error(None, "has a name that is taken already")
            self.index[name] = len(scene.bodies)
            scene.bodies.append(Body(name, None))
        for name, fields in self.cameras.items():
            if not re.fullmatch(r"[\w.-]+", name):  # it is part of the names of topics
                raise fields.error(None, f"has the name '{name}'; take letters, digits, _ . and -")
            scene.cameras.append(read_camera(name, fields, top.arguments))
        self._placed: dict[str, bool] = {}
        for name in (*self.cameras, *self.bodies):
            self._place(name)

    def _place(self, name: str) -> None:
        """Gives body `name` its trajectory, after the one of the body it stands on."""
        if self._placed.get(name):
            return
        fields = self.bodies.get(name) or self.cameras[name]
        if name in self._placed:
            raise fields.error("parent", "leads back to the body itself")
        self._placed[name] = False
        body = self._scene.bodies[self.index[name]]
        parent = self.reference(fields, "parent") if fields.has("parent") else None
        start = self._start(fields)
        along = fields.section("trajectory", "trajectory")
        motions = read_trajectory(along, self._home) if along is not None else []
        motions += [read_motion(m) for m in fields.items("motion", "motion")]
        above = self._scene.bodies[parent] if parent is not None else None
        if above is None or above.trajectory is not None:
            outer = above.trajectory if above else None
            assert outer is None or isinstance(outer, motion.Prescribed)
            body.trajectory = motion.Prescribed(start, motions, outer)
        elif motions:
            key = "motion" if fields.has("motion") else "trajectory"
            raise fields.error(key, f"is not possible on '{above.name}', which the physics engine moves")
        else:
            assert parent is not None
            root, offset = above.mount or (parent, se3.IDENTITY)
            body.mount = (root, se3.compose(offset, start))
        self._placed[name] = True

    def _start(self, fields: Fields) -> np.ndarray:
        if fields.has("trajectory"):
            for key in ("position", "rotation", "quaternion", "look_at", "view"):
                if fields.has(key):
                    raise fields.error(key, "and a trajectory are given, which has the poses; leave one out")
            return se3.IDENTITY
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
        camera = self._scene.camera(name)
        self._place(name)
        trajectory = self._scene.bodies[self.index[name]].trajectory
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

    def reference(self, fields: Fields, key: str) -> int:
        """Gives the number of the body or camera that a key names, which is placed then. Raises SceneError."""
        name = fields.text(key)
        if name not in self.index:
            raise fields.error(key, f"is '{name}'; {nearest(name, self.index)}")
        if name in self.bodies or name in self.cameras:
            self._place(name)
        return self.index[name]
