"""Textures where a pixel covers many texels, and where it covers less than one."""

from itertools import pairwise

import numpy as np
import pytest
import warp as wp
from renderer_scenes import at, camera, poses, quad, rays, scene

from evis.scene.model import Camera, Material, Mesh
from nodes.renderer.renderer import Renderer
from nodes.renderer.textures import texture_kernels
from nodes.renderer.textures.textures import halve, pyramid

THRESHOLD = 0.15
"""Contrast threshold of a typical sensor."""


def checker(size, low=0.05, high=0.9):
    i, j = np.indices((size, size))
    return np.repeat(np.where((i + j) % 2, high, low)[..., None], 3, -1).astype(np.float32)


def floor(texture, view, repeat=1.0, half=20.0, two_sided=True):
    """A textured square, lit by a sky of 1: its radiance is its albedo."""
    mesh = quad(half, half)
    mesh.uv = mesh.uv * repeat
    material = Material("m", np.ones(3), texture, two_sided=two_sided)
    return scene([(mesh, 0, 0)], bodies=1, materials=[material], view=view, environment=(1.0, 1.0, 1.0))


def radiance(renderer, *bodies):
    return renderer.render(poses(*bodies))["radiance"][0].astype(np.float64).copy()


# -- the pyramid -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(8, 8), (7, 5), (1, 6), (3, 1), (1, 1), (37, 64)])
def test_every_level_keeps_the_mean(shape):
    texture = np.random.default_rng(0).random((*shape, 3)).astype(np.float32)
    levels = list(pyramid(texture))
    assert levels[0].shape == texture.shape and levels[-1].shape == (1, 1, 3)
    for before, after in pairwise(levels):
        assert after.shape[:2] == (max(before.shape[0] // 2, 1), max(before.shape[1] // 2, 1))
        np.testing.assert_allclose(after.mean((0, 1)), texture.mean((0, 1)), rtol=1e-5)


def test_a_halved_odd_row_is_the_mean_over_each_texels_area():
    """Against a sum of 3 n equal parts: 7 texels of 3 parts each are 3 texels of 7 parts each."""
    row = np.random.default_rng(1).random((1, 7, 3))
    parts = np.repeat(row, 3, 1).reshape(1, 3, 7, 3)
    np.testing.assert_allclose(halve(row, 1), parts.mean(2), rtol=1e-12)


# -- minified --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [64, 100])
def test_a_far_checker_is_its_mean_and_does_not_flicker(size):
    """8 texels to a pixel and more: unfiltered, a pixel is 0.05 or 0.9 by chance, a deviation of 1.4 in log."""
    view = camera(48, 36, 40.0)
    world = floor(checker(size), view, repeat=20.0)
    renderer = Renderer(world, view)
    frames = np.array([radiance(renderer, at(0.0037 * n, 0.0021 * n, 6.0), at(0, 0, 0)) for n in range(20)])
    inner = np.log(frames[:, 4:-4, 4:-4])
    assert inner.std(0).max() < THRESHOLD / 5
    np.testing.assert_allclose(np.exp(inner).mean(), checker(size).mean(), rtol=5e-3)


def test_a_floor_to_the_horizon_does_not_flicker():
    """Every distance and slant at once; rows where a texel is under half a pixel."""
    view = camera(64, 48, 60.0)
    world = floor(checker(64), view, repeat=100.0)
    renderer = Renderer(world, view)
    eye = lambda n: at(0.0013 * n, -0.6, 0.0007 * n)
    flat = at(0, 0, 18.0, (np.pi / 2, 0, 0))
    frames = np.array([radiance(renderer, flat, eye(n)) for n in range(16)])
    depth = renderer.render(poses(flat, eye(0)), None, ("depth",))["depth"][0]
    # Half the texels' size of 40 m / 6400 at the focal length of 60 px: under a pixel where z > 0.75 m.
    far = np.isfinite(depth) & (depth > 3.0) & (depth < 30.0)
    assert far.sum() > 500
    deviation = np.log(frames).std(0)[far]
    assert np.sqrt((deviation**2).mean()) < THRESHOLD / 5


def test_slanted_footprints_keep_what_lies_across_them():
    """Stripes along the view on a slanted plane: 4 pixels wide across, while down it a pixel covers 6 texels."""
    stripes = np.repeat(np.where(np.arange(32) // 4 % 2, 0.9, 0.05)[None, :, None], 32, 0)
    stripes = np.repeat(stripes, 3, -1).astype(np.float32)
    view = camera(64, 48, 200.0)
    world = floor(stripes, view, repeat=40.0, half=2.0)
    renderer = Renderer(world, view)
    # Texels of 3.1 mm: 0.42 px across at 1.5 m, and six times as many down at 80 degrees.
    image = radiance(renderer, at(0, 0, 1.5, (np.radians(80), 0, 0)), at(0, 0, 0))[20:28, :, 0]
    assert image.max() > 0.6 and image.min() < 0.35


def test_filter_against_the_mean_over_the_pixels_area():
    """A random texture, 3 texels to a pixel: the mean over each pixel of the texture itself, by 16 x 16 samples.

    The two filters differ in shape; both have the size of the footprint.
    """
    texture = np.random.default_rng(2).random((64, 64, 3)).astype(np.float32)
    view = camera(48, 36, 40.0)
    world = floor(texture, view, repeat=4.0, half=20.0)
    image = radiance(Renderer(world, view), at(0, 0, 6.0), at(0, 0, 0))
    d = rays(view)
    step = (np.arange(16) + 0.5) / 16 - 0.5
    total = np.zeros(d.shape)
    for sx in step:
        for sy in step:
            x = 6.0 * (d[..., 0] + sx / view.k[0, 0])
            y = 6.0 * (d[..., 1] + sy / view.k[1, 1])
            u, v = 4 * (x + 20) / 40, 4 * (y + 20) / 40
            i, j = np.floor(u * 64).astype(int) % 64, np.floor((1 - v) * 64).astype(int) % 64
            total += texture[j, i]
    expected = total / 256
    unfiltered = 0.29  # of a uniform random number
    assert np.std(image - expected) < 0.35 * unfiltered
    assert np.corrcoef(image.ravel(), expected.ravel())[0, 1] > 0.6
    np.testing.assert_allclose(image.mean(), expected.mean(), rtol=2e-2)


# -- magnified -------------------------------------------------------------------------------------------------------


def bilinear(texture, u, v):
    h, w = texture.shape[:2]
    x, y = u * w - 0.5, (1 - v) * h - 0.5
    i, j = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - i)[..., None], (y - j)[..., None]
    texel = lambda a, b: texture[b % h, a % w].astype(float)
    upper = (1 - fx) * texel(i, j) + fx * texel(i + 1, j)
    return (1 - fy) * upper + fy * ((1 - fx) * texel(i, j + 1) + fx * texel(i + 1, j + 1))


@pytest.mark.parametrize("coefficients", [(), (-0.2, 0.05, 0.001, 0.001)])
def test_magnified_is_bilinear(coefficients):
    from evis.geometry.distortion import Lens, unproject
    from evis.geometry.pinhole import pixel_grid

    texture = np.random.default_rng(3).random((9, 13, 3)).astype(np.float32)
    view = camera(96, 72, 80.0)
    if coefficients:
        view = Camera("cam0", 96, 72, view.k, 1e-3, "plumb_bob", coefficients)
    image = radiance(Renderer(floor(texture, view, half=1.0), view), at(0, 0, 1.0), at(0, 0, 0))
    d = rays(view)
    if coefficients:
        d = unproject(view.k, Lens.of("plumb_bob", coefficients), pixel_grid(96, 72))
        d = d / d[..., 2:]
    seen = np.abs(d[..., :2]).max(-1) < 0.98
    expected = bilinear(texture, (d[..., 0] + 1) / 2, (d[..., 1] + 1) / 2)
    assert seen.mean() > 0.5
    np.testing.assert_allclose(image[seen], expected[seen], atol=2e-5)


def test_just_minified_is_nearly_bilinear():
    """1.005 texels to a pixel: a smooth texture must not jump where it begins to be filtered."""
    i, j = np.indices((64, 64))
    smooth = 0.5 + 0.4 * np.sin(2 * np.pi * i / 16) * np.cos(2 * np.pi * j / 16)
    texture = np.repeat(smooth[..., None], 3, -1).astype(np.float32)
    view = Camera("cam0", 48, 48, np.array([[64.0, 0, 23.5], [0, 64.0, 23.5], [0, 0, 1]]))
    image = radiance(Renderer(floor(texture, view, half=0.5), view), at(0, 0, 1.005), at(0, 0, 0))
    d = 1.005 * rays(view)
    expected = bilinear(texture, d[..., 0] + 0.5, d[..., 1] + 0.5)
    assert np.abs(np.log(image / expected)).max() < 0.03


def test_unusable_textures_name_their_material():
    texture = checker(8)
    texture[3, 5, 1] = np.nan
    view = camera()
    with pytest.raises(ValueError, match=r"texture of material 'm' .* texel \[3, 5\] is"):
        Renderer(floor(texture, view), view)
    with pytest.raises(ValueError, match=r"texture of material 'm' must be finite \[h, w, 3\], it is \[8, 8\]"):
        Renderer(floor(checker(8)[..., 0], view), view)


def test_a_texture_that_no_mesh_shows_is_not_carried():
    plain = Mesh(quad(1, 1).vertices, quad(1, 1).faces)
    world = scene([(plain, -1, 0)], materials=[Material("m", np.full(3, 0.5), checker(512), two_sided=True)])
    assert not Renderer(world, world.cameras[0]).shading.surfaces.textures.texels.size


@pytest.mark.parametrize(
    "uv", [(0.0, 0.0), (-1e-9, 1.0 + 1e-9), (7e6, -7e6), (1e30, 0.5), (np.nan, 0.5), (np.inf, -np.inf)]
)
def test_texture_coordinates_of_any_size(uv):
    """Nothing is read beside the texels, and numbers give numbers between those."""
    rng = np.random.default_rng(1)
    texture = rng.uniform(0.2, 0.8, (5, 7, 3)).astype(np.float32)
    texels = np.concatenate(
        [np.full((4, 4), 1e6), np.pad(texture.reshape(-1, 3), ((0, 0), (0, 1))), np.full((1, 4), 1e6)]
    ).astype(np.float32)

    @wp.kernel(module="unique", enable_backward=False)
    def look(texels: wp.array(dtype=wp.vec4), uv: wp.vec2, found: wp.array(dtype=wp.vec3)):
        found[0] = texture_kernels.bilinear(texels, wp.vec3i(4, 7, 5), uv)

    found = wp.zeros(1, dtype=wp.vec3, device="cpu")
    wp.launch(look, 1, [wp.array(texels, dtype=wp.vec4, device="cpu"), wp.vec2(*uv)], [found], device="cpu")
    value = found.numpy()[0]
    assert not np.isfinite(uv).all() or ((value >= texture.min()).all() and (value <= texture.max()).all())
    assert not (np.abs(value) > 1.0).any()
