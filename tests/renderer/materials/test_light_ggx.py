"""The GGX term against a float64 evaluation of the glTF 2.0 formulas, and its energy."""

from functools import cache

import numpy as np
import pytest
from ggx_reference import lobe, reflected
from light_scenes import ALBEDO, facing, lamp, render, small, world
from renderer_scenes import at, rays, scene

from evis.scene.model import WORLD, Light, Material
from nodes.renderer.materials.ggx import COSINES, ROUGHNESSES, directional_albedo

COSINE = np.linspace(0.5, 1, 12)
"""Towards the viewer; those of the images below are among them."""


@cache
def dielectric(roughness):
    return reflected(0.04, roughness, COSINE)


def brdf_of(albedo, roughness, metallic, n, v, l):
    """The whole BRDF: the lobe, and Lambert's term with what a dielectric's lobe leaves."""
    left = 1 - np.interp(v @ n, COSINE, dielectric(roughness)) if metallic < 1 else 0.0 * (v @ n)
    f0 = 0.04 * (1 - metallic) + albedo * metallic
    diffuse = np.asarray(left)[..., None] * albedo * (1 - metallic) / np.pi
    return diffuse + lobe(f0, roughness, n, v, l)


def unit(a):
    return a / np.linalg.norm(a, axis=-1, keepdims=True)


def towards_viewer(scene_):
    return -unit(rays(scene_.cameras[0]))


@pytest.mark.parametrize("roughness, metallic, tolerance", [(0.1, 1.0, 2e-3), (0.4, 0.0, 2e-3), (0.99, 0.5, 2e-3)])
@pytest.mark.parametrize("kind", ["directional", "point"])
def test_brdf_under_a_single_light(kind, roughness, metallic, tolerance):
    """A lobe of 0.01 rad magnifies float32's rounding of the half vector by 1e4; the table of what is left has 2e-3."""
    source = np.array([0.3, -0.2, 1.0]) if kind == "directional" else np.array([0.4, 0.3, 0.6])
    light = Light("light", kind, np.array([3.0, 2.0, 1.0]), source)
    scene_ = world([(facing(), WORLD, 0)], [light], Material("gloss", ALBEDO, roughness=roughness, metallic=metallic))
    n = np.array([0.0, 0, -1])
    l, strength = -unit(source), 1.0
    if kind == "point":
        way = source - 2.0 * rays(scene_.cameras[0])
        l, strength = unit(way), 1 / (way**2).sum(-1, keepdims=True)
    brdf = brdf_of(ALBEDO, roughness, metallic, n, towards_viewer(scene_), l)
    expected = brdf * light.colour * strength * np.broadcast_to(l @ n, brdf.shape[:2])[..., None]
    np.testing.assert_allclose(render(scene_), expected, rtol=tolerance)


@pytest.mark.parametrize("roughness, metallic", [(0.15, 1.0), (0.5, 0.0), (0.9, 0.3)])
def test_gloss_of_an_area_light_against_a_sum_over_it(roughness, metallic):
    """1600 samples of each kind; single pixels within their noise, the mean within a tenth of it."""
    area = lamp((0.1, 0.0, 1.0), (0.3, 0, 0), (0, 0.24, 0.07))
    material = Material("gloss", ALBEDO, roughness=roughness, metallic=metallic)
    scene_ = world([(facing(), WORLD, 0)], [area], material, view=small())
    image = render(scene_, light_samples=1600)
    g = (np.arange(300) + 0.5) / 150 - 1
    points = area.vector + g[:, None, None] * area.half_u + g[None, :, None] * area.half_v
    normal, n = np.cross(area.half_u, area.half_v), np.array([0.0, 0, -1])
    ratios = []
    for j, i in [(j, i) for j in range(1, 18, 4) for i in range(1, 24, 4)]:
        way = points - 2.0 * rays(scene_.cameras[0])[j, i]
        l, r2 = unit(way), (way**2).sum(-1)
        brdf = brdf_of(ALBEDO, roughness, metallic, n, towards_viewer(scene_)[j, i], l)
        weight = np.maximum(l @ n, 0) * np.maximum(-(l @ normal), 0) / r2 * 4
        ratios.append(image[j, i] / ((brdf * weight[..., None]).mean((0, 1)) * area.colour))
    assert np.abs(np.array(ratios) - 1).max() < 0.03 and abs(np.mean(ratios) - 1) < 2e-3


def test_directional_albedo_against_a_sum_over_the_hemisphere():
    table = directional_albedo()
    for row, column in ((6, 20), (12, 5), (12, 31), (20, 12), (31, 3), (31, 31)):
        mu, roughness = (column / (COSINES - 1)) ** 2, row / (ROUGHNESSES - 1)
        a, b = table[row, column]
        assert reflected(1.0, roughness, mu)[0] == pytest.approx(a + b, abs=2e-3)
        assert reflected(0.0, roughness, mu)[0] == pytest.approx(b, abs=2e-3)


def test_nothing_reflects_more_than_it_gets():
    a, b = np.moveaxis(directional_albedo(), -1, 0)
    assert (a + b).max() <= 1 + 1e-9 and min(a.min(), b.min()) >= 0


@pytest.mark.parametrize("mapped", [False, True])
def test_white_furnace(mapped):
    """Under a sky of 1, white shows 1, also under a gloss; a white metal all but what single scattering loses."""
    shown = {}
    for roughness, metallic in ((1.0, 0.0), (0.05, 1.0), (0.3, 1.0), (0.95, 1.0), (0.5, 0.0)):
        material = Material("white", np.ones(3), roughness=roughness, metallic=metallic)
        scene_ = world([(facing(), WORLD, 0)], [], material, environment=np.ones(3), view=small())
        if mapped:
            scene_.environment_map = np.ones((8, 16, 3), np.float32)
        image = render(scene_)
        shown[roughness, metallic] = (image.min(), image.max())
    assert max(high for _, high in shown.values()) <= 1 + 1e-6
    np.testing.assert_allclose(shown[1.0, 0.0], 1.0, rtol=1e-6)
    assert shown[0.05, 1.0][0] > 0.998 and shown[0.3, 1.0][0] > 0.98 and shown[0.95, 1.0][0] > 0.3
    np.testing.assert_allclose(shown[0.5, 0.0], 1.0, rtol=1e-6)


def test_rough_and_not_metallic_is_the_plain_diffuse_surface():
    lights = [Light("sun", "directional", np.ones(3), np.array([0.2, 0.1, 1.0]))]
    plain = world([(facing(), WORLD, 0)], lights, view=small())
    lean = scene([(facing(), WORLD, 0)], materials=[Material("m", ALBEDO)], lights=lights, view=small(), bodies=1)
    np.testing.assert_array_equal(render(plain), render(lean, at(0, 0, -50)))
