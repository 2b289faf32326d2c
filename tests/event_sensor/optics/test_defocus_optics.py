"""Defocus: the filter against the closed form of an edge, and the lens against ray optics."""

import math

import numpy as np
import pytest
import warp as wp
from scipy.special import erf

from nodes.event_sensor.optics.defocus import Defocus, defocus_from_optics


def blurred(image, sigma):
    """One grey image [H, W] through the filter, float64."""
    images = wp.array(np.ascontiguousarray(image[None, ..., None], np.float32), device="cpu")
    return Defocus(sigma, "cpu")(images).numpy()[0, ..., 0].astype(np.float64)


def edge(x, sigma):
    return 0.5 * (1 + erf(x / (math.sqrt(2) * sigma)))


@pytest.mark.parametrize("sigma", [0.8, 1.5, 4.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_an_edge_spreads_as_an_error_function(sigma, axis):
    """A soft edge of 1 px becomes one of sqrt(1 + sigma^2): variances add. 6e-5 of the filter is cut off."""
    x = np.arange(101) - 50.3
    image = np.broadcast_to(1 + 9 * edge(x, 1.0), (30, 101))
    got = blurred(image if axis == 1 else image.T.copy(), sigma)
    got = got[15] if axis == 1 else got[:, 15]
    want = 1 + 9 * edge(x, math.hypot(1.0, sigma))
    inside = slice(20, 81)
    assert np.abs(got - want)[inside].max() < 9 * 2e-4
    slope = np.gradient(want)[inside].max()
    assert np.gradient(got)[inside].max() == pytest.approx(slope, rel=2e-3)


@pytest.mark.parametrize("sigma", [0.3, 1.0, 3.0])
def test_light_is_neither_lost_nor_made_away_from_the_border(sigma):
    rng = np.random.default_rng(0)
    image = np.zeros((60, 70))
    image[20:40, 25:45] = rng.uniform(0, 1e4, (20, 20))
    got = blurred(image, sigma)
    assert got.sum() == pytest.approx(image.sum(), rel=1e-6)
    y, x = np.mgrid[:60, :70]
    for grid in (x, y):
        before = np.average(grid, weights=image), np.average((grid - 35) ** 2, weights=image)
        after = np.average(grid, weights=got), np.average((grid - 35) ** 2, weights=got)
        assert after[0] == pytest.approx(before[0], abs=1e-4)
        # The variance of the light grows by sigma^2, less what is cut off at 4 sigma; sampling at 0.3 px loses more.
        if sigma >= 1:
            assert after[1] - before[1] == pytest.approx(sigma**2, rel=3e-3)


def test_a_constant_image_stays_as_it_is_at_the_border_too():
    assert np.abs(blurred(np.full((9, 13), 3.5), 2.0) - 3.5).max() < 1e-6
    assert np.abs(blurred(np.full((1, 1), 3.5), 2.0) - 3.5).max() < 1e-6


def test_channels_and_images_do_not_mix():
    images = np.zeros((2, 11, 11, 3), np.float32)
    images[1, 5, 5, 1] = 1
    got = Defocus(1.0, "cpu")(wp.array(images, device="cpu")).numpy()
    assert got[0].max() == 0 and got[1, ..., 0].max() == 0 and got[1, ..., 2].max() == 0
    assert got[1, ..., 1].sum() == pytest.approx(1, rel=1e-6)


def traced_spread(focal, f_number, focus, depth):
    """Standard deviation along one axis [m] of where rays through all of the aperture hit the sensor."""
    image_of = lambda d: 1 / (1 / focal - 1 / d)
    sensor, point = image_of(focus), image_of(depth)
    rng = np.random.default_rng(1)
    radius = focal / f_number / 2 * np.sqrt(rng.random(400_000))
    height = radius * np.cos(2 * np.pi * rng.random(400_000))
    return (height * (1 - sensor / point)).std()


@pytest.mark.parametrize("depth", [0.3, 0.9, 1.5, 40.0])
def test_the_blur_is_that_of_traced_rays(depth):
    focal, f_number, focus, pitch = 8e-3, 1.8, 1.2, 15e-6
    got = defocus_from_optics(focal, f_number, focus, pitch, depth)
    assert got == pytest.approx(traced_spread(focal, f_number, focus, depth) / pitch, rel=5e-3)


def test_the_textbook_example_and_its_limits():
    """50 mm at f/2 focused at 2 m, a point at 4 m: c = 25 mm * 2/4 * 50/1950 = 0.3205 mm."""
    assert defocus_from_optics(0.05, 2.0, 2.0, 1e-5, 4.0) == pytest.approx(0.3205128e-3 / 4 / 1e-5, rel=1e-6)
    assert defocus_from_optics(0.05, 2.0, 2.0, 1e-5, 2.0) == 0
    assert defocus_from_optics(0.05, math.inf, 2.0, 1e-5, 4.0) == 0
    far = defocus_from_optics(0.05, 2.0, 2.0, 1e-5, math.inf)
    assert far == pytest.approx(defocus_from_optics(0.05, 2.0, 2.0, 1e-5, 1e9), rel=1e-6)
    at_infinity = defocus_from_optics(0.05, 2.0, math.inf, 1e-5, np.array([1.0, 2.0, math.inf]))
    np.testing.assert_allclose(at_infinity, [0.05**2 / 2 / 4e-5, 0.05**2 / 4 / 4e-5, 0], rtol=1e-12)


@pytest.mark.parametrize(
    "values, text",
    [
        ((0, 2, 1, 1e-5, 1), "focal_length_m is 0, must be above 0"),
        ((0.05, 2, 0.04, 1e-5, 1), "focus_distance_m is 0.04, must be above 0.05"),
        ((0.05, math.nan, 1, 1e-5, 1), "f_number is nan"),
        ((0.05, 2, 1, -1, 1), "pixel_pitch_m is -1"),
        ((0.05, 2, 1, 1e-5, 0), "depth_m must be above 0"),
        ((0.05, 2, 1, 1e-5, np.array([1, math.nan])), "depth_m must be above 0"),
    ],
)
def test_impossible_lenses_are_named(values, text):
    with pytest.raises(ValueError, match=text):
        defocus_from_optics(*values)
