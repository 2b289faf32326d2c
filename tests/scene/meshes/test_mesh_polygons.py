"""Faces of an OBJ with many corners: the triangles cover what the face covers, whatever its shape."""

import time

import numpy as np
import pytest

from evis.scene import SceneError
from evis.scene.mesh.files import load_parts
from evis.scene.mesh.polygons import cut_polygons

FRAME = [(0, 0), (6, 0), (6, 4), (0, 4), (0, 0), (1, 1), (1, 3), (5, 3), (5, 1), (1, 1)]
"""A rectangle with a window, as modellers write it: one face that goes in and out along one line."""
SHAPES = {
    "arrow": [(0, 0), (2, 1), (0, 2), (0.5, 1)],
    "L": [(0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3)],
    "comb": [(0, 0), (7, 0), (7, 3), (6, 3), (6, 1), (5, 1), (5, 3), (4, 3), (4, 1), (3, 1), (3, 3), (0, 3)],
    "window": FRAME,
    "star": [(np.cos(a) * r, np.sin(a) * r) for a, r in zip(np.arange(14) * np.pi / 7, [3, 1] * 7)],
}


def inside(polygon, points):
    """By the number of edges that a ray along +x crosses."""
    a, b = np.array(polygon), np.roll(polygon, -1, axis=0)
    x, y = points[:, None, 0], points[:, None, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = a[:, 0] + (y - a[:, 1]) * (b - a)[:, 0] / (b - a)[:, 1]
    return (((a[:, 1] > y) != (b[:, 1] > y)) & (x < crossing)).sum(1) % 2 == 1


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("backwards", [False, True])
def test_triangles_cover_the_face_once_and_nothing_else(tmp_path, name, backwards):
    """In a tilted plane, of 1,000 points, by winding; corners counted from the start or back from the face."""
    polygon = np.array(SHAPES[name], np.float64)
    polygon = polygon[::-1] if backwards else polygon
    tilt = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    space = np.c_[polygon, np.zeros(len(polygon))] @ tilt.T
    corners = range(1, len(polygon) + 1) if backwards else range(-len(polygon), 0)
    text = "".join("v {:.17g} {:.17g} {:.17g}\n".format(*p) for p in space) + f"f {' '.join(map(str, corners))}\n"
    (tmp_path / "a.obj").write_text(text + "v 9 9 9\n")
    (part,) = load_parts(tmp_path / "a.obj", np.ones(3))
    flat = (part.mesh.vertices[part.mesh.faces].astype(np.float64) @ tilt)[..., :2]
    a, b, c = flat[:, 0], flat[:, 1], flat[:, 2]
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    assert (area > -1e-6).all() if area.sum() > 0 else (area < 1e-6).all()
    points = np.random.default_rng(2).uniform(polygon.min(0), polygon.max(0), (1000, 2))
    covered = sum(inside(triangle, points).astype(int) for triangle in flat)
    assert (covered == inside(polygon, points)).mean() > 0.997, "but for rounding at edges"


def test_what_is_convex_stays_as_it_is():
    """Byte by byte, also flat quads whose corners round to a turn the other way."""
    text = b"v 0 0 0\nv 1 0 0\nv 2 0 1e-17\nv 2 2 0\nv 0 2 0\nf 1 2 3 4 5\nf 1/1 3/2 4/3 5/4\nf 1 2 3\n"
    assert cut_polygons(text) is text


def test_a_face_of_very_many_corners_is_refused_soon(tmp_path):
    """A spiral comb of 4,000 corners; cutting it would take the square of that."""
    x = np.arange(2000)
    points = [*((k, (k % 2) * 5) for k in x), *((k, -1 - (k % 2)) for k in x[::-1])]
    text = "".join(f"v {a} {b} 0\n" for a, b in points) + f"f {' '.join(map(str, range(1, 4001)))}\n"
    (tmp_path / "a.obj").write_text(text)
    (tmp_path / "small.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    load_parts(tmp_path / "small.obj", np.ones(3))  # with its imports
    start = time.thread_time()
    with pytest.raises(SceneError, match=r"a\.obj: has a face of 4000 corners that is not convex; the most is 256"):
        load_parts(tmp_path / "a.obj", np.ones(3))
    assert time.thread_time() - start < 2, "of this thread: other programs take of the machine what they take"


def test_numbers_below_0_count_back_from_their_face(tmp_path):
    """Two triangles, each after its vertices, texture coordinates and normals; a line that goes on, and a remark."""
    text = "".join(
        f"v {k} 0 0\nv {k + 1} 0 0\nv {k} 1 0\nvt {k} 0\nvt {k} 1\nvn 0 0 1\n"
        "f -3/-2/-1 -2/-1/-1 \\\n -1/-2/-1 # there\n"
        for k in range(2)
    )
    (tmp_path / "a.obj").write_text(text)
    (part,) = load_parts(tmp_path / "a.obj", np.ones(3))
    corners = part.mesh.vertices[part.mesh.faces]
    order = np.argsort(corners[:, 0, 0])
    assert corners[order].tolist() == [[[k, 0, 0], [k + 1, 0, 0], [k, 1, 0]] for k in range(2)]
    assert part.mesh.uv[order].tolist() == [[[k, 0], [k, 1], [k, 0]] for k in range(2)]
    (tmp_path / "a.obj").write_text("v 0 0 0\nf -1 -2 -1\nv 1 1 1\n")
    with pytest.raises(SceneError, match="a face counts back 2 places, where there are 1"):
        load_parts(tmp_path / "a.obj", np.ones(3))


@pytest.mark.parametrize(
    ("corners", "others", "bare"),
    [(4, 6, "{0}/{0}"), (3, 6, "{0}"), (6, 12, "{0}")],
    ids=["quad", "triangle", "hexagon"],
)
def test_faces_of_as_many_numbers_keep_their_corners(tmp_path, corners, others, bare):
    """One has normals and the other not, so that both are of as many numbers: both cover the area of their polygon."""
    turns = [np.arange(count) / count * 2 * np.pi for count in (corners, others)]
    points = np.concatenate([np.c_[np.cos(turn) + 3 * k, np.sin(turn), 0 * turn] for k, turn in enumerate(turns)])
    named = bare + ("/1" if "/" in bare else "//1")
    lines = [f"v {x} {y} {z}\nvt {x} {y}" for x, y, z in points]
    lines += ["vn 0 0 1", " ".join(["f", *(named.format(n) for n in range(1, corners + 1))])]
    lines += [" ".join(["f", *(bare.format(n) for n in range(corners + 1, len(points) + 1))])]
    (tmp_path / "a.obj").write_text("\n".join(lines) + "\n")
    (part,) = load_parts(tmp_path / "a.obj", np.ones(3))
    seen = part.mesh.vertices[part.mesh.faces].astype(np.float64)
    areas = 0.5 * np.cross(seen[:, 1] - seen[:, 0], seen[:, 2] - seen[:, 0])[:, 2]
    right = seen[:, :, 0].mean(axis=1) > 1.5
    expected = [0.5 * count * np.sin(2 * np.pi / count) for count in (corners, others)]
    assert np.allclose([areas[~right].sum(), areas[right].sum()], expected, rtol=1e-5) and areas.min() > 0
    if part.mesh.uv is not None:
        assert np.allclose(part.mesh.uv, seen[:, :, :2], atol=1e-6)
