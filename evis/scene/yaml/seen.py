"""Reads what is seen of a scene file into its Scene: materials, and shapes as instances of meshes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from evis.config.suggestions import nearest
from evis.geometry import se3
from evis.scene.folders import Folders
from evis.scene.images.pictures import lets_through
from evis.scene.model import Instance, Material, Mesh, Scene
from evis.scene.yaml.made_pictures import MadePictures
from evis.scene.yaml.materials import read_material
from evis.scene.yaml.reader import Fields
from evis.scene.yaml.tessellate import read_own, read_parts, read_shape


class Seen:
    """Adds materials and instances to a scene that may have some already, those of a model."""

    def __init__(
        self,
        scene: Scene,
        folders: Folders,
        textures: bool,
        pictures: MadePictures,
        made: dict[Any, Any],
        copies: Callable[[Fields], list[tuple[str, Fields]]],
        take: Callable[[int, Fields], None],
    ) -> None:
        """Takes the names that the scene has so far.

        Args:
            scene: to which all is added.
            folders: where the scene file lies, and from where the files that it names may come.
            textures: False: no texture is made.
            pictures: where those are begun that are made by code.
            made: meshes and textures of worlds built before, which are shared.
            copies: gives what an entry stands for.
            take: is told the bytes of what is made of an entry, and raises SceneError for too many.
        """
        self.scene, self.folders, self.textures = scene, folders, textures
        self.pictures, self.made, self._copies, self._take = pictures, made, copies, take
        self.materials = {material.name: i for i, material in enumerate(scene.materials)}
        self.labels = {instance.name for instance in scene.instances}
        self.counted: dict[int, Mesh] = {}
        self.of_files: dict[int, int] = {}
        """Materials of mesh files, by id; `made` keeps them."""

    def read_materials(self, entries: Mapping[str, Fields]) -> None:
        """Adds the materials of `materials:`. Raises SceneError."""
        for name, entry in entries.items():
            for ending, fields in self._copies(entry):
                made = read_material(name + ending, fields, self.folders.home, self.pictures, self.textures, self.made)
                self._add_material(made, fields)
                self._tell_opaque(fields)

    def _tell_opaque(self, fields: Fields) -> None:
        """Tells of a picture file that lets light through, since all is drawn opaque, as of materials of mesh files."""
        section = fields.section("texture", "texture")
        if section is None or not self.textures or not section.has("file") or section.has("folder"):
            return
        path = self.folders.home / section.text("file")
        if path.suffix.lower() != ".exr" and lets_through(path):
            note = f"{path.name} has transparent texels, which are drawn opaque; cut the shape out as a mesh instead"
            self.scene.left_out += [] if note in self.scene.left_out else [note]

    def _add_material(self, material: Material, fields: Fields) -> None:
        if material.name in self.materials:
            raise fields.error(None, f"has the name '{material.name}', which another material has already")
        self._take(0 if material.texture is None else material.texture.nbytes, fields)
        self.materials[material.name] = len(self.scene.materials)
        self.scene.materials.append(material)

    def read_shapes(self, body: int, name: str, shapes: list[Fields], shared: str = "", stem: str = "world") -> None:
        """Adds the shapes of a body. shared: the body's own class; stem: its name without what copies add. Raises
        SceneError.
        """
        entries = [entry for fields in shapes for entry in self._copies(fields)]
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
            elif (own := read_own(fields, self.folders.home, self.textures, self.made)) is not None:
                self._parts(label, body, fields, material, pose, semantic, own)
            else:
                mesh = read_shape(fields, self.made)
                self._add_instance(Instance(label, body, mesh, material, pose, semantic), fields)
            fields.done()

    def _material(self, fields: Fields) -> int:
        name = fields.text("material")
        if name not in self.materials:
            raise fields.error("material", f"is '{name}'; {nearest(name, self.materials)}")
        return self.materials[name]

    def _add_instance(self, instance: Instance, fields: Fields) -> None:
        if instance.name in self.labels:
            raise fields.error("name", f"'{instance.name}' is taken already")
        if id(instance.mesh) not in self.counted:
            self.counted[id(instance.mesh)] = instance.mesh
            self._take(instance.mesh.nbytes, fields)
        self.labels.add(instance.name)
        self.scene.instances.append(instance)

    def _file(
        self, label: str, body: int, fields: Fields, material: int | None, pose: np.ndarray, semantic: str
    ) -> None:
        """Every mesh of a file as an instance, with the file's materials unless the entry names one."""
        parts = read_parts(fields, self.folders, self.textures, self.made)
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
        """Every part of a mesh as an instance, with its own material; those without one get `material`."""
        for i, part in enumerate(parts):
            chosen = material
            if part.material is not None:
                chosen = self._material_of(part, fields)
            assert chosen is not None
            name = label if len(parts) == 1 else f"{label}_{i}"
            at = pose if part.place is None else se3.compose(pose, se3.make_pose(part.place, se3.IDENTITY[3:]))
            self._add_instance(Instance(name, body, part.mesh, chosen, at, semantic), fields)

    def _material_of(self, part: Any, fields: Fields) -> int:
        """The material that a file gives a part; files of one name in several folders have each their own."""
        material = part.material
        if id(material) not in self.of_files:
            lacks = [f"{lack}; what it is for is drawn without" for lack in part.lacks]
            for told in (*lacks, *filter(None, [part.opaque])):
                note = f"{part.file} {told}"
                self.scene.left_out += [] if note in self.scene.left_out else [note]
            name, count = material.name, 2
            while name in self.materials:
                name, count = f"{material.name}_{count}", count + 1
            self._add_material(replace(material, name=name), fields)
            self.of_files[id(material)] = self.materials[name]
        return self.of_files[id(material)]
