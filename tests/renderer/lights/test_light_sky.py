"""Environment maps: what is seen of them, the irradiance they give, and their reflection."""

import numpy as np
import pytest
from ggx_reference import lobe
from light_scenes import ALBEDO, NOWHERE, facing, render, small, world
from renderer_scenes import at, camera, quad, rays

from evis.geometry import se3
from evis.scene.model import WORLD, Material
from nodes.renderer.lights import sky


def directions(h, w):
    """Unit vectors [h, w, 3] of the texels' centres: row 0 up, column 0 at +x turning to +y."""
    theta, phi = np.meshgrid((np.arange(h) + 0.5) / h * np.pi, (np.arange(w) + 0.5) / w * 2 * np.pi, indexing="ij")
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)


def linear(d):
    return 1.0 + np.stack([0.9 * d[..., 0], 0.9 * d[..., 1], 0.9 * d[..., 2]], -1)


def under(function, meshes=(), material=None, size=(128, 256), **more):
    scene_ = world(list(meshes), [], material, **more)
    scene_.environment_map = function(directions(*size)).astype(np.float32)
    return scene_


TURNS = [(0.0, 0.0, 0.0), (np.pi / 2, 0.0, 0.0), (-1.1, 0.7, 0.4), (0.0, np.pi, 0.0), (0.3, -np.pi / 2, 0.0)]


@pytest.mark.parametrize("turn", TURNS)
def test_the_sky_is_seen_where_it_is(turn):
    """Linear between texels of 1.4 degrees: (0.025)^2 / 8 of the value."""
    scene_ = under(linear, view=camera(40, 30, 25.0))
    eye = at(3.0, 2.0, 1.0, turn)
    d = rays(scene_.cameras[0]) @ se3.to_matrix(eye[3:]).T
    d /= np.linalg.norm(d, axis=-1, keepdims=True)
    np.testing.assert_allclose(render(scene_, eye=eye), linear(d), atol=2e-4)


def plane_turned(turn):
    """A plate 2 m before the camera, and its normal towards it."""
    return at(0, 0, 2.0, (np.pi + turn, 0, 0)), np.array([0, np.sin(turn), -np.cos(turn)])


def shown_on_plate(function, turn, material=None, **more):
    place, normal = plane_turned(turn)
    scene_ = under(function, [(quad(9, 9), 0, 0)], material, view=small(), **more)
    scene_.cameras[0].k[:2, :2] *= 8
    return render(scene_, place), normal, scene_


def test_irradiance_of_a_gradient_and_of_a_cosine_lobe():
    """E / pi = 1 + 2/3 n.s of 1 + d.s. Of max(0, d.s): 2/3 (sin t + (pi - t) cos t) / pi, t between n and s."""
    s = np.array([0.6, 0.0, 0.8])
    for turn in (-1.0, -0.3, 0.4, 1.1):
        image, n, _ = shown_on_plate(linear, turn)
        np.testing.assert_allclose(image, np.broadcast_to(ALBEDO * (1 + 0.6 * n), image.shape), atol=1e-3)
        image, n, _ = shown_on_plate(lambda d: np.maximum(d @ s, 0)[..., None] * np.ones(3), turn)
        t = np.arccos(n @ s)
        expected = ALBEDO * 2 / 3 * (np.sin(t) + (np.pi - t) * np.cos(t)) / np.pi
        np.testing.assert_allclose(image, np.broadcast_to(expected, image.shape), rtol=4e-3, atol=2e-4)


def test_irradiance_of_a_single_bright_texel():
    """A sun of 1e6 in one texel: radiance times solid angle times cosine, to the texel's width and the map's step."""
    sun = np.zeros((128, 256, 3))
    sun[100, 192] = 1e6
    solid = (np.cos(100 / 128 * np.pi) - np.cos(101 / 128 * np.pi)) * 2 * np.pi / 256
    towards = directions(128, 256)[100, 192]
    for turn in (-0.4, 0.0, 0.5):
        image, n, _ = shown_on_plate(lambda d: sun, turn)
        assert n @ towards > 0.1
        expected = ALBEDO / np.pi * 1e6 * solid * (n @ towards)
        np.testing.assert_allclose(image, np.broadcast_to(expected, image.shape), rtol=1e-2)


@pytest.mark.parametrize("roughness, metallic", [(1.0, 0.0), (0.2, 1.0), (0.6, 0.3), (0.9, 0.0)])
def test_a_map_of_one_value_is_the_uniform_sky(roughness, metallic):
    sky = np.array([0.3, 2.0, 1.0])
    material = Material("m", ALBEDO, roughness=roughness, metallic=metallic)
    image, _, scene_ = shown_on_plate(lambda d: np.broadcast_to(sky, d.shape), 0.4, material, environment=sky)
    scene_.environment_map = None
    np.testing.assert_allclose(image, render(scene_, plane_turned(0.4)[0]), rtol=1e-5)


def test_a_smooth_metal_mirrors_the_sky():
    """Schlick's term at v.h = n.v; the lobe of 0.05^2 rad, and float32, blur the gradient by less than 1e-3."""
    image, n, scene_ = shown_on_plate(linear, 0.5, Material("mirror", ALBEDO, roughness=0.05, metallic=1.0))
    v = -rays(scene_.cameras[0])
    v /= np.linalg.norm(v, axis=-1, keepdims=True)
    cosine = (v @ n)[..., None]
    f = ALBEDO + (1 - ALBEDO) * (1 - cosine) ** 5
    np.testing.assert_allclose(image, f * linear(2 * cosine * n - v), rtol=3e-3)


def gathered(function, f0, roughness, n, v):
    """What a metal mirrors of a map at views v [..., 3]: midpoints over the hemisphere about n, float64."""
    across = np.cross(n, [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across)
    theta, phi = (np.arange(200) + 0.5) / 200 * np.pi / 2, (np.arange(400) + 0.5) / 400 * 2 * np.pi
    theta, phi = np.meshgrid(theta, phi, indexing="ij")
    l = np.cos(theta)[..., None] * n + np.sin(theta)[..., None] * (
        np.cos(phi)[..., None] * across + np.sin(phi)[..., None] * np.cross(n, across)
    )
    share = np.sin(theta) * np.cos(theta) * (np.pi / 2 / 200) * (2 * np.pi / 400)
    light = function(l) * share[..., None]
    return np.array([(lobe(f0, roughness, n, one, l) * light).sum((0, 1)) for one in v.reshape(-1, 3)]).reshape(v.shape)


@pytest.mark.parametrize("samples, tolerance", [(24, 0.025), (2048, 1e-3)])
def test_a_rough_metal_gathers_its_lobe(monkeypatch, samples, tolerance):
    """Of a map of mean radiance 1: 24 samples err by what their widths blur, 2048 come down to the tables' steps."""
    monkeypatch.setattr(sky, "SPECULAR_SAMPLES", samples)
    for turn, roughness in ((0.4, 0.5), (-0.9, 0.7), (1.1, 0.4), (0.0, 0.6)):
        image, n, scene_ = shown_on_plate(linear, turn, Material("rough", ALBEDO, roughness=roughness, metallic=1.0))
        v = -rays(scene_.cameras[0])[::6, ::8]
        v /= np.linalg.norm(v, axis=-1, keepdims=True)
        np.testing.assert_allclose(image[::6, ::8], gathered(linear, ALBEDO, roughness, n, v), rtol=0, atol=tolerance)


def test_a_sky_of_eleven_decades():
    bright = np.full((32, 64, 3), 1e-4)
    bright[8, 10] = 1e7
    image, _, _ = shown_on_plate(lambda d: bright, 0.3, Material("m", ALBEDO, roughness=0.4, metallic=1.0))
    assert np.isfinite(image).all() and image.min() >= 1e-5


def test_unusable_maps_are_refused():
    for bad, text in (
        (np.ones((4, 8)), r"environment_map must be \[h, w, 3\], it is \[4, 8\]"),
        (np.full((4, 8, 3), -1.0), "environment_map has 96 values that are negative or not finite"),
        (np.where(np.arange(96).reshape(4, 8, 3) == 30, np.nan, 1.0), "the first at row 1, column 2"),
    ):
        scene_ = world([(facing(), WORLD, 0)], [])
        scene_.environment_map = bad
        with pytest.raises(ValueError, match=text):
            render(scene_, NOWHERE)
