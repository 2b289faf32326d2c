"""Takes the distortion out of a camera's pixels: against the models' closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from evis.dataset.layouts.rectification import Rectification
from msgs.camera import CameraInfo
from msgs.header import Header

K = np.array([[40.0, 0.0, 31.5], [0.0, 40.0, 23.5], [0.0, 0.0, 1.0]])


def test_a_fisheye_whose_coefficients_are_all_zero_is_no_pinhole() -> None:
    """Its radius is f theta, a pinhole's f tan(theta)."""
    lens = Rectification(CameraInfo(Header(0), K, np.zeros(4), width=64, height=48, distortion_model="equidistant"))
    y, x = np.mgrid[:48, :64]
    u, v = (x - 31.5) / 40, (y - 23.5) / 40
    theta = np.hypot(u, v)
    want = np.stack((31.5 + 40 * np.tan(theta) * u / theta, 23.5 + 40 * np.tan(theta) * v / theta), -1)
    assert np.abs(lens.map - want).max() < 1e-4
    own = np.broadcast_to(np.arange(64.0), (48, 64))
    # at the rectified column 60, atan(28.5 / 40) from the axis on the row through the middle
    assert abs(lens.image(own, np.nan)[24, 60] - (31.5 + 40 * np.arctan(28.5 / 40))) < 0.6


@pytest.mark.parametrize(("model", "coefficients"), [("none", []), ("plumb_bob", [0.0] * 5)])
def test_without_distortion_nothing_moves(model: str, coefficients: list[float]) -> None:
    """To the bit."""
    info = CameraInfo(Header(0), K, np.array(coefficients), width=64, height=48, distortion_model=model)
    y, x = np.mgrid[:48, :64]
    assert np.array_equal(Rectification(info).map, np.stack((x, y), -1))
