"""Declares the event sensor's node: its parameters and topics, and what a launch can tell of the sensor from them."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from evis.config.params import EACH, Param
from evis.runtime.declaration import Declaration, Input, Output
from evis.scene.parameters import SCENE, of_environment
from nodes.event_sensor.parameters import NODE, PRESET, preset_name, source_of, unused_samples, why_unmarked
from nodes.event_sensor.presets import PRESETS
from nodes.event_sensor.scene_parameters import check_shared, has_parameters, resolve_with_scene


class EventSensorDeclaration(Declaration):
    """Declares what turns the light that a camera sees into events."""

    PARAMS = {
        "camera": Param(str, "cam0", "which camera of the scene"),
        "source": Param(
            str,
            "frames",
            "samples or frames (interpolator), or keyframe (renderer, K = 1); a sensor that cannot take "
            "further samples between the frames reads frames instead",
            choices=("frames", "samples", "keyframe"),
        ),
        "preset": PRESET,
        "seed": Param(int, 0, "seed of the sensor's random streams; environment k has seed + k", "", 0, 2**63 - 1),
        "device": Param(str, "cpu", "where kernels run: cpu, cuda, cuda:1"),
        "colour": Param(bool, False, "colour events: three sensors, for R, G and B, instead of one for luminance"),
        "envs": Param(int, 1, "parallel environments; environment k has the random numbers of seed + k", "", 1, 65536),
        "scene": replace(SCENE["scene"], help="world that is seen, whose `sensor:` gives parameters"),
        "scene_args": SCENE["scene_args"],
        **NODE,
    }
    BRINGS = {"preset": {name: {"width": p.width, "height": p.height} for name, p in PRESETS.items() if p.width}}
    PER_ENVIRONMENT = True
    INPUTS = {
        "frames": Input("/{camera}/frames", on_device=True),
        "samples": Input("/{camera}/samples", on_device=True),
        "keyframe": Input("/{camera}/keyframe", on_device=True),
    }
    OUTPUTS = {"events": Output("/{camera}/events"), "signal": Output("/{camera}/signal", late=False)}

    @classmethod
    def without_effect(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """Names parameters that the event model lacks, or that another one turns off."""
        from nodes.event_sensor.effects import without_effect

        return without_effect(resolve_with_scene("event sensor", params))

    @classmethod
    def foreseen(cls, params: Mapping[str, Any]) -> tuple[str, ...]:
        """Tells that samples between frames are asked for, and the sensor takes frames alone."""
        return unused_samples(params["source"], resolve_with_scene("event sensor", params))

    @classmethod
    def random(cls, params: Mapping[str, Any]) -> tuple[str, ...]:
        """Names the faults that are drawn."""
        from nodes.event_sensor import effects

        resolved = resolve_with_scene("event sensor", params)
        return effects.random(resolved)

    @classmethod
    def sensor(cls, params: Mapping[str, Any]) -> Mapping[str, Any]:
        """Describes the sensor: its name, the preset, the seed, and every parameter that has a value, those of the
        preset too."""
        preset = params["preset"]
        resolved = resolve_with_scene("event sensor", params)
        about = {"sensor": preset_name(preset), "preset": preset, "seed": params["seed"], "colour": params["colour"]}
        return {**about, **{name: value for name, value in resolved.items() if value is not None}}

    @classmethod
    def needs(cls, params: Mapping[str, Any], wanted: frozenset[str]) -> frozenset[str]:
        """Names the input: samples or frames where an interpolator runs, keyframes where it is left out."""
        return frozenset({source_of(params["source"], lambda: resolve_with_scene("event sensor", params))})

    @classmethod
    def missing(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """Names the marks of events, where the sensor cannot tell which of them noise made."""
        with contextlib.suppress(OSError, ValueError):  # who loads the scene says so
            why = why_unmarked(params["camera"], [resolve_with_scene("event sensor", params)])
            return {"signal": why} if why else {}
        return {}

    @classmethod
    def reads(cls, params: Mapping[str, Any], port: str) -> frozenset[str] | None:
        """Says that of keyframes luminance will do, unless there are sensors for each colour, and that nobody needs the
        frames' counts."""
        if port == "frames":
            return frozenset({"rgb" if params["colour"] else "luminance"})
        if port == "samples":
            return frozenset({"rgb", "further_rgb"} if params["colour"] else {"luminance", "further"})
        return frozenset({"radiance" if params["colour"] else "luminance"}) if port == "keyframe" else None

    @classmethod
    def check_seed(cls, params: Mapping[str, Any], wanted: frozenset[str], env: int, seed: int) -> None:
        """Raises ValueError where a seed draws a sensor that cannot be there, or not in place of the run's."""
        if not has_parameters(params):
            return
        own = {name: value for name, value in of_environment(params, env).items() if name != EACH}
        drawn = resolve_with_scene("event sensor", {**own, "seed": seed})
        run, of_run = f"with seed {of_environment(params, 0)['seed']}", resolve_with_scene("event sensor", params)
        check_shared("event sensor", drawn, f"with seed {seed}", of_run, run)
        if "signal" in wanted and (why := why_unmarked(params["camera"], [drawn])):
            raise ValueError(f"event sensor: {why}")
