"""How many pixels an audit looks at if nobody says: as many as cost less than a fixed share of the run.

Costs are estimates of a scene's work in nanoseconds of one core, from its size and what is in it; no clock is read, so
that the same command audits the same pixels everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass

from evis.scene.model import Camera, Scene
from nodes.audit.causes import is_still

SHARE = 0.03
"""Part of a run's cost that an audit may add."""

LEAST, MOST = 4, 64
"""Pixels in any case, and at most."""

KEYFRAME_NS = 120.0
"""Of a pixel of a keyframe."""

FRAME_NS = {False: 15.0, True: 150.0}
"""Of a pixel of a frame with its share of the sensor, before a camera that stands still and one that moves."""

RAY_NS, INSTANCE_NS, LIGHT_NS = 900.0, 15.0, 100.0
"""Of a ray, of each instance that it is tried against, and of a light that a point is lit by."""

BASE_LOOKS, OWN_LOOKS = 500.0, 1500.0
"""Looks in a second that all pixels have together at the same instants, and those that a pixel has of its own."""

INSTANT_NS, PLACE_NS = 2_000.0, 60.0
"""Of an instant at which anything is looked at, and of each instance that is placed then."""


@dataclass(frozen=True)
class Rates:
    """Holds keyframes a second and frames to each of them."""

    keyframes: float
    upsampling: int


def run_cost(camera: Camera, moving: bool, samples: int, envs: int, rates: Rates) -> float:
    """Estimates the cost of a second of a run without its audit [ns]. moving: whether the camera ever does."""
    pixels = camera.width * camera.height * samples**2
    return envs * rates.keyframes * pixels * (KEYFRAME_NS + FRAME_NS[moving] * rates.upsampling)


def look_cost(scene: Scene, samples: int, light_samples: int, paths: int) -> float:
    """Estimates the cost of a look at a pixel [ns]. paths: rays along paths for each sample, 0 without any."""
    shadows = sum((light_samples if light.kind == "area" else 1) for light in scene.lights if light.shadows)
    trace = RAY_NS + INSTANCE_NS * min(len(scene.instances), 64)
    return samples**2 * (trace * (1 + 0.5 * shadows + paths) + LIGHT_NS * len(scene.lights))


def pixels_for(
    scene: Scene, camera: Camera, rates: Rates, envs: int = 1, samples: int = 1, light_samples: int = 16, paths: int = 0
) -> int:
    """Chooses how many pixels to audit, of all environments together."""
    moving = not is_still(scene, scene.body_index(camera.name))
    allowed = SHARE * run_cost(camera, moving, samples, envs, rates)
    look = look_cost(scene, samples, light_samples, paths)
    instant = INSTANT_NS + PLACE_NS * len(scene.instances)
    own = BASE_LOOKS * look + OWN_LOOKS * (look + instant)
    return int(max(LEAST, min(MOST, (allowed - BASE_LOOKS * instant) // own)))
