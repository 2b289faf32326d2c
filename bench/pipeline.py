"""The simulator's pure parts in a row, in one process and without the bus: what a method costs by itself."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from bench.metrics import Stream
from evis.clock import keyframe_count, keyframe_stamp
from evis.scene import load_scene
from nodes.event_sensor.sensor import EventSensor
from nodes.interpolator.interpolator import Interpolator
from nodes.renderer.renderer import Renderer


@dataclass
class Run:
    """Events of a run, and the wall time [s] of its stages (set-up and compilation excluded)."""

    stream: Stream
    render_s: float
    interpolate_s: float
    sense_s: float

    @property
    def wall_s(self) -> float:
        """All three stages."""
        return self.render_s + self.interpolate_s + self.sense_s


def simulate(
    scene_name: str,
    overrides: dict[str, object],
    method: str,
    keyframe_rate: float,
    upsampling: int,
    duration_s: float,
    threshold: float = 0.2,
    camera_name: str = "cam0",
) -> Run:
    """One environment of a scene with prescribed motion, from t = 0 for duration_s."""
    scene = load_scene(scene_name, overrides)
    camera = scene.camera(camera_name)
    renderer = Renderer(scene, camera)
    interpolator = Interpolator(method, upsampling)
    sensor = EventSensor(camera.height, camera.width, threshold_on=threshold, threshold_off=threshold)
    outputs = {"radiance"} if method == "none" else {"radiance", "depth", "motion"}
    interpolator.warm_up()
    episodes = np.zeros(1, np.int32)
    previous, parts = None, []
    spent = np.zeros(3)
    for k in range(keyframe_count(round(duration_s * 1e9), keyframe_rate)):
        stamp = keyframe_stamp(k, keyframe_rate)
        at = np.array([stamp])
        poses = np.stack([b.trajectory.pose(at)[0] for b in scene.bodies if b.trajectory is not None])[None]
        clock = [time.perf_counter()]
        images = renderer.render(poses, previous, outputs, {})
        clock.append(time.perf_counter())
        t, frames = interpolator.push(
            stamp, episodes, images["radiance"].copy(), _own(images, "depth"), _own(images, "motion"), 0, _allocate
        )
        clock.append(time.perf_counter())
        parts.append(sensor.process(frames, t, episodes))
        clock.append(time.perf_counter())
        if k:  # the first keyframe compiles and only sets the reference
            spent += np.diff(clock)
        previous = poses
    fields = (np.concatenate([getattr(e, name) for e in parts]) for name in "txyp")
    return Run(Stream(*fields, camera.width, camera.height), *spent)


def _own(images: dict[str, np.ndarray], name: str) -> np.ndarray | None:
    """A copy: the renderer writes its next image into the same memory, and the interpolator remembers this one."""
    return images[name].copy() if name in images else None


def _allocate(shape: tuple[int, ...]) -> np.ndarray:
    return np.empty(shape, np.float32)
