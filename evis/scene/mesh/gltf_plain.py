"""Rewrites a glTF file in the few ways that trimesh understands: as a GLB, with plain numbers.

trimesh takes no notice of normalised and sparse numbers, of sets of texture coordinates other than the first, and of
how a texture is laid over them (KHR_texture_transform), and finds materials by names that several may share.
"""

from __future__ import annotations

import base64
import copy
import json
import struct
from typing import Any

import numpy as np

from evis.scene.errors import SceneError
from evis.scene.mesh.gltf_nodes import name_nodes

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_PARTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_FLOAT = 5126
_FAN = 6
NO_MATERIAL = "none"
"""Name of what stands for the material of a mesh that has none, where the others are named by their numbers."""


def plain(tree: dict[str, Any], buffers: list[bytes]) -> bytes:
    """Returns a GLB that says the same, where materials are named by their numbers.

    Raises SceneError, whose text the caller puts the name before, for what cannot be read; whatever else a damaged file
    leads to.
    """
    tree = copy.deepcopy(tree)
    new = _Numbers(tree, buffers)
    for number, material in enumerate(tree.get("materials", [])):
        material["name"] = str(number)
    bare = None
    for mesh in tree.get("meshes", []):
        for primitive in mesh.get("primitives", []):
            if primitive.get("mode") == _FAN:
                raise SceneError("has fans of triangles, which are not read; export it as plain triangles")
            if "material" not in primitive and "TEXCOORD_0" in primitive["attributes"]:
                # trimesh leaves the coordinates out where there is no material; a scene may have one for them.
                bare = len(tree.setdefault("materials", [])) if bare is None else bare
                tree["materials"][bare:] = [{"name": NO_MATERIAL}]
                primitive["material"] = bare
            _lay(tree, primitive, new)
            attributes = primitive["attributes"]
            for key in ("POSITION", "TEXCOORD_0", "COLOR_0"):
                if key in attributes:
                    attributes[key] = new.readable(attributes[key], whole=key == "COLOR_0")
            if "indices" in primitive:
                primitive["indices"] = new.readable(primitive["indices"], whole=True)
    name_nodes(tree)
    tree["buffers"] = [{"byteLength": len(b), "uri": _uri(b)} for b in buffers[1:]]
    binary = buffers[0] if buffers else b""
    if buffers:
        tree["buffers"].insert(0, {"byteLength": len(binary)})
    new.add_to(tree)
    text = json.dumps(tree).encode()
    chunks = [(b"JSON", text + b" " * (-len(text) % 4)), (b"BIN\0", binary + bytes(-len(binary) % 4))]
    body = b"".join(struct.pack("<I4s", len(chunk), kind) + chunk for kind, chunk in chunks)
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def base_texture(material: dict[str, Any]) -> dict[str, Any]:
    """Returns what a material says of the texture of its base colour; empty without one."""
    found = material.get("pbrMetallicRoughness", {}).get("baseColorTexture", {})
    return found if isinstance(found, dict) else {}


def texture_set(texture: dict[str, Any]) -> int:
    """Returns the number of the texture coordinates by which a texture lies."""
    change = texture.get("extensions", {}).get("KHR_texture_transform", {})
    return int(change.get("texCoord", texture.get("texCoord", 0)))


def _lay(tree: dict[str, Any], primitive: dict[str, Any], new: _Numbers) -> None:
    """Make the first texture coordinates those by which the base colour's texture lies."""
    if "material" not in primitive:
        return
    texture = base_texture(tree["materials"][primitive["material"]])
    change = texture.get("extensions", {}).get("KHR_texture_transform", {})
    which = texture_set(texture)
    attributes = primitive["attributes"]
    found = attributes.get(f"TEXCOORD_{which}")
    if which:
        attributes.pop("TEXCOORD_0", None)
    if found is None:
        return
    attributes["TEXCOORD_0"] = found
    if change.keys() & {"offset", "rotation", "scale"}:
        u, v = (new.values(found) * np.array(change.get("scale", [1, 1]), np.float64)).T
        sine, cosine = np.sin(change.get("rotation", 0.0)), np.cos(change.get("rotation", 0.0))
        # Counter-clockwise as it is seen, while v counts downwards.
        turned = np.stack((cosine * u + sine * v, cosine * v - sine * u), axis=-1)
        laid = turned + np.array(change.get("offset", [0, 0]), np.float64)
        if not np.isfinite(laid).all():
            raise SceneError(
                f"material {primitive['material']} has a KHR_texture_transform that is not finite; write it anew"
            )
        attributes["TEXCOORD_0"] = new.add(laid)


class _Numbers:
    """The accessors of a file, and those that are added, in a buffer of their own."""

    def __init__(self, tree: dict[str, Any], buffers: list[bytes]) -> None:
        self.accessors: list[dict[str, Any]] = tree.get("accessors", [])
        self.views: list[dict[str, Any]] = tree.get("bufferViews", [])
        self.buffers, self.data, self.known = buffers, bytearray(), dict[int, int]()
        self.own = len(buffers)

    def readable(self, number: int, whole: bool) -> int:
        """The number of an accessor that trimesh reads right; whole: whole numbers may stay, also normalised ones."""
        accessor = self.accessors[number]
        if "sparse" not in accessor and (whole or accessor["componentType"] == _FLOAT):
            return number
        if number not in self.known:
            self.known[number] = self.add(self._raw(accessor)) if whole else self.add(self.values(number))
        return self.known[number]

    def values(self, number: int) -> np.ndarray:
        """Tells what an accessor means, float64 [count, parts]."""
        accessor = self.accessors[number]
        raw = self._raw(accessor)
        if not accessor.get("normalized", False) or raw.dtype.kind == "f":
            return raw.astype(np.float64)
        return np.maximum(raw / float(np.iinfo(raw.dtype).max), -1.0)

    def add(self, values: np.ndarray) -> int:
        """Adds an accessor; floats as float32."""
        values = values.astype("<f4") if values.dtype.kind == "f" else values
        kind = next(k for k, name in _TYPES.items() if np.dtype(name) == values.dtype)
        parts = next(name for name, count in _PARTS.items() if count == values.shape[1])
        content = np.ascontiguousarray(values).tobytes()
        view = {"buffer": self.own, "byteOffset": len(self.data), "byteLength": len(content)}
        self.data += content + bytes(-len(content) % 4)
        self.views.append(view)
        accessor = {"bufferView": len(self.views) - 1, "componentType": kind, "count": len(values), "type": parts}
        self.accessors.append(accessor)
        return len(self.accessors) - 1

    def add_to(self, tree: dict[str, Any]) -> None:
        """Returns the buffer of the new ones, if there are any."""
        if self.data:
            if not tree["buffers"]:  # the first is the binary chunk
                tree["buffers"].append({"byteLength": 0})
            tree["buffers"].append({"byteLength": len(self.data), "uri": _uri(bytes(self.data))})
            tree["accessors"], tree["bufferViews"] = self.accessors, self.views

    def _raw(self, accessor: dict[str, Any]) -> np.ndarray:
        parts = _PARTS[accessor["type"]]
        values = self._read(accessor, accessor["count"], accessor["componentType"], parts)
        if "sparse" in accessor:
            sparse = accessor["sparse"]
            if sparse["count"] > accessor["count"]:
                raise ValueError(f"an accessor of {accessor['count']} numbers puts {sparse['count']} in their places")
            places = self._read(sparse["indices"], sparse["count"], sparse["indices"]["componentType"], 1)
            values = values.copy()
            values[places[:, 0]] = self._read(sparse["values"], sparse["count"], accessor["componentType"], parts)
        return values

    def _read(self, entry: dict[str, Any], count: int, kind: int, parts: int) -> np.ndarray:
        """Numbers [count, parts] of a view; 0 where there is none."""
        dtype = np.dtype(_TYPES[kind])
        if "bufferView" not in entry:
            return np.zeros((count, parts), dtype)
        view = self.views[entry["bufferView"]]
        start, end = view.get("byteOffset", 0), view.get("byteOffset", 0) + view["byteLength"]
        content = self.buffers[view["buffer"]][start:end]
        return np.ndarray(
            (count, parts), dtype, content, entry.get("byteOffset", 0),
            (view.get("byteStride", parts * dtype.itemsize), dtype.itemsize),
        )  # fmt: skip


def _uri(content: bytes) -> str:
    return "data:application/octet-stream;base64," + base64.b64encode(content).decode()
