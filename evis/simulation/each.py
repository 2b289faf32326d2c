"""Merges the plans of environments with arguments and seeds of their own, and extracts what a step has of one of
them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from evis.config.params import EACH
from evis.runtime.plan import Plan
from evis.scene.parameters import SCENE, camera_of, scene_of
from evis.scene.stereo import baseline
from evis.shares.cut import cut
from evis.simulation.errors import SimulationError
from evis.simulation.step import IMAGE, IMAGES, CameraOutputs, Step, on_host
from msgs.camera import CameraInfo, EventPacket, EventSignal, Image, Labels, Samples
from msgs.header import Message
from nodes.event_sensor.parameters import SENSOR

OWN = ("scene_args", "seed")
"""Parameters of any node that environments may have for themselves."""


def together(plans: Sequence[Plan]) -> Plan:
    """Merges the plans that environments would have by themselves into the first of them.

    They may differ in arguments of the scene, which decide values and not what there is, in parameters of the event
    sensor, and in seeds. Raises SimulationError naming anything else.
    """
    first = plans[0]
    for env, plan in enumerate(plans):
        if list(plan.nodes) != list(first.nodes):
            raise SimulationError(f"environment {env} needs other nodes than environment 0; simulate it by itself")
        for name, node in plan.nodes.items():
            # A sensor that takes frames alone stands beside none that takes the samples between them.
            mine, others = (" and ".join(sorted(one.inputs)) for one in (node, first.nodes[name]))
            if mine != others:
                raise SimulationError(
                    f"{name} reads {mine} in environment {env} and {others} in environment 0; simulate them apart, or "
                    "give what makes the difference (defocus, crossing, model) to all"
                )
    for name, node in first.nodes.items():
        rows = [plan.nodes[name].params for plan in plans]
        own = [key for key in rows[0] if any(row[key] != rows[0][key] for row in rows)]
        may = (*OWN, *SENSOR) if node.target.endswith(":EventSensorNode") else OWN
        if shared := [key for key in own if key not in may]:
            other = next(row[shared[0]] for row in rows if row[shared[0]] != rows[0][shared[0]])
            # Nobody may have asked for it: a bag has it unless it is turned off.
            remedy = "; audit=0 leaves it out" if node.target.endswith(":AuditNode") else ""
            raise SimulationError(
                f"environments have {shared[0]} of {name} in common; environment 0 has {rows[0][shared[0]]!r}, another "
                f"one {other!r}{remedy}"
            )
        keys = dict.fromkeys([*own, *(["seed"] if "seed" in rows[0] else [])])
        if keys:
            node.params = {**node.params, EACH: [{key: row[key] for key in keys} for row in rows]}
    return first


def alone(step: Step, env: int, infos: Mapping[str, CameraInfo]) -> Step:
    """Extracts one environment from a step, as if it had been simulated by itself.

    infos: CameraInfo of each camera for that environment, in the place of one that the step has. Raises
    SimulationError for an output that cannot be taken apart.
    """
    cameras = {
        name: {key: _part(key, value, env, infos.get(name)) for key, value in vars(outputs).items() if key != IMAGE}
        for name, outputs in step.cameras.items()
    }
    if step.finished:
        # By itself an environment of which a sensor held nothing back has no packet then, and nothing beside it.
        cameras = {
            name: {key: None if _is_of_no_event(value) else value for key, value in outputs.items()}
            for name, outputs in cameras.items()
        }
    for outputs in cameras.values():
        if IMAGES in outputs:
            outputs[IMAGE] = next(reversed(outputs[IMAGES]), None)
    first = next(iter(step.cameras), "")
    of_no_camera = {
        key: _part(key, value, env, None)
        for key, value in vars(step).items()
        if key not in _OF_STEP and key not in vars(step.cameras.get(first, _NONE))
    }
    return Step(step.stamp_ns, step.episodes[env : env + 1], cameras, of_no_camera, step.over, step.finished)


_NONE = CameraOutputs({})
_OF_STEP = ("stamp_ns", "episodes", "over", "finished", "cameras")
"""What a step has besides outputs."""


def _is_of_no_event(value: Any) -> bool:
    """Tells whether an output goes with a packet of events, and has none."""
    if isinstance(value, EventPacket | EventSignal):
        return not value.env_offsets[-1]
    return isinstance(value, Labels) and value.event_env is not None and not len(value.event_env)


def _part(name: str, value: Any, env: int, info: CameraInfo | None) -> Any:
    if value is None or isinstance(value, CameraInfo):
        return None if value is None else info
    if isinstance(value, EventPacket):
        return _events(value, env)
    if isinstance(value, EventSignal):
        return _signal(value, env)
    if isinstance(value, Samples):
        return on_host(value).of(slice(env, env + 1))
    if name == IMAGES:
        return tuple(_image(image) for image in value if image.env == env)
    return _message(value, env) if isinstance(value, Message) else value[env : env + 1]


def _image(image: Image) -> Image:
    """Gives the image of an environment that is by itself."""
    whole: Any = image
    alone: Image = dataclasses.replace(whole, env=0, envs=1)
    return alone


def _events(packet: EventPacket, env: int) -> EventPacket:
    packet = on_host(packet)
    first, end = packet.env_offsets[env : env + 2].tolist()
    columns: dict[str, Any] = {name: getattr(packet, name) for name in ("t", "x", "y", "p", "c")}
    columns = {name: column if column is None else column[first:end] for name, column in columns.items()}
    whole: Any = packet
    part: EventPacket = dataclasses.replace(whole, **columns, env_offsets=np.array([0, end - first]))
    return part


def _signal(told: EventSignal, env: int) -> EventSignal:
    first, end = told.env_offsets[env : env + 2].tolist()
    return EventSignal(told.header, np.array([0, end - first]), on_host(told).signal[first:end])


def _message(message: Message, env: int) -> Message:
    whole: Any = message
    part: Message = dataclasses.replace(whole, **cut(message, slice(env, env + 1)))
    return part


def info_of(info: CameraInfo, env: int, plan: Plan, physics: str) -> CameraInfo:
    """Extracts the CameraInfo of one environment, as it would have been by itself.

    info: of all of them. plan: that of the environment by itself. physics: its node that steps the world.
    """
    scene = scene_of("simulation", {key: plan.nodes[physics].params.get(key) for key in (*SCENE, "seed")})
    lens: dict[str, Any] = {}
    if info.env_k is not None and info.env_distortion is not None:
        lens = {"k": info.env_k[env], "distortion": info.env_distortion[env], "env_k": None, "env_distortion": None}
        lens["env_baseline"] = None
    drawn = {place: values[env : env + 1] for place, values in info.drawn.items() if values[env] is not None}
    sensor = plan.sensors.get(f"/{info.name}", {})
    apart = baseline(scene, camera_of(scene, info.name))
    return dataclasses.replace(info, envs=1, sensor=sensor, drawn=drawn, baseline=apart, **lens)
