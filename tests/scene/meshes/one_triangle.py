"""A glTF of one triangle, which a test changes before it is written."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np

TRIANGLE = np.eye(3, dtype="<f4")
Tree = dict[str, Any]


def triangle(nodes: int = 1) -> Tree:
    """The JSON of a file with one triangle, which all of its nodes show."""
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": list(range(nodes))}],
        "nodes": [{"mesh": 0} for _ in range(nodes)],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36}],
    }


def gltf(path: Path, tree: Tree) -> Path:
    uri = "data:;base64," + base64.b64encode(TRIANGLE.tobytes()).decode()
    path.write_text(json.dumps(tree | {"buffers": [tree["buffers"][0] | {"uri": uri}]}))
    return path
