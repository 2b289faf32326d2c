"""Computes ln I as the sensor has it without dark current, in float64, for all that an audit compares."""

from __future__ import annotations

import numpy as np

from nodes.event_sensor.parameters import FLOOR


def log_level(luminance: np.ndarray) -> np.ndarray:
    """Computes ln I, float64 of the same shape; of dark light, and of NaN, that of the sensor's floor."""
    return np.log(np.fmax(luminance.astype(np.float64), FLOOR))
