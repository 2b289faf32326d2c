"""Reads the JSON of a glTF or GLB file: its materials, and how much memory the file asks for."""

from __future__ import annotations

import base64
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

from evis.files.allowance import Allowance
from evis.files.json_text import parsed
from evis.scene.errors import SceneError
from evis.scene.images.pictures import check_picture
from evis.scene.mesh.gltf_primitives import check_primitives
from evis.scene.mesh.gltf_structure import check_extents, check_names

SUFFIXES = (".gltf", ".glb")
_PARTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_TRIANGLES = 4
"""Mode of a primitive whose corners are taken by threes; also where none is given."""
ELEMENT = 8
"""Most bytes of one number, as meshes are worked on in float64."""
NODE = 256
"""Bytes that a node takes, of which each primitive of a mesh has one wherever the mesh is shown."""


def read_header(path: Path) -> tuple[dict[str, Any], bytes]:
    """Reads the JSON of a glTF or GLB file, and of a GLB the binary chunk. Raises ValueError for what is neither."""
    data = path.read_bytes()
    binary = b""
    if data[:4] == b"glTF":
        (length,) = struct.unpack_from("<I", data, 12)
        binary = data[28 + length :]
        data = data[20 : 20 + length]
    tree = parsed(data)
    if not isinstance(tree, dict):
        raise ValueError("its JSON is no map")
    return tree, binary


def buffer_names(tree: dict[str, Any]) -> set[str]:
    """Returns the URIs of a file's buffers, which are no pictures."""
    return {str(buffer["uri"]).strip() for buffer in tree.get("buffers", []) if "uri" in buffer}


def buffers_of(tree: dict[str, Any], binary: bytes, read: Callable[[str], bytes]) -> list[bytes]:
    """Returns the contents of a file's buffers. read: the content of a uri."""
    return [_content(buffer, read, binary) for buffer in tree.get("buffers", [])]


def check_header(tree: dict[str, Any], buffers: list[bytes], size: int) -> None:
    """Refuses a file that asks for more memory than its size allows, or names what is not there, and pictures within it
    that are too large.

    buffers: as of `buffers_of`. size: of the file [bytes]. Accessors, views and meshes count as often as they are used:
    numbers in a few bytes of JSON can name the same bytes many times. Raises SceneError, AllowanceError (whose texts
    the caller puts the name before), or whatever else a damaged file leads to.
    """
    check_names(tree, _PARTS)
    views = tree.get("bufferViews", [])
    allowance = Allowance(size + sum(map(len, buffers)))
    for view in views:
        allowance.take(max(0, int(view["byteLength"])))
    sizes = [_size(accessor) for accessor in tree.get("accessors", [])]
    for one in sizes:
        allowance.take(one)
    meshes = [
        sum(NODE + sum(sizes[i] for i in (*p["attributes"].values(), *_indices(p))) for p in mesh.get("primitives", []))
        for mesh in tree.get("meshes", [])
    ]
    nodes = tree.get("nodes", [])
    roots = [n for scene in tree.get("scenes", []) for n in scene.get("nodes", [])]
    if tree.get("meshes") and not roots:
        raise SceneError("it has meshes and no scene that shows them; write it with a scene")
    _check_triangles(tree)
    for number in (*roots, *(child for node in nodes for child in node.get("children", []))):
        if "mesh" in nodes[number]:
            allowance.take(meshes[nodes[number]["mesh"]])
    for one in meshes:
        allowance.take(one)
    check_primitives(tree)
    check_extents(tree, buffers, _PARTS)
    for number, image in enumerate(tree.get("images", [])):
        if "bufferView" in image:
            view = views[image["bufferView"]]
            start = int(view.get("byteOffset", 0))
            packed = buffers[view["buffer"]][start : start + int(view["byteLength"])]
        elif str(image.get("uri", "")).find("base64,") >= 0:
            packed = base64.b64decode(str(image["uri"]).partition("base64,")[2])
        else:
            continue  # a file, which is checked as it is read
        try:
            check_picture(packed)
        except SceneError as error:
            raise SceneError(f"its image {image.get('name', number)}, {error}") from None


def _content(entry: dict[str, Any], read: Callable[[str], bytes], binary: bytes) -> bytes:
    """The bytes of a buffer or image."""
    uri = entry.get("uri")
    if uri is None:
        return binary
    start = str(uri).find("base64,")
    return read(str(uri)) if start < 0 else base64.b64decode(str(uri)[start + 7 :])


def _check_triangles(tree: dict[str, Any]) -> None:
    """Raises SceneError for triangles whose corners are no multiple of three."""
    for number, mesh in enumerate(tree.get("meshes", [])):
        for primitive in mesh.get("primitives", []):
            corners = primitive.get("indices", primitive["attributes"].get("POSITION"))
            if corners is None or primitive.get("mode", _TRIANGLES) != _TRIANGLES:
                continue
            count = tree["accessors"][corners]["count"]
            if count % 3:
                raise SceneError(f"mesh {number} has triangles of {count} corners, no multiple of 3; write it anew")


def _size(accessor: dict[str, Any]) -> int:
    count = accessor["count"]
    if type(count) is not int or count < 0:
        raise ValueError(f"an accessor has the count {count!r:.40}")
    return count * _PARTS[accessor["type"]] * ELEMENT


def _indices(primitive: dict[str, Any]) -> list[int]:
    return [primitive["indices"]] if "indices" in primitive else []
