"""Shadow rays traced before an image is shaded, against those traced while it is: the same image, bit for bit."""

import numpy as np
import pytest
import warp as wp
from renderer_scenes import at, camera, poses, quad, scene, sphere

from evis.scene.model import WORLD, Light, Material
from nodes.renderer.lighting import Shading
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.shading.options import ShadingOptions


def crowd(lights, count):
    """Balls before a floor, all of them movers, seen by a camera that moves; the image is no whole number of tiles."""
    floor = quad(4, 4)
    floor.vertices[:, 2] = 2.5
    materials = [Material("grey", np.full(3, 0.5), two_sided=True), Material("gloss", np.full(3, 0.7), roughness=0.3)]
    meshes = [(floor, WORLD, 0), *((sphere(0.15, 10), body, body % 2) for body in range(count))]
    return scene(meshes, count, materials, lights, camera(85, 61, 60.0), still_camera=False)


BULB = Light("bulb", "point", np.array([4.0, 4, 4]), np.array([-0.5, 0.2, 0.0]))
SUN = Light("sun", "directional", np.array([3.0, 2, 1]), np.array([0.3, 0.4, 1.0]))
FILL = Light("fill", "point", np.array([1.0, 1, 2]), np.array([0.8, 0.0, 0.5]), shadows=False)


@pytest.mark.parametrize("count", [6, 20])
def test_rays_of_their_own_pass_hide_the_same(count):
    now = np.concatenate([
        poses(*(at(0.4 * (n % 5) - 0.8, 0.35 * (n // 5) - 0.6, 1.4 + 0.3 * e) for n in range(count)), at(0.1 * e, 0, 0))
        for e in (0, 1)
    ])  # fmt: skip
    world = crowd([FILL, SUN, BULB], count)
    images = []
    for split in (False, True):
        visibility = Visibility(world, world.cameras[0], 2)
        shading = Shading(visibility, ShadingOptions(split=split))
        shading.update(visibility.update(now))
        image = wp.zeros(visibility.shape, dtype=wp.vec3, device="cpu")
        shading.shade(image)
        images.append(image.numpy())
    assert np.array_equal(*images)
    assert shading.shadow_pass is not None
    hidden = shading.shadow_pass.shadow_mask.numpy()
    # Of the sun and the bulb, not of what casts no shadow.
    assert all(((hidden >> bit) & 1).mean() > 0.01 for bit in (1, 2))
    assert not (hidden & ~np.uint32(6)).any()


def test_lists_of_pixels_have_their_rays_traced_first_too():
    """Two lists after each other: what the first one found must not hide lights from the second."""
    now = poses(*(at(0.4 * (n % 5) - 0.8, 0.35 * (n // 5) - 0.6, 1.4) for n in range(20)), at(0, 0, 0))
    world = crowd([FILL, SUN, BULB], 20)
    visibility = Visibility(world, world.cameras[0])
    frames = visibility.update(now)
    whole = Shading(visibility, ShadingOptions(split=False))
    whole.update(frames)
    image = wp.zeros(visibility.shape, dtype=wp.vec3, device="cpu")
    whole.shade(image)
    shading = Shading(visibility, ShadingOptions(remember=False, split=True))
    shading.update(frames)
    assert shading.shadow_pass is not None
    pixels = np.random.default_rng(3).permutation(image.size).astype(np.int32)
    for part, ready in ((pixels[:3000], False), (pixels[2000:], True)):
        listed = wp.zeros(visibility.shape, dtype=wp.vec3, device="cpu")
        count = wp.array([len(part)], dtype=wp.int32, device="cpu")
        shading.shade_list(listed, wp.array(part, dtype=wp.int32, device="cpu"), count, [0], ready)
        shown = np.zeros(image.size, bool)
        shown[part] = True
        expected = np.where(shown[:, None], image.numpy().reshape(-1, 3), 0.0)
        assert np.array_equal(listed.numpy().reshape(-1, 3), expected)
        # Nothing is left for the next list.
        assert not shading.shadow_pass.shadow_mask.numpy().any()
