"""Replaces `interpolator:=auto` of a launch file by method, keyframe rate and K, and `upsampling:=auto` by K alone, by
measuring the scene beforehand.

The choice is made of arguments, so that the plan, the bag and the result hold it like any other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from evis.gpu.devices import device_named
from evis.launch.arguments import ArgumentError, resolve
from evis.launch.expand import NodeSpec, expand
from evis.launch.files import LaunchFile
from evis.launch.planner import Options
from evis.scene.parameters import camera_of, scene_of
from nodes.event_sensor.parameters import frames_only
from nodes.event_sensor.scene_parameters import resolve_with_scene
from nodes.interpolator.auto import cache
from nodes.interpolator.auto.choice import Choice, frames_beside_samples
from nodes.interpolator.auto.probe import Say, probe
from nodes.interpolator.auto.setting import Setting
from nodes.interpolator.auto.trial import Measured, settle
from nodes.interpolator.samples import by_frames_alone
from nodes.renderer.parameters import light_options

SENSOR = ("threshold", "threshold_on", "threshold_off", "crossing", "dark_level")
"""The sensor's parameters that count; noise is no matter of how frames are made."""
WARP = ("tolerance",)
"""The interpolator's parameters that count."""
LONGEST_S = 2.0
"""How much of a run's beginning is looked at [s]; of one without an end, 1 s."""


def replace_auto(
    launch: LaunchFile, given: Mapping[str, Any], options: Options, say: Say, warn: Say
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Replaces auto in the arguments of a launch file; gives them, and what was chosen and why, for people and the bag.

    Args:
        launch: a launch file whose interpolator or upsampling is auto.
        given: its arguments.
        options: as for planning it.
        say: told what is being measured, line by line.
        warn: told what went wrong beside the choice.

    Raises ValueError where the scene cannot be measured or a wish makes no sense.
    """
    values = resolve(launch.path.name, launch.arguments, given)
    method = values["interpolator"]
    # Any method with frames in between stands for the choice, so that all nodes are there with their parameters.
    stand_in = {**given, "interpolator": "rigid" if method == "auto" else method, "upsampling": 2}
    graph = expand(launch, stand_in, options.names())
    wishes: dict[str, Any] = {key: values[key] if key in given else None for key in ("keyframe_rate", "upsampling")}
    if wishes["upsampling"] == "auto":
        wishes["upsampling"] = None
    if method != "auto":
        wishes |= {"methods": (method,), "keyframe_rate": values["keyframe_rate"]}
    own_rates = bool(graph.values.get("camera_rate"))
    if own_rates:
        # The rates of the others are fractions of it; what is measured is the first camera at its own.
        wishes["keyframe_rate"] = next(n.params["keyframe_rate"] for n in graph.nodes if n.type == "renderer")
    if values["time_tolerance"] > 0:
        nodes = [node for node in graph.nodes if node.type == "interpolator"]
        alone = method == "rigid" and (any(map(_by_frames_alone, nodes)) or any(map(_senses_frames_alone, graph.nodes)))
        # What goes by frames has as many as beside the closest samples.
        tolerance = 0.0 if alone else values["time_tolerance"]
        return _beside_samples(given, method, wishes["keyframe_rate"], tolerance, bool(values.get("image")))
    setting = setting_of(graph.nodes, options.duration_s, wishes)
    found, cached = measured(setting, say)
    tried = len(found.trials)
    choice = settle(setting, found, values["wanted_error"], values["wanted_rtf"], say)
    if not cached or len(found.trials) > tried:
        try:
            cache.write(setting, found)
        except OSError as error:
            warn(f"what was measured is not kept: {error}")
    best = choice.candidate
    taken: dict[str, Any] = {
        "interpolator": best.method,
        "keyframe_rate": values["keyframe_rate"] if own_rates else best.keyframe_rate,
        "upsampling": best.upsampling,
    }
    chosen = taken | _described(choice, found, values, cached)
    return {**given, **taken}, chosen


def _described(choice: Choice, found: Measured, values: Mapping[str, Any], cached: bool) -> dict[str, Any]:
    """Describes what is told of a choice beside the arguments: why, what to expect, and out of how many candidates."""
    best = choice.candidate
    expectation = {
        "expected_error": best.error,
        "expected_s_per_simulated_s": best.seconds,
        "candidates": len(found.candidates),
        "trials": len(found.trials),
    }
    expected = f"error {best.error:.3g} of 1, {best.seconds:.3g} s per simulated second"
    told: dict[str, Any] = {"why": choice.why}
    if values["wanted_error"] is not None or values["wanted_rtf"] is not None:
        told["wish_kept"] = choice.met
    return told | expectation | {"from_cache": cached, "summary": f"{best}: {choice.why}; expected: {expected}"}


def _by_frames_alone(node: NodeSpec) -> bool:
    """Tells whether the pixels of an interpolator's camera take no samples between frames."""
    p = node.params
    camera = camera_of(scene_of("interpolator", p), p.get("camera") or "cam0")
    return bool(by_frames_alone(camera, p))


def _senses_frames_alone(node: NodeSpec) -> bool:
    """Tells whether a node is a sensor that takes no samples between frames."""
    if node.type != "event_sensor":
        return False
    return bool(frames_only(resolve_with_scene("event sensor", node.params)))


def _beside_samples(
    given: Mapping[str, Any], method: str, keyframe_rate: float, time_tolerance: float, images: bool
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Chooses K for a run with `time_tolerance` [s], which needs no measuring; 0 = of whose pixels all go by frames.

    images: of a frame sensor are made, whose motion blur is of frames alone.
    """
    if method == "auto":
        raise ArgumentError("interpolator:=auto compares frames alone; with time_tolerance write interpolator:=rigid")
    if method != "rigid":
        raise ArgumentError(f"time_tolerance goes with interpolator:=rigid alone, and this is {method}")
    k = frames_beside_samples(keyframe_rate, 0.0 if images else time_tolerance)
    taken, rate = {"upsampling": k}, k * keyframe_rate
    how = "; time_tolerance decides the error, by samples between them"
    if time_tolerance == 0:
        how = ", by which all pixels go"
    elif 2 * time_tolerance * rate >= 1:
        how = ", which are as close as time_tolerance asks for: there are no samples between them"
    why = f"about {rate:.0f} frames per second{how}"
    summary = f"rigid, {keyframe_rate:g} keyframes per second x {taken['upsampling']}: {why}"
    return {**given, **taken}, {**taken, "why": why, "summary": summary}


def setting_of(nodes: Sequence[NodeSpec], duration_s: float | None, wishes: Mapping[str, Any]) -> Setting:
    """Collects from a graph what is to be measured: its first renderer and what follows it. wishes: the user's
    keyframe_rate and upsampling, or None, and the methods to choose from if not all."""
    by_type = {node.type: node.params for node in reversed(nodes)}
    if not {"renderer", "event_sensor"} <= by_type.keys():
        raise ValueError("interpolator auto needs a graph with a renderer and an event sensor to measure")
    p = by_type["renderer"]
    scene = scene_of("renderer", p)
    camera = camera_of(scene, p.get("camera") or "cam0")
    asked = by_type["event_sensor"]
    full = resolve_with_scene("event sensor", {**asked, "preset": asked.get("preset") or "ideal"})
    sensor = {key: full[key] for key in SENSOR if full[key] is not None}
    frames = by_type.get("interpolator", {})
    if p.get("supersampling"):
        camera = replace(camera, supersampling=int(p["supersampling"]))
    # What several devices share is measured on the first of them.
    devices = p["device"].split(",")
    return Setting(
        scene,
        camera,
        round(min(duration_s or 1.0, LONGEST_S) * 1e9),
        seed=by_type.get("physics", {}).get("seed") or 0,
        sensor=sensor,
        light=light_options(p),
        warp={key: frames[key] for key in WARP if frames.get(key) is not None},
        device=devices[0],
        envs=-(-p["envs"] // len(devices)),
        # One thread's CPU time can be told from that of other programs.
        threads=p["threads"] or 1,
        margin=p["margin"],
        **wishes,
    )


def measured(setting: Setting, say: Say) -> tuple[Measured, bool]:
    """Gives cost and error of every candidate, read from the cache or measured, and whether they were in the cache."""
    device_named(setting.device)
    known = cache.read(setting)
    return (known, True) if known is not None else (probe(setting, say), False)
