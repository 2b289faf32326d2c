"""Depth of triangles seen edge-on, where rounding decides the plane: within the triangle's own range, in float64."""

import numpy as np
import pytest
from renderer_scenes import at, camera, poses, scene

from evis.geometry.distortion import Lens, unproject
from evis.scene.model import Camera, Mesh
from nodes.renderer.raster.visibility import Visibility

TRIANGLES = 1000
LENSES = {"none": (), "plumb_bob": (-0.1, 0.01, 0.0, 0.0), "equidistant": (-0.02, 0.006, 0.0, 0.0)}


def edge_on(view):
    """float32 [T, 3, 3]: corners in the plane of the rays of two pixels, but for their rounding."""
    rng = np.random.default_rng(0)
    pixels = rng.integers((0, 0), (view.width, view.height), (2, TRIANGLES, 1, 2))
    directions = unproject(view.k, Lens.of(view.distortion_model, view.distortion), pixels)
    one, other = directions / directions[..., 2:]
    depth, share = rng.uniform(1, 5, (TRIANGLES, 3, 1)), rng.uniform(-0.5, 1.5, (TRIANGLES, 3, 1))
    return (depth * (share * one + (1 - share) * other)).astype(np.float32)


@pytest.mark.parametrize("tiled", [False, True])
@pytest.mark.parametrize("lens", LENSES)
def test_a_triangle_seen_edge_on_stays_within_its_depth(lens, tiled):
    """Its depth lies between its corners'; along the rays of a lens, it is no farther than its farthest corner."""
    plain = camera(64, 48, 60.0)
    view = Camera("cam0", 64, 48, plain.k, plain.near, lens, LENSES[lens])
    triangles = edge_on(view)
    mesh = Mesh(triangles.reshape(-1, 3), np.arange(3 * TRIANGLES, dtype=np.int32).reshape(-1, 3))
    visibility = Visibility(scene([(mesh, -1, 0)], view=view), view, tiled=tiled)
    visibility.update(poses(at(0, 0, 0)))
    hits = visibility.hits()
    here = hits["triangle"][0] >= 0
    assert here.sum() > 100
    point, hit = hits["point"][0][here].astype(float), triangles[hits["triangle"][0][here]].astype(float)
    # 1e-6: float32 of the corners, of the depth and of the point.
    if lens == "none":
        depth = hit[..., 2]
        assert (point[:, 2] >= depth.min(1) * (1 - 1e-6)).all() and (point[:, 2] <= depth.max(1) * (1 + 1e-6)).all()
    else:
        assert (np.linalg.norm(point, axis=-1) <= np.linalg.norm(hit, axis=-1).max(1) * (1 + 1e-6)).all()
