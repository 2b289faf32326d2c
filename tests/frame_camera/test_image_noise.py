"""Noise of images: the photon transfer curve, the readout's noise, and that it hangs on seed, pixel and image alone."""

import numpy as np
import pytest
from films import film

STILL = {"image_rate": 100.0, "exposure_ms": 8.0, "image_bits": 16}
WELL, SENSITIVITY = 60000.0, 6e6
GAIN = 65535 / WELL
"""Values per electron."""


def images(light, end_ms=400, size=(24, 32), **given):
    shots, _ = film(lambda t: np.full(size, light), end_ms, 50, 1, full_well=WELL, image_sensitivity=SENSITIVITY,
                    **{**STILL, **given})  # fmt: skip
    return np.stack([shot.pixels[..., 0] for shot in shots]).astype(float)


def test_cameras_of_a_rig_have_noise_of_their_own():
    """The same light and seed: noise of 30,000 values correlates by 0.006 at random."""
    left, right = (images(0.4, photon_noise=True, read_noise=10.0, name=name) for name in ("left", "right"))
    assert abs(np.corrcoef(left.ravel(), right.ravel())[0, 1]) < 0.03


def test_variance_grows_with_the_mean_by_the_gain():
    """EMVA 1288: the slope of variance over mean is the gain; also where electrons are counted one by one."""
    points = []
    for light in (0.001, 0.0015, 0.01, 0.1, 0.4, 0.9):
        values = images(light, photon_noise=True)
        mean = GAIN * SENSITIVITY * 8e-3 * light
        count = values.size
        assert values.mean() == pytest.approx(mean, abs=5 * np.sqrt(GAIN * mean / count))
        points.append((mean, values.var()))
        # The variance of a Poisson sample has the relative deviation sqrt(2 / n + 1 / (n mean)).
        spread = np.sqrt((2 + GAIN / mean) / count)
        assert values.var() == pytest.approx(GAIN * mean, rel=5 * spread, abs=1 / 6)
    mean, variance = np.array(points).T
    assert np.polyfit(mean, variance, 1)[0] == pytest.approx(GAIN, rel=0.01)


@pytest.mark.parametrize("mean", [0.3, 5.0, 63.0, 65.0, 400.0])
def test_electrons_are_poisson_distributed(mean):
    """Share of each count, on both sides of where the normal number takes over."""
    from math import exp, lgamma, log

    values = images(mean / (SENSITIVITY * 8e-3), end_ms=600, photon_noise=True)
    counts = np.bincount(np.rint(values / GAIN).astype(int).ravel())
    k = np.arange(len(counts))
    law = np.array([exp(n * log(mean) - mean - lgamma(n + 1)) for n in k]) * counts.sum()
    used = law > 30
    chi = ((counts[used] - law[used]) ** 2 / law[used]).sum()
    freedom = used.sum()
    assert chi < freedom + 5 * np.sqrt(2 * freedom)


def test_read_noise_has_its_deviation_and_dark_current_its_mean():
    values = images(0.1, read_noise=40.0)
    assert values.std() == pytest.approx(40.0 * GAIN, rel=5 / np.sqrt(2 * values.size))
    dark = images(0.0, dark_current=50000.0)
    assert (dark == np.floor(50000 * 8e-3 * GAIN + 0.5)).all()


def test_noise_is_of_the_image_and_the_seed_alone():
    """The same for any gaps; another in each image and pixel; environment k is seed + k."""
    noisy = {"photon_noise": True, "read_noise": 20.0, **STILL}
    light = lambda t: np.full((12, 16), 0.2)
    one, _ = film(light, 60, 10, 3, seed=4, **noisy)
    other, _ = film(light, 60, 30, 5, seed=4, **noisy)
    both, _ = film(light, 60, 20, 1, seed=3, envs=2, **noisy)
    second = [shot for shot in both if shot.env == 1]
    for a, b, c in zip(one, other, second, strict=True):
        np.testing.assert_array_equal(a.pixels, b.pixels)
        np.testing.assert_array_equal(a.pixels, c.pixels)
    stack = np.stack([shot.pixels[..., 0].ravel() for shot in one]).astype(float)
    together = np.corrcoef(stack) - np.eye(len(stack))
    assert abs(together).max() < 5 / np.sqrt(stack.shape[1])
    assert not np.array_equal(one[0].pixels, both[0].pixels)
