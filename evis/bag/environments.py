"""Splits a message of E parallel environments into E messages of one, each as a single run would give it, and joins
them again."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from evis.bag import BagError
from msgs.camera import CameraInfo, EventPacket, Image, Samples
from msgs.fields import array_specs, environment_key
from msgs.header import Message


def count(message: Message) -> int:
    """Counts the environments in a message, 0 where it has no such axis. An image is of one, which it names."""
    if isinstance(message, EventPacket):
        return max(len(message.env_offsets) - 1, 0)
    specs = array_specs(type(message))
    axes = [a.shape[0] for n, a in message.arrays().items() if specs[n].dims[0] == "E"]
    return int(axes[0]) if axes else 0


def check_one(topic: str, envs: int) -> None:
    """Raises BagError where a topic has several environments and the export can hold only one."""
    if envs > 1:
        raise BagError(f"{topic} has {envs} environments; name one of them: /env0{topic}")


def tabular(message: Message) -> bool:
    """Tells whether the message is a table whose rows name their environment."""
    return any(environment_key(name, type(message)) for name in message.arrays())


def split(message: Message, envs: int) -> list[tuple[Message, dict[str, list[int]]]]:
    """Splits a message into one per environment, and for tables whose rows are not sorted by environment also their
    rows."""
    if isinstance(message, EventPacket):
        return [(_events(message, e), {}) for e in range(envs)]
    if isinstance(message, CameraInfo):
        return [(_info_of_environment(message, e), {}) for e in range(envs)]
    if isinstance(message, Samples):
        return [(message.of(slice(e, e + 1)), {}) for e in range(envs)]
    specs = array_specs(type(message))
    arrays = {n: np.asarray(a) for n, a in message.arrays().items()}
    keys = {n: environment_key(n, type(message)) for n in arrays}
    sorted_tables = {n: bool((np.diff(arrays[n]) >= 0).all()) for n in arrays if keys[n] == n}
    result = []
    for e in range(envs):
        changes: dict[str, Any] = {}
        rows: dict[str, list[int]] = {}
        for name, array in arrays.items():
            key = keys[name]
            if specs[name].dims[0] == "E":
                changes[name] = array[e : e + 1]
            elif key and key in arrays:
                picked = np.flatnonzero(arrays[key] == e)
                changes[name] = array[picked] if key != name else np.zeros(len(picked), array.dtype)
                if not sorted_tables[key]:
                    rows[key] = picked.tolist()
        result.append((dataclasses.replace(message, **changes), rows))  # type: ignore[type-var]
    return result


def of_one(message: Message, env: int) -> Message | None:
    """Returns the part of a message that belongs to an environment, None for an image of another one."""
    if isinstance(message, Image):
        return message if message.env == env else None
    # Tables alone do not tell how many environments there are.
    return split(message, max(count(message), env + 1))[env][0]


def fits(message: Message, envs: int) -> bool:
    """Tells whether rows or events are wholly dealt out among the environments; otherwise a message is kept whole."""
    if isinstance(message, EventPacket):
        offsets = np.asarray(message.env_offsets)
        total = 0 if message.t is None else len(message.t)
        return message.raw is None and offsets[0] == 0 and offsets[-1] == total and bool((np.diff(offsets) >= 0).all())
    tables = [np.asarray(a) for n, a in message.arrays().items() if environment_key(n, type(message)) == n]
    return all(not t.size or (t.min() >= 0 and t.max() < envs) for t in tables)


def _events(packet: EventPacket, e: int) -> EventPacket:
    first, end = int(packet.env_offsets[e]), int(packet.env_offsets[e + 1])
    cut = {n: getattr(packet, n)[first:end] for n in "txypc" if getattr(packet, n) is not None}
    return dataclasses.replace(packet, env_offsets=np.array([0, end - first], np.int64), **cut)


def join(parts: Sequence[tuple[Message, dict[str, list[int]]]]) -> Message:
    """Joins the messages that `split` made of one."""
    first = parts[0][0]
    if isinstance(first, EventPacket):
        return _join_events([m for m, _ in parts])  # type: ignore[misc]
    if isinstance(first, CameraInfo):
        return _join_infos([m for m, _ in parts])  # type: ignore[misc]
    lists = _join_lists([m for m, _ in parts]) if isinstance(first, Samples) else {}  # type: ignore[misc]
    specs = array_specs(type(first))
    changes: dict[str, Any] = {}
    for name in first.arrays():
        pieces = [np.asarray(getattr(m, name)) for m, _ in parts]
        key = environment_key(name, type(first))
        if specs[name].dims[0] == "E":
            changes[name] = np.concatenate(pieces)
        elif key:
            if key == name:
                pieces = [np.full(len(p), e, p.dtype) for e, p in enumerate(pieces)]
            joined = np.concatenate(pieces)
            if key in parts[0][1]:
                order = np.concatenate([np.array(rows[key], np.int64) for _, rows in parts])
                joined = joined[np.argsort(order)]
            changes[name] = joined
    return dataclasses.replace(first, **changes, **lists)  # type: ignore[type-var]


def _join_lists(parts: list[Samples]) -> dict[str, Any]:
    """Joins the lists of samples of messages of one environment each."""
    specs = array_specs(Samples)
    names = [name for name in parts[0].arrays() if specs[name].dims[0] == "R"]
    sizes = np.cumsum([0, *(int(p.first[-1]) for p in parts)])
    firsts = [np.zeros(1, np.int32), *(p.first[1:] + size for p, size in zip(parts, sizes))]
    joined = {name: np.concatenate([np.asarray(getattr(p, name)) for p in parts]) for name in names}
    return {"first": np.concatenate(firsts).astype(np.int32), **joined}


def _join_events(packets: list[EventPacket]) -> EventPacket:
    names = [n for n in "txypc" if getattr(packets[0], n) is not None]
    cut: dict[str, Any] = {n: np.concatenate([getattr(p, n) for p in packets]) for n in names}
    sizes = [int(p.env_offsets[-1]) for p in packets]
    return dataclasses.replace(packets[0], env_offsets=np.cumsum([0, *sizes], dtype=np.int64), **cut)


def info_alone(info: CameraInfo, env: int) -> CameraInfo:
    """Returns the CameraInfo of one environment as a single run with a seed of its own would give it."""
    own = {place: v[env : env + 1] if len(v) == info.envs else v for place, v in info.drawn.items()}
    drawn = {place: values for place, values in own.items() if values and values[0] is not None}
    sensor = dict(info.sensor)
    if isinstance(sensor.get("seed"), int):
        sensor["seed"] += env
    return dataclasses.replace(info, envs=1, sensor=sensor, drawn=drawn)


def _info_of_environment(info: CameraInfo, e: int) -> CameraInfo:
    """Returns the camera as environment e has it."""
    assert info.env_k is not None and info.env_distortion is not None
    apart = info.baseline if info.env_baseline is None else float(info.env_baseline[e])
    drawn = {place: values[e : e + 1] for place, values in info.drawn.items()}
    k, distortion = np.array(info.env_k[e]), np.array(info.env_distortion[e])
    own: dict[str, Any] = {"k": k, "distortion": distortion, "baseline": apart, "drawn": drawn}
    return dataclasses.replace(info, env_k=None, env_distortion=None, env_baseline=None, **own)


def _join_infos(infos: list[CameraInfo]) -> CameraInfo:
    drawn = {place: [value for info in infos for value in info.drawn[place]] for place in infos[0].drawn}
    k, distortion = (np.stack([getattr(info, name) for info in infos]) for name in ("k", "distortion"))
    apart = np.array([info.baseline for info in infos])
    return dataclasses.replace(infos[0], env_k=k, env_distortion=distortion, env_baseline=apart, drawn=drawn)
