"""Makes the materials of a scene file, and of its shapes the instances that are drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from evis.config.suggestions import nearest
from evis.files.allowance import Allowance, AllowanceError
from evis.geometry import se3
from evis.scene.folders import Folders
from evis.scene.images.made_pictures import MadePictures
from evis.scene.images.pictures import lets_through
from evis.scene.model import Instance, Material, Mesh, Scene
from evis.scene.yaml.copies import Copies
from evis.scene.yaml.materials import read_material
from evis.scene.yaml.reader import Fields
from evis.scene.yaml.tessellate import read_own, read_parts, read_shape


class Shapes:
    """Adds materials and instances to a scene, beside those that it has; what is made of a few lines is counted.

    Methods raise SceneError.
    """

    def __init__(
        self,
        scene: Scene,
        folders: Folders,
        textures: bool,
        made: dict[Any, Any],
        pictures: MadePictures,
        allowance: Allowance,
        copies: Copies,
    ) -> None:
        """folders: that files are in. textures: whether they are read. made: meshes and textures of earlier worlds,
        which it shares. pictures: makes those that code draws. allowance: of bytes."""
        self._scene, self._folders, self._textures = scene, folders, textures
        self._made, self._pictures, self._allowance, self._copies = made, pictures, allowance, copies
        self._materials = {material.name: i for i, material in enumerate(scene.materials)}
        self._labels = {instance.name for instance in scene.instances}
        self._counted: dict[int, Mesh] = {}
        self._of_files: dict[int, int] = {}
        """Materials of mesh files, by id; `made` keeps them."""

    def add_materials(self, entries: dict[str, Fields]) -> None:
        """Adds the materials of the file."""
        for name, entry in entries.items():
            for ending, fields in self._copies.of(entry):
                home, full = self._folders.home, name + ending
                material = read_material(full, fields, home, self._pictures, self._textures, self._made)
                self._add_material(material, fields)
                self._tell_opaque(fields)

    def _tell_opaque(self, fields: Fields) -> None:
        """Tells of a picture file that lets light through, since all is drawn opaque, as of materials of mesh files."""
        section = fields.section("texture", "texture")
        if section is None or not self._textures or not section.has("file") or section.has("folder"):
            return
        path = self._folders.home / section.text("file")
        if path.suffix.lower() != ".exr" and lets_through(path):
            note = f"{path.name} has transparent texels, which are drawn opaque; cut the shape out as a mesh instead"
            self._scene.left_out += [] if note in self._scene.left_out else [note]

    def _add_material(self, material: Material, fields: Fields) -> None:
        if material.name in self._materials:
            raise fields.error(None, f"has the name '{material.name}', which another material has already")
        self.take(0 if material.texture is None else material.texture.nbytes, fields)
        self._materials[material.name] = len(self._scene.materials)
        self._scene.materials.append(material)

    def add(self, body: int, name: str, shapes: list[Fields], shared: str = "", stem: str = "world") -> None:
        """Adds the shapes of a body. shared: the body's own class; stem: its name without what copies add."""
        entries = [entry for fields in shapes for entry in self._copies.of(fields)]
        for i, (ending, fields) in enumerate(entries):
            if fields.has("name"):
                label = fields.text("name") + ending
            else:
                label = name if len(entries) == 1 else f"{name}_{i}"
            material = self._material(fields) if fields.has("material") else None
            pose = se3.make_pose(fields.place("position"), fields.rotation())
            semantic = fields.text("semantic", shared or fields.text("name", stem))
            if fields.has("file"):
                self._file(label, body, fields, material, pose, semantic)
            elif material is None:
                raise fields.error(None, "needs 'material', such as grey, with materials: {grey: {albedo: 0.5}}")
            elif (own := read_own(fields, self._folders.home, self._textures, self._made)) is not None:
                self._parts(label, body, fields, material, pose, semantic, own)
            else:
                mesh = read_shape(fields, self._made)
                self._add_instance(Instance(label, body, mesh, material, pose, semantic), fields)
            fields.done()

    def take(self, size: int, fields: Fields) -> None:
        """Counts what is made of a few lines. Raises SceneError at the one that is too much."""
        try:
            self._allowance.take(size)
        except AllowanceError as error:
            raise fields.error(None, f"is too large with what stands before it: {error}") from None

    def _material(self, fields: Fields) -> int:
        name = fields.text("material")
        if name not in self._materials:
            raise fields.error("material", f"is '{name}'; {nearest(name, self._materials)}")
        return self._materials[name]

    def _add_instance(self, instance: Instance, fields: Fields) -> None:
        if instance.name in self._labels:
            raise fields.error("name", f"'{instance.name}' is taken already")
        if id(instance.mesh) not in self._counted:
            self._counted[id(instance.mesh)] = instance.mesh
            self.take(instance.mesh.nbytes, fields)
        self._labels.add(instance.name)
        self._scene.instances.append(instance)

    def _file(
        self, label: str, body: int, fields: Fields, material: int | None, pose: np.ndarray, semantic: str
    ) -> None:
        """Adds every mesh of a file as an instance, with the file's materials unless the entry names one."""
        parts = read_parts(fields, self._folders, self._textures, self._made)
        if material is not None:
            parts = [replace(part, material=None) for part in parts]
        elif any(part.material is None for part in parts):
            why = f" (it {' and '.join(parts[0].lacks)})" if parts[0].lacks else ""
            raise fields.error("file", f"names {fields.text('file')}, which has no material{why}; add 'material'")
        self._parts(label, body, fields, material, pose, semantic, parts)

    def _parts(
        self,
        label: str,
        body: int,
        fields: Fields,
        material: int | None,
        pose: np.ndarray,
        semantic: str,
        parts: Sequence[Any],
    ) -> None:
        """Adds every part of a mesh as an instance, with its own material; those without one get `material`."""
        for i, part in enumerate(parts):
            chosen = material
            if part.material is not None:
                chosen = self._material_of(part, fields)
            assert chosen is not None
            name = label if len(parts) == 1 else f"{label}_{i}"
            at = pose if part.place is None else se3.compose(pose, se3.make_pose(part.place, se3.IDENTITY[3:]))
            self._add_instance(Instance(name, body, part.mesh, chosen, at, semantic), fields)

    def _material_of(self, part: Any, fields: Fields) -> int:
        """Gives the material that a file gives a part; files of one name in several folders have each their own."""
        material = part.material
        if id(material) not in self._of_files:
            lacks = [f"{lack}; what it is for is drawn without" for lack in part.lacks]
            for told in (*lacks, *filter(None, [part.opaque])):
                note = f"{part.file} {told}"
                self._scene.left_out += [] if note in self._scene.left_out else [note]
            name, count = material.name, 2
            while name in self._materials:
                name, count = f"{material.name}_{count}", count + 1
            self._add_material(replace(material, name=name), fields)
            self._of_files[id(material)] = self._materials[name]
        return self._of_files[id(material)]
