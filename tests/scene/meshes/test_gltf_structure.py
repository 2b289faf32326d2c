"""A glTF that names what is not there, is cut, or whose nodes are no trees is refused in a line that says where."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from one_triangle import TRIANGLE, Tree, gltf, triangle

from evis.scene.errors import SceneError
from evis.scene.mesh.files import load_parts


def glb(path: Path) -> bytes:
    """Writes the triangle as a GLB, whose last number is not 0, and returns its bytes."""
    text = json.dumps(triangle()).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", 36, b"BIN\0") + TRIANGLE.tobytes()
    content = struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
    path.write_bytes(content)
    return content


def put(*keys: Any, value: Any) -> Callable[[Tree], None]:
    """Sets an entry of the tree."""

    def change(tree: Any) -> None:
        for key in keys[:-1]:
            tree = tree[key]
        tree[keys[-1]] = value

    return change


PRIMITIVE = "meshes", 0, "primitives", 0


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (put("nodes", 0, "mesh", value=-1), "its node 0 names number -1 of its meshes, of which there are 1;"),
        (put("nodes", 0, "mesh", value=9), "its node 0 names number 9 of its meshes, of which there are 1;"),
        (put("nodes", 0, "children", value=[7]), "its node 0 names number 7 of its nodes, of which there are 2;"),
        (put("scenes", 0, "nodes", value=[5]), "its scene 0 names number 5 of its nodes, of which there are 2;"),
        (put("scene", value=1), "it names number 1 of its scenes, of which there are 1;"),
        (put(*PRIMITIVE, "material", value=0), "its mesh 0 names number 0 of its materials, of which there are 0;"),
        (put(*PRIMITIVE, "indices", value=1), "its mesh 0 names number 1 of its accessors, of which there are 1;"),
        (put("accessors", 0, "bufferView", value=-1), "its accessor 0 names number -1 of its bufferViews,"),
        (put("bufferViews", 0, "buffer", value=2), "its bufferView 0 names number 2 of its buffers,"),
        (put("accessors", 0, "count", value=6), "its accessor 0 has bytes 0 to 72 of 36: it is cut, or damaged;"),
        (put("accessors", 0, "byteOffset", value=-4), "its accessor 0 has bytes -4 to 32 of 36:"),
        (put("bufferViews", 0, "byteOffset", value=4), "its bufferView 0 has bytes 4 to 40 of 36:"),
        (put("bufferViews", 0, "byteStride", value=4), "its accessor 0 has elements of 12 bytes every 4;"),
        (put("buffers", 0, "byteLength", value=40), "its buffer 0 has 36 bytes of 40: it is cut, or damaged;"),
        (put("nodes", 0, "translation", value=[float("nan"), 0, 0]), "its node 0 has a translation that is not of 3 "),
        (put("nodes", 1, "rotation", value=[0, 0, 0]), "its node 1 has a rotation that is not of 4 finite numbers;"),
        (put("nodes", 0, "children", value=[1]), "its node 1 is below node 0 and the scene itself;"),
        (put("nodes", value={}), "its nodes are no list of maps;"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, change: Callable[[Tree], None], says: str) -> None:
    """A number below 0 was taken from the end of the list, a transform with NaN left out."""
    tree = triangle(nodes=2)
    change(tree)
    with pytest.raises(SceneError) as caught:
        load_parts(gltf(tmp_path / "a.gltf", tree), np.ones(3))
    text = str(caught.value)
    assert text.startswith(f"a.gltf: {says}") and "; write it " in text and "\n" not in text


def test_a_node_with_two_parents_is_refused(tmp_path: Path) -> None:
    """It was shown below one of them."""
    tree = triangle(nodes=3) | {"scenes": [{"nodes": [0, 1]}]}
    tree["nodes"][0]["children"] = tree["nodes"][1]["children"] = [2]
    with pytest.raises(SceneError, match=r"a\.gltf: its node 2 is below node 1 and node 0; write it with"):
        load_parts(gltf(tmp_path / "a.gltf", tree), np.ones(3))


def test_a_cut_file_is_never_read(tmp_path: Path) -> None:
    """Wherever it is cut: the last one to three bytes of a GLB's numbers were taken as 0."""
    path = tmp_path / "a.glb"
    content = glb(path)
    assert len(load_parts(path, np.ones(3))) == 1
    for length in range(len(content)):
        path.write_bytes(content[:length])
        with pytest.raises(SceneError, match=r"^a\.glb[^\n]*$"):
            load_parts(path, np.ones(3))
