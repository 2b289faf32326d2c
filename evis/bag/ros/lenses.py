"""Converts the names of distortion models to those of sensor_msgs/CameraInfo and back.

ROS calls the model of OpenCV with five coefficients `plumb_bob` and that with eight `rational_polynomial`; a camera
that was not calibrated has an empty name, or no coefficients.
"""

from __future__ import annotations

import numpy as np

RATIONAL = 8
"""Coefficients of `rational_polynomial`; OpenCV has up to six more, of thin prisms and a tilted sensor."""


def to_ros(model: str, coefficients: np.ndarray) -> tuple[str, np.ndarray]:
    """Returns ROS's name and coefficients of a distortion model."""
    if model not in ("none", "plumb_bob"):
        return model, coefficients
    padded = np.zeros(max(5, len(coefficients)))
    padded[: len(coefficients)] = coefficients
    return "rational_polynomial" if len(padded) == RATIONAL else "plumb_bob", padded


def from_ros(model: str, coefficients: np.ndarray) -> tuple[str, np.ndarray]:
    """Returns our name and coefficients of ROS's distortion model; an unknown name is kept."""
    if model in ("", "plumb_bob", "rational_polynomial") and not np.any(coefficients):
        return "none", np.zeros(0)
    if model == "rational_polynomial":
        further = len(coefficients) > RATIONAL and not np.any(coefficients[RATIONAL:])
        return "plumb_bob", coefficients[:RATIONAL] if further else coefficients
    return model, coefficients
