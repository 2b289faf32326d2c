"""Reads what a scene file says of dynamics: the MuJoCo model, where it starts, what of it is other than its file says.

Nothing of MuJoCo is loaded for a scene without a model.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from evis.config.paths import other_than_model
from evis.scene.folders import Folders
from evis.scene.model import Scene
from evis.scene.view.fineness import make_finer
from evis.scene.yaml.reader import Fields

SUBSTEP_NS = 1_000_000
"""Sub-step of /state unless the scene says otherwise [ns]: the 1 kHz that controllers and inertial sensors use."""


class Dynamics:
    """Adds the MuJoCo model, if there is one, to a scene without bodies: so body n of the engine is body n here.

    model: the MjModel, or None.
    """

    def __init__(self, scene: Scene, top: Fields, folders: Folders, visuals: bool) -> None:
        """top: the file's own keys. folders: that the model may take files from. visuals: whether shapes are wanted.
        Raises SceneError."""
        self._scene, self._top, self._visuals = scene, top, visuals
        scene.timestep_ns = round(top.number("timestep", SUBSTEP_NS * 1e-9, above=1e-7) * 1e9)
        spread = top.section("initial_spread", "initial_spread")
        if spread:
            scene.initial_spread = (spread.number("position", 0.0, minimum=0), spread.angle("rotation", 0.0))
            spread.done()
        starts = top.sections("initial_joints", "joint")
        self.model: Any = None
        self._changes: Fields | None = None
        if top.has("mjcf"):
            self._add_model(folders, starts)
            self._read_keyframe()
            self._read_changes()
            return
        for key in ("initial_spread", "initial_joints", "keyframe", "model", "actuators"):
            if top.has(key):
                raise top.error(key, "is for scenes with an mjcf; prescribed motion starts where it says")

    def _add_model(self, folders: Folders, starts: Mapping[str, Fields]) -> None:
        """Adds the bodies of the model and what is seen of them. starts: of its joints, by name."""
        from evis.scene.mjcf.joints import read_starts
        from evis.scene.mjcf.model import add_model

        scene, top = self._scene, self._top
        scene.mjcf = (folders.home / top.text("mjcf")).resolve()
        if not scene.mjcf.is_file():
            raise top.error("mjcf", f"names {scene.mjcf.name}, which is not in {folders.home or '.'}")
        if kind := other_than_model(scene.mjcf):
            raise top.error("mjcf", f"names {scene.mjcf.name}, which is {kind}")
        scene.folders = folders.beside(scene.mjcf)
        size = (int(top.arguments["width"]), int(top.arguments["height"]))
        self.model = add_model(scene, size, own_cameras="cameras" in top.table, visuals=self._visuals)
        self._of_model = len(scene.instances)
        scene.initial_joints = read_starts(self.model, starts)

    def _read_keyframe(self) -> None:
        """Reads from which keyframe of the model the scene starts."""
        from evis.scene.mjcf.model import keyframe_of, unused_keyframe

        wanted = self._top.text("keyframe", "auto")
        try:
            self._scene.keyframe = keyframe_of(self.model, wanted)
        except ValueError as error:
            raise self._top.error("keyframe", str(error)) from None
        if wanted == "auto" and self._scene.keyframe < 0 and self.model.nkey:
            self._scene.notes.append(unused_keyframe(self.model))

    def _read_changes(self) -> None:
        """Reads what of the model is other than its file says, but for what is seen of it, which is not there yet."""
        section = self._top.section("model", "model")
        if section:
            from evis.scene.mjcf.changes import read_changes

            self._scene.changes = read_changes(section, self.model)
        self._changes = section
        if self._top.has("actuators"):
            from evis.scene.mjcf.added_actuators import read_actuators

            self._scene.actuators = read_actuators(self._top, self.model)

    def complete(self) -> None:
        """Gives the scene the cameras, light and sky of the model that its file does not have itself, and the changes
        of what is seen. Raises SceneError."""
        from evis.scene.mjcf.model import complete

        top, visuals = self._top, self._visuals
        sky = top.has("environment") or top.has("environment_map")
        complete(self._scene, self.model, top.arguments, lit=top.has("lights"), sky=sky, visuals=visuals)
        if self._changes and visuals:
            from evis.scene.mjcf.changes import change_looks

            change_looks(self._changes, self._scene)
            self._changes.done()

    def make_finer(self, take: Callable[[int], None], made: dict[Any, Any]) -> None:
        """Gives round shapes as many sides as are seen; take: is told the bytes of each new mesh; made: of `build`."""
        if self.model is None:
            make_finer(self._scene, None, take, made.setdefault(make_finer, {}))
            return
        from evis.scene.mjcf.frames import rest_poses

        make_finer(self._scene, rest_poses(self.model), take, {})
        for instance in self._scene.instances[: self._of_model]:
            instance.mesh.round = None  # it would keep the model

    def free(self, name: str, body: int) -> bool:
        """Gives another name to a link of the model that is called so; tells whether `body` is a link."""
        if self.model is None or body >= self.model.nbody - 1:
            return False
        from evis.scene.mjcf.frames import free_name

        self._scene.bodies[body].name = free_name(self._scene, name, "body")
        return True
