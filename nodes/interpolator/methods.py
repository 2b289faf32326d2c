"""Lists the interpolation methods by name: what each reads, and how it is made.

A new method is a row here and a file of its own. Nothing heavy is imported until a method is made, so that the planner
can ask what a method reads.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from evis.scene.model import Camera, Scene
    from nodes.interpolator.keyframe import Method


@dataclass
class Gap:
    """Describes what a method is made for: the gaps between keyframes of one size.

    Args:
        height, width: of the keyframes, margin included [px].
        envs: parallel environments E.
        upsampling: frames per gap K.
        margin: pixels beyond the image on every side.
        channels: 1 (luminance) or 3 (linear RGB).
        device: Warp device of keyframes and frames.
        threads: CPU threads.
        scene, camera: those of the renderer; the camera is as fine as the keyframes.
        light: options of a method that shades: light_samples, paths, tolerance; what is None is as it is by default.
        worlds: the scene of each environment where they move differently, and look alike.
        time_tolerance_ns: of the time of a crossing, by further samples of single pixels; 0 = frames only.
        sampled: whether somebody reads these samples; the frames are the same.
        in_a_row: the environments are gaps of one, each of which begins where the one before ends; for `rigid`.
        late: the report of a gap may come with the next one.
        fineness: sub-pixels per pixel and axis, which are averaged when they are there; the keyframes are of these.
    """

    height: int
    width: int
    envs: int
    upsampling: int
    margin: int
    channels: int
    device: str
    threads: int
    scene: Scene | None = None
    camera: Camera | None = None
    light: Mapping[str, Any] = field(default_factory=dict)
    worlds: Sequence[Scene] = ()
    time_tolerance_ns: float = 0.0
    sampled: bool = True
    in_a_row: bool = False
    late: bool = False
    fineness: int = 1

    @property
    def images(self) -> tuple[int, int, int, int, int, int, str, int]:
        """Gives the arguments of a method that works on images: height, width and those of `bodies`."""
        return self.height, self.width, *self.bodies

    @property
    def bodies(self) -> tuple[int, int, int, int, str, int]:
        """Gives the arguments, after scene and camera, of a method that knows the scene's bodies: envs, K, margin,
        channels, device, threads."""
        return self.envs, self.upsampling, self.margin, self.channels, self.device, self.threads


@dataclass(frozen=True)
class Registered:
    """Holds one method. reads: inputs besides the keyframe, by the names of the node's ports. looks_back: keyframes
    before a gap that its frames depend on."""

    help: str
    make: Callable[[Gap], Method]
    reads: frozenset[str] = frozenset()
    looks_back: int = 0


def _rigid(gap: Gap) -> Method:
    from nodes.interpolator.rigid import Rigid, RigidOptions

    assert gap.scene is not None and gap.camera is not None
    asked = {name: value for name, value in gap.light.items() if value is not None}
    if gap.time_tolerance_ns == 0 or "paths" in asked:
        options = RigidOptions(**asked)
        rigid = Rigid(gap.scene, gap.camera, *gap.bodies, options, gap.worlds, gap.in_a_row, gap.late)
        rigid.begin_build()
        return rigid
    from nodes.interpolator.refine.method import Refined, tolerance_of

    options = RigidOptions(**{"tolerance": tolerance_of(1e-9 * gap.time_tolerance_ns), **asked}, single=True)
    rigid = Rigid(gap.scene, gap.camera, *gap.bodies, options, worlds=gap.worlds, in_a_row=gap.in_a_row)
    rigid.begin_build()
    refined = Refined(rigid, gap.time_tolerance_ns, gap.threads, options.light_samples, gap.fineness)
    refined.sampled = gap.sampled
    refined.begin_build()
    return refined


def _splat(gap: Gap) -> Method:
    from nodes.interpolator.splat.splat import Splat, make_splat

    return Splat(make_splat(*gap.images), gap.envs)


def _splat_quadratic(gap: Gap) -> Method:
    from nodes.interpolator.splat.quadratic import SplatQuadratic

    return SplatQuadratic(*gap.images)


def _none(gap: Gap) -> Method:
    from nodes.interpolator.passthrough import Passthrough

    return Passthrough(gap.margin)


METHODS: Mapping[str, Registered] = {
    "rigid": Registered("by body poses", _rigid, frozenset({"state"})),
    "splat": Registered("by motion vectors", _splat, frozenset({"depth", "motion"}), looks_back=1),
    "splat-quadratic": Registered(
        "along a parabola through three keyframes", _splat_quadratic, frozenset({"depth", "motion"}), looks_back=2
    ),
    "none": Registered("render each", _none),
}
HELP = "how the frames between keyframes are made: " + ", ".join(f"{name} = {m.help}" for name, m in METHODS.items())


def reads(method: str) -> frozenset[str]:
    """Gives the inputs that a method reads besides the keyframe: depth and motion (images), state (of the bodies)."""
    return METHODS[method].reads
