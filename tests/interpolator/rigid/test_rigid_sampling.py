"""Samples of `rigid` in proportion to a pixel's displacement, and who is seen at the sub-frames between."""

import numpy as np
import pytest
import warp as wp
from rigid_rig import GAP, START, camera, closed_form, cross, disc, keyframe, lamp, painted, plain, pose, quad, world

import evis
from evis.geometry import se3
from evis.scene.model import Body
from evis.scene.motion import Linear, Prescribed, Sinusoid, Spin
from nodes.interpolator.rigid import Rigid
from nodes.interpolator.rigid.body_motion_kernels import BodyMotion, find_body_motion
from nodes.interpolator.rigid.layout import TOLERANCE
from nodes.interpolator.rigid.sampling import pixels_per_radian
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.renderer import Renderer

PIXELS = 96 * 72
DEPTH = 3.0


def sideways(pixels, focal=80.0):
    """Moves along x by so many pixels per gap at DEPTH, through the origin when the gap begins."""
    speed = pixels * DEPTH / focal / (GAP * 1e-9)
    return Prescribed(pose(-speed * START * 1e-9, 0, 0), [Linear(np.array([speed, 0.0, 0.0]))])


def wall(material=None, motion="world"):
    mesh = quad(6.0)
    mesh.vertices[:, 2] = DEPTH
    return mesh, material or plain(0.6), motion


@pytest.mark.parametrize("moves", ["the wall", "the camera"])
@pytest.mark.parametrize(("pixels", "spans"), [(0.9, 1), (7.36, 8), (20.0, 32), (40.0, 32)])
def test_as_many_samples_as_a_pixel_goes_pixels(moves, pixels, spans):
    """Of 32 steps of 0.23 px four fit into one px: 8 spans with 7 samples between them; of 0.63 px or more only one."""
    if moves == "the wall":
        scene = world([wall(motion=sideways(pixels))])
    else:
        scene = world([wall()], camera_motion=sideways(pixels))
    gap = cross(scene, 32)
    assert gap.report.sampled == (spans - 1) * PIXELS
    assert gap.error().max() < 1e-5
    assert cross(scene, 32, on_device=True).report.sampled == 31 * PIXELS


def test_what_moves_along_the_line_of_sight_is_sampled_by_where_it_is_in_the_image():
    """At 4 px from the centre an approach by a tenth moves a pixel by 0.4 px, at 40 px by 4."""
    speed = 0.1 * DEPTH / (GAP * 1e-9)
    path = Prescribed(pose(0, 0, -speed * START * 1e-9), [Linear(np.array([0.0, 0.0, speed]))])
    gap = cross(world([wall()], camera_motion=path), 32)
    y, x = np.mgrid[:72, :96]
    view = camera()
    away = np.hypot(x - view.k[0, 2], y - view.k[1, 2])
    longest = 0.1 / 0.9 * away
    # A span more than the path has pixels at most, and one per pixel at least: steps are not cut.
    assert gap.report.sampled <= np.ceil(longest * 1.25).sum()
    assert gap.report.sampled >= (np.ceil(0.1 * away) - 1).sum()
    assert gap.error().max() < 1e-5


MOTIONS = {
    "out and back": lambda: Prescribed(pose(0, 0, 0), [Sinusoid(np.array([0.3, 0.0, 0.0]), 1e9 / GAP)]),
    "slowly": lambda: sideways(3.0),
    "round about": lambda: Prescribed(pose(0, 0, DEPTH), [Spin(np.array([0.0, 0.0, 1.0]), 2e9 * np.pi / GAP)]),
}


@pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS)
def test_lines_between_samples_are_as_right_as_samples(motion):
    """What is back where it was at the next keyframe has been elsewhere: the path counts, not the displacement."""
    path = motion()
    mesh = disc(1.0)
    mesh.vertices[:, 2] = DEPTH - path.pose(np.array([START]))[0, 2]
    scene = world([(mesh, painted(1024), path)])
    each, some = (cross(scene, 32, on_device=every) for every in (True, False))
    assert each.error().max() < 0.07
    assert some.error().max() < 0.07 + TOLERANCE / 2
    assert np.sqrt((some.error() ** 2).mean()) < np.sqrt((each.error() ** 2).mean()) + 0.01


def test_the_edge_of_a_shadow_is_found_to_the_sub_frame():
    """It passes over a wall that stands still: where the ends of a span differ the middle is looked at."""
    path = Prescribed(pose(-0.2 - 12.0 * START * 1e-9, 0, 2.0), [Linear(np.array([12.0, 0.0, 0.0]))])
    scene = world([wall(), (disc(0.25), plain(0.5), path)], lights=[lamp()], sky=0.05)
    each, some = (cross(scene, 32, on_device=every) for every in (True, False))
    wrong = [(gap.error() > 2 * TOLERANCE).mean() for gap in (each, some)]
    assert wrong[1] < wrong[0] + 0.001
    # Where the shadow may be, every frame is shaded in both; what is looked up is what lines spare.
    assert some.report.reshaded <= each.report.reshaded
    assert some.report.sampled < 0.5 * each.report.sampled


def test_through_a_lens_as_through_a_pinhole():
    view = camera(model="equidistant", coefficients=(-0.02, 0.003, 0.0, 0.0))
    scene = world([wall(painted(1024))], view=view, camera_motion=sideways(3.0))
    each, some = (cross(scene, 32, on_device=every) for every in (True, False))
    assert some.report.sampled < 0.25 * each.report.sampled
    # 3 px, and more towards the corners, are three spans or more: two samples between.
    assert some.report.sampled >= 1.95 * PIXELS
    assert some.error().max() < each.error().max() + TOLERANCE / 2
    # f theta_d / sin theta across the radius: 80 in the middle, 87.2 in the farthest corner, at theta = 0.755.
    assert 80 < pixels_per_radian(Visibility(scene, view)) < 87.2


@pytest.mark.gpu
def test_a_gpu_gives_the_frames_of_a_cpu():
    """Of one that looks up every pixel of every frame; bits differ where both round otherwise."""
    path = Prescribed(pose(-0.2 - 12.0 * START * 1e-9, 0, 2.0), [Linear(np.array([12.0, 0.0, 0.0]))])
    things = [wall(painted(1024)), (disc(0.25), painted(), path)]
    scene = world(things, camera_motion=sideways(3.0), lights=[lamp()], sky=0.05)
    here, there = (cross(scene, 32, on_device=True, device=device) for device in ("cpu", "cuda"))
    apart = np.abs(np.log(there.frames) - np.log(here.frames))
    assert (apart > 1e-4).mean() < 2e-3
    assert (there.frames[-1] == here.frames[-1]).all()
    assert there.report.reshaded == pytest.approx(here.report.reshaded, rel=0.01)


def test_how_bodies_go_is_what_their_poses_say():
    """spin x p + shift against the poses themselves, to first order of a turn by 1e-3."""
    rng = np.random.default_rng(5)
    small = lambda: se3.make_pose(1e-3 * rng.normal(size=3), se3.exp(1e-3 * rng.normal(size=3)))
    poses = [se3.make_pose(rng.normal(size=(3, 3)), se3.exp(rng.normal(size=(3, 3))))]
    for _ in range(3):
        poses.append(np.stack([se3.compose(p, small()) for p in poses[-1]]))
    poses = np.array(poses)
    poses[:, 1] = poses[0, 1]
    walk = BodyMotion()
    walk.spin, walk.shift = (wp.zeros((4, 5), dtype=wp.vec3, device="cpu") for _ in range(2))
    walk.as_world = wp.zeros((1, 5), dtype=wp.int32, device="cpu")
    given = [wp.array(p, dtype=wp.transformd, device="cpu") for p in (poses[:1], poses[1:3], poses[3:])]
    wp.launch(find_body_motion, (1, 5), [2, 2, 1, 0, *given], [walk], device="cpu")
    # Body 1 rests in the world; the camera is body 2.
    assert walk.as_world.numpy().tolist() == [[0, 3, 2, 3, 4]]
    spin, shift = walk.spin.numpy(), walk.shift.numpy()
    points = rng.normal(size=(20, 3))
    for k in (1, 2, 3):
        for body in (0, 2, 3, 4):
            seen = []
            for n in (k - 1, k):
                eye = poses[n, 2].copy()
                if body == 4:
                    # The sky has no place.
                    eye[:3] = 0.0
                there = se3.transform(poses[n, body], points) if body < 3 else points
                seen.append(se3.transform(se3.inverse(eye), there))
            went = np.cross(spin[k, body], seen[0]) + shift[k, body]
            np.testing.assert_allclose(went, seen[1] - seen[0], atol=3e-5)


def field(count=400, seed=2):
    """Many discs that stand about, some before others, and one that flies."""
    rng = np.random.default_rng(seed)
    things = [wall(plain(0.3))]
    for n in range(count):
        mesh = disc(rng.uniform(0.01, 0.06), 12)
        mesh.vertices += np.array([*rng.uniform(-1.2, 1.2, 2), rng.uniform(1.5, 2.9)], np.float32)
        things.append((mesh, plain(0.2 + 0.7 * n / count), "world"))
    flight = Prescribed(pose(-0.5 - 60.0 * START * 1e-9, 0, 1.2), [Linear(np.array([60.0, 0.0, 0.0]))])
    return [*things, (disc(0.1), plain(0.95), flight)]


def test_what_is_seen_between_two_keyframes_alone_is_drawn():
    """Goods behind the posts and boards of a warehouse, past which a camera flies; against dense rendering."""
    given = {"width": 33, "height": 50, "audit": 0}
    luminance = np.array([0.2126, 0.7152, 0.0722], np.float32)
    with evis.Simulation(
        "warehouse", outputs=["frames"], keyframe_rate=50, upsampling=3, tolerance=0.002, **given
    ) as s:
        frames = np.concatenate([step.frames.luminance.reshape(-1, 50, 33) for step in [s.reset(), *s.run(0.1)]])
    with evis.Simulation("warehouse", outputs=["keyframe", "ids"], keyframe_rate=150, upsampling=1, **given) as s:
        steps = [s.reset(), *s.run(0.1)]
        dense = np.stack([step.keyframe.astype(np.float32).reshape(50, 33, 3) @ luminance for step in steps])
        ids = np.stack([step.ids.reshape(50, 33) for step in steps])
    assert frames.shape == dense.shape == (16, 50, 33)
    between = np.setdiff1d(np.arange(16), np.arange(0, 16, 3))
    seen = ids[between] == ids[between // 3 * 3]
    seen |= ids[between] == ids[between // 3 * 3 + 3]
    assert (~seen).sum() > 100  # pixels with what neither keyframe shows there
    assert (np.abs(np.log(frames / dense)) > 0.05).mean() < 1e-4


def test_a_shadow_falls_from_where_its_caster_is_whatever_was_drawn_before():
    """Discs under a lamp, so many that rays find them by a tree: the second gap alone, and after the first."""
    speed = 3e9 / GAP
    start = -1.0 - speed * (START - GAP) * 1e-9
    paths = [
        Prescribed(pose(start + 0.3 * (k % 8), 0.3 * (k // 8), 2.5), [Linear(np.array([speed, 0, 0]))])
        for k in range(40)
    ]
    things = [*field(150), *((disc(0.1), plain(0.3), path) for path in paths)]
    scene = world([wall(), *things], camera_motion=sideways(0.5), lights=[lamp()], sky=0.05)
    view = scene.cameras[0]
    renderer = Renderer(scene, view)
    states = [
        closed_form(scene, np.linspace(START + k * GAP, START + (k + 1) * GAP, 11).round().astype(np.int64))
        for k in (-2, -1, 0)
    ]
    keys = [
        keyframe(renderer, s, s.pose[:, 0], START + k * GAP, ("radiance", "depth", "motion"))
        for k, s in zip((-1, 0, 1), states)
    ]

    def gap(*numbers):
        rigid, out = Rigid(scene, view, 1, 32), np.empty((1, 32, view.height, view.width), np.float32)
        for k in numbers:
            rigid.between(keys[k], keys[k + 1], [False], out)
        return out

    alone, after = gap(1), gap(0, 1)
    assert np.abs(np.log(alone[0, 7] / alone[0, 23])).max() > 0.2
    assert np.array_equal(alone, after)


def test_what_is_drawn_of_an_environment_does_not_depend_on_others():
    """Two cameras that go at different speeds past the same things, alone and together."""
    paths = [sideways(2.0), sideways(9.0)]
    scene = world(field(150), camera_motion=paths[0])
    view = scene.cameras[0]

    def frames(envs):
        views, renderer = [], Renderer(scene, view, len(envs))
        for t in (np.array([START]), np.array([START, START + GAP])):
            states = closed_form(scene, t)
            states.pose, states.twist = (np.repeat(a, len(envs), 0) for a in (states.pose, states.twist))
            for e, env in enumerate(envs):
                states.pose[e, :, -1], states.twist[e, :, -1] = paths[env].pose(t), paths[env].twist(t)
            views.append(keyframe(renderer, states, None, int(t[-1])))
        out = np.empty((len(envs), 32, 72, 96), np.float32)
        scene.bodies[-1] = Body("cam0", None)
        Rigid(scene, view, len(envs), 32).between(*views, [False] * len(envs), out)
        scene.bodies[-1] = Body("cam0", paths[0])
        return out

    together = frames([0, 1])
    assert all((together[e] == frames([e])[0]).all() for e in (0, 1))
