"""Declares parameters of the light in an image, for the renderer and for whatever shades anew what it has shaded, and
tells what follows from them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from evis.config.params import Param

LIGHT: dict[str, Param] = {
    "bounces": Param(int, 0, "surfaces beyond the seen one over which light may come, by paths", "", 0, 63),
    "sky_occlusion": Param(bool, False, "light of the sky that things hide, and of glowing surfaces, by paths"),
    "path_samples": Param(int, 16, "paths per pixel where there are any", "", 1, 65536),
    "roulette": Param(bool, False, "from the second bounce on, end paths at random that carry little"),
    "light_samples": Param(int, 16, "shadow rays for an area light and pixel, a square number", "", 1, 4096),
    "supersampling": Param(int, 0, "samples per pixel and axis, averaged; 0 = the camera's", "", 0, 16),
}
BATCH = Param(
    int,
    0,
    "keyframes that are made at once, with the gaps between them, where nobody waits for each (--compose, pace:=fast, "
    "no actions); 0 = as many as pay; the events are the same",
    "",
    0,
    32,
)
PATHS = ("path_samples", "roulette")
"""Of LIGHT, what is about paths alone."""


def by_paths(params: Mapping[str, Any]) -> bool:
    """Tells whether any light comes by paths."""
    return bool(params.get("bounces") or params.get("sky_occlusion"))


def without_effect(params: Mapping[str, Any]) -> dict[str, str]:
    """Names the parameters of paths where there are none: name -> why it changes nothing."""
    if by_paths(params):
        return {}
    return dict.fromkeys(PATHS, "no light comes by paths without bounces or sky_occlusion")


def light_options(params: Mapping[str, Any]) -> dict[str, Any]:
    """Gives arguments `light_samples` and `paths` of Renderer and Interpolator, for all of LIGHT or a part of it."""
    found: dict[str, Any] = {"light_samples": params.get("light_samples") or LIGHT["light_samples"].default}
    if by_paths(params):
        from nodes.renderer.paths.paths import PathOptions

        values = {name: params[name] if name in params else LIGHT[name].default for name in ("bounces", *PATHS)}
        found["paths"] = PathOptions(values["bounces"], values["path_samples"], bool(values["roulette"]))
    return found


def rates_between(params: Mapping[str, Any]) -> tuple[float, float]:
    """Gives the rate [Hz] at which single pixels are seen between frames, and that of keyframes; 0 where none are."""
    if not params["resolved"] or by_paths(params):
        return 0.0, 0.0
    return 1.0 / params["resolved"], params["keyframe_rate"]
