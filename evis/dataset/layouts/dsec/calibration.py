"""Writes DSEC's cam_to_cam.yaml, by the names of https://dsec.ifi.uzh.ch/data-format."""

from __future__ import annotations

from typing import Any

import numpy as np

from msgs.camera import CameraInfo

MODELS = {"plumb_bob": "radtan", "equidistant": "equidistant", "none": "radtan"}
"""Names of our distortion models in Kalibr, which DSEC's calibration has."""


def calibration(left: CameraInfo, right: CameraInfo | None) -> dict[str, Any]:
    """Makes the contents of DSEC's cam_to_cam.yaml: cam0, cam3 see events left and right, cam1, cam2 the frames."""
    pairs = [("0", left), ("1", left), *([("2", right), ("3", right)] if right else [])]
    intrinsics: dict[str, Any] = {}
    for number, info in pairs:
        k, size = np.asarray(info.k), [info.width, info.height]
        matrix = [float(v) for v in (k[0, 0], k[1, 1], k[0, 2], k[1, 2])]
        coefficients = [float(c) for c in np.asarray(info.distortion)] or [0.0] * 4
        intrinsics[f"cam{number}"] = {
            "camera_matrix": matrix, "distortion_coeffs": coefficients, "resolution": size,
            "distortion_model": MODELS[info.distortion_model],
        }  # fmt: skip
        intrinsics[f"camRect{number}"] = {"camera_matrix": matrix, "resolution": size}
    extrinsics: dict[str, Any] = {"T_10": np.eye(4).tolist()}
    extrinsics |= {f"R_rect{number}": np.eye(3).tolist() for number, _ in pairs}
    whole = {"intrinsics": intrinsics, "extrinsics": extrinsics}
    if right is not None:
        to_right = np.eye(4)
        to_right[0, 3] = -right.baseline
        extrinsics |= {"T_21": to_right.tolist(), "T_32": np.eye(4).tolist()}
        fx, cx, cy = (float(v) for v in (left.k[0, 0], left.k[0, 2], left.k[1, 2]))
        q = [[1.0, 0, 0, -cx], [0, 1.0, 0, -cy], [0, 0, 0, fx], [0, 0, 1 / right.baseline, 0]]
        whole["disparity_to_depth"] = {"cams_03": q, "cams_12": q}
    return whole
