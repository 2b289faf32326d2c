"""Scenes whose radiance is known at every time, keyframes of them, and dense rendering at the sub-frames' own times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from evis.geometry import se3
from evis.runtime.clock import subframe_stamps
from evis.scene.model import Body, Camera, Instance, Light, Material, Mesh, Scene
from evis.scene.motion import Prescribed
from nodes.interpolator.keyframe import KeyframeView, Report, States
from nodes.interpolator.luminance import luminance_of
from nodes.interpolator.rigid import Rigid, RigidOptions
from nodes.interpolator.splat.splat import make_splat
from nodes.renderer.renderer import Renderer

GAP = 10_000_000
"""Time between keyframes [ns]."""
WIDTH, HEIGHT, FOCAL = 96, 72, 80.0
START = 1_000_000_000


def camera(width=WIDTH, height=HEIGHT, focal=FOCAL, near=1e-3, model="none", coefficients=()):
    k = np.array([[focal, 0, (width - 1) / 2 + 0.3], [0, focal, (height - 1) / 2 - 0.2], [0, 0, 1]])
    return Camera("cam0", width, height, k, near, model, coefficients)


def pose(x=0.0, y=0.0, z=0.0, turn=(0.0, 0.0, 0.0)):
    return se3.make_pose(np.array([x, y, z], np.float64), se3.exp(np.array(turn, np.float64)))


def wave(u, v):
    """A smooth picture, 0.2 ... 0.8; u and v in 0 ... 1."""
    return 0.5 + 0.2 * np.sin(2 * np.pi * (2 * u + 0.1)) + 0.1 * np.cos(2 * np.pi * (v + u))


def painted(size=512):
    """Material that shows `wave`, under a light that is everywhere 1."""
    at = (np.arange(size) + 0.5) / size
    u, v = np.meshgrid(at, at[::-1])
    return Material("wave", np.ones(3), np.repeat(wave(u, v)[..., None], 3, -1).astype(np.float32), two_sided=True)


def plain(value):
    return Material(f"plain {value}", np.full(3, value, np.float64), two_sided=True)


def quad(half):
    """Square in z = 0, uv from 0 to 1, seen from both sides."""
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float32) * half
    faces = np.array([(0, 1, 2), (0, 2, 3)], np.int32)
    uv = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)[faces]
    return Mesh(corners.astype(np.float32), faces, uv)


def disc(radius, segments=90):
    angle = 2 * np.pi * np.arange(segments) / segments
    rim = np.stack([np.cos(angle), np.sin(angle), 0 * angle], -1)
    vertices = np.concatenate([[[0, 0, 0]], rim]).astype(np.float32)
    faces = np.array([(0, 1 + i, 1 + (i + 1) % segments) for i in range(segments)], np.int32)
    return Mesh(vertices * np.float32(radius), faces, (vertices[:, :2] / 2 + 0.5)[faces])


def world(things, view=None, camera_motion=None, lights=(), sky=0.3, spares=()):
    """things: (mesh, material, motion); motion a Prescribed, None for a body that physics moves, or "world".

    The sky is the only light unless there are others; a surface is as bright as it is white.
    """
    view = view or camera()
    bodies, instances, materials = [], [], []
    for n, (mesh, material, motion) in enumerate(things):
        on = -1
        if motion != "world":
            on = len(bodies)
            bodies.append(Body(f"body{n}", motion))
        instances.append(Instance(f"thing{n}", on, mesh, n))
        materials.append(material)
    bodies += [Body(name, motion) for name, motion in spares]
    bodies.append(Body("cam0", camera_motion or Prescribed(pose())))
    return Scene("test", bodies, instances, materials, list(lights), [view], np.full(3, sky))


def closed_form(scene, t):
    """States of all bodies at times int64 [S]; a body without trajectory stands at the origin."""
    none = Prescribed(pose())
    paths = [body.trajectory or none for body in scene.bodies]
    return States(t, np.stack([p.pose(t) for p in paths], 1)[None], np.stack([p.twist(t) for p in paths], 1)[None])


@dataclass
class Gap:
    """Frames of one gap, by `rigid` and (splat) by the motion vectors, and the true ones, float [K, h, w]."""

    frames: np.ndarray
    dense: np.ndarray
    report: Report
    splat: np.ndarray | None = None

    def error(self, frames=None):
        """|ln I - ln I_true| of the frames between the keyframes."""
        frames = self.frames if frames is None else frames
        return np.abs(np.log(frames[:-1].astype(np.float64)) - np.log(self.dense[:-1]))


def luminance(radiance):
    return radiance.astype(np.float64) @ np.array([0.2126, 0.7152, 0.0722])


def keyframe(renderer, states, before, stamp, outputs=("radiance",)):
    images = renderer.render(states.pose[:, -1], before, outputs, {}, stamp)
    motion = images.get("motion")
    return KeyframeView(
        luminance_of(images["radiance"].copy()),
        wp.array(images["depth"].copy(), device="cpu") if "depth" in images else None,
        wp.array(motion.copy(), dtype=wp.float32, device="cpu") if motion is not None else None,
        states,
        stamp,
    )


def cross(scene, upsampling=4, margin=0, gap=GAP, states=closed_form, splat=False, **options):
    """One gap from START on. states: (scene, times) -> States, for bodies that physics moves."""
    view = scene.cameras[0]
    light = {name: options[name] for name in ("paths", "light_samples") if name in options}
    renderer = Renderer(scene, view, margin=margin, **light)
    stamps = subframe_stamps(START, START + gap, upsampling)
    outputs = ("radiance", "depth", "motion")
    at = [np.array([START - gap, START]), np.linspace(START, START + gap, 11).round().astype(np.int64)]
    first, second = (states(scene, t) for t in at)
    a = keyframe(renderer, first, first.pose[:, 0], START, outputs)
    b = keyframe(renderer, second, first.pose[:, -1], START + gap, outputs)
    h, w = view.height, view.width
    out = np.full((1, upsampling, h, w), np.nan, np.float32)
    device = options.pop("device", "cpu")
    rigid = Rigid(scene, view, 1, upsampling, margin, device=device, options=RigidOptions(**options))
    report = rigid.between(a, b, [False], out)
    inner = Renderer(scene, view, **light)
    dense = [
        luminance(inner.render(states(scene, np.array([t])).pose[:, 0], t_ns=int(t))["radiance"])[0] for t in stamps
    ]
    result = Gap(out[0], np.array(dense), report)
    if splat:
        warped = np.empty_like(out)
        make_splat(h + 2 * margin, w + 2 * margin, 1, upsampling, margin).between(a, b, [False], warped)
        result.splat = warped[0]
    return result


def lamp(**given):
    return Light("lamp", "point", np.full(3, 40.0), np.array([0.0, -1.0, 0.0]), **given)
