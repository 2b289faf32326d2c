"""Decodes the bytes of an Event Stream to events, by a loop in plain Python and by the same loop as a Warp kernel."""

from __future__ import annotations

import numpy as np

from evis.events.arrays import Events
from evis.events.files.es.layout import EVENT_BYTES, TIME_SHIFT, longest_time

LOOP_BYTES = 1 << 20
"""Size below which the plain loop is done before Warp would have been imported."""


class EsDecoder:
    """Decodes the bytes of an Event Stream, in any pieces.

    Coordinates and times [us] are as stored: the time is 0 before the first byte.
    """

    def __init__(self, kind: str, backend: str = "auto", size: int = 0) -> None:
        self.kind = kind
        if backend == "auto":
            backend = "numpy" if size <= LOOP_BYTES else "warp"
        self.backend = backend
        self._rest = b""
        self._t = 0

    @property
    def pending(self) -> int:
        """Returns the bytes of an event that is not complete yet."""
        return len(self._rest)

    def decode(self, data: bytes) -> tuple[Events, int]:
        """Decodes bytes to (events, number of ATIS exposure measurements left out)."""
        data = self._rest + data
        run = _launch if self.backend == "warp" else _loop
        (t, x, y, p), exposures, used, self._t = run(data, TIME_SHIFT[self.kind], self._t)
        self._rest = data[used:]
        return Events(t * 1000, x, y, p), exposures


Result = tuple[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray], int, int, int]


def _loop(data: bytes, shift: int, t: int) -> Result:
    at, end, exposures = 0, len(data), 0
    size, longest = EVENT_BYTES, longest_time(shift)
    pause = longest << shift
    below = (1 << shift) - 1
    marked = below >> 1
    places: list[int] = []
    times: list[int] = []
    while at < end:
        first = data[at]
        if first >= pause:
            t += longest * (first & below)
            at += 1
        elif at + size > end:
            break
        else:
            t += first >> shift
            if first & marked:
                exposures += 1
            else:
                places.append(at)
                times.append(t)
            at += size
    raw = np.frombuffer(data, np.uint8)
    place = np.array(places, np.int64)
    x = raw[place + 1] | raw[place + 2].astype(np.uint16) << 8
    y = raw[place + 3] | raw[place + 4].astype(np.uint16) << 8
    return (np.array(times, np.int64), x, y, raw[place] >> (shift - 1) & 1), exposures, at, t


def _launch(data: bytes, shift: int, t: int) -> Result:
    from evis.events.codecs.warp_calls import run
    from evis.events.files.es.kernels import decode_es

    n = len(data) // EVENT_BYTES
    columns = [np.empty(n, d) for d in (np.int64, np.uint16, np.uint16, np.uint8)]
    out = np.array([0, 0, 0, t], np.int64)
    run(decode_es, [np.frombuffer(data, np.uint8), shift, longest_time(shift)], [out, *columns])
    used, count, exposures, t = (int(v) for v in out)
    return tuple(c[:count].copy() for c in columns), exposures, used, t  # type: ignore[return-value]
