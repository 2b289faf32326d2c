"""Joins messages of the shares to one of all environments, which is the one that a single share gives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate
from typing import Any

import numpy as np

from msgs.camera import CameraInfo, EventPacket, EventSignal, Frames, Labels, Samples
from msgs.fields import array_specs, environment_key
from msgs.header import Header, Message

SUMS = ("filled", "reshaded", "lost")
"""Fields that count something in all environments."""


@dataclass
class Joined:
    """Holds a message of all environments before it is written. pieces: of each array, what to put one after another.

    others: the fields that are no arrays.
    """

    kind: type[Message]
    header: Header
    others: dict[str, Any]
    pieces: dict[str, list[np.ndarray]] = field(default_factory=dict)

    def shapes(self) -> dict[str, tuple[tuple[int, ...], np.dtype]]:
        """Gives shape and dtype of every array."""
        return {
            name: ((sum(len(piece) for piece in found), *found[0].shape[1:]), found[0].dtype)
            for name, found in self.pieces.items()
        }

    def written(self, into: dict[str, np.ndarray]) -> Message:
        """Returns the message, whose arrays are `into`, of `shapes`."""
        for name, found in self.pieces.items():
            np.concatenate(found, out=into[name])
        kind: Any = self.kind
        message: Message = kind(self.header, **into, **self.others)
        return message


def complete(parts: Sequence[Message | None]) -> bool:
    """Tells whether parts can be joined: all are there, or what lacks are events or labels of events alone, of which a
    share may have none.
    """
    return all(part is not None for part in parts) or any(map(_of_events, parts))


def _of_events(part: Message | None) -> bool:
    """Tells events, and the labels of those that a sensor held back until the end, which are of no keyframe."""
    if isinstance(part, Labels):
        return all(name.startswith("event_") for name in part.arrays())
    return isinstance(part, EventPacket | EventSignal)


def join(parts: Sequence[Message | None], envs: Sequence[slice]) -> Joined:
    """Joins the messages of one stamp. envs: the environments of each part.

    A part may lack (None) where others hold events, for it has none to tell then. Raises ValueError where parts
    disagree about what all environments share.
    """
    there = [part for part in parts if part is not None]
    first, kind = there[0], type(there[0])
    others = {name: sum(getattr(p, name) for p in there) if name in SUMS else v for name, v in first.scalars().items()}
    h = first.header
    joined = Joined(kind, Header(h.stamp_ns, clock=h.clock, episode=h.episode), others)
    if not complete(parts):
        raise ValueError(f"a share lacks its {kind.__name__} at {h.stamp_ns} ns")
    arrays = [_over_gap(part, there) for part in there]
    theirs = [own for part, own in zip(parts, envs) if part is not None]
    for name in first.arrays():
        pieces = [np.asarray(found[name]) for found in arrays]
        joined.pieces[name] = _ends(parts, envs) if name == "env_offsets" else _pieces(name, kind, pieces, theirs)
    return joined


def _over_gap(part: Message, parts: Sequence[Message]) -> dict[str, Any]:
    """Gives the arrays of a part.

    Where all its environments begin an episode while others go on, its one frame of each holds for the whole gap, as it
    does among them.
    """
    arrays: dict[str, Any] = dict(part.arrays())
    if not isinstance(part, Frames | Samples):
        return arrays
    times: list[np.ndarray] = [other.t for other in parts if isinstance(other, Frames | Samples)]
    longest = max(times, key=len)
    if len(part.t) != 1 or len(longest) == 1 or part.t[-1] != longest[-1]:
        return arrays
    specs = array_specs(type(part))
    held = {n: np.repeat(a, len(longest), axis=1) for n, a in arrays.items() if specs[n].dims[:2] == ("E", "K")}
    return {**arrays, **held, "t": longest}


def _pieces(name: str, kind: type[Message], pieces: list[np.ndarray], envs: Sequence[slice]) -> list[np.ndarray]:
    dim = array_specs(kind)[name].dims[0]
    if kind is Samples and name == "first":
        starts = accumulate((piece[-1] for piece in pieces), initial=np.int32(0))
        return [pieces[0], *(piece[1:] + start for piece, start in list(zip(pieces, starts))[1:])]
    if environment_key(name, kind) == name:
        return [(piece + part.start).astype(piece.dtype) for piece, part in zip(pieces, envs)]
    if dim in ("E", "n", "R") or environment_key(name, kind):
        return pieces
    if any(not np.array_equal(piece, pieces[0]) for piece in pieces):
        raise ValueError(f"shares of the environments have a {kind.__name__}.{name} each, which must be one for all")
    return pieces[:1]


def _ends(parts: Sequence[Message | None], envs: Sequence[slice]) -> list[np.ndarray]:
    """Finds where the events of each environment end."""
    made, last = [np.zeros(1, np.int64)], 0
    for part, own in zip(parts, envs):
        ends = np.zeros(own.stop - own.start + 1, np.int64)
        if isinstance(part, EventPacket | EventSignal):
            ends = np.asarray(part.env_offsets)
        made.append(ends[1:] + last)
        last = int(made[-1][-1])
    return made


def join_infos(infos: Sequence[CameraInfo]) -> CameraInfo:
    """Joins what the shares tell of their camera."""
    counts, first = [info.envs for info in infos], infos[0]
    places = dict.fromkeys(place for info in infos for place in info.drawn)
    drawn = {p: [v for i in infos for v in (i.drawn[p] if p in i.drawn else [None] * i.envs)] for p in places}
    newest = max((info.header for info in infos), key=lambda header: (header.episode, header.stamp_ns))
    header = Header(newest.stamp_ns, clock=newest.clock, episode=newest.episode)
    k = np.concatenate([_each(i.k, i.env_k, n) for i, n in zip(infos, counts)])
    distortion = np.concatenate([_each(i.distortion, i.env_distortion, n) for i, n in zip(infos, counts)])
    apart = np.concatenate([_each(np.array(i.baseline), i.env_baseline, n) for i, n in zip(infos, counts)])
    info = replace(first, header=header, envs=sum(counts), drawn=drawn)
    info.env_k = info.env_distortion = info.env_baseline = None
    if any((each != each[0]).any() for each in (k, distortion, apart)):
        info.env_k, info.env_distortion, info.env_baseline = k, distortion, apart
    return info


def _each(shared: np.ndarray, own: np.ndarray | None, envs: int) -> np.ndarray:
    return np.repeat(np.asarray(shared)[None], envs, axis=0) if own is None else np.asarray(own)
