"""Faces of PLY files with any number of corners, as Blender writes them: area, volume and colours of a known solid."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from evis.scene.errors import SceneError
from evis.scene.mesh.files import load_parts
from evis.scene.model import Mesh

TURNS = np.arange(6) * np.pi / 3
RING = np.stack([np.cos(TURNS), np.sin(TURNS)], 1)
POINTS = np.vstack([np.c_[RING, np.zeros(6)], np.c_[RING, np.ones(6)]])
"""Of a prism over a hexagon of side 1, 1 high: its volume is 1.5 sqrt(3), its area 3 sqrt(3) + 6."""
SIDES = [[k, (k + 1) % 6, (k + 1) % 6 + 6, k + 6] for k in range(6)]
FACES = [[5, 4, 3, 2, 1, 0], *SIDES[:5], [5, 0, 6], [5, 6, 11], [6, 7, 8, 9, 10, 11]]


def written(path: Path, form: str, colours: bool) -> bytes:
    order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[form]
    colour = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue")) if colours else ""
    head = (
        f"ply\nformat {form} 1.0\nelement vertex 12\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(FACES)}\nproperty uchar flags\nproperty list uchar ushort vertex_indices\n{colour}"
        "element edge 1\nproperty int vertex1\nproperty int vertex2\nend_header\n"
    )
    rows = [(7, len(face), *face, *([0, 255 * (k == 0), 0] if colours else [])) for k, face in enumerate(FACES)]
    if order:
        body = b"".join(struct.pack(f"{order}3f", *point) for point in POINTS)
        kinds = [f"{order}BB{len(face)}H{'3B' if colours else ''}" for face in FACES]
        body += b"".join(struct.pack(kind, *row) for kind, row in zip(kinds, rows)) + struct.pack(f"{order}2i", 0, 1)
    else:
        lines = [*(" ".join(f"{v:.9g}" for v in p) for p in POINTS), *(" ".join(map(str, r)) for r in rows), "0 1"]
        body = ("\n".join(lines) + "\n").encode()
    path.write_bytes(head.encode() + body)
    return head.encode() + body


def only(path: Path) -> Mesh:
    (part,) = load_parts(path, np.ones(3))
    return part.mesh


@pytest.mark.parametrize("colours", [False, True])
@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_faces_of_three_four_and_six_corners(form: str, colours: bool, tmp_path: Path) -> None:
    written(tmp_path / "a.ply", form, colours)
    mesh = only(tmp_path / "a.ply")
    a, b, c = mesh.vertices[mesh.faces].astype(np.float64).transpose(1, 0, 2)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=-1) / 2
    assert areas.sum() == pytest.approx(3 * np.sqrt(3) + 6, rel=1e-6)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(1.5 * np.sqrt(3), rel=1e-6)
    assert (mesh.colours is not None) == colours
    if mesh.colours is not None:  # green at the bottom, black elsewhere
        below = (np.stack((a, b, c))[..., 2] < 0.5).all(0)
        assert mesh.colours.shape == (len(mesh.faces), 3, 3)
        assert (mesh.colours == np.where(below, 1.0, 0.0)[:, None, None] * [0, 1, 0]).all()


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
def test_a_file_that_is_cut_is_refused(form: str, tmp_path: Path) -> None:
    whole = written(tmp_path / "a.ply", form, False)
    (tmp_path / "b.ply").write_bytes(whole[:-30])
    with pytest.raises(SceneError, match=r"b\.ply cannot be read as PLY: it is cut"):
        only(tmp_path / "b.ply")


def test_a_text_of_stl_that_is_cut_is_refused(tmp_path: Path) -> None:
    """Between two solids too, of which the first is whole."""
    facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    solid = f"solid facet\n{facet * 3}endsolid facet\n"
    (tmp_path / "a.stl").write_text(solid * 2)
    assert sum(len(part.mesh.faces) for part in load_parts(tmp_path / "a.stl", np.ones(3))) == 6
    (tmp_path / "a.stl").write_text((solid * 2)[:-120])
    with pytest.raises(SceneError, match=r"a\.stl cannot be read as STL: it is cut.*5 facets .* begin, 4 "):
        load_parts(tmp_path / "a.stl", np.ones(3))


@pytest.mark.parametrize("points", [np.zeros((3, 3)), np.outer(range(3), [1e-6, 2e-6, 0]), [[5, 0, 0], [5, 1, 0]] * 2])
def test_a_mesh_without_any_area_is_refused(points: np.ndarray, tmp_path: Path) -> None:
    """It would be in the scene, and in no picture."""
    text = "".join(f"v {x:g} {y:g} {z:g}\n" for x, y, z in points)
    (tmp_path / "a.obj").write_text(f"{text}f 1 2 3\n")
    with pytest.raises(SceneError, match=r"a\.obj has no triangle with an area"):
        only(tmp_path / "a.obj")
    (tmp_path / "a.obj").write_text(f"{text}v 0 0 3\nv 1e-4 0 3\nv 0 1e-4 3\nf 1 2 3\nf {len(points) + 1} -2 -1\n")
    assert len(only(tmp_path / "a.obj").faces) == 2
