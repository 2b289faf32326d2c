"""Writes a message as text or plain values."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from evis.console.printable import printable
from msgs.header import Message


def as_plain(message: Message, full: bool) -> dict[str, Any]:
    """Turns a message into plain values; arrays as dtype, shape and range, or whole."""
    body: dict[str, Any] = {"type": type(message).__name__, "header": dataclasses.asdict(message.header)}
    body |= message.scalars()
    for name, array in message.arrays().items():
        body[name] = np.asarray(array).tolist() if full else _summary(np.asarray(array))
    return body


def as_text(message: Message, full: bool) -> str:
    """Writes a message on a few lines."""
    h = message.header
    clock = printable(h.clock)
    lines = [f"{type(message).__name__} at {h.stamp_ns} ns, seq {h.seq}, clock {clock}, episode {h.episode}"]
    lines += [f"  {name}: {printable(value)}" for name, value in message.scalars().items()]
    for name, array in message.arrays().items():
        values = np.asarray(array)
        lines.append(f"  {name}: " + (np.array2string(values, threshold=2**31) if full else _line(values)))
    return "\n".join(lines)


def _summary(array: np.ndarray) -> dict[str, Any]:
    body: dict[str, Any] = {"dtype": array.dtype.name, "shape": list(array.shape)}
    finite = array[np.isfinite(array)] if array.dtype.kind == "f" else array
    if finite.size:
        body |= {"min": finite.min().item(), "max": finite.max().item()}
    if finite.size != array.size:
        body["not_finite"] = int(array.size - finite.size)
    return body


def _line(array: np.ndarray) -> str:
    body = _summary(array)
    shape = " ".join(map(str, body["shape"]))
    extent = f" {body['min']:.6g} to {body['max']:.6g}" if "min" in body else ""
    odd = f", {body['not_finite']} not finite" if "not_finite" in body else ""
    return f"{body['dtype']} [{shape}]{extent}{odd}"
