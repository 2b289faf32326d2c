"""Declares the renderer node: its parameters and topics, and what a launch can tell of it from the scene."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from typing import Any

from evis.config.params import Param
from evis.runtime.declaration import Declaration, Input, Output
from evis.scene.parameters import SCENE, SEED, ends_alone, foreseen_worlds, scene_of
from evis.scene.sampling import undersampled
from nodes.renderer import parameters
from nodes.renderer.parameters import BATCH, LIGHT


class RendererDeclaration(Declaration):
    """Declares what renders the images of a camera."""

    PARAMS = {
        **SCENE,
        "seed": SEED,
        "camera": Param(str, "cam0", "which camera of the scene"),
        "device": Param(str, "cpu", "where kernels run: cpu, cuda, cuda:1"),
        "envs": Param(int, 1, "parallel environments", minimum=1, maximum=65536),
        "margin": Param(int, 0, "pixels rendered beyond every side of the image", "px", 0, 1024),
        "threads": Param(
            int,
            0,
            "CPU threads of physics, renderer and interpolator; 0 = as cores, environments and pixels are worth",
            minimum=0,
            maximum=256,
        ),
        "half": Param(bool, False, "keyframes as float16, clipped at 65504"),
        "keyframes": Param(
            str,
            "auto",
            "what keyframes hold; auto = luminance while nobody reads colour; the events are the same",
            choices=("auto", "rgb", "luminance"),
        ),
        "samples_apart": Param(bool, False, "keyframes hold the samples, for an interpolator to average what it moved"),
        **LIGHT,
        "batch": BATCH,
        "keyframe_rate": Param(float, 30.0, "rate of the states, told to readers in /info", "Hz", 0),
        "frame_rate": Param(float, 0.0, "rate at which things are seen, to warn of what is too fast; 0 = any", "Hz", 0),
        "resolved": Param(float, 0.0, "time to which single pixels are seen between frames; 0 = frames only", "s", 0),
    }
    PER_ENVIRONMENT = True
    INPUTS = {"state": Input("/state")}
    OUTPUTS = {
        "info": Output("/{camera}/info"),
        "keyframe": Output("/{camera}/keyframe"),
        "depth": Output("/{camera}/depth"),
        "motion": Output("/{camera}/motion"),
        "ids": Output("/{camera}/ids"),
        "normal": Output("/{camera}/normal"),
    }

    @classmethod
    def without_effect(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """Names the parameters of paths where there are none."""
        return parameters.without_effect(params)

    @classmethod
    def reads(cls, params: Mapping[str, Any], port: str) -> frozenset[str] | None:
        """Asks for poses at the keyframe, where nothing is moved by an engine that may turn it too fast."""
        return ends_alone(params.get("scene")) if port == "state" else None

    @classmethod
    def imports(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """Names what is spared where a still camera sees still things: they are not drawn again."""
        from evis.scene.load import is_dynamic

        scene, camera = params.get("scene"), params.get("camera")
        if not scene or not camera:
            return {}
        try:
            if is_dynamic(scene):
                return {}
            bodies = scene_of("renderer", params, visuals=False).bodies
        except (ValueError, OSError):
            # Whoever loads the scene says what is wrong with it.
            return {}
        still = {body.name for body in bodies if body.trajectory is not None and body.trajectory.is_static()}
        if camera not in still:
            return {}
        kept = f" and {len(still) - 1} of {len(bodies) - 1} bodies" if len(still) > 1 else ""
        return {"static background": f"{camera} never moves: the world{kept} drawn once and kept"}

    @classmethod
    def foreseen(cls, params: Mapping[str, Any]) -> tuple[str, ...]:
        """Names the lights that flicker, and the prescribed motion that turns, too fast for the frames."""
        if params.get("scene") and params.get("frame_rate"):
            # Whoever loads the scene says what is wrong with it.
            with contextlib.suppress(ValueError, OSError):
                worlds = foreseen_worlds("renderer", params)
                return tuple(undersampled(worlds, params["frame_rate"], *parameters.rates_between(params)))
        return ()

    @classmethod
    def alike(cls, params: Mapping[str, Any]) -> Any:
        """Tells that renderers of the same worlds at the same rates warn of the same, whatever their cameras."""
        return {name: value for name, value in params.items() if name not in ("camera", "margin")}
