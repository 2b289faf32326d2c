"""A glTF that shows nothing is answered with the cause."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evis.scene.errors import SceneError
from evis.scene.mesh.files import load_parts


def triangle(path: Path, corners: int = 3, **change: Any) -> Path:
    """A triangle as glTF has it; None takes an entry away."""
    points, indices = np.eye(3, dtype="<f4").tobytes(), (np.arange(corners, dtype="<u2") % 3).tobytes()
    data = base64.b64encode(points + indices).decode()
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"uri": f"data:application/octet-stream;base64,{data}", "byteLength": len(points) + len(indices)}],
        "bufferViews": [
            {"buffer": 0, "byteLength": len(points)},
            {"buffer": 0, "byteOffset": len(points), "byteLength": len(indices)},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0] * 3, "max": [1] * 3},
            {"bufferView": 1, "componentType": 5123, "count": corners, "type": "SCALAR"},
        ],
        **change,
    }
    path.write_text(json.dumps({name: value for name, value in tree.items() if value is not None}))
    return path


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"scenes": None, "scene": None}, "meshes and no scene that shows them"),
        ({"corners": 4}, "mesh 0 has triangles of 4 corners, no multiple of 3"),
    ],
)
def test_the_cause_is_told(tmp_path: Path, change: dict[str, Any], says: str) -> None:
    assert len(load_parts(triangle(tmp_path / "whole.gltf"), np.ones(3))[0].mesh.faces) == 1
    with pytest.raises(SceneError, match=says):
        load_parts(triangle(tmp_path / "a.gltf", **change), np.ones(3))
