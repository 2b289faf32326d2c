"""Where few of many bodies move, only these are sent to the device: the images are those of sending all of them."""

from itertools import pairwise

import numpy as np
import pytest
import warp as wp
from renderer_scenes import ALL, Still, at, camera, poses, quad, scene, sphere

from evis.scene.model import WORLD, Light, Material
from nodes.renderer.geometry import pose_upload
from nodes.renderer.renderer import LAST, Renderer

MOVERS, STILL = 2, 14


def store(still_camera):
    """A floor, many balls on bodies that never move, and two that do."""
    floor = quad(6, 6)
    floor.vertices[:, 2] = 3.0
    ball = sphere(0.15, 8)
    count = MOVERS + STILL
    meshes = [(floor, WORLD, 0), *((ball, body, 0) for body in range(count))]
    lamp = Light("lamp", "point", np.full(3, 9.0), np.array([0.5, -0.4, 0.2]))
    world = scene(meshes, count, [Material("m", np.full(3, 0.5))], [lamp], camera(), still_camera=still_camera)
    for body in world.bodies[MOVERS:count]:
        body.trajectory = Still()
    return world


def instant(k, still=0.0, eye=0.0, env=0):
    """Poses [1, N, 7]: movers at step k; all the others somewhere else by `still`."""
    moving = [at(0.1 * k - 0.3, 0.2 * n, 1.0 + 0.2 * env, (0.1 * k, 0, 0)) for n in range(MOVERS)]
    resting = [at(0.35 * (n % 5) - 0.7 + still, 0.4 * (n // 5) - 0.4, 2.0) for n in range(STILL)]
    return poses(*moving, *resting, at(eye, 0, 0, (0, eye, 0)))


def both(*each):
    return np.concatenate([instant(*each), instant(*each, env=1)])


RUN = [both(0), both(1), both(2), both(3, 0.1), both(4, 0.1), both(4, 0.2), both(4, 0.2), both(5, 0.2, 0.1)]
RUN += [both(6, 0.2, 0.1), both(7, 0.2)]


def sparse(monkeypatch, world, device="cpu", piece=pose_upload.PIECE):
    monkeypatch.setattr(pose_upload, "SPARSE_FROM", 0)
    monkeypatch.setattr(pose_upload, "PIECE", piece)
    renderer = Renderer(world, world.cameras[0], 2, device=device)
    monkeypatch.undo()
    assert renderer.visibility._upload.sparse
    return renderer


def run_both(world, renderer, device):
    """RUN by a renderer, and by one that sends all poses: the same images. How often it drew the next instant."""
    whole = Renderer(world, world.cameras[0], 2, device=device)
    renderer.prepare(ALL)
    taken, advance = [], renderer.visibility.advance
    renderer.visibility.advance = lambda *a: taken.append(advance(*a)) or taken[-1]
    for before, now in zip([None, *RUN], RUN):
        got = {name: image.copy() for name, image in renderer.render(now, LAST, ALL).items()}
        want = whole.render(now, before, ALL)
        for name in ALL:
            np.testing.assert_array_equal(got[name], want[name], err_msg=name)
        np.testing.assert_array_equal(renderer.visibility.last, now)
        np.testing.assert_array_equal(renderer.visibility.poses.numpy(), now)
    return sum(frames is not None for frames in taken)


@pytest.mark.parametrize("still_camera", [True, False])
def test_each_image_is_as_if_all_poses_had_been_sent(still_camera, monkeypatch):
    """Also where bodies are put elsewhere that never move by themselves, and where nothing has moved."""
    world = store(still_camera)
    assert run_both(world, sparse(monkeypatch, world), "cpu") == len(RUN) - 3


@pytest.mark.gpu
@pytest.mark.skipif(not wp.is_cuda_available(), reason="there is no CUDA device here")
@pytest.mark.parametrize("still_camera", [True, False])
@pytest.mark.parametrize("piece", [pose_upload.PIECE, 64])
def test_so_they_are_on_a_gpu(still_camera, piece, monkeypatch):
    """Read by it from where the host wrote them, or copied."""
    world = store(still_camera)
    assert run_both(world, sparse(monkeypatch, world, "cuda", piece), "cuda") == len(RUN) - 3


def test_with_other_poses_before_and_with_none(monkeypatch):
    world = store(False)
    renderer, whole = sparse(monkeypatch, world), Renderer(world, world.cameras[0], 2)
    kinds = [None, LAST, None, RUN[7], LAST, None, LAST, RUN[0], None, LAST]
    last = None
    for now, previous in zip(RUN, kinds):
        got = {name: image.copy() for name, image in renderer.render(now, previous, ALL).items()}
        want = whole.render(now, last if isinstance(previous, str) else previous, ALL)
        for name in ALL:
            np.testing.assert_array_equal(got[name], want[name], err_msg=name)
        last = now


@pytest.mark.parametrize("body", [1, MOVERS + 5])
def test_a_pose_that_is_none_is_named_wherever_it_is(body, monkeypatch):
    """And what comes after it is as good as ever."""
    world = store(False)
    renderer, whole = sparse(monkeypatch, world), Renderer(world, world.cameras[0], 2)
    for now in RUN[:2]:
        renderer.render(now, LAST, ALL)
    bad = RUN[2].copy()
    bad[1, body, 4] = np.nan
    with pytest.raises(ValueError, match=rf"pose of body 'body{body}' is not finite \(environment 1\)"):
        renderer.render(bad, LAST, ALL)
    for before, now in pairwise(RUN[1:4]):
        got = renderer.render(now, before, ALL)
        want = whole.render(now, before, ALL)
        for name in ALL:
            np.testing.assert_array_equal(got[name], want[name], err_msg=name)


def test_poses_of_another_shape_are_refused(monkeypatch):
    world = store(True)
    renderer = sparse(monkeypatch, world)
    renderer.render(RUN[0])
    with pytest.raises(ValueError, match=r"poses have shape \(1, 17, 7\); 2 environment\(s\) of 17 bodies"):
        renderer.render(RUN[1][:1])
