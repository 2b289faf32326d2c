"""Packs /state for a bag: transforms of the moving bodies at all sub-steps, then of the others once, at the stamp."""

from __future__ import annotations

from typing import Any

import numpy as np

from evis.bag import BagError
from evis.bag.ros import transforms
from evis.bag.ros.jsonform import get_array
from msgs.fields import ArraySpec, array_specs
from msgs.world import WorldState

WORLD = "world"
"""Frame of the poses."""
MAX_BODIES = 1 << 20
PACKED = ("end_pose", "moving_pose")
"""Fields that the transforms hold."""
OLD = ArraySpec(("float64",), ("E", "S", "N", "?"), False, "all sub-steps of all bodies")
"""`pose` and `twist` of older bags."""


def pack(state: WorldState) -> bytes:
    """Packs a tf2_msgs/TFMessage of a state of one environment with at least one sub-step."""
    names = _frame_names(state.names, state.end_pose.shape[1])
    moving, still = _moving_and_still(state.moving, len(names))
    end = np.asarray(state.end_pose)[0, still][None]
    return transforms.pack(
        WORLD,
        [
            (tuple(names[n] for n in moving), np.asarray(state.t), np.asarray(state.moving_pose)[0]),
            (tuple(names[n] for n in still), np.asarray(state.t)[-1:], end),
        ],
    )


def whole(state: WorldState) -> bool:
    """Tells whether the transforms are all that PACKED has: one environment, whose moving bodies end at their
    end_pose."""
    if len(state.end_pose) != 1 or not len(state.t):
        return False
    last = np.asarray(state.moving_pose)[:, -1]
    return last.tobytes() == np.asarray(state.end_pose)[:, np.asarray(state.moving)].tobytes()


def unpack(raw: memoryview | None, body: dict[str, Any]) -> dict[str, np.ndarray]:
    """Returns the arrays that `pack`'s bytes (None: there are none) and the closing JSON `body` hold otherwise than by
    name.

    Bags from before bodies that stand were told apart have all sub-steps of all bodies; they all count as moving.
    Raises BagError.
    """
    moving = get_array(body, "moving", array_specs(WorldState)["moving"])
    if raw is None:
        return {} if moving is not None else _full_state(get_array(body, "pose", OLD), body)
    bodies, steps = body["_bodies"], body["_steps"]
    rows = bodies * steps if moving is None else len(moving) * steps
    if steps < 1 or max(rows, bodies) * transforms.POSE_BYTES > len(raw) or bodies > MAX_BODIES:
        raise BagError(f"tf2_msgs/TFMessage has {len(raw)} bytes, too few for {steps} steps of {bodies} bodies")
    names = _frame_names(body.get("names", []), bodies)
    if moving is None:
        return _full_state(transforms.unpack(raw, WORLD, [(names, steps)])[0][None], body)
    if moving.size and (moving.min() < 0 or moving.max() >= bodies):
        raise BagError(f"WorldState.moving names bodies {moving.min()} to {moving.max()} of {bodies}")
    driven, still = _moving_and_still(moving, bodies)
    groups = [(tuple(names[n] for n in driven), steps), (tuple(names[n] for n in still), 1)]
    moved, rest = transforms.unpack(raw, WORLD, groups)
    end = np.empty((1, bodies, 7))
    end[0, driven], end[0, still] = moved[-1], rest[0]
    return {"end_pose": end, "moving_pose": moved[None]}


def _full_state(pose: np.ndarray | None, body: dict[str, Any]) -> dict[str, np.ndarray]:
    """Makes a state that has all sub-steps of all bodies, as older bags do."""
    twist = get_array(body, "twist", OLD)
    if pose is None or twist is None or pose.ndim != 4 or not pose.shape[1]:
        return {}
    moving = np.arange(pose.shape[2], dtype=np.int32)
    return {"end_pose": pose[:, -1], "moving": moving, "moving_pose": pose, "moving_twist": twist}


def _moving_and_still(moving: np.ndarray, bodies: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns the bodies that move, and those that do not."""
    still = np.ones(bodies, bool)
    still[np.asarray(moving)] = False
    return np.asarray(moving), np.flatnonzero(still)


def _frame_names(names: list[str], count: int) -> tuple[str, ...]:
    """Returns as many frame names as there are bodies, also where not all of them have a name."""
    return (*names[:count], *(f"body{i}" for i in range(len(names), count)))
