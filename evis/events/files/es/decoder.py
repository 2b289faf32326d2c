"""The bytes of an Event Stream to events: a loop in plain Python as the reference, the same loop as a Warp kernel."""

from __future__ import annotations

import numpy as np

from evis.events.arrays import Events

SIZES = {"dvs": 5, "atis": 5}
"""Bytes of an event, by type of stream."""
LOOP_BYTES = 1 << 20
"""Below this size the plain loop is done before Warp would have been imported."""


class EsDecoder:
    """Decodes bytes of an Event Stream, cut anywhere.

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
        """Bytes of an event that is not complete."""
        return len(self._rest)

    def decode(self, data: bytes) -> tuple[Events, int]:
        """(events, ATIS exposure measurements left out)."""
        data = self._rest + data
        run = _launch if self.backend == "warp" else _loop
        (t, x, y, p), exposures, used, self._t = run(data, self.kind == "atis", self._t)
        self._rest = data[used:]
        return Events(t * 1000, x, y, p), exposures


Result = tuple[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray], int, int, int]


def _loop(data: bytes, atis: bool, t: int) -> Result:
    at, end, exposures = 0, len(data), 0
    places: list[int] = []
    times: list[int] = []
    while at < end:
        first = data[at]
        if atis and first & 0xFC == 0xFC:
            t += 63 * (first & 3)
            at += 1
        elif not atis and first >= 0xFE:
            t += 127 * (first & 1)
            at += 1
        elif at + 5 > end:
            break
        else:
            t += first >> 2 if atis else first >> 1
            if atis and first & 1:
                exposures += 1
            else:
                places.append(at)
                times.append(t)
            at += 5
    raw = np.frombuffer(data, np.uint8)
    place = np.array(places, np.int64)
    x = raw[place + 1] | raw[place + 2].astype(np.uint16) << 8
    y = raw[place + 3] | raw[place + 4].astype(np.uint16) << 8
    return (np.array(times, np.int64), x, y, raw[place] >> (1 if atis else 0) & 1), exposures, at, t


def _launch(data: bytes, atis: bool, t: int) -> Result:
    from evis.events.codecs.warp_calls import run
    from evis.events.files.es.kernels import decode_es

    n = len(data) // 5
    columns = [np.empty(n, d) for d in (np.int64, np.uint16, np.uint16, np.uint8)]
    out = np.array([0, 0, 0, t], np.int64)
    run(decode_es, [np.frombuffer(data, np.uint8), int(atis)], [out, *columns])
    used, count, exposures, t = (int(v) for v in out)
    return tuple(c[:count].copy() for c in columns), exposures, used, t  # type: ignore[return-value]
