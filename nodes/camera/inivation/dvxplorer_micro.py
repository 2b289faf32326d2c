"""Drives the DVXplorer Micro, and a Mini with firmware from 10 on: registers of eight bytes, and a firmware that sets
up the chip.

Facts from jAER's public sources, which follow iniVation's own library.
"""

from __future__ import annotations

from nodes.camera.inivation.fx3 import DVS, IMU, IMU_RUN

FIRMWARE = 10
"""Low byte of bcdDevice from which on this holds."""
RUN, FLATTEN, SUBSAMPLE_X, SUBSAMPLE_Y = 3, 4, 5, 6
HOLD, RESET, RESET_SKIP, TIMEOUT_ON, TIMEOUT_US, READOUTS = 8, 9, 10, 11, 12, 13
THRESHOLD_ON, THRESHOLD_OFF = 14, 15
CROP_X, CROP_Y, CROP_WIDTH, CROP_HEIGHT, CROP_APPLY, FLIP_X, FLIP_Y = 19, 20, 21, 22, 23, 24, 25
"""Parameters of the module DVS, as are those above."""
VARIABLE_5000 = 8
"""Readouts as events come, at most 5000 a second."""
THRESHOLDS = {"very_low": 15, "low": 12, "default": 9, "high": 5, "very_high": 2}
"""Contrast thresholds, 0 to 17, of the presets of the chip's own registers."""
RATE_800_HZ, FILTER_NORMAL, RANGE_4_G, RANGE_500_DPS = 11, 2, 1, 2
"""Values of the BMI160's own registers."""

Writes = tuple[tuple[int, int, int], ...]
"""(module, parameter, value)."""


def configuration(sensitivity: str, width: int, height: int, orientation: int) -> Writes:
    """Returns the writes that set up the camera.

    orientation: register (DVS, 2), two letters: X and Y for axes that are to be flipped.
    """
    flip_x, flip_y = (chr(orientation >> shift & 0xFF).upper() == letter for shift, letter in ((8, "X"), (0, "Y")))
    dvs = {
        FLATTEN: 0, SUBSAMPLE_X: 0, SUBSAMPLE_Y: 0, HOLD: 1, RESET: 0, RESET_SKIP: 0, TIMEOUT_ON: 1, TIMEOUT_US: 2000,
        READOUTS: VARIABLE_5000, **{p: v for _, p, v in thresholds(sensitivity)},
        CROP_X: 0, CROP_Y: 0, CROP_WIDTH: width, CROP_HEIGHT: height, CROP_APPLY: 0,
        FLIP_X: int(flip_x), FLIP_Y: int(flip_y),
    }  # fmt: skip
    imu = (RATE_800_HZ, FILTER_NORMAL, RANGE_4_G, RATE_800_HZ, FILTER_NORMAL, RANGE_500_DPS)
    return (*((DVS, p, v) for p, v in dvs.items()), *((IMU, 5 + i, v) for i, v in enumerate(imu)))


def thresholds(sensitivity: str) -> Writes:
    """Returns the writes that set the contrast thresholds of a preset."""
    return tuple((DVS, parameter, THRESHOLDS[sensitivity]) for parameter in (THRESHOLD_ON, THRESHOLD_OFF))


def running(events: bool, samples: bool) -> Writes:
    """Returns the writes that switch the event sensor and the inertial sensor on or off."""
    return ((DVS, RUN, int(events)), *((IMU, p, int(samples)) for p in IMU_RUN))
