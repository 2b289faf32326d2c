"""Groups sequences that are made at once, as environments of one simulation."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import cache
from typing import Any

from evis.dataset.recipe import Plan, Recipe
from evis.scene.load import scene_args
from nodes.event_sensor.parameters import SENSOR

SIZE = ("width", "height")
OF_SENSOR = frozenset((*SENSOR, "defocus")) - {"model", "crossing"}
"""Arguments of the event sensor that environments may have for themselves, as launch files call them."""
DEFAULT_PIXELS = 346 * 260
BYTES_PER_PIXEL = 2000
"""Memory of a GPU that an environment takes at most, for each of its pixels: its images, sub-frames and state."""
MOST = 16
"""Environments beyond which a GPU gains little from more of them."""


def batches(plans: Sequence[Plan], size: int) -> list[list[Plan]]:
    """Groups sequences that may be made at once, `size` of them and what is left over, the first ones first.

    They have one scene, size of images, length, outputs and layout, and differ in arguments of the scene or the sensor
    and in seeds. Whether these change what there is, and not values alone, is seen when they are made.
    """
    if size == 1:
        return [[plan] for plan in plans]
    groups: dict[str, list[Plan]] = {}
    for plan in plans:
        groups.setdefault(_alike(plan), []).append(plan)
    found = [group[k : k + size] for group in groups.values() for k in range(0, len(group), size)]
    return sorted(found, key=lambda batch: batch[0].index)


def batch_size(recipe: Recipe, sequences: int, workers: int, memory: int) -> int:
    """Returns how many sequences a GPU makes at once, so that all workers have some.

    memory: that a worker may use, bytes.
    """
    pixels = max(
        int(corner.get("width") or DEFAULT_PIXELS**0.5) * int(corner.get("height") or DEFAULT_PIXELS**0.5)
        for scene in recipe.scenes
        for corner in scene.corners()
    )
    return max(1, min(MOST, memory // (BYTES_PER_PIXEL * pixels), -(-sequences // workers)))


def _alike(plan: Plan) -> str:
    """What sequences that are made at once have in common."""
    own = _own(plan.scene) | OF_SENSOR
    shared = {name: value for name, value in plan.arguments.items() if name not in own}
    return json.dumps([plan.scene, plan.duration_s, plan.outputs, plan.labels, plan.layout, shared], sort_keys=True)


@cache
def _own(scene: str) -> frozenset[str]:
    """Arguments of a scene; none of a launch file."""
    found: dict[str, Any] = {}
    try:
        found = scene_args(scene)
    except (ValueError, OSError):
        pass
    return frozenset(found) - set(SIZE)
