"""Tells readers of a camera's topics what the camera is and what there is to see."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from evis.scene.model import Camera
from evis.scene.parameters import camera_of
from evis.scene.worlds import Worlds
from msgs.camera import CameraInfo
from msgs.header import Header


def camera_info(header: Header, params: Mapping[str, Any], worlds: Worlds, sensor: Mapping[str, Any]) -> CameraInfo:
    """Makes the CameraInfo of a renderer's camera, with lens and baseline of each environment where they differ.

    params: of the node. worlds: those that it sees. sensor: parameters of the camera's sensor, {} without one.
    """
    from evis.scene.stereo import baseline

    scene = worlds.scenes[0]
    camera = camera_of(scene, params["camera"])
    kinds = ["background", *(i.semantic or i.name for i in scene.instances)]
    classes = {kind: number for number, kind in enumerate(dict.fromkeys(kinds))}
    info = CameraInfo(
        header,
        k=np.asarray(camera.k, np.float64),
        distortion=np.asarray(camera.distortion, np.float64),
        distortion_model=camera.distortion_model,
        name=camera.name,
        width=camera.width,
        height=camera.height,
        margin=params["margin"],
        envs=params["envs"],
        keyframe_rate=params["keyframe_rate"],
        instances=["background", *(i.name for i in scene.instances)],
        instance_bodies=["", *(scene.bodies[i.body].name if i.body >= 0 else "" for i in scene.instances)],
        semantic=np.array([classes[kind] for kind in kinds], np.int32),
        classes=list(classes),
        baseline=baseline(scene, camera),
        sensor=dict(sensor),
        drawn=worlds.drawn(),
    )
    lenses = [camera_of(one, params["camera"]) for one in worlds.scenes]
    apart = np.array([baseline(one, lens) for one, lens in zip(worlds.scenes, lenses)])
    if (apart != apart[0]).any() or any(lens is not camera and not same_lens(lens, camera) for lens in lenses):
        info.env_k = np.stack([np.asarray(lens.k, np.float64) for lens in lenses])
        info.env_distortion = np.array([lens.distortion for lens in lenses], np.float64).reshape(len(lenses), -1)
        info.env_baseline = apart
    return info


def same_lens(a: Camera, b: Camera) -> bool:
    """Tells whether two cameras see a point of their frame in the same pixel."""
    return bool(np.array_equal(a.k, b.k)) and a.distortion == b.distortion
