"""Chooses how many pixels an audit computes by default: as many as cost less than a fixed share of the run.

Costs are estimates of a scene's work in nanoseconds of one core, from its size and what is in it; no clock is read, so
that the same command audits the same pixels everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass

from evis.scene.model import Camera, Scene
from nodes.audit.causes import is_still

SHARE = 0.024
"""Part of a run's cost that an audit may add: less than 3 %, for estimates are off by a few tenths."""

LEAST, USEFUL, MOST = 4, 16, 64
"""Pixels in any case, those below which an interval says little, and at most."""

SMALL_NS, USEFUL_NS = 1e9, 45e6
"""A second of a run that costs less than the first may have USEFUL pixels for the second [ns]: a share of it would be
next to nothing."""

KEYFRAME_NS = 120.0
"""Of a pixel of a keyframe."""

FRAME_NS, SEEN_NS = {False: 40.0, True: 150.0}, 0.3
"""Of a pixel of a frame with its share of the sensor, before a camera that stands still and one that moves, and more
of it for each instance before the latter."""

RAY_NS, INSTANCE_NS, LIGHT_NS = 450.0, 5.0, 100.0
"""Of a ray, of each instance that it is tried against, and of a light that a point is lit by."""

BASE_LOOKS, OWN_LOOKS = 500.0, {False: 400.0, True: 1200.0}
"""Looks in a second that all pixels have together at the same instants, and those that a pixel has of its own; more of
them where textures move, and pixels are drawn where they do."""

INSTANT_NS, PLACE_NS = 300.0, 3.0
"""Of an instant at which a pixel alone is looked at, and of each instance that is placed then."""

FIXED_NS, INSTANCE_FIXED_NS, DRIVEN_NS = 6e6, 110e3, 18e6
"""Of a second, however many pixels are looked at, of each instance in it, and of motion that is not in closed form."""


@dataclass(frozen=True)
class Rates:
    """Holds keyframes a second and frames to each of them."""

    keyframes: float
    upsampling: int


def run_cost(scene: Scene, camera: Camera, samples: int, envs: int, rates: Rates) -> float:
    """Estimates the cost of a second of a run without its audit [ns]."""
    pixels = camera.width * camera.height * samples**2
    moving = not is_still(scene, scene.body_index(camera.name))
    frame = FRAME_NS[moving] + SEEN_NS * len(scene.instances) * moving
    return envs * rates.keyframes * pixels * (KEYFRAME_NS + frame * rates.upsampling)


def sample_cost(scene: Scene, samples: int, light_samples: int, paths: int) -> float:
    """Estimates the cost of one sample of a pixel [ns]. paths: rays along paths for each sample, 0 without any."""
    # An area light takes all its rays only where it may be hidden.
    shadows = sum((max(1, light_samples / 8) if light.kind == "area" else 1) for light in scene.lights if light.shadows)
    trace = RAY_NS + INSTANCE_NS * min(len(scene.instances), 64)
    return samples**2 * (trace * (1 + 0.5 * shadows + paths) + LIGHT_NS * len(scene.lights))


def audit_cost(scene: Scene, camera: Camera, look: float) -> tuple[float, float]:
    """Estimates the cost of a second of an audit [ns]: without any pixel, and of each. look: cost of a look [ns]."""
    moving = not is_still(scene, scene.body_index(camera.name))
    placed = sum(moving or not is_still(scene, instance.body) for instance in scene.instances)
    driven = any(body.trajectory is None for body in scene.bodies)
    fixed = FIXED_NS + INSTANCE_FIXED_NS * len(scene.instances) + DRIVEN_NS * driven
    own = OWN_LOOKS[not driven and any(material.texture is not None for material in scene.materials)]
    return fixed, BASE_LOOKS * look + own * (look + INSTANT_NS + PLACE_NS * placed)


def pixels_for(
    scene: Scene, camera: Camera, rates: Rates, envs: int = 1, samples: int = 1, light_samples: int = 16, paths: int = 0
) -> int:
    """Chooses how many pixels to audit, of all environments together."""
    run = run_cost(scene, camera, samples, envs, rates)
    fixed, each = audit_cost(scene, camera, sample_cost(scene, samples, light_samples, paths))
    least = USEFUL if run < SMALL_NS and fixed + USEFUL * each <= USEFUL_NS else LEAST
    return int(max(least, min(MOST, (SHARE * run - fixed) // each)))
