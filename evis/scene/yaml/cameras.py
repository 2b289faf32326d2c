"""Reads cameras of a scene file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from evis.geometry import pinhole
from evis.scene.model import Camera
from evis.scene.yaml.reader import Fields

COEFFICIENTS = {"plumb_bob": (4, 5, 8), "equidistant": (4,)}
"""How many a distortion model has."""


def read_camera(name: str, fields: Fields, arguments: Mapping[str, Any]) -> Camera:
    """Reads one entry of `cameras:` but for its place; width and height are the scene's arguments unless it has its
    own.

    fov: the vertical one, without the distortion of plumb_bob; under `equidistant` the image height is focal times fov.
    """
    width = fields.whole("width", arguments["width"], minimum=1)
    height = fields.whole("height", arguments["height"], minimum=1)
    model, coefficients = _distortion(fields)
    if fields.has("focal") and fields.has("fov"):
        raise fields.error("focal", "and fov are given; leave one out")
    if fields.has("focal"):
        focal = fields.number("focal", above=0.0)
    else:
        fov, widest = fields.angle("fov"), 360 if model == "equidistant" else 180
        if not 0.0 < fov < np.radians(widest):
            raise fields.error(
                "fov", f"is {fov:g} rad; it must lie between 0 and {widest} deg; degrees are written as in `40 deg`"
            )
        focal = height / fov if model == "equidistant" else pinhole.focal_from_fov(height, fov)
    near = fields.number("near", 1e-3, above=0.0)
    supersampling = fields.whole("supersampling", 1, minimum=1, maximum=16)
    rate = fields.number("rate", above=0.0) if fields.has("rate") else None
    k = pinhole.intrinsics(width, height, focal)
    return Camera(name, width, height, k, near, model, coefficients, supersampling, rate)


def _distortion(fields: Fields) -> tuple[str, tuple[float, ...]]:
    section = fields.section("distortion", "distortion")
    if section is None:
        return "none", ()
    model = section.text("model", choices=tuple(COEFFICIENTS))
    values = section.raw("coefficients")
    counts = COEFFICIENTS[model]
    if not isinstance(values, list) or len(values) not in counts:
        number = " or ".join(str(n) for n in counts)
        raise section.error("coefficients", f"is {values!r}; {model} has {number} of them")
    numbers = tuple(section.number_of("coefficients", v) for v in values)
    section.done()
    return model, numbers
