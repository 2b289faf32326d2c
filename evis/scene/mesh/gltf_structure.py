"""Checks that what the entries of a glTF file name is there: extensions, entries by their numbers, bytes of buffers."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from typing import Any

from evis.scene.errors import SceneError

_COMPONENT = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
"""Bytes of one number."""
_KINDS = (
    "accessors", "bufferViews", "buffers", "images", "materials", "meshes", "nodes", "scenes", "textures",
)  # fmt: skip
_READ = ("KHR_materials_", "KHR_texture_transform", "KHR_mesh_quantization", "KHR_lights_punctual", "EXT_texture_webp")
"""Beginnings of extensions that a file may ask for: what they say is read, or what a picture may do without."""
_TRANSFORMS = {"translation": 3, "rotation": 4, "scale": 3, "matrix": 16}
_NONE = {"translation": [0, 0, 0], "rotation": [0, 0, 0, 1], "scale": [1, 1, 1]}
"""What changes nothing, which some programs write beside a matrix."""
_VERSION = "2."
_LAST_ROW, _ROUNDED = ((3, 0.0), (7, 0.0), (11, 0.0), (15, 1.0)), 1e-6
"""Where a matrix, column by column, has its last row, and what that is; by how much programs round it."""


def check_names(tree: dict[str, Any], parts: dict[str, int]) -> None:
    """Refuses a file of which an entry names another that is not there, or of which nodes are no trees.

    Also one of another version, that needs an extension which is not read, or has a node whose transform is none, or
    accessors of numbers that the format has not. parts: of the types of accessors. Raises SceneError, whose text the
    caller puts the name before.
    """
    version = str(tree.get("asset", {}).get("version", _VERSION))
    if not version.startswith(_VERSION):
        raise SceneError(f"is of glTF {version:.20}, and only glTF 2 is read; export it as that")
    for key in ("extensionsUsed", "extensionsRequired"):
        if not isinstance(tree.get(key, []), list):
            raise SceneError(f"its {key} are no list; write it anew")
    for name in tree.get("extensionsRequired", []):
        if not str(name).startswith(_READ):
            raise SceneError(f"needs the extension {name!s:.60}, which is not read; export it without")
    for kind in _KINDS:
        entries = tree.get(kind, [])
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            raise SceneError(f"its {kind} are no list of maps; write it anew")
    for who, kind, number in _names(tree):
        if type(number) is not int or not 0 <= number < len(tree.get(kind, [])):
            there = len(tree.get(kind, []))
            raise SceneError(
                f"{who} names number {number!r:.40} of its {kind}, of which there are {there}; write it anew"
            )
    for k, accessor in enumerate(tree.get("accessors", [])):
        if accessor["componentType"] not in _COMPONENT or accessor["type"] not in parts:
            told = f"component type {accessor['componentType']!s:.20} and type {accessor['type']!s:.20}"
            raise SceneError(f"its accessor {k} has {told}, which glTF 2 has not; write it anew")
    _check_ways(tree.get("nodes", []))
    scenes = tree.get("scenes", [])
    shown = scenes[tree.get("scene", 0)].get("nodes", []) if scenes else []
    above = dict.fromkeys(shown, "the scene itself")
    for k, node in enumerate(tree.get("nodes", [])):
        for child in node.get("children", []):
            if child in above:
                told = f"its node {child} is below node {k} and {above[child]}"
                raise SceneError(f"{told}; write it with nodes that form a tree")
            above[child] = f"node {k}"
        _check_transform(k, node)


def check_extents(tree: dict[str, Any], buffers: list[bytes], parts: dict[str, int]) -> None:
    """Refuses a file of which a buffer, view or accessor is longer than what it lies in, as where a file is cut.

    buffers: their contents. parts: of the types of accessors. Raises SceneError, whose text the caller puts the name
    before.
    """
    views = tree.get("bufferViews", [])
    for k, (buffer, content) in enumerate(zip(tree.get("buffers", []), buffers)):
        if buffer.get("byteLength", 0) > len(content):
            told = f"its buffer {k} has {len(content)} bytes of {buffer['byteLength']}"
            raise SceneError(f"{told}: it is cut, or damaged; write it anew")
    for k, view in enumerate(views):
        start = view.get("byteOffset", 0)
        _check_within(f"its bufferView {k}", start, start + view["byteLength"], len(buffers[view["buffer"]]))
    for k, accessor in enumerate(tree.get("accessors", [])):
        if "bufferView" not in accessor or not accessor["count"]:
            continue
        view = views[accessor["bufferView"]]
        start, size = accessor.get("byteOffset", 0), _COMPONENT[accessor["componentType"]] * parts[accessor["type"]]
        step = view.get("byteStride", size)
        if step < size:
            raise SceneError(f"its accessor {k} has elements of {size} bytes every {step}; write it anew")
        end = start + step * (accessor["count"] - 1) + size
        _check_within(f"its accessor {k}", start, end, view["byteLength"])


def _check_within(who: str, start: int, end: int, there: int) -> None:
    if start < 0 or end > there:
        raise SceneError(f"{who} has bytes {start} to {end} of {there}: it is cut, or damaged; write it anew")


def _check_ways(nodes: list[dict[str, Any]]) -> None:
    """Raises SceneError where the way down from a node comes back to it."""
    above = Counter(child for node in nodes for child in node.get("children", []))
    free = [number for number in range(len(nodes)) if not above[number]]
    while free:
        for child in nodes[free.pop()].get("children", []):
            above[child] -= 1
            if not above[child]:
                free.append(child)
    if left := [number for number, count in above.items() if count]:
        raise SceneError(f"its node {min(left)} is below itself; write it with nodes that form a tree")


def _check_transform(number: int, node: dict[str, Any]) -> None:
    for key, count in _TRANSFORMS.items():
        values = node.get(key, [0.0] * count)
        known = isinstance(values, list) and len(values) == count
        if not known or not all(type(value) in (int, float) and math.isfinite(value) for value in values):
            raise SceneError(f"its node {number} has a {key} that is not of {count} finite numbers; write it anew")
    matrix = node.get("matrix")
    if matrix is not None:
        if beside := [key for key, none in _NONE.items() if node.get(key, none) != none]:
            told = f"a matrix and a {beside[0]} beside it, of which a node may have one"
            raise SceneError(f"its node {number} has {told}; write it anew")
        if any(abs(matrix[k] - value) > _ROUNDED for k, value in _LAST_ROW):
            raise SceneError(f"its node {number} has a matrix whose last row is not 0 0 0 1; write it anew")
    if not any(node.get("rotation", [1.0])):
        raise SceneError(f"its node {number} has a rotation of 0 0 0 0, which is none; write it anew")


def _names(tree: dict[str, Any]) -> Iterator[tuple[str, str, Any]]:
    """Yields what names an entry, of which kind that is, and its number."""
    if "scene" in tree:
        yield "it", "scenes", tree["scene"]
    for kind, key, named in (
        ("bufferViews", "buffer", "buffers"), ("accessors", "bufferView", "bufferViews"), ("nodes", "mesh", "meshes"),
        ("images", "bufferView", "bufferViews"), ("textures", "source", "images"),
    ):  # fmt: skip
        for k, entry in enumerate(tree.get(kind, [])):
            if key in entry:
                yield f"its {kind[:-1]} {k}", named, entry[key]
    for kind, key in (("scenes", "nodes"), ("nodes", "children")):
        for k, entry in enumerate(tree.get(kind, [])):
            for number in entry.get(key, []):
                yield f"its {kind[:-1]} {k}", "nodes", number
    for k, mesh in enumerate(tree.get("meshes", [])):
        for primitive in mesh.get("primitives", []):
            for number in (
                *primitive["attributes"].values(),
                *([primitive["indices"]] if "indices" in primitive else []),
            ):
                yield f"its mesh {k}", "accessors", number
            if "material" in primitive:
                yield f"its mesh {k}", "materials", primitive["material"]
    for k, material in enumerate(tree.get("materials", [])):
        for texture in (*material.values(), *_maps(material.get("pbrMetallicRoughness"))):
            if isinstance(texture, dict) and "index" in texture:
                yield f"its material {k}", "textures", texture["index"]


def _maps(entry: Any) -> list[Any]:
    return list(entry.values()) if isinstance(entry, dict) else []
