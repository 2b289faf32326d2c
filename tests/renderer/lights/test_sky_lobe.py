"""What a lobe gathers of a map, one sample after another and several at a time, against the same sums in float64."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from light_scenes import facing, world

from evis.scene.model import WORLD
from nodes.renderer.lights import sky
from nodes.renderer.lights.lobe_kernels import BESIDE, RUN
from nodes.renderer.lights.sky_kernels import Sky, make_specular_means

LEAST_COSINE = 1e-4
TYPES = wp.vec3, wp.vec3, wp.float32
WAYS = pytest.mark.parametrize("by_runs", [False, True])


@cache
def kernel_of(by_runs):
    specular_means = make_specular_means(by_runs)

    @wp.kernel(module="unique", enable_backward=False)
    def gather(
        sky: Sky,
        n: wp.array2d(dtype=wp.vec3),
        v: wp.array2d(dtype=wp.vec3),
        alpha: wp.array2d(dtype=float),
        base: wp.array2d(dtype=wp.vec3),
        rim: wp.array2d(dtype=wp.vec3),
    ):
        env, i = wp.tid()
        found = specular_means(sky, env, n[env, i], v[env, i], alpha[env, i])
        base[env, i] = found[0]
        rim[env, i] = found[1]

    return gather


def specular_means_by_sample(by_runs, map_, n, v, alpha):
    """Both means [2, E, N, 3] of surfaces [E, N]."""
    means = [wp.zeros(alpha.shape, dtype=wp.vec3, device="cpu") for _ in range(2)]
    inputs = [wp.array(a.astype(np.float32), dtype=t, device="cpu") for a, t in zip((n, v, alpha), TYPES)]
    wp.launch(kernel_of(by_runs), alpha.shape, [map_, *inputs], means, device="cpu")
    return np.stack([m.numpy() for m in means])


def rounded(a):
    """As the kernels get it."""
    return np.asarray(a, np.float32).astype(np.float64)


def unit(a):
    return a / np.linalg.norm(a, axis=-1, keepdims=True)


def turned(rng, envs):
    """Rotations [E, 3, 3]."""
    return rounded([np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(envs)])


def map_of(radiance, camera):
    scene = world([(facing(), WORLD, 0)], [])
    scene.environment_map = radiance
    put = lambda a, t: wp.array(np.asarray(a), dtype=t, device="cpu")
    return sky.make_sky(SimpleNamespace(scene=scene, put=put, eye=put(camera, wp.mat33)), True)


def interpolated(level, world_):
    """A map [h, w, 3] between its texels' centres, at directions [..., 3]: across a pole lies the other side's row."""
    h, w = level.shape[:2]
    x = np.arctan2(world_[..., 1], world_[..., 0]) / (2 * np.pi) * w - 0.5
    y = np.arctan2(np.hypot(world_[..., 0], world_[..., 1]), world_[..., 2]) / np.pi * h - 0.5
    total = 0.0
    for i, share_x in ((np.floor(x), 1 - x % 1), (np.floor(x) + 1, x % 1)):
        for j, share_y in ((np.floor(y), 1 - y % 1), (np.floor(y) + 1, y % 1)):
            column, row = i.astype(int), j.astype(int)
            column = np.where((row < 0) | (row >= h), column + w // 2, column) % w
            total = total + level[np.clip(row, 0, h - 1), column] * (share_x * share_y)[..., None]
    return total


def expected(radiance, camera, n, v, alpha):
    """The means in float64, by the formulas of GGX: Walter's density, Smith's masking by his Lambda, Schlick's term."""
    levels = [rounded(level) for level in sky.halvings(radiance)]
    index = np.arange(sky.SPECULAR_SAMPLES)
    bits = np.array([int(f"{k:032b}"[::-1], 2) / 2**32 for k in index])
    turn, height = 2 * np.pi * bits, 1 - (index + 0.5) / len(index)
    t = unit(v - (n * v).sum(-1, keepdims=True) * n)
    b = np.cross(n, t)
    nv = (n * v).sum(-1)
    held = np.clip(nv, LEAST_COSINE, 1)
    seen = unit(np.stack([alpha * np.sqrt(1 - held**2), 0 * held, held], -1))[..., None, :]
    z = height * (1 + seen[..., 2]) - seen[..., 2]
    ring = np.sqrt(np.maximum(1 - z * z, 0))
    cap = np.stack([ring * np.cos(turn), ring * np.sin(turn), z], -1) + seen
    a, axes = alpha[..., None], np.stack([t, b, n], -2)[..., None, :, :]
    h = unit(np.stack([a * cap[..., 0], a * cap[..., 1], np.maximum(cap[..., 2], 0)], -1))
    nh = h[..., 2]
    h = (h[..., None] * axes).sum(-2)
    vh = (h * v[..., None, :]).sum(-1)
    l = 2 * vh[..., None] * h - v[..., None, :]
    nl = (l * n[..., None, :]).sum(-1)
    # sin^2 of the half vector from its part across n, for 1 - nh^2 has no digits in a narrow lobe.
    across = ((h - nh[..., None] * n[..., None, :]) ** 2).sum(-1)
    density = a**2 / np.pi / (nh**2 * a**2 + across) ** 2
    tall = lambda x: (np.sqrt(1 + a**2 * (1 - x**2) / x**2) - 1) / 2
    above, held = nl > 0, held[..., None]
    nl = np.where(above, nl, 1.0)
    share = density / (1 + tall(held)) / (4 * held)
    weight = np.where(above, nl / (4 * nl * held) / (1 + tall(held) + tall(nl)), 0.0)
    glancing = weight * np.clip(1 - vh, 0, 1) ** 5
    whole = radiance.shape[0] * radiance.shape[1] / (2 * np.pi**2)
    lod = np.clip(0.5 * np.log2(whole / (len(index) * share)), 0, len(levels) - 1)
    world_ = (camera[:, None, None] @ l[..., None])[..., 0]
    each = np.stack([interpolated(level, world_) for level in levels])
    near = np.maximum(1 - np.abs(lod - np.arange(len(levels))[:, None, None, None]), 0)
    colour = (each * near[..., None]).sum(0)
    sums = [((w[..., None] * colour).sum(-2), w.sum(-1)[..., None]) for w in (weight - glancing, glancing)]
    return np.stack([total / np.where(weight > 0, weight, 1) for total, weight in sums])


def surfaces(rng, envs, count):
    """Normals, and views on their outer side: many of them grazing, some by less than the least cosine."""
    n = rounded(unit(rng.normal(size=(envs, count, 3))))
    aside = unit(np.cross(n, rng.normal(size=n.shape)))
    grazing = 10 ** rng.uniform(-6, 0, (envs, count, 1))
    cosine = np.minimum(np.where(rng.random(grazing.shape) < 0.5, rng.random(grazing.shape), grazing), 0.999)
    return n, rounded(cosine * n + np.sqrt(1 - cosine**2) * aside)


ALPHAS = {
    "any": lambda rng, shape: rng.random(shape) ** 2,
    "least": lambda rng, shape: np.full(shape, 1e-3),
    "tiny": lambda rng, shape: np.full(shape, 1e-5),
    "one": lambda rng, shape: np.ones(shape),
}


@WAYS
@pytest.mark.parametrize("alphas", ALPHAS)
@pytest.mark.parametrize("size", [(2, 2), (3, 5), (7, 4), (33, 65)])
def test_lobes_against_float64(by_runs, size, alphas):
    """Texels that are independent of each other: many columns magnify float32's error of a direction."""
    rng = np.random.default_rng(3)
    radiance, camera = rng.random((*size, 3)) + 0.05, turned(rng, 2)
    n, v = surfaces(rng, 2, 500)
    alpha = rounded(ALPHAS[alphas](rng, n.shape[:2]))
    found = specular_means_by_sample(by_runs, map_of(radiance, camera), n, v, alpha)
    np.testing.assert_allclose(found, expected(radiance, camera, n, v, alpha), rtol=2e-5 + 2e-6 * size[1])


@pytest.mark.parametrize("size", [(5, 9), (128, 256)])
def test_by_runs_as_one_by_one(size):
    """Closer to each other than either is to float64, since both round the same directions."""
    rng = np.random.default_rng(4)
    map_ = map_of(rng.random((*size, 3)) * 10.0 ** rng.integers(-4, 5, (*size, 1)), turned(rng, 1))
    n, v = surfaces(rng, 1, 2000)
    alpha = rng.random(n.shape[:2]) ** 2
    np.testing.assert_allclose(
        specular_means_by_sample(True, map_, n, v, alpha), specular_means_by_sample(False, map_, n, v, alpha), rtol=3e-6
    )


@WAYS
def test_a_lobe_without_width_shows_one_place(by_runs):
    """Of a mirror, also where he looks along its normal: all samples go the same way, and none is wide."""
    rng = np.random.default_rng(5)
    radiance, camera = rng.random((6, 11, 3)) + 0.05, turned(rng, 1)
    n, v = surfaces(rng, 1, 200)
    v[:, :20] = n[:, :20]
    towards = 2 * (n * v).sum(-1, keepdims=True) * n - v
    shown = interpolated(radiance, (camera[:, None] @ towards[..., None])[..., 0])
    found = specular_means_by_sample(by_runs, map_of(radiance, camera), n, v, np.zeros(n.shape[:2]))
    oblique = (n * v).sum(-1) < 0.9
    np.testing.assert_allclose(found[0], shown, rtol=4e-5)
    np.testing.assert_allclose(found[1][oblique], shown[oblique], rtol=4e-5)


@WAYS
def test_what_is_no_number_gathers_nothing(by_runs):
    """And reads nothing that is not there: what lies beside is as it was."""
    rng = np.random.default_rng(6)
    n, v = surfaces(rng, 1, 60)
    alpha = rng.random(n.shape[:2])
    map_ = map_of(rng.random((5, 9, 3)) + 0.05, turned(rng, 1))
    before = specular_means_by_sample(by_runs, map_, n, v, alpha)
    for which, value in ((n, np.nan), (v, np.nan), (alpha, np.nan), (n, np.inf), (v, -np.inf)):
        kept = which[0, ::7].copy()
        which[0, ::7] = value
        after = specular_means_by_sample(by_runs, map_, n, v, alpha)
        which[0, ::7] = kept
        assert not after[:, 0, ::7].any()
        beside = np.arange(60) % 7 > 0
        np.testing.assert_array_equal(after[:, 0, beside], before[:, 0, beside])


@WAYS
def test_a_map_of_one_texel_is_that_texel(by_runs):
    """Smaller than any that a scene may have; the texel that follows is another one's."""
    rng = np.random.default_rng(7)
    colour, beside = np.array([3.0, 0.5, 7.0]), np.full((BESIDE, 3), 1e9)
    map_ = map_of(np.ones((2, 2, 3)), turned(rng, 1))
    map_.levels = wp.array(np.array([[0, 1, 1], [0, 1, 1]], np.int32), dtype=wp.vec3i, device="cpu")
    texels = np.concatenate([sky.surrounded(colour[None, None]).reshape(-1, 3), beside])
    map_.texels = wp.array(texels, dtype=wp.vec3, device="cpu")
    n, v = surfaces(rng, 1, 300)
    found = specular_means_by_sample(by_runs, map_, n, v, rng.random(n.shape[:2]))
    np.testing.assert_allclose(found, np.broadcast_to(colour, found.shape), rtol=2e-6)


def test_samples_of_a_lobe_are_whole_runs():
    assert sky.SPECULAR_SAMPLES % RUN == 0
