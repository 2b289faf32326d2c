"""Runs a scene through renderer and interpolator and gives what an audit gets, without bus and processes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from evis.geometry import se3
from evis.runtime.clock import keyframe_count, keyframe_stamp
from evis.scene.load import load_scene
from evis.scene.model import Scene
from msgs.header import Header
from msgs.world import WorldState
from nodes.audit.audit import Audit, AuditOptions
from nodes.event_sensor.input.further import Further
from nodes.interpolator.interpolator import Interpolator
from nodes.interpolator.keyframe import States
from nodes.renderer.renderer import Renderer

LIGHT_SCENES = Path(__file__).parents[2] / "bench" / "interpolation" / "light_scenes"
SUBSTEPS = 34


def small(name: str, width: int = 48, height: int = 36, **overrides: Any) -> Scene:
    """A scene of bench/interpolation/light_scenes, or one that comes with evis."""
    path = LIGHT_SCENES / f"{name}.yaml"
    return load_scene(str(path) if path.is_file() else name, {"width": width, "height": height, **overrides})


def poses_at(scene: Scene, t: np.ndarray) -> np.ndarray:
    """Poses float64 [T, N, 7]; what physics moves is at the origin."""
    paths = (body.trajectory for body in scene.bodies)
    return np.stack([np.tile(se3.IDENTITY, (len(t), 1)) if p is None else p.pose(t) for p in paths], 1)


def gaps(
    scene: Scene, seconds: float, rate: float, k: int, method: str, episode: int = 0, time_tolerance: float = 0.0
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, WorldState, int, Further | None]]:
    """Frames [1, K, h, w], stamps, episodes, states, margin and further samples of one gap after another."""
    camera = scene.cameras[0]
    finer: dict[str, Any] = {"time_tolerance": time_tolerance} if time_tolerance else {}
    renderer, interpolator = Renderer(scene, camera), Interpolator(method, k, scene=scene, camera=camera, **finer)
    episodes, before = np.full(1, episode, np.int32), 0
    for n in range(keyframe_count(round(seconds * 1e9), rate)):
        stamp = keyframe_stamp(n, rate)
        t = np.linspace(before, stamp, SUBSTEPS).astype(np.int64) if n else np.zeros(1, np.int64)
        poses = poses_at(scene, t)[None]
        twists = np.zeros((*poses.shape[:3], 6))
        light = renderer.render(poses[:, -1], None, ("luminance",), t_ns=stamp)["luminance"].copy()
        stamps, frames = interpolator.push(stamp, episodes, light, None, None, states=States(t, poses, twists))
        state = WorldState.dense(Header(stamp), t, poses, twists, episodes)
        further = None if interpolator.further is None else Further(*interpolator.further.arrays(False))
        yield np.asarray(frames), stamps, episodes, state, 0, further
        before = stamp


def audited(
    scene: Scene,
    pixels: int,
    *,
    seed: int = 0,
    seconds: float = 0.1,
    rate: float = 30,
    k: int = 32,
    method: str = "rigid",
    given: Mapping[str, Any] | None = None,
) -> Audit:
    """An audit after a whole run."""
    horizon = round(seconds * 1e9)
    audit = Audit(scene, scene.cameras[0], AuditOptions(pixels, seed=seed, horizon_ns=horizon, **(given or {})))
    for gap in gaps(scene, seconds, rate, k, method):
        audit.push(*gap)
    audit.finish()
    return audit
