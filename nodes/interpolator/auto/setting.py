"""Describes how a scene is going to be run, for the probe, and the rates that it tries."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import warp as wp

from evis.runtime.clock import NS
from evis.scene.model import Camera, Scene
from nodes.interpolator.interpolator import Interpolator
from nodes.interpolator.pixel_means import Allocate, new_frames
from nodes.renderer.renderer import Renderer
from nodes.renderer.supersampling import SupersampledRenderer

LIGHT = "luminance"
"""What keyframes carry where nobody reads their colour."""
METHODS = ("none", "splat", "rigid")
RATES = (31.25, 62.5, 125.0, 250.0)
"""Keyframe rates [Hz] that are tried where the user gives none; of `none`, where K is given, the last one alone."""
FRAME_RATES = (250, 500, 1000, 2000, 4000)
"""Frames per second, about, that are tried with every keyframe rate; for dense rendering also half of the least."""
REFERENCE_HZ = {8000: 1.5, 4000: 3.0, 2000: 3.0}
"""Rates of dense rendering that errors may be against [Hz], and how long it may take [s]; the last has no choice."""
Way = tuple[str, float, int]
"""Method, keyframe rate [Hz], K."""


@dataclass
class Setting:
    """Holds how a scene is going to be run, as far as it decides cost and error.

    methods: those to choose from. keyframe_rate, upsampling: the user's own, or None. sensor: parameters of EventSensor
    without noise. light: options of the renderer (light_samples, paths). warp: options of the interpolator (tolerance).
    """

    scene: Scene
    camera: Camera
    duration_ns: int
    seed: int = 0
    device: str = "cpu"
    envs: int = 1
    threads: int = 1
    margin: int = 0
    methods: tuple[str, ...] = METHODS
    keyframe_rate: float | None = None
    upsampling: int | None = None
    sensor: dict[str, Any] = field(default_factory=dict)
    light: dict[str, Any] = field(default_factory=dict)
    warp: dict[str, Any] = field(default_factory=dict)

    def shifted(self) -> Setting:
        """Gives the same setting with moving bodies placed by states alone, not by their paths, so that the probe may
        use stamps other than the world's times."""
        still = [b.trajectory is not None and b.trajectory.is_static() for b in self.scene.bodies]
        bodies = [b if fixed else replace(b, trajectory=None) for b, fixed in zip(self.scene.bodies, still)]
        return replace(self, scene=replace(self.scene, bodies=bodies))

    @property
    def measured_methods(self) -> tuple[str, ...]:
        """Gives the methods to be measured: dense rendering always, for errors are against it."""
        return ("none", *(method for method in self.methods if method != "none"))

    def samples(self, method: str) -> int:
        """Gives the samples per pixel and axis that keyframes have when the method gets them."""
        return self.camera.supersampling if method == "rigid" else 1

    @property
    def on_gpu(self) -> bool:
        """Tells whether images stay on a GPU."""
        return self.device.startswith("cuda")

    def clock(self) -> float:
        """Reads a clock [s]: CPU time where one thread does all the work, as other programs may be running; else wall
        time."""
        if self.on_gpu:
            wp.init()
            wp.synchronize_device(self.device)
            return time.perf_counter()
        return time.process_time() if self.threads == 1 else time.perf_counter()


@dataclass(eq=False)
class Grid:
    """Holds rates that fit each other: every frame of a candidate is at a stamp of the reference.

    base: reference [Hz]. ways: (method, keyframe rate, K).
    """

    base: float
    ways: list[Way]

    @staticmethod
    def of(setting: Setting, reference_hz: float = max(REFERENCE_HZ)) -> Grid:
        """Makes the grid of the rates that the user's keyframe rate and K leave. reference_hz: about that of the
        reference."""
        rates = [f for f in FRAME_RATES if 2 * f <= reference_hz]
        rate, given = setting.keyframe_rate, setting.upsampling
        odd = given // (given & -given) if given else 1
        base = (rate or RATES[0]) * odd
        while base * np.sqrt(2) < reference_hz:
            base *= 2
        shortest = 0.999 * NS / setting.duration_ns
        ks = [given] if given else [2**n for n in range(8)]
        ways = set()
        for method in setting.measured_methods:
            for r in [rate] if rate else _rates(method, shortest):
                for k in ks:
                    fits = given or any(abs(np.log2(r * k / f)) <= 0.5 for f in rates)
                    if method == "none" and (rate or given) and (given or r * k <= base / 2):
                        ways.add((method, r, k))
                    elif method != "none" and k > 1 and fits:
                        ways.add((method, r, k))
        if not rate and not given:
            ways |= {("none", float(f), 1) for f in (rates[0] / 2, *rates)}
        top = max(r * k for _, r, k in ways)
        while base < 2 * top:
            base *= 2
        return Grid(base, sorted(ways))

    @property
    def gap(self) -> int:
        """Counts the steps of the reference in the longest gap between keyframes."""
        return max(round(self.base / r) for _, r, k in self.ways)

    @property
    def length(self) -> int:
        """Returns the duration of the longest gap between keyframes [ns]."""
        return self.stamp(0, self.gap)

    def stamp(self, start_ns: int, step: int) -> int:
        """Gives the time of a step of the reference in a window that starts at start_ns [ns]."""
        return start_ns + round(step * NS / self.base)


def _rates(method: str, shortest: float) -> list[float]:
    """Gives the keyframe rates [Hz] that are tried, with a gap at most as long as the run."""
    tried = RATES[-1:] if method == "none" else RATES
    return [r for r in tried if r >= shortest] or [RATES[-1]]


def make_interpolator(s: Setting, scene: Scene, camera: Camera, method: str, k: int) -> Interpolator:
    """Makes the interpolator as the graph would. camera: of the image or a cut-out of it; k: frames per gap K."""
    how: dict[str, Any] = {"device": s.device, "threads": s.threads, **s.light, **s.warp}
    return Interpolator(method, k, scene=scene, camera=camera, **how)


def make_renderer(s: Setting, camera: Camera, method: str, **how: Any) -> Renderer | SupersampledRenderer:
    """Makes the renderer as the graph would before a method. how: further arguments of Renderer."""
    if camera.supersampling > 1:
        apart = method == "rigid"
        return SupersampledRenderer(s.scene, camera, camera.supersampling, **how, **s.light, apart=apart)
    return Renderer(s.scene, camera, **how, **s.light)


class Renderers:
    """Makes the renderers before methods when they are first asked for, and keeps them."""

    def __init__(self, s: Setting, camera: Camera, **how: Any) -> None:
        """Takes a setting and a camera. how: further arguments of Renderer."""
        self._setting, self._camera, self._how = s, camera, how
        self._made: dict[bool, Renderer | SupersampledRenderer] = {}

    def before(self, method: str) -> Any:
        """Gives the renderer before a method; one that hands on samples is another than one that averages them."""
        apart = self._setting.samples(method) > 1
        if apart not in self._made:
            self._made[apart] = make_renderer(self._setting, self._camera, method, **self._how)
        return self._made[apart]


def draw(s: Setting, renderer: Any, poses: np.ndarray, before: Any, outputs: set[str], stamp: int) -> dict[str, Any]:
    """Renders images into the renderer's own memory, of numpy or on a GPU, as the graph hands them on.

    Args:
        s, renderer: of make_renderer.
        poses: of the bodies, float64 [E, N, 7].
        before: poses at the keyframe before, LAST (those of the last call) or None.
        outputs: names of the images.
        stamp: time of the images [ns].
    """
    return renderer.render(poses, before, outputs, renderer.buffers(outputs) if s.on_gpu else {}, stamp)


def copied(s: Setting, images: dict[str, Any]) -> dict[str, Any]:
    """Copies images of `draw`, since the interpolator remembers them."""
    return {name: wp.clone(image) if s.on_gpu else image.copy() for name, image in images.items()}


def frames_for(s: Setting) -> Allocate:
    """Gives the function that allocates memory for frames, as in the graph."""
    if not s.on_gpu:
        return new_frames
    return lambda shape: wp.empty(shape[:4], dtype=wp.float32, device=s.device)
