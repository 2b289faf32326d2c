"""`rigid` before textures that are finer than its keyframes' pixels."""

import numpy as np
import pytest
from rigid_rig import START, Gap, cross, lamp, pose, quad, world

from evis.scene.model import Material, Scene
from evis.scene.motion import Linear, Prescribed
from nodes.interpolator.rigid.layout import MANY_FRAMES


def grains(texels: int, **given: object) -> Material:
    """A wall of random grains, 0.3 ... 0.9."""
    rng = np.random.default_rng(3)
    picture = np.repeat(rng.uniform(0.3, 0.9, (texels, texels, 1)), 3, -1)
    return Material("grains", np.ones(3), picture.astype(np.float32), two_sided=True, **given)  # type: ignore[arg-type]


def passed(material: Material) -> Scene:
    """A camera that moves by five pixels in the gap before a wall of four metres."""
    mesh = quad(4.0)
    mesh.vertices[:, 2] = 3.0
    speed = 5 * 3.0 / 80 * 100
    start = pose(-speed * START * 1e-9, -0.3 * speed * START * 1e-9, 0)
    path = Prescribed(start, [Linear(np.array([speed, 0.3 * speed, 0.0]))])
    return world([(mesh, material, "world")], camera_motion=path, lights=[lamp()], sky=0.1)


def off(gap: Gap) -> float:
    return float(gap.error().mean())


@pytest.mark.parametrize("given", [{}, {"roughness": 0.6}])
def test_grains_as_large_as_pixels_keep_their_contrast(given: dict) -> None:
    """The texture is that of the frame's own time: interpolation alone dulls it by several times as much."""
    scene = passed(grains(220, **given))
    few, many = cross(scene, MANY_FRAMES // 2), cross(scene, 2 * MANY_FRAMES)
    # What a glossy surface reflects beside its texture goes with the texture: 4 % of it.
    assert off(many) < 0.015
    assert off(many) < 0.4 * off(few)
    contrast = [np.log(frames[:-1]).std() for frames in (many.frames, many.dense)]
    assert contrast[0] > 0.98 * contrast[1]


def test_light_is_still_carried_over() -> None:
    """Little is shaded anew for that."""
    gap = cross(passed(grains(220)), 2 * MANY_FRAMES)
    assert gap.report.reshaded < 0.2 * gap.report.samples
