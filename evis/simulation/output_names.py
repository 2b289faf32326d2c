"""Names the outputs of a simulation, and suggests one for a name that is none."""

from __future__ import annotations

from collections.abc import Sequence

from evis.config.suggestions import closest, did_you_mean, nearest
from msgs.topics import TOPICS
from nodes.labeler.kinds import NEEDS as KINDS

STATE = "/state"
CAMERA = "/<cam>/"
OF_CAMERA = tuple(t.pattern.removeprefix(CAMERA) for t in TOPICS if t.pattern.startswith(CAMERA))
"""Outputs that every camera has: events, frames, keyframe, ..."""
NAMES = (*OF_CAMERA, *(t.pattern[1:] for t in TOPICS if not t.pattern.startswith(CAMERA) and t.lockstep))
LABELS = "labels"


def meant(parts: Sequence[str]) -> str:
    """Suggests an output for a name that is none: labels are outputs by their kind."""
    *camera, last = parts
    near = closest(last, (*NAMES, *KINDS))
    if near is None or near in NAMES:
        return nearest(last, NAMES)
    # Of `label.flow` the first part is no camera, of `left.flow` it may be.
    of = [part for part in camera if closest(part, [LABELS]) is None]
    return f"did you mean '{'.'.join([*of, LABELS, near])}'?"


def how_to_get(name: str, there: Sequence[str]) -> str:
    """Words how to get an attribute that a step does not have. there: the attributes that it has."""
    if name in KINDS and name not in NAMES and LABELS in there:
        return f"labels are in `labels`, as step.labels.{name}, where `outputs` has '{LABELS}.{name}'"
    if name in KINDS or name in NAMES:
        wanted = name if name in NAMES else f"{LABELS}.{name}"
        return f"add '{wanted}' to the `outputs` with which the simulation is made"
    return f"it has {', '.join(there)}{did_you_mean(name, (*there, *NAMES))}"
