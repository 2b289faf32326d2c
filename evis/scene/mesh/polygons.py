"""Cuts faces of an OBJ with more than three corners that are not convex into triangles. trimesh would cut them into
fans, which would cover what lies outside of them.
"""

from __future__ import annotations

import re

import numpy as np

from evis.scene.errors import SceneError

MOST_CORNERS = 256
"""Of a face that is not convex; cutting one takes the square of their number."""
_POLYGON = re.compile(rb"^[ \t]*f(?:[ \t]+[^\s#]+){4,}[ \t]*\r?$", re.MULTILINE)
_BEYOND = re.compile(rb"/\S*")
_VERTEX = re.compile(rb"^[ \t]*v[ \t]+(\S+)[ \t]+(\S+)[ \t]+(\S+)", re.MULTILINE)


def cut_polygons(content: bytes) -> bytes:
    """Returns an OBJ, as `absolute` gives it, with its faces that are not convex as triangles; the same bytes where all
    are convex.

    Raises SceneError, whose text the caller puts the name before, and ValueError for a damaged file.
    """
    faces = list(_POLYGON.finditer(content))
    if not faces:
        return content
    points = np.array(b" ".join(b" ".join(groups) for groups in _VERTEX.findall(content)).split(), np.float64)
    points = points.reshape(-1, 3)
    # Numbers of vertices alone, of all faces in a row.
    lines = _BEYOND.sub(b"", b"\n".join(face[0] for face in faces)).split(b"\n")
    counts = np.array([len(line.split()) - 1 for line in lines])
    places = np.array(b" ".join(lines).replace(b"f", b"").split(), np.int64) - 1
    if places.min() < 0 or places.max() >= len(points):
        raise ValueError(f"a face names vertex {places.max() + 1}; there are {len(points)}")
    first = np.cumsum(counts) - counts
    pieces, at = [], 0
    for number in np.sort(np.concatenate([_not_convex(n, counts, first, places, points) for n in np.unique(counts)])):
        face, corners = faces[number], faces[number][0].split()[1:]
        if len(corners) > MOST_CORNERS:
            raise SceneError(
                f"has a face of {len(corners)} corners that is not convex; the most is {MOST_CORNERS}, "
                "so export triangles"
            )
        cut = ears(points[places[first[number] :][: len(corners)]])
        lines = [b"f " + b" ".join(corners[k] for k in triangle) for triangle in cut]
        pieces += [content[at : face.start()], b"\n".join(lines)]
        at = face.end()
    return b"".join([*pieces, content[at:]])


def _not_convex(n: int, counts: np.ndarray, first: np.ndarray, places: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Which of the faces with n corners turn the other way at some corner. first: where in `places` each begins."""
    these = np.flatnonzero(counts == n)
    turns, normal = _turns(points[places[first[these][:, None] + np.arange(n)]])
    bad = (turns < -1e-9 * np.linalg.norm(normal, axis=-1)[:, None]).any(axis=-1)
    return these[bad]


def _turns(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How each corner turns about the face's normal, which has twice the length of its area; of faces [F, n, 3]."""
    normal = np.cross(corners, np.roll(corners, -1, axis=1)).sum(axis=1)
    unit = normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-300)
    edge = np.roll(corners, -1, axis=1) - corners
    return np.einsum("fnx,fx->fn", np.cross(np.roll(edge, 1, axis=1), edge), unit), normal


def ears(corners: np.ndarray) -> list[tuple[int, int, int]]:
    """Cuts a face [n, 3] that does not cross itself into n - 2 triangles of its corners, in their sense of rotation."""
    normal = np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0)
    axis = int(np.abs(normal).argmax())
    flat = np.roll(corners, -1 - axis, axis=1)[:, :2]
    flat = (flat - flat[0]) * [1.0, 1.0 if normal[axis] > 0 else -1.0]
    left, cut = list(range(len(corners))), []
    while len(left) > 3:
        place = next((k for k in range(len(left)) if _is_ear(flat, left, k)), 0)  # any corner of one without area
        n = len(left)
        cut.append((left[place - 1], left[place], left[(place + 1) % n]))
        del left[place]
    return [*cut, (left[0], left[1], left[2])]


def _is_ear(flat: np.ndarray, left: list[int], k: int) -> bool:
    """Whether the triangle at a corner is all inside: it turns left, and no other corner lies in it."""
    a, b, c = (flat[left[i]] for i in (k - 1, k, (k + 1) % len(left)))
    if not _side(a, b, c) > 0:
        return False
    others = flat[left]
    inside = (_side(a, b, others) >= 0) & (_side(b, c, others) >= 0) & (_side(c, a, others) >= 0)
    same = (others == a).all(-1) | (others == b).all(-1) | (others == c).all(-1)
    return not (inside & ~same).any()


def _side(a: np.ndarray, b: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Above 0 where points p lie to the left of the way from a to b."""
    side: np.ndarray = (b[0] - a[0]) * (p[..., 1] - a[1]) - (b[1] - a[1]) * (p[..., 0] - a[0])
    return side
