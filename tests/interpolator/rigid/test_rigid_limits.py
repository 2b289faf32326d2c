"""What `rigid` must not look up: light that has changed too much, what is across a fold, pixels that are no number."""

import numpy as np
import pytest
import warp as wp
from rigid_rig import GAP, START, closed_form, cross, keyframe, painted, plain, pose, quad, world

from evis.scene.model import Material, Mesh
from evis.scene.motion import Linear, Prescribed
from nodes.interpolator.interpolator import Interpolator
from nodes.interpolator.rigid import Rigid, RigidOptions
from nodes.interpolator.rigid.layout import TOLERANCE
from nodes.renderer.renderer import Renderer

PIXELS = 96 * 72


def wall(material=None, z=3.0):
    mesh = quad(6.0)
    mesh.vertices[:, 2] = z
    return mesh, material or plain(0.6), "world"


def sideways(speed):
    """Along x at so many m/s, through the origin when the gap begins."""
    return Prescribed(pose(-speed * START * 1e-9, 0, 0), [Linear(np.array([speed, 0.0, 0.0]))])


def views_of(scene):
    """Both keyframes of the gap that begins at START."""
    renderer = Renderer(scene, scene.cameras[0])
    at = [np.array([START - GAP, START]), np.linspace(START, START + GAP, 11).round().astype(np.int64)]
    states = [closed_form(scene, t) for t in at]
    return [keyframe(renderer, s, None, int(s.t[-1])) for s in states]


@pytest.mark.parametrize("moves", [0.0, 1.0])
@pytest.mark.parametrize(("share", "shaded"), [(0.5, False), (1.5, True)])
def test_light_that_differs_by_more_than_the_tolerance_is_shaded_anew(share, shaded, moves):
    """Keyframe B brighter by some tolerances than the scene is: the mean of both logarithms, or the scene itself."""
    scene = world([wall(painted())], camera_motion=sideways(moves))
    a, b = views_of(scene)
    b.image = wp.array(b.image.numpy() * np.float32(np.exp(share * TOLERANCE)), dtype=wp.float32, device="cpu")
    out = np.empty((1, 4, 72, 96), np.float32)
    report = Rigid(scene, scene.cameras[0], 1, 4, options=RigidOptions(on_device=True)).between(a, b, [False], out)
    true = cross(scene, 4).dense
    grown = np.log(out[0, :3]) - np.log(true[:3])
    # Away from the sides, beyond which one keyframe alone shows the wall.
    inner = (slice(None), slice(4, -4), slice(4, -4))
    fraction = np.array([0.25, 0.5, 0.75])[:, None, None]
    expected = np.zeros_like(fraction) if shaded else fraction * share * TOLERANCE
    np.testing.assert_allclose(grown[inner], np.broadcast_to(expected, grown.shape)[inner], atol=2e-3)
    assert (report.reshaded > 0.8 * 3 * PIXELS) if shaded else (report.reshaded < 0.1 * 3 * PIXELS)


def test_a_pixel_that_is_no_number_in_a_keyframe_is_in_no_frame():
    scene = world([wall(painted())], camera_motion=sideways(1.0))
    a, b = views_of(scene)
    image = a.image.numpy().copy()
    image[0, 30:33, 40] = np.nan
    image[0, 50, 60] = np.inf
    a.image = wp.array(image, dtype=wp.float32, device="cpu")
    out = np.empty((1, 4, 72, 96), np.float32)
    report = Rigid(scene, scene.cameras[0], 1, 4).between(a, b, [False], out)
    assert np.abs(np.log(out[0]) - np.log(cross(scene, 4).dense)).max() < TOLERANCE / 2
    # Counted when the keyframe was taken in, which is before the frames are.
    assert report.nonfinite == 0


def hills(rows=400):
    """One smooth sheet, y = 0.25 + 0.1 cos 6 z for z = 2 to 6: from above its near edge hills hide what is behind."""
    z = np.linspace(2.0, 6.0, rows)
    y = 0.25 + 0.1 * np.cos(6.0 * z)
    vertices = np.stack([np.stack([np.full(rows, x), y, z], -1) for x in (-3.0, 3.0)], 1).reshape(-1, 3)
    at = 2 * np.arange(rows - 1)
    faces = np.concatenate([np.stack([at, at + 1, at + 2], -1), np.stack([at + 1, at + 3, at + 2], -1)])
    place = np.stack([vertices[:, 0] / 6 + 0.5, (vertices[:, 2] - 2) / 4], -1).astype(np.float32)
    return Mesh(vertices.astype(np.float32), faces.astype(np.int32), place[faces])


def test_a_surface_that_hides_a_part_of_itself_is_not_looked_up_across_the_fold():
    """It is 18 times brighter far away than near by, so that a mean over a fold is far off."""
    grey = 0.05 * 18.0 ** np.linspace(1, 0, 512)
    albedo = np.repeat(np.repeat(grey[:, None, None], 8, 1), 3, -1).astype(np.float32)
    hill = hills(), Material("fog", np.ones(3), albedo, two_sided=True), "world"
    rise = Prescribed(pose(0, -0.05 + 6.0 * START * 1e-9, 0), [Linear(np.array([0.0, -6.0, 0.0]))])
    gap = cross(world([hill], camera_motion=rise), 4)
    # Within a sheet cubic convolution is as good as this; across a fold it would be off by six times as much.
    assert gap.error().max() < 0.015
    assert (gap.frames[0] != gap.frames[-1]).mean() > 0.1


def test_a_keyframe_of_the_same_stamp_is_refused():
    interpolator = Interpolator("splat", 4)
    images = np.ones((1, 8, 8, 3), np.float32), np.ones((1, 8, 8), np.float32), np.zeros((1, 8, 8, 2), np.float32)
    interpolator.push(5, np.zeros(1, np.int32), *images)
    with pytest.raises(ValueError, match="came after the one at 5 ns"):
        interpolator.push(5, np.zeros(1, np.int32), *images)
