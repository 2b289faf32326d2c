"""Finds which cameras of a scene are simulated, and which have a keyframe rate of their own: as given, or as it
says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from evis.config.document import LaunchError
from evis.config.suggestions import nearest
from evis.launch.arguments import ArgumentError, parse_pairs
from evis.runtime.clock import times_slower

NEEDED = ("camera_rate", "cameras", "keyframe_rate", "scene")
"""Arguments of a launch file that has cameras with rates of their own."""


def with_cameras(file: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Returns `values` whose `cameras`, where that is None, are the scene's: cam0, or all where none is called so.

    Raises ArgumentError for a camera that the scene file does not declare.
    """
    if not {"scene", "cameras"} <= values.keys() or not values["scene"]:
        return dict(values)
    from evis.scene.load import camera_names

    try:
        names = camera_names(str(values["scene"]), _scene_values(values))
    except (ValueError, OSError):
        names = None  # whoever loads the scene says what is wrong with it
    if values["cameras"] == []:
        raise ArgumentError(f"{file}: cameras is empty; name one, as cameras:=cam0")
    if values["cameras"] is None:
        return {**values, "cameras": ["cam0"] if not names or "cam0" in names else names}
    unknown = [str(camera) for camera in values["cameras"] if str(camera) not in (names or [str(camera)])]
    if unknown and names:
        raise ArgumentError(
            f"{file}: scene {values['scene']} has no camera '{unknown[0]}'; {nearest(unknown[0], names)}"
        )
    return dict(values)


def with_camera_rates(file: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Returns `values` whose `camera_rate` holds NAME=HZ of every simulated camera that has not the rate of the states.

    Raises LaunchError for a camera that is not simulated and for a rate that is no whole fraction of keyframe_rate.
    """
    if not all(name in values for name in NEEDED):
        return dict(values)
    cameras = [str(name) for name in values["cameras"]]
    given = _given(file, values["camera_rate"], cameras)
    rates = {**_of_the_scene(values), **given}
    kept = []
    for camera in cameras:
        if camera not in rates:
            continue
        try:
            slower = times_slower(values["keyframe_rate"], rates[camera])
        except ValueError as error:
            if camera in given:
                raise ArgumentError(f"{file}: camera_rate of {camera}: {error}") from None
            raise LaunchError(
                f"scene {values['scene']}: rate of camera {camera}: {error}; camera_rate:={camera}=HZ gives another"
            ) from None
        if slower > 1:
            kept.append(f"{camera}={rates[camera]!r}")
    return {**values, "camera_rate": kept}


def _given(file: str, words: Sequence[Any], cameras: Sequence[str]) -> dict[str, float]:
    rates: dict[str, float] = {}
    try:
        named = pairs(words)
    except ArgumentError as error:
        raise ArgumentError(f"{file}: camera_rate: {error}") from None
    for camera, text in named.items():
        if camera not in cameras:
            raise ArgumentError(f"{file}: camera_rate: no camera '{camera}' is simulated; {nearest(camera, cameras)}")
        try:
            rates[camera] = float(text)
        except ValueError:
            rates[camera] = 0.0
        if not 0 < rates[camera] < float("inf"):
            raise ArgumentError(f"{file}: camera_rate of {camera} is '{text}', must be a number above 0")
    return rates


def _of_the_scene(values: Mapping[str, Any]) -> dict[str, float]:
    from evis.scene.load import camera_rates

    try:
        return camera_rates(str(values["scene"]), _scene_values(values))
    except (ValueError, OSError):
        # Whoever loads the scene says what is wrong with it.
        return {}


def _scene_values(values: Mapping[str, Any]) -> dict[str, Any]:
    """Gives the arguments of the scene that are given, and its size."""
    from evis.scene.load import parse_args

    size = {key: values[key] for key in ("width", "height") if values.get(key)}
    return {**parse_args(values.get("scene_args")), **size}


def pairs(words: Sequence[Any]) -> dict[str, str]:
    """Parses `name=value` words, with spaces about name and value or without, as `parse_pairs` does."""
    tight = ["=".join(part.strip() for part in str(word).split("=", 1)) for word in words]
    return parse_pairs(tight, "=", "name", "cam1=15")
