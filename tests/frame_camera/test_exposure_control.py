"""Auto-exposure: the mean that is asked for, its limits, and how it follows a change of light."""

import numpy as np
import pytest
from films import MS, film

LIGHT = np.linspace(0.2, 1.0, 64).reshape(8, 8)


def means(shots):
    return [float(shot.pixels.mean()) / 65535 for shot in shots]


@pytest.mark.parametrize("brightness", [0.05, 1.0, 30.0])
def test_the_first_image_has_the_mean_that_is_asked_for(brightness):
    shots, _ = film(lambda t: brightness * LIGHT, 300, 10, 2, image_rate=10, exposure_target=0.3)
    assert means(shots) == pytest.approx([0.3] * len(shots), rel=2e-3)


def test_limits_hold():
    dark, _ = film(lambda t: 1e-4 * LIGHT, 200, 10, 2, image_rate=20, exposure_max_ms=30)
    bright, _ = film(lambda t: 1e4 * LIGHT, 200, 10, 2, image_rate=20, exposure_min_ms=0.5)
    assert {s.exposure_ns for s in dark} == {30 * MS}
    assert {s.exposure_ns for s in bright} == {MS // 2}


def test_it_follows_light_that_changes_by_the_images_before():
    """A step of the light is first seen by an image that was exposed for the light before it."""
    light = lambda t: LIGHT * (1.0 if t < 100 else 2.0)
    shots, _ = film(light, 400, 10, 4, image_rate=20, exposure_target=0.2)
    found = means(shots)
    assert found[:2] == pytest.approx([0.2] * 2, rel=5e-3)
    assert found[2] == pytest.approx(0.4, rel=0.02)
    assert found[4:] == pytest.approx([0.2] * len(found[4:]), rel=5e-3)


def test_what_it_chooses_is_the_same_for_any_gaps():
    light = lambda t: LIGHT * (1.0 + 0.01 * t)
    asked = {"image_rate": 40, "rolling_shutter_us": 2000.0, "exposure_target": 0.2}
    films = [film(light, 200, step, k, **asked)[0] for step, k in ((10, 4), (50, 2), (25, 1))]
    for other in films[1:]:
        assert [s.exposure_ns for s in other] == [s.exposure_ns for s in films[0]]
