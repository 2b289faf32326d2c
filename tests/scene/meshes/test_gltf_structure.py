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
        (put("extensionsUsed", value=5), "its extensionsUsed are no list;"),
        (put("extensionsRequired", value="KHR_materials_unlit"), "its extensionsRequired are no list;"),
        (put("nodes", 1, "rotation", value=[0, 0, 0, 0]), "its node 1 has a rotation of 0 0 0 0, which is none;"),
        (put("nodes", 0, "matrix", value=[*[1, 0, 0, 0.1], *np.eye(4).ravel()[4:].tolist()]), "its node 0 has a matri"),
        (put("accessors", 0, "componentType", value=5124), "its accessor 0 has component type 5124 and type VEC3, "),
        (put("accessors", 0, "type", value="VEC5"), "its accessor 0 has component type 5126 and type VEC5, which "),
        (put("accessors", 0, "type", value="VEC2"), "its mesh 0 has POSITION of VEC2 in place of VEC3;"),
        (put(*PRIMITIVE, "attributes", value={}), "its mesh 0 has triangles without POSITION;"),
        (put("textures", value=[{"source": -1}]), "its texture 0 names number -1 of its images, of which there are 0;"),
        (put("images", value=[{"bufferView": 4}]), "its image 0 names number 4 of its bufferViews, of which there are"),
        (
            put("materials", value=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": -1}}}]),
            "its material 0 names number -1 of its textures, of which there are 0;",
        ),
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


@pytest.mark.parametrize(
    ("name", "accessor", "says"),
    [
        ("NORMAL", {"count": 2}, "2 NORMAL for 3 POSITION; write it anew"),
        ("TEXCOORD_0", {"count": 1, "type": "VEC2"}, "1 TEXCOORD_0 for 3 POSITION; write it anew"),
        ("COLOR_0", {"type": "VEC2"}, "COLOR_0 of VEC2 in place of VEC3 or VEC4; write it anew"),
    ],
)
def test_attributes_are_of_every_vertex(tmp_path: Path, name: str, accessor: Tree, says: str) -> None:
    """Those of fewer vertices than there are were left out without a word."""
    tree = triangle()
    tree["accessors"].append(tree["accessors"][0] | accessor)
    tree["meshes"][0]["primitives"][0]["attributes"][name] = 1
    with pytest.raises(SceneError) as caught:
        load_parts(gltf(tmp_path / "a.gltf", tree), np.ones(3))
    assert str(caught.value) == f"a.gltf: its mesh 0 has {says}"


def test_indices_are_whole_numbers(tmp_path: Path) -> None:
    """Floats were taken for indices."""
    tree = triangle()
    tree["accessors"].append({"bufferView": 0, "componentType": 5126, "count": 3, "type": "SCALAR"})
    tree["meshes"][0]["primitives"][0]["indices"] = 1
    with pytest.raises(SceneError, match=r"its mesh 0 has indices of component type 5126 and type SCALAR, not of "):
        load_parts(gltf(tmp_path / "a.gltf", tree), np.ones(3))


def test_a_transform_is_told_in_one_way(tmp_path: Path) -> None:
    """A node has a matrix, or translation, rotation and scale (glTF 2.0, 3.5.3); what changes nothing may be there."""
    tree = triangle()
    matrix = np.diag([2.0, 2.0, 2.0, 1.0]).ravel().tolist()
    tree["nodes"][0] |= {"matrix": matrix, "translation": [0, 0, 0], "rotation": [0, 0, 0, 1], "scale": [1, 1, 1]}
    (part,) = load_parts(gltf(tmp_path / "a.gltf", tree), np.ones(3))
    assert np.allclose(np.linalg.norm(part.mesh.vertices, axis=1), 2.0)
    tree["nodes"][0] |= {"matrix": np.eye(4).ravel().tolist(), "scale": [2, 2, 2]}
    with pytest.raises(SceneError, match=r"its node 0 has a matrix and a scale beside it, of which a node may have"):
        load_parts(gltf(tmp_path / "a.gltf", tree), np.ones(3))


def test_another_version_is_told(tmp_path: Path) -> None:
    """Meshes of glTF 1 are a map and not a list."""
    tree = triangle() | {"asset": {"version": "1.0"}, "meshes": {"m": {}}}
    with pytest.raises(SceneError, match=r"a\.gltf: is of glTF 1\.0, and only glTF 2 is read; export it as that"):
        load_parts(gltf(tmp_path / "a.gltf", tree), np.ones(3))


def test_a_compressed_mesh_is_refused_also_where_it_is_not_said_to_be_needed(tmp_path: Path) -> None:
    """Its accessors have no numbers, and all its vertices were at the origin."""
    tree = triangle()
    tree["meshes"][0]["primitives"][0]["extensions"] = {"KHR_draco_mesh_compression": {"bufferView": 0}}
    del tree["accessors"][0]["bufferView"]
    with pytest.raises(SceneError, match=r"its mesh 0 has KHR_draco_mesh_compression, .* export it without"):
        load_parts(gltf(tmp_path / "a.gltf", tree), np.ones(3))


def test_a_buffer_that_is_not_there_is_named(tmp_path: Path) -> None:
    """As a file beside the glTF."""
    tree = triangle()
    tree["buffers"][0]["uri"] = "numbers.bin"
    (tmp_path / "a.gltf").write_text(json.dumps(tree))
    with pytest.raises(SceneError, match=r"a\.gltf names numbers\.bin for its numbers, which is not there; keep that "):
        load_parts(tmp_path / "a.gltf", np.ones(3))


@pytest.mark.parametrize("name", ["EXT_mesh_gpu_instancing", "KHR_materials_unlit"])
def test_extensions_that_are_left_out_are_told(tmp_path: Path, name: str) -> None:
    """What is drawn without them looks otherwise; other extensions change nothing that is drawn."""
    tree = triangle() | {"extensionsUsed": [name, "KHR_materials_clearcoat"]}
    (part,) = load_parts(gltf(tmp_path / "a.gltf", tree), np.ones(3))
    assert part.lacks == (f"has {name}, which is not read",)


def test_a_picture_without_coordinates_is_told(tmp_path: Path) -> None:
    """It lies by the second set, and the mesh has the first alone."""
    pixel = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
    tree = triangle() | {
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 1}}}],
        "textures": [{"source": 0}],
        "images": [{"uri": f"data:image/png;base64,{pixel}"}],
    }
    tree["accessors"].append(tree["accessors"][0] | {"type": "VEC2"})
    tree["meshes"][0]["primitives"][0] |= {"material": 0, "attributes": {"POSITION": 0, "TEXCOORD_0": 1}}
    path = gltf(tmp_path / "a.gltf", tree)
    (part,) = load_parts(path, np.ones(3))
    assert part.lacks == ("has a baseColorTexture that lies by TEXCOORD_1, of which mesh 0 has none",)
    assert load_parts(path, np.ones(3), textures=False)[0].lacks == ()


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
