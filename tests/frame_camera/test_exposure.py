"""The light of an exposure: closed forms of still and moving scenes, whatever the frames are."""

import numpy as np
import pytest
from films import LINEAR, MS, film, rows_of

from nodes.frame_camera.camera import FrameCamera
from nodes.frame_camera.parameters import settings_of
from nodes.frame_camera.timetable import Exposure, quadrature

FULL = 65535
PER_MS = LINEAR["image_sensitivity"] * 1e-3 / LINEAR["full_well"] * FULL
"""Value that a radiance of 1 adds in 1 ms."""


def test_a_still_scene_gives_gain_times_light_times_time():
    light = np.linspace(0.1, 1.2, 12).reshape(3, 4)
    for exposure, gain in ((4.0, 1.0), (2.5, 2.0), (0.3, 0.5)):
        shots, _ = film(lambda t, light=light: light, 100, 10, 4, image_rate=50, exposure_ms=exposure, image_gain=gain)
        assert [s.stamp_ns for s in shots] == [n * 20 * MS + round(exposure * MS / 2) for n in range(5)]
        wanted = np.floor(gain * PER_MS * exposure * np.float32(light).astype(float) + 0.5)
        for shot in shots:
            np.testing.assert_array_equal(shot.pixels[..., 0], wanted)
            assert shot.exposure_ns == round(exposure * MS)


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_bits_gamma_and_black_level(bits):
    shots, _ = film(
        lambda t: np.full((2, 2), 0.5), 20, 10, 2, image_rate=100, exposure_ms=5.0, image_bits=bits, image_gamma=2.2,
        black_level=0.1,
    )  # fmt: skip
    value = np.floor((0.25 + 0.1) ** (1 / 2.2) * (2**bits - 1) + 0.5)
    assert (shots[0].pixels == value * (1 if bits == 8 else 2 ** (16 - bits))).all()
    assert shots[0].pixels.dtype == (np.uint8 if bits == 8 else np.uint16)


def test_light_that_changes_linearly_is_integrated_exactly_between_any_frames():
    """Exposures begin and end between frames and span gaps of several keyframes; K and the gaps make no difference."""
    slope = np.array([[0.01, 0.02], [-0.005, 0.0]])
    asked = {"image_rate": 31.0, "image_phase_ms": 1.7, "exposure_ms": 3.3, "image_gain": 2.0}
    films = [film(lambda t: 0.6 + slope * t, 120, step, k, **asked)[0] for step, k in ((10, 4), (40, 1), (2.5, 7))]
    assert len(films[0]) == 4
    for k, shot in enumerate(films[0]):
        middle = 1.7 + 1000 * k / 31.0 + 3.3 / 2
        wanted = 2.0 * PER_MS * 3.3 * (0.6 + slope * middle)
        np.testing.assert_allclose(shot.pixels[..., 0], np.minimum(wanted, FULL), atol=0.6)
        for other in films[1:]:
            np.testing.assert_array_equal(other[k].pixels, shot.pixels)
            assert other[k].stamp_ns == shot.stamp_ns


def test_an_exposure_may_be_longer_than_the_gaps():
    shots, camera = film(lambda t: np.full((1, 1), 0.01 * t), 250, 5, 1, image_rate=10, exposure_ms=90.0)
    assert [s.stamp_ns // MS for s in shots] == [45, 145]
    assert shots[0].pixels[0, 0, 0] == np.floor(min(PER_MS * 0.01 * 90 * 45, FULL) + 0.5)
    assert camera.unfinished == 1  # the third began at 200 ms


def moving_edge(width, speed):
    """Light 0 left of an edge that moves right by `speed` px per ms, 1 right of it; a pixel sees its share of both."""
    return lambda t: np.tile(np.clip(np.arange(width) + 1 - 4 - speed * t, 0, 1), (6, 1))


def test_a_moving_edge_becomes_a_ramp_as_long_as_its_path():
    """Each pixel is lit until the edge has come; sampled finely, the light is nowhere further than a step from it."""
    speed, exposure = 2.0, 8.0
    shots, _ = film(moving_edge(30, speed), 20, 10, 200, image_rate=50, exposure_ms=exposure)
    ramp = shots[0].pixels[3, :, 0] / (PER_MS * exposure)
    x = np.arange(30) + 0.5
    wanted = np.clip((x - 4) / (speed * exposure), 0, 1)
    np.testing.assert_allclose(ramp, wanted, atol=0.5 / (speed * exposure))
    inside = (x > 5) & (x < 19)
    assert np.count_nonzero((ramp > 0.001) & (ramp < 0.999)) == pytest.approx(speed * exposure, abs=1)
    np.testing.assert_allclose(np.diff(ramp[inside]), 1 / (speed * exposure), rtol=1e-3)


def test_a_rolling_shutter_skews_a_moving_edge():
    """The edge stands further to the right in each row, by its speed times the delay of a row."""
    speed, delay = 2.0, 0.75
    asked = {"image_rate": 50, "exposure_ms": 2.0, "rolling_shutter_us": delay * 1000}
    shots, _ = film(moving_edge(40, speed), 20, 5, 100, **asked)
    place = 40 - shots[0].pixels[..., 0].sum(axis=1) / (PER_MS * 2.0)
    np.testing.assert_allclose(place, 4 + speed * (1.0 + delay * np.arange(6)), atol=0.01)
    assert shots[0].stamp_ns == round((2.0 + 5 * delay) * MS / 2)


def test_rolling_exposures_that_overlap_are_kept_apart():
    """Row 0 of an image begins before the last rows of the image before have ended."""
    asked = {"image_rate": 100, "exposure_ms": 9.0, "rolling_shutter_us": 1500.0}
    light = lambda t: np.full((6, 2), 0.01 * t)
    shots, camera = film(light, 100, 5, 3, **asked)
    assert len(shots) == 9 and camera.unfinished == 1
    for n, shot in enumerate(shots):
        middle = 10.0 * n + 4.5 + 1.5 * np.arange(6)
        np.testing.assert_allclose(shot.pixels[:, 0, 0], np.minimum(PER_MS * 9.0 * 0.01 * middle, FULL), atol=0.6)


def test_a_readout_longer_than_the_period_is_refused():
    """One row at a time: 6 rows of 1.7 ms do not fit into 10 ms, of which 6 rows have 1.6666 ms each."""
    light = lambda t: np.ones((6, 2))
    with pytest.raises(ValueError, match=r"rolling_shutter_us is 1700 us, which for 6 rows is 10.2 ms; .* 1666.666 us"):
        film(light, 10, 5, 3, image_rate=100, exposure_ms=2.0, rolling_shutter_us=1700.0)
    shots, _ = film(light, 30, 5, 3, image_rate=100, exposure_ms=2.0, rolling_shutter_us=1666.666)
    assert len(shots) == 2


def test_weights_against_a_numerical_integral():
    """Random frames and times; the oracle integrates the broken line on a fine grid, in float64."""
    rng = np.random.default_rng(5)
    t = np.cumsum(rng.integers(1, 40, 9)).astype(np.int64) * 1000
    light = rng.random(9)
    start, length = int(t[0]) - 700, int(t[-1] - t[2])
    weights = quadrature(t, Exposure(0, start, length, 0), 3100, 4)
    for row in range(4):
        begin = start + 3100 * row
        fine = np.linspace(max(begin, t[0]), min(begin + length, t[-1]), 400_001)
        wanted = np.trapezoid(np.interp(fine, t, light), fine) * 1e-9
        assert weights[row] @ light == pytest.approx(wanted, rel=1e-6)
    assert weights.sum(axis=1) == pytest.approx([(min(start + 3100 * r + length, t[-1]) - max(start + 3100 * r, t[0]))
                                                 * 1e-9 for r in range(4)])  # fmt: skip


def test_what_is_too_bright_is_clipped_and_counted():
    light = np.array([[0.5, 2.0, 3.0], [np.inf, np.nan, 0.1]])
    shots, camera = film(lambda t: light, 20, 10, 2, image_rate=100, exposure_ms=8.0)
    assert len(shots) == 2
    wanted = [[round(4 * PER_MS), FULL, FULL], [FULL, 0, round(0.8 * PER_MS)]]
    np.testing.assert_allclose(shots[0].pixels[..., 0], wanted, atol=1)
    assert (camera.clipped, camera.nonfinite) == (2 * 3, 2 * 2)


def test_a_pixel_in_colour_is_counted_once():
    """Three of four pixels are too bright in one, two and three channels; one is not finite in two of them."""
    light = np.array([[[9.0, 0.1, 0.1], [9.0, 9.0, 0.1], [9.0, 9.0, 9.0], [0.1, np.nan, -np.inf]]], np.float32)
    settings = settings_of("camera", "ideal", {**LINEAR, "image_rate": 100.0, "exposure_ms": 8.0})
    camera = FrameCamera(settings, [0], light.shape)
    for stamp in (0, 10 * MS):
        camera.push(light[None, None], np.full((1, 1), stamp), np.array([stamp == 0]), rows_of(1, stamp))
    assert (camera.clipped, camera.nonfinite) == (3, 1)


def test_the_lens_blurs_the_image():
    """The second moment of a point grows by sigma squared, and no light is lost."""
    point = np.zeros((41, 41))
    point[20, 20] = 1.0
    shots, _ = film(lambda t: point, 10, 10, 2, image_rate=100, exposure_ms=8.0, defocus_px=2.0, image_gain=20.0)
    image = shots[0].pixels[..., 0].astype(float)
    x = np.arange(41) - 20
    assert image.sum() == pytest.approx(20 * PER_MS * 8.0, rel=2e-3)
    assert (image.sum(axis=0) @ x**2) / image.sum() == pytest.approx(4.0, rel=0.02)


def test_an_exposure_longer_than_the_period_is_refused():
    with pytest.raises(ValueError, match=r"exposure_ms is 40 ms, images at image_rate 30 Hz are 33.333333 ms apart"):
        settings_of("frame_camera", "ideal", {"exposure_ms": 40.0})
    with pytest.raises(ValueError, match="exposure_max_ms is 40 ms"):
        settings_of("frame_camera", "ideal", {"exposure_max_ms": 40.0})
    with pytest.raises(ValueError, match=r"exposure_ms is 33.333334 ms, .* are 33.333333 ms apart"):
        settings_of("frame_camera", "ideal", {"exposure_ms": 33.333334})
    with pytest.raises(ValueError, match="exposure_min_ms is 5 ms, images at image_rate 1000 Hz are 1 ms apart"):
        settings_of("frame_camera", "ideal", {"image_rate": 1000.0, "exposure_min_ms": 5.0})
    with pytest.raises(ValueError, match=r"exposure_min_ms is 0.01 ms, above exposure_max_ms, 0.001 ms; give a range"):
        settings_of("frame_camera", "ideal", {"exposure_max_ms": 0.001})
    assert settings_of("frame_camera", "ideal", {"image_rate": 100000.0}).shortest == 10_000
    with pytest.raises(ValueError, match="must be one of 8, 10, 12, 14, 16"):
        settings_of("frame_camera", "ideal", {"image_bits": 9})
