"""Lenses by the names that ROS has for them, through rosbags, an independent reader and writer of the messages."""

from __future__ import annotations

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from evis.bag.ros import mapping, schemas
from evis.dataset.layouts import LayoutError
from evis.dataset.layouts.dsec.calibration import calibration
from evis.dataset.layouts.rectification import Rectification
from msgs.camera import CameraInfo
from msgs.header import Header

STORE = get_typestore(Stores.ROS2_HUMBLE)
T = STORE.types
K = np.array([[40.0, 0.0, 31.5], [0.0, 40.0, 23.5], [0.0, 0.0, 1.0]])
RATIONAL = [-0.25, 0.08, 0.004, -0.003, 0.01, 0.02, -0.01, 0.005]


def read(model: str, coefficients: list[float]) -> CameraInfo:
    """What another program's message is read as."""
    header = T["std_msgs/msg/Header"](T["builtin_interfaces/msg/Time"](1, 2), "cam")
    roi = T["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    p = np.hstack([K, np.zeros((3, 1))]).ravel()
    d = np.array(coefficients)
    message = T["sensor_msgs/msg/CameraInfo"](header, 48, 64, model, d, K.ravel(), np.eye(3).ravel(), p, 0, 0, roi)
    raw = memoryview(STORE.serialize_cdr(message, message.__msgtype__))
    found = mapping.decode_foreign(schemas.CAMERA_INFO, raw, 0)
    assert isinstance(found, CameraInfo)
    return found


@pytest.mark.parametrize("further", [[], [0.0] * 6])
def test_a_rational_lens_is_read(further: list[float]) -> None:
    """Rectified points, bent by OpenCV's formula, are the pixels that they came from."""
    lens = Rectification(read("rational_polynomial", RATIONAL + further))
    x, y = ((lens.map.astype(np.float64) - [31.5, 23.5]) / 40).transpose(2, 0, 1)
    k1, k2, p1, p2, k3, k4, k5, k6 = RATIONAL
    r = x * x + y * y
    g = (1 + k1 * r + k2 * r**2 + k3 * r**3) / (1 + k4 * r + k5 * r**2 + k6 * r**3)
    u = x * g + 2 * p1 * x * y + p2 * (r + 2 * x * x)
    v = y * g + p1 * (r + 2 * y * y) + 2 * p2 * x * y
    rows, columns = np.mgrid[:48, :64]
    assert np.abs(40 * u + 31.5 - columns).max() < 1e-4 and np.abs(40 * v + 23.5 - rows).max() < 1e-4


@pytest.mark.parametrize(("model", "coefficients"), [("", []), ("", [0.0] * 5), ("plumb_bob", [])])
def test_a_camera_without_calibration_is_read(model: str, coefficients: list[float]) -> None:
    """As drivers publish it: a data set of DSEC's layout can be made of it."""
    info = read(model, coefficients)
    assert calibration(info, None)["intrinsics"]["cam0"]["distortion_coeffs"] == [0.0] * 4


def test_an_unknown_lens_is_refused_with_its_camera() -> None:
    """And with the layouts that do without it."""
    with pytest.raises(LayoutError, match=r"cam0, .*no distortion model 'unified'.*layouts npz, zarr"):
        _ = Rectification(read("unified", RATIONAL[:4])).map


@pytest.mark.parametrize(
    ("model", "ours", "name", "theirs"),
    [
        ("plumb_bob", RATIONAL, "rational_polynomial", RATIONAL),
        ("plumb_bob", RATIONAL[:4], "plumb_bob", [*RATIONAL[:4], 0.0]),
        ("plumb_bob", RATIONAL[:5], "plumb_bob", RATIONAL[:5]),
        ("equidistant", RATIONAL[:4], "equidistant", RATIONAL[:4]),
        ("none", [], "plumb_bob", [0.0] * 5),
    ],
)
def test_ours_are_written_as_ros_names_them(model: str, ours: list[float], name: str, theirs: list[float]) -> None:
    """sensor_msgs/distortion_models.h: plumb_bob has five coefficients, rational_polynomial eight."""
    info = CameraInfo(Header(0), K, np.array(ours), width=64, height=48, distortion_model=model)
    parts, _ = mapping.encode(info, "cam0")
    raw = b"".join(bytes(piece) for piece in parts[0].buffers)
    found = STORE.deserialize_cdr(raw, "sensor_msgs/msg/CameraInfo")
    assert found.distortion_model == name and found.d.tolist() == theirs
