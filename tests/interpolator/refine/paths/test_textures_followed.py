"""Textures finer than keyframes' pixels are followed by themselves: samples lie where ln I bends, and nowhere else."""

import numpy as np
import pytest
from refine_rig import refined
from rigid_rig import FOCAL, GAP, HEIGHT, START, WIDTH, closed_form, disc, keyframe, painted, plain, pose, quad, world

from evis.scene.mesh.shapes import cylinder
from evis.scene.model import Material, Mesh
from evis.scene.motion import Linear, Prescribed, Spin
from nodes.interpolator.refine.paths.texture_charts import NO_CHART, charts_of
from nodes.renderer.geometry.triangles import geometry_of
from nodes.renderer.renderer import Renderer

K, TOLERANCE_NS, TOLERANCE = 4, 300_000, 0.02
DEPTH = 3.0


def charts(mesh, material):
    scene = world([(mesh, material, "world")])
    return charts_of(scene, geometry_of(scene))


def test_triangles_of_one_plane_with_one_texture_are_a_chart():
    for flat in (quad(1.0), disc(0.7)):
        assert len(set(charts(flat, painted()).tolist())) == 1
    # Moved along u the texture of the second triangle is another one; folded up it lies on another plane.
    moved, folded = quad(1.0), quad(1.0)
    moved.uv[1] += np.float32(0.01)
    folded.vertices[3, 2] = 0.01
    for mesh in (moved, folded):
        assert len(set(charts(mesh, painted()).tolist())) == 2


def test_a_round_side_has_a_chart_for_each_of_its_facets():
    mesh = cylinder(0.5, 1.0)
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    found = charts(mesh, painted())
    same = found[:, None] == found[None]
    assert (normal[:, None] * normal[None]).sum(axis=-1)[same].min() > 1 - 1e-6
    side = np.abs(normal[:, 2]) < 0.5
    assert len(set(found[side].tolist())) == side.sum() // 2


def test_what_is_not_a_texture_alone_has_no_chart():
    glowing, coloured = painted(), quad(1.0)
    glowing.emission = np.full(3, 0.5)
    coloured.colours = np.full((2, 3, 3), 0.5, np.float32)
    bare = Mesh(quad(1.0).vertices, quad(1.0).faces)
    for mesh, material in ((quad(1.0), glowing), (coloured, painted()), (bare, painted()), (quad(1.0), plain(0.5))):
        assert (charts(mesh, material) == NO_CHART).all()


def lines(count, width, size=4096):
    """Material with so many dark lines along v, each `width` texels wide."""
    on = np.arange(size) * count % size < width * count
    picture = np.broadcast_to(np.where(on, 0.2, 0.8)[:, None], (size, 3))[None].repeat(8, 0)
    return Material("lines", np.ones(3), picture.astype(np.float32), two_sided=True)


def course(scene, columns, count=401):
    """ln I of pixels of the middle row by rendering at so many times of the gap; the times [ns]."""
    times = np.linspace(0, GAP, count).round().astype(np.int64)
    renderer, dense = Renderer(scene, scene.cameras[0]), []
    for t in times + START:
        states = closed_form(scene, np.array([t]))
        dense.append(
            np.log(keyframe(renderer, states, states.pose[:, 0], int(t)).image.numpy()[0, HEIGHT // 2, columns])
        )
    return times, np.array(dense)


SPEED = 12.0 * DEPTH / FOCAL / GAP * 1e9
"""Of a wall that goes on by 12 pixels in the gap [m/s]."""
WAYS = {
    "straight": (pose(x=-SPEED * START * 1e-9, z=DEPTH), Linear(np.array([SPEED, 0.0, 0.0]))),
    "turning": (pose(x=-0.3, z=DEPTH), Spin(np.array([0.0, 0.0, 1.0]), 40.0)),
}


@pytest.mark.parametrize("way", WAYS)
def test_lines_far_apart_take_samples_where_they_pass(way):
    """Lines a quarter of a pixel wide and ten pixels apart: lines between samples are within half a tolerance of
    rendering at 40 kHz, on the average, and between two of the painted lines there is no sample."""
    start, motion = WAYS[way]
    scene = world([(quad(3.0), lines(16, 6), Prescribed(start, [motion]))], sky=1.0)
    frames, (pixels, ns, values) = refined(scene, K, TOLERANCE_NS, tolerance=TOLERANCE)
    columns = np.arange(WIDTH // 2, WIDTH - 14)
    times, truth = course(scene, columns)
    off, idle, there = [], 0, 0
    for n, x in enumerate(columns):
        mine = pixels == HEIGHT // 2 * WIDTH + x
        at = np.concatenate([[0], ns[mine], np.arange(1, K + 1) * GAP / K])
        level = np.concatenate([truth[:1, n], np.log(values[mine]), np.log(frames[:, HEIGHT // 2, x])])
        order = np.argsort(at)
        off.append(np.abs(np.interp(times, at[order], level[order]) - truth[:, n]).mean())
        for t in ns[mine]:
            near = np.abs(times - t) < 2 * TOLERANCE_NS
            idle += np.ptp(truth[near, n]) < 0.1 * TOLERANCE
            there += 1
    assert np.ptp(truth, axis=0).mean() > 0.15
    assert np.mean(off) < TOLERANCE / 2
    assert there > 50
    assert idle < 0.1 * there
