"""Makes small scenes that are hard for reprojection, one keyframe gap each, and measures how far off every method is.

The truth is dense rendering at the sub-frames' own times. What no method should get wrong (rotation, approach, thin
things, crossing, teleport) stands beside what reprojection is known to get wrong (light that moves on a surface).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from evis.geometry import se3
from evis.runtime.clock import subframe_stamps
from evis.scene.model import Body, Camera, Instance, Light, Material, Mesh, Scene, Waveform
from evis.scene.motion import Linear, Motion, Prescribed, Spin
from nodes.interpolator.auto.setting import LIGHT
from nodes.interpolator.interpolator import Interpolator
from nodes.interpolator.keyframe import States
from nodes.interpolator.methods import METHODS, reads
from nodes.renderer.renderer import Renderer

GAP = 10_000_000
"""Time between keyframes [ns]."""
START = 1_000_000_000
THRESHOLD = 0.2
UPSAMPLING = 8
WIDTH, HEIGHT, FOCAL = 96, 72, 80.0
SPEED = 1e9 / GAP
"""Gaps per second: what moves at x SPEED moves by x in a gap."""


def square(half: float, height: float | None = None) -> Mesh:
    """Makes a rectangle in z = 0 with uv from 0 to 1. half, height: half of its edges [m]."""
    size = np.array([half, half if height is None else height, 0])
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]) * size
    faces = np.array([(0, 1, 2), (0, 2, 3)], np.int32)
    uv = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)[faces]
    return Mesh(corners.astype(np.float32), faces, uv)


def painted() -> Material:
    """Makes a material with a smooth picture, 0.2 ... 0.8."""
    at = (np.arange(512) + 0.5) / 512
    u, v = np.meshgrid(at, at[::-1])
    picture = 0.5 + 0.2 * np.sin(2 * np.pi * (2 * u + 0.1)) + 0.1 * np.cos(2 * np.pi * (v + u))
    return Material("painted", np.ones(3), np.repeat(picture[..., None], 3, -1).astype(np.float32), two_sided=True)


def plain(value: float, **given: Any) -> Material:
    """Makes a material of one colour."""
    return Material(f"plain {value}", np.full(3, value), two_sided=True, **given)


def moving(place: Sequence[float], *motions: Motion) -> Prescribed:
    """Makes a body that is at `place`, not turned, half a gap after START, and moves as the motions say."""
    middle = (START + GAP // 2) * 1e-9
    start, turn = np.array(place, np.float64), np.zeros(3)
    for motion in motions:
        if isinstance(motion, Linear):
            start -= motion.velocity * middle
        elif isinstance(motion, Spin):
            turn -= motion.axis * motion.rate * middle
    return Prescribed(se3.make_pose(start, se3.exp(turn)), motions)


def along(*per_gap: float) -> Linear:
    """Makes a motion by so many metres per gap."""
    return Linear(np.array(per_gap, np.float64) * SPEED)


def turning(degrees: float, axis: Sequence[float] = (0, 0, 1)) -> Spin:
    """Makes a rotation by an angle per gap."""
    return Spin(np.array(axis, np.float64), np.radians(degrees) * SPEED)


Thing = tuple[Mesh, Material, Prescribed]


def scene_of(
    things: Sequence[Thing], camera_path: Prescribed | None = None, lights: Sequence[Light] = (), sky: float = 0.3
) -> Scene:
    """Makes a scene of things before a camera at the origin that looks along +z; without lights the sky lights it."""
    k = np.array([[FOCAL, 0, (WIDTH - 1) / 2 + 0.3], [0, FOCAL, (HEIGHT - 1) / 2 - 0.2], [0, 0, 1]])
    bodies = [Body(f"body{n}", path) for n, (_, _, path) in enumerate(things)]
    instances = [Instance(f"thing{n}", n, mesh, n) for n, (mesh, _, _) in enumerate(things)]
    materials = [material for _, material, _ in things]
    bodies.append(Body("cam0", camera_path or moving((0, 0, 0))))
    view = Camera("cam0", WIDTH, HEIGHT, k)
    return Scene("case", bodies, instances, materials, list(lights), [view], np.full(3, sky))


def wall(depth: float = 3.0, material: Material | None = None) -> Thing:
    """Makes a painted wall that fills the image and stands still."""
    return square(4.0), material or painted(), moving((0, 0, depth))


def lamp(**given: Any) -> Light:
    """Makes a point light above the camera."""
    return Light("lamp", "point", np.full(3, 40.0), np.array([0.0, -1.0, 0.0]), **given)


def rotation(degrees: float) -> Scene:
    """Makes a painted square that turns in the image by an angle per gap."""
    return scene_of([(square(0.6), painted(), moving((0, 0, 2), turning(degrees)))])


def approach(share: float) -> Scene:
    """Makes a painted wall that comes closer by a share of its distance at keyframe A."""
    far = 2.0
    return scene_of([(square(4.0), painted(), moving((0, 0, far * (1 - share / 2)), along(0, 0, -far * share)))])


def wire(pixels: float) -> Scene:
    """Makes a wire of some pixels in width that moves 10 pixels per gap before a wall."""
    depth = 2.0
    scale = depth / FOCAL
    mesh = square(pixels * scale / 2, 2.0)
    return scene_of([wall(), (mesh, plain(0.9), moving((0, 0, depth), along(10 * scale, 0, 0)))])


def crossing() -> Scene:
    """Makes two squares that pass each other, at 20 pixels per gap each."""
    step = 20 * 2.0 / FOCAL
    left = (square(0.25), plain(0.9), moving((0.1, 0, 2.0), along(step, 0, 0)))
    right = (square(0.25), painted(), moving((-0.1, 0.05, 2.2), along(-step, 0, 0)))
    return scene_of([wall(), left, right])


def turned_over() -> Scene:
    """Makes a plate under a lamp that turns by 340 degrees per gap: its back shows only between the keyframes."""
    turn, middle = turning(340, (0, 1, 0)), (START + GAP // 2) * 1e-9
    start = se3.exp(turn.axis * (np.pi - turn.rate * middle))
    plate = (square(0.5), plain(0.7), Prescribed(se3.make_pose(np.array([0.0, 0.0, 2.0]), start), (turn,)))
    return scene_of([wall(), plate], lights=[lamp()])


def leap() -> Scene:
    """Makes a square that moves by 500 pixels within a gap."""
    return scene_of([wall(), (square(0.3), plain(0.9), moving((0, 0, 2.0), along(500 * 2.0 / FOCAL, 0, 0)))])


def near_plane() -> Scene:
    """Makes a square that comes from the front through the camera's plane in mid-gap."""
    return scene_of([wall(), (square(0.05), painted(), moving((0.02, 0.01, 0.0), along(0, 0, -0.4)))])


def turned_sky() -> Scene:
    """Makes a square before the sky, seen by a camera that turns by 10 degrees per gap."""
    return scene_of([(square(0.4), painted(), moving((0, 0, 2)))], moving((0, 0, 0), turning(10, (0, 1, 0))), sky=1.0)


def shadow() -> Scene:
    """Makes a small thing whose shadow crosses a wall that stands still."""
    thing = (square(0.1), plain(0.5), moving((0, -0.6, 1.0), along(0.3, 0, 0)))
    return scene_of([wall(), thing], lights=[lamp()])


def highlight() -> Scene:
    """Makes a shiny tilting plate, over which the lamp's reflection runs."""
    plate = (square(1.5), plain(0.8, roughness=0.15, metallic=1.0), moving((0, 0, 2), turning(3, (1, 0, 0))))
    return scene_of([plate], lights=[lamp()])


def flicker() -> Scene:
    """Makes a light that flickers once per gap, so that both keyframes see it equally strong."""
    return scene_of([wall()], lights=[lamp(waveform=Waveform("sine", SPEED, 0.5))], sky=0.1)


CASES: dict[str, Callable[[], Scene]] = {
    "rotation, 20 deg per gap": lambda: rotation(20),
    "rotation, 60 deg per gap": lambda: rotation(60),
    "rotation, 120 deg per gap": lambda: rotation(120),
    "approach, 10 % per gap": lambda: approach(0.1),
    "approach, 50 % per gap": lambda: approach(0.5),
    "crosses the near plane in mid-gap": near_plane,
    "wire, 0.5 px wide, 10 px per gap": lambda: wire(0.5),
    "wire, 2 px wide, 10 px per gap": lambda: wire(2.0),
    "two things that cross": crossing,
    "500 px per gap": leap,
    "plate that turns over and back": turned_over,
    "sky, camera turns by 10 deg": turned_sky,
    "moving shadow": shadow,
    "running highlight": highlight,
    "light that flickers once per gap": flicker,
}


@dataclass
class Frames:
    """Holds the sub-frames of one gap without keyframe B, float32 [K - 1, h, w]: those of a method and the true ones.

    reshaded, filled: pixels of sub-frames that the method shaded anew, and that it guessed.
    """

    made: np.ndarray
    truth: np.ndarray
    reshaded: int
    filled: int

    def errors(self) -> np.ndarray:
        """Computes |ln I - ln I_true| in thresholds, float64 [K - 1, h, w]."""
        made, truth = (np.log(np.maximum(a.astype(np.float64), 1e-6)) for a in (self.made, self.truth))
        return np.abs(made - truth) / THRESHOLD


def states_of(scene: Scene, t: np.ndarray) -> States:
    """Computes the bodies' states in closed form, at times int64 [S] ns."""
    paths = [body.trajectory for body in scene.bodies if body.trajectory is not None]
    return States(t, np.stack([p.pose(t) for p in paths], 1)[None], np.stack([p.twist(t) for p in paths], 1)[None])


def frames_of(scene: Scene, method: str, upsampling: int = UPSAMPLING) -> Frames:
    """Makes the sub-frames of the gap from START on by one method, and renders the true ones.

    The gap before is made too, since some methods know the past by it.
    """
    camera = scene.cameras[0]
    renderer = Renderer(scene, camera)
    interpolator = Interpolator(method, upsampling, scene=scene, camera=camera)
    outputs = {LIGHT} | (reads(method) & {"depth", "motion"})
    before = None
    for k in range(3):
        stamp = START + (k - 1) * GAP
        t = np.linspace(stamp - GAP if k else stamp, stamp, 11 if k else 1).round().astype(np.int64)
        states = states_of(scene, t)
        poses = states.pose[:, -1]
        images = {n: v.copy() for n, v in renderer.render(poses, before, outputs, {}, stamp).items()}
        _, frames = interpolator.push(
            stamp, np.zeros(1, np.int32), images[LIGHT], images.get("depth"), images.get("motion"),
            states=states if "state" in reads(method) else None,
        )  # fmt: skip
        before = poses
    dense = []
    for stamp in subframe_stamps(START, START + GAP, upsampling)[:-1].tolist():
        poses = states_of(scene, np.array([stamp])).pose[:, 0]
        dense.append(renderer.render(poses, None, {LIGHT}, {}, stamp)[LIGHT][0].copy())
    report = interpolator.report
    return Frames(frames[0, :-1], np.array(dense), report.reshaded, report.filled)


def measured() -> list[dict[str, Any]]:
    """Measures every method on every case.

    Each case has, by method, `rms`, the root mean square error in thresholds, and `off`, the share of pixels that are
    off by more than one; `reshaded` is the share that `rigid` shades anew.
    """
    found = []
    for name, make in CASES.items():
        scene = make()
        case: dict[str, Any] = {"case": name, "rms": {}, "off": {}}
        for method in METHODS:
            if method == "none":
                continue
            frames = frames_of(scene, method)
            errors = frames.errors()
            case["rms"][method] = float(np.sqrt(np.mean(errors**2)))
            case["off"][method] = float((errors > 1).mean())
            if method == "rigid":
                case["reshaded"] = frames.reshaded / frames.made.size
        found.append(case)
    return found


def rows(cases: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Makes the rows of a table from what `measured` returns."""
    lines = []
    for case in cases:
        shown = {m: f"{rms:.3f} ({100 * case['off'][m]:.1f} %)" for m, rms in case["rms"].items()}
        lines.append({"case": case["case"]} | shown | {"shaded anew [%]": round(100 * case["reshaded"], 2)})
    return lines
