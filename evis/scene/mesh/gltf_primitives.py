"""Checks the primitives of a glTF file against the specification, and tells what of a file is not read."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from evis.scene.errors import SceneError
from evis.scene.mesh.gltf_plain import base_texture, texture_set

_TRIANGLES = 4
"""Least mode of a primitive of triangles, also where none is given."""
_SHAPES = {"POSITION": ("VEC3",), "NORMAL": ("VEC3",), "TANGENT": ("VEC4",), "COLOR": ("VEC3", "VEC4"),
           "TEXCOORD": ("VEC2",)}  # fmt: skip
"""Types of the accessors of attributes, sets of which have a number behind the name (glTF 2.0, 3.7.2.1)."""
_WHOLE = {5121: "unsigned byte", 5123: "unsigned short", 5125: "unsigned int"}
"""Component types of indices."""
_COMPRESSED = "KHR_draco_mesh_compression"
_OTHERWISE = ("EXT_mesh_gpu_instancing", "KHR_materials_unlit")
"""Extensions without which a file shows something else, and which it may name without asking for them."""


def check_primitives(tree: dict[str, Any]) -> None:
    """Refuses a file with a primitive of triangles whose attributes or indices are not as the specification has them.

    tree: of which all that is named is there. Raises SceneError, whose text the caller puts the name before.
    """
    accessors = tree.get("accessors", [])
    for mesh, primitive in _triangles(tree):
        attributes = primitive["attributes"]
        if "POSITION" not in attributes:
            raise SceneError(f"its mesh {mesh} has triangles without POSITION; write it anew")
        if _COMPRESSED in primitive.get("extensions", {}) and "bufferView" not in accessors[attributes["POSITION"]]:
            raise SceneError(f"its mesh {mesh} has {_COMPRESSED}, which is not read; export it without compression")
        count = accessors[attributes["POSITION"]]["count"]
        for name, number in attributes.items():
            types = _SHAPES.get(name.partition("_")[0])
            there = accessors[number]
            if types is None:
                continue  # what a program has added for itself
            if there["type"] not in types:
                told = f"{name} of {there['type']!s:.20} in place of {' or '.join(types)}"
                raise SceneError(f"its mesh {mesh} has {told}; write it anew")
            if there["count"] != count:
                told = f"{there['count']} {name} for {count} POSITION"
                raise SceneError(f"its mesh {mesh} has {told}; write it anew")
        if "indices" in primitive:
            indices = accessors[primitive["indices"]]
            if indices["componentType"] not in _WHOLE or indices["type"] != "SCALAR":
                told = f"indices of component type {indices['componentType']!s:.20} and type {indices['type']!s:.20}"
                raise SceneError(f"its mesh {mesh} has {told}, not of {', '.join(_WHOLE.values())}; write it anew")


def left_out(tree: dict[str, Any], textures: bool) -> list[str]:
    """Tells what a file says and is not drawn: extensions, and pictures whose texture coordinates a mesh has not.

    textures: whether pictures are wanted.
    """
    used = [name for name in tree.get("extensionsUsed", []) if name in _OTHERWISE]
    found = [f"has {name}, which is not read" for name in used]
    materials = tree.get("materials", [])
    for mesh, primitive in _triangles(tree):
        if "material" not in primitive or not textures:
            continue
        texture = base_texture(materials[primitive["material"]])
        wanted = f"TEXCOORD_{texture_set(texture)}"
        if texture and wanted not in primitive["attributes"]:
            told = f"has a baseColorTexture that lies by {wanted}, of which mesh {mesh} has none"
            found += [] if told in found else [told]
    return found


def _triangles(tree: dict[str, Any]) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yields the primitives that have a surface, each behind the number of its mesh."""
    for number, mesh in enumerate(tree.get("meshes", [])):
        for primitive in mesh.get("primitives", []):
            if primitive.get("mode", _TRIANGLES) >= _TRIANGLES:
                yield number, primitive
