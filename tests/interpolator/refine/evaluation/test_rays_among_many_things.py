"""What a ray sees among many things: found by trees over them as one by one, and as the raster draws it."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from refine_rig import box
from rigid_rig import GAP, START, closed_form, keyframe, lamp, painted, plain, pose, quad, world

from evis.scene.motion import Linear, Prescribed, Spin
from nodes.interpolator.refine.evaluation.visibility_kernels import FAR, Targets, make_trace_all
from nodes.interpolator.refine.method import Refined
from nodes.interpolator.rigid import Rigid, RigidOptions
from nodes.renderer.raster.depth_kernels import MISS
from nodes.renderer.raster.lens.view_kernels import CameraView, pixel_ray
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.renderer import Renderer
from nodes.renderer.shadows import occlusion

UP = np.array([0.0, 1.0, 0.0])
K = 4


def crowd():
    """Twenty sticks that stand, and twenty that fly across at speeds and distances of their own and turn."""
    rng = np.random.default_rng(3)
    things = [(quad(6.0), painted(256), Prescribed(pose(z=4.0)))]
    for _ in range(20):
        place = pose(rng.uniform(-0.8, 0.8), rng.uniform(-0.4, 0.4), rng.uniform(1.2, 3.5))
        things.append((box((0.012, 0.25, 0.012)), plain(rng.uniform(0.1, 0.9)), Prescribed(place)))
    for _ in range(20):
        place = pose(rng.uniform(-0.8, 0.8), rng.uniform(-0.4, 0.4), rng.uniform(1.0, 3.0))
        ways = [Linear(np.array([rng.uniform(-25.0, 25.0), 0.0, 0.0])), Spin(UP, 50.0)]
        things.append((box((0.01, 0.2, 0.02)), plain(rng.uniform(0.1, 0.9)), Prescribed(place, ways)))
    return world(things, lights=[lamp()])


def after_a_gap(scene, device):
    """What rays can meet at the instants of the gap from START on, with the view, and these instants [ns]."""
    view = scene.cameras[0]
    renderer = Renderer(scene, view)
    times = [np.array([START - GAP, START]), np.linspace(START, START + GAP, 11).round().astype(np.int64)]
    first, second = (closed_form(scene, t) for t in times)
    a = keyframe(renderer, first, first.pose[:, 0], START)
    b = keyframe(renderer, second, first.pose[:, -1], START + GAP)
    a, b = (replace(each, image=each.image.to(device)) for each in (a, b))
    rigid = Rigid(scene, view, 1, K, 0, device=device, options=RigidOptions(single=True))
    method = Refined(rigid, 500_000)
    method.between(a, b, [False], wp.empty((1, K, view.height, view.width), dtype=wp.float32, device=device))
    (rounds,) = method.refinement._rounds.values()
    evaluator = rounds.evaluator
    return evaluator, evaluator._stamps[np.array(evaluator._at) - 1]


def seen(evaluator, trees):
    """Z-buffer entries uint64 [slots, h, w] of all pixels' rays."""
    trace_all = make_trace_all(trees)

    @wp.kernel(module="unique", enable_backward=False)
    def trace_pixels(view: CameraView, targets: Targets, found: wp.array3d(dtype=wp.uint64)):
        n, y, x = wp.tid()
        found[n, y, x] = trace_all(view, targets, n, pixel_ray(view, x, y), FAR, MISS)

    v = evaluator.visibility
    found = wp.zeros(v.shape, dtype=wp.uint64, device=v.device)
    wp.launch(trace_pixels, v.shape, [v.view, evaluator.targets], [found], device=v.device)
    return found.numpy()


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda", marks=pytest.mark.gpu)])
@pytest.mark.parametrize("trees_from", [1, 21, 30])
def test_rays_among_many_things(trees_from, device, monkeypatch):
    """trees_from: fewest things of a kind, still or moving, that are in a tree: 21 still ones, 20 that move."""
    monkeypatch.setattr(occlusion, "TREE_FROM", trees_from)
    scene = crowd()
    evaluator, stamps = after_a_gap(scene, device)
    casters = evaluator.targets.casters
    trees = evaluator.shading.occluders.trees
    assert (casters.still_tree != 0, casters.moving_tree != 0) == (trees_from < 30, trees_from == 1)
    entries = seen(evaluator, trees)
    np.testing.assert_array_equal(entries, seen(evaluator, False))
    drawn = Visibility(scene, scene.cameras[0], len(stamps))
    drawn.update(closed_form(scene, stamps).pose[0])
    faces, expected = entries & 0xFFFFFFFF, drawn.packed.numpy() & 0xFFFFFFFF
    assert len(np.unique(expected)) > 40
    # A ray rounds otherwise than the raster, at edges.
    assert (faces == expected).mean() > 0.995
