"""Every mesh of a glTF stands where the specification's node transforms put it, in an order that the file tells."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evis.scene.errors import SceneError
from evis.scene.mesh.files import load_parts

TRIANGLE = np.eye(3)
Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
CAMERA = {"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1, "aspectRatio": 1.0}}


def written(path: Path, nodes: list[dict[str, Any]], roots: list[int], primitives: int = 1, count: int = 3) -> Path:
    """Writes a glTF whose one mesh has triangles k, TRIANGLE moved by 10 k along x."""
    points = [np.add(TRIANGLE, [10.0 * k, 0.0, 0.0]).astype("<f4") for k in range(primitives)]
    data = b"".join(each.tobytes() for each in points)
    views = [{"buffer": 0, "byteOffset": 36 * k, "byteLength": 36} for k in range(primitives)]
    accessors = [
        {"bufferView": k, "componentType": 5126, "count": count, "type": "VEC3",
         "min": each.min(0).tolist(), "max": each.max(0).tolist()}
        for k, each in enumerate(points)
    ]  # fmt: skip
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": roots}],
        "nodes": nodes,
        "cameras": [CAMERA],
        "meshes": [{"primitives": [{"attributes": {"POSITION": k}} for k in range(primitives)]}],
        "buffers": [{"uri": "data:;base64," + base64.b64encode(data).decode(), "byteLength": len(data)}],
        "bufferViews": views,
        "accessors": accessors,
    }
    path.write_text(json.dumps(tree))
    return path


def corners(path: Path) -> list[np.ndarray]:
    """Loads the corners of each part's triangle, [3, 3], sorted, for a mirror runs through them backwards."""
    return [np.sort(part.points()[part.mesh.faces[0]], axis=0) for part in load_parts(path, np.ones(3))]


def expected(transform: np.ndarray) -> np.ndarray:
    """Moves TRIANGLE by a transform [4, 4] of the specification, y up."""
    return np.sort((TRIANGLE @ transform[:3, :3].T + transform[:3, 3]) @ Z_UP.T, axis=0)


def moved(*translation: float) -> np.ndarray:
    """Makes a translation [4, 4]."""
    matrix = np.eye(4)
    matrix[:3, 3] = translation
    return matrix


def test_primitives_of_a_mesh_come_in_the_order_of_the_file(tmp_path: Path) -> None:
    found = load_parts(written(tmp_path / "a.gltf", [{"mesh": 0, "name": "chair"}], [0], primitives=7), np.ones(3))
    assert [round(float(part.points()[:, 0].min())) for part in found] == [0, 10, 20, 30, 40, 50, 60]


@pytest.mark.parametrize(
    "parent",
    [{"name": "world"}, {"camera": 0}, {"camera": 0, "name": "world"}, {"name": "", "camera": 0}],
    ids=["called_world", "camera", "camera_called_world", "without_a_name"],
)
def test_a_node_carries_its_mesh_and_its_children(tmp_path: Path, parent: dict[str, Any]) -> None:
    child = {"name": "child", "mesh": 0, "translation": [0, 0, 5]}
    nodes = [parent | {"translation": [100, 0, 0], "mesh": 0, "children": [1]}, child]
    # The child is 5 m along z, which is -y where z is up.
    found = sorted(corners(written(tmp_path / "a.gltf", nodes, [0])), key=lambda each: float(each[0, 1]))
    np.testing.assert_allclose(found, [expected(moved(100, 0, 5)), expected(moved(100, 0, 0))], atol=1e-5)


@pytest.mark.parametrize("seed", range(8))
def test_trees_of_nodes_stand_as_their_transforms_say(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    nodes: list[dict[str, Any]] = []
    placed: list[np.ndarray] = []
    roots = []
    for n in range(8):
        node: dict[str, Any] = {"mesh": 0} if n == 0 or rng.random() < 0.7 else {}
        own = np.eye(4)
        if rng.random() < 0.4:
            own[:3] = rng.normal(size=(3, 4))
            node["matrix"] = own.T.ravel().tolist()
        else:
            angle, scale = rng.uniform(-3, 3), rng.uniform(0.5, 2, 3) * rng.choice([-1, 1], 3)
            turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
            own[:3, :3], own[:3, 3] = turn * scale, rng.normal(size=3)
            node["rotation"] = [0.0, 0.0, float(np.sin(angle / 2)), float(np.cos(angle / 2))]
            node |= {"scale": scale.tolist(), "translation": own[:3, 3].tolist()}
        if rng.random() < 0.6:
            node["name"] = str(rng.choice(["world", "a", "a_1", "3", "node"]))
        if rng.random() < 0.3:
            node["camera"] = 0
        if n and rng.random() < 0.6:
            parent = int(rng.integers(n))
            nodes[parent].setdefault("children", []).append(n)
            own = placed[parent] @ own
        else:
            roots.append(n)
        nodes.append(node)
        placed.append(own)
    found = corners(written(tmp_path / "a.gltf", nodes, roots))
    wanted = [expected(place) for place, node in zip(placed, nodes) if "mesh" in node]
    assert len(found) == len(wanted)
    for each in wanted:
        nearest = min(np.abs(each - other).max() for other in found)
        assert nearest < 1e-5 * (1.0 + np.abs(each).max())  # float32 of the file's corners


def test_many_nodes_with_many_empty_primitives_are_refused(tmp_path: Path) -> None:
    nodes = [{"mesh": 0} for _ in range(20_000)]
    path = written(tmp_path / "a.gltf", nodes, list(range(len(nodes))), primitives=1, count=0)
    tree = json.loads(path.read_text())
    tree["meshes"][0]["primitives"] *= 20_000
    path.write_text(json.dumps(tree))
    with pytest.raises(SceneError, match=r"a\.gltf: .*EVIS_UNPACK_LIMIT"):
        load_parts(path, np.ones(3))
