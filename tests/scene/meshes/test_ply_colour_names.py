"""Colours of a PLY under the names that other programs give them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from evis.scene.mesh.files import load_parts

HEADER = """ply
format {kind} 1.0
element vertex 3
property float x
property float y
property float z
property uchar {0}
property uchar {1}
property uchar {2}
element face 1
property list uchar int vertex_indices
end_header
"""


@pytest.mark.parametrize("names", [("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b")])
@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian"])
def test_colours_have_their_value(tmp_path: Path, names: tuple[str, str, str], kind: str) -> None:
    """sRGB 255, 188, 0 is linear 1, ((188 / 255 + 0.055) / 1.055) ** 2.4, 0."""
    corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
    if kind == "ascii":
        body = "".join(f"{x} {y} {z} 255 188 0\n" for x, y, z in corners).encode() + b"3 0 1 2\n"
    else:
        rows = [np.array(c, "<f4").tobytes() + bytes((255, 188, 0)) for c in corners]
        body = b"".join(rows) + bytes((3,)) + np.arange(3, dtype="<i4").tobytes()
    path = tmp_path / "a.ply"
    path.write_bytes(HEADER.format(*names, kind=kind).encode() + body)
    colours = load_parts(path, np.ones(3))[0].mesh.colours
    assert colours is not None
    np.testing.assert_allclose(colours[0], [[1.0, ((188 / 255 + 0.055) / 1.055) ** 2.4, 0.0]] * 3, rtol=1e-6)
