"""Declares the interpolator's node: its parameters and topics, and what a launch can tell of its methods from them."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from evis.config.params import Param
from evis.runtime.declaration import Declaration, Input, Output
from evis.scene.parameters import SCENE, SEED, camera_of, ends_alone, worlds_of
from nodes.interpolator.methods import HELP, METHODS, reads
from nodes.interpolator.samples import by_frames_alone
from nodes.renderer import parameters
from nodes.renderer.parameters import BATCH, LIGHT


def usable(params: Mapping[str, Any]) -> str:
    """Returns the method asked for, or splat where it needs a scene and there is none."""
    return "splat" if "state" in reads(params["method"]) and not params.get("scene") else params["method"]


class InterpolatorDeclaration(Declaration):
    """Declares what makes the frames between keyframes."""

    PARAMS = {
        "method": Param(str, "rigid", HELP, choices=tuple(METHODS)),
        "upsampling": Param(int, 8, "frames per keyframe interval (K)", "", 1, 4096),
        "tolerance": Param(
            float, None,
            "error of ln I that rigid looks for, to shade anew; less costs more; 0.1 if not given, and with "
            "time_tolerance 67 of it a second: 0.02 for 0.3 ms, 0.0125 at least, 0.1 at most",
            "ln I", 0.001, 10, optional=True,
        ),
        "time_tolerance": Param(
            float, 0.0,
            "for rigid: error of the time at which a pixel's ln I crosses a threshold, to which single pixels are "
            "looked at between the frames; 0 = frames only",
            "s", 0, 1,
        ),
        "keyframe_rate": Param(float, 0.0, "rate that is expected, to prepare for it; 0 = any", "Hz", 0),
        "colour": Param(bool, False, "frames are linear RGB, for colour events, instead of luminance"),
        **SCENE,
        "scene": replace(SCENE["scene"], help="world that was rendered, for rigid; without it splat is used"),
        "seed": SEED,
        "camera": Param(str, "cam0", "which camera of the scene"),
        "envs": Param(int, 1, "parallel environments that are expected", minimum=1, maximum=65536),
        "margin": Param(int, 0, "the renderer's margin that is expected", "px", 0, 1024),
        **LIGHT,
        "batch": BATCH,
        "device": Param(str, "cpu", "where kernels run: cpu, cuda, cuda:1"),
        "threads": Param(
            int, 0, "CPU threads, which share the frames of a gap; 0 = as cores and pixels are worth, at most 8",
            minimum=0, maximum=256,
        ),
    }  # fmt: skip
    PER_ENVIRONMENT = True
    INPUTS = {
        "keyframe": Input("/{camera}/keyframe", on_device=True),
        "depth": Input("/{camera}/depth", on_device=True),
        "motion": Input("/{camera}/motion", on_device=True),
        "state": Input("/state"),
    }
    OUTPUTS = {"frames": Output("/{camera}/frames"), "samples": Output("/{camera}/samples", late=False)}

    @classmethod
    def without_effect(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """Names the parameters that only `rigid` reads, for other methods."""
        method = usable(params)
        if method == "rigid":
            found = parameters.without_effect(params)
            if params["time_tolerance"] > 0 and parameters.by_paths(params):
                found = found | {"time_tolerance": "light by paths goes by frames alone"}
            return found
        light = ("tolerance", "time_tolerance", *(name for name in LIGHT if name != "supersampling"))
        found = dict.fromkeys(light, f"method {method} shades nothing anew")
        if "state" not in reads(method):
            found |= dict.fromkeys(("scene", "scene_args"), f"method {method} needs no scene")
        return found

    @classmethod
    def needs(cls, params: Mapping[str, Any], wanted: frozenset[str]) -> frozenset[str]:
        """Names depth and motion only for methods that warp by them, states for those that know the bodies."""
        return frozenset({"keyframe"}) | reads(usable(params))

    @classmethod
    def reads(cls, params: Mapping[str, Any], port: str) -> frozenset[str] | None:
        """Asks for luminance keyframes, or radiance if frames are in colour; of motion in closed form for its ends."""
        if port == "state":
            return ends_alone(params.get("scene"))
        return frozenset({"radiance" if params["colour"] else "luminance"}) if port == "keyframe" else None

    @classmethod
    def foreseen(cls, params: Mapping[str, Any]) -> tuple[str, ...]:
        """Says which pixels go by frames alone although there is a tolerance of time."""
        if params["time_tolerance"] == 0 or usable(params) != "rigid":
            return ()
        # Whoever loads the scene says what is wrong with it.
        with contextlib.suppress(ValueError, OSError):
            camera = camera_of(worlds_of("interpolator", params).scenes[0], params["camera"])
            told = by_frames_alone(camera, params)
            return (told,) if told else ()
        return ()

    @classmethod
    def looks_back(cls, params: Mapping[str, Any]) -> int:
        """Counts the keyframes before that at the start of a gap on which its frames depend, by the method."""
        return METHODS[usable(params)].looks_back
