"""Models the readout: how events get from the pixels to the outside, and what that does to their times.

One bus carries the events of all pixels, at most `readout_rate` a second, first come first served; events of the same
ns are served row by row. The k-th event that asked at t_k leaves at

    D_k = max(t_k, D_{k-1} + 1 / readout_rate),

so an isolated event is not delayed and a burst queues (Lindley's recursion for a constant service time; Kleinrock,
Queueing Systems I, 8.1). The timestamp is taken as an event leaves, with a jitter: a normal delay with the given
standard deviation and three times that as its mean, cut at three standard deviations, so that it is never negative
(the cut makes the deviation 0.25 % smaller).

Times only ever become later, therefore no event belongs to a packet that is already sent: what leaves after a packet's
stamp is held for the packet in whose interval it falls. Nothing is lost unless `queue` says so; how a stream is cut
into packets changes no event.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp

from evis.random_numbers import seed_of_time
from nodes.event_sensor.cpu.order import sort_keys, unpack
from nodes.event_sensor.input.batch import Batch
from nodes.event_sensor.model.keys import KeyLayout
from nodes.event_sensor.model.sensor_kernels import Sensor
from nodes.event_sensor.readout import readout_kernels as kernels
from nodes.event_sensor.readout.packet import merged, parted

SPAN_BITS = 62
"""The queue's clock counts up to 2^62 units after a packet's start."""

OF_QUEUES = ("free", "origins", "seeds")
"""Arrays [E] that a queue goes on from."""
COUNTED = ("delayed", "delay_ns", "longest_ns", "dropped", "cut")

NONE = np.zeros(0, np.uint8)
"""The colour channel of events without one."""


class Readout:
    """Models the readouts of E cameras of width x height pixels.

    readout_rate: events per second, 0 = no limit, else at least 1. timestamp_jitter_us: standard deviation [us], 0 =
    none; environment e draws from seed + e, by pixel, polarity, the number of its episode and the event's time since
    that began. queue: most events that may wait in one camera; further ones are dropped and counted; 0 = no limit.
    Raises ValueError.

    Counters, over all environments: `delayed` events that had to wait, `delay_ns` that they waited together,
    `longest_ns` of them, `dropped` events that found the queue full, `cut` events whose episode ended before they left.
    """

    def __init__(
        self,
        width: int,
        height: int,
        envs: int = 1,
        readout_rate: float = 0.0,
        timestamp_jitter_us: float = 0.0,
        seed: int = 0,
        queue: int = 0,
    ) -> None:
        if not (math.isfinite(readout_rate) and (readout_rate == 0 or readout_rate >= 1)):
            raise ValueError(f"readout_rate {readout_rate:g} must be 0 (no limit) or at least 1 event per second")
        if not (math.isfinite(timestamp_jitter_us) and 0 <= timestamp_jitter_us <= 1e6):
            raise ValueError(f"timestamp_jitter_us {timestamp_jitter_us:g} must lie in 0 to 1e6")
        if queue < 0:
            raise ValueError(f"queue {queue} must be 0 (no limit) or a number of events")
        self._envs = envs
        service = 1e9 / readout_rate if readout_rate else 0.0
        # 2^20 units per service time at least: the rate is met within 5e-7.
        self._fraction = max(0, 20 - math.floor(math.log2(service))) if service else 0
        values = {
            "service": round(service * 2**self._fraction),
            "fraction": self._fraction,
            "capacity": queue,
            "sigma": 1e3 * timestamp_jitter_us,
            "width": width,
            "height": height,
        }
        self._queue = kernels.Queue()
        for name, value in values.items():
            setattr(self._queue, name, value)
        self._layout = KeyLayout.of(height, width, envs)
        self._shifts = Sensor()
        for name in ("x", "y", "t", "env"):
            setattr(self._shifts, f"shift_{name}", getattr(self._layout, name))
        self._keys: wp.array = wp.empty(0, dtype=wp.int64, device="cpu")
        self._spare = self._keys
        self._free = np.zeros(envs, np.int64)
        self._base, self._seed = 0, seed
        self._origins = np.zeros(envs, np.int64)
        self._seeds = np.array([_seed_of(seed + env, 0) for env in range(envs)], np.uint64)
        self._held: dict[str, np.ndarray] | None = None
        self.delayed = self.delay_ns = self.longest_ns = self.dropped = self.cut = 0

    @property
    def queues(self) -> bool:
        """Tells whether there is a rate, so that events have to come in the order of time."""
        return bool(self._queue.service > 0)

    @property
    def waiting(self) -> int:
        """Returns the events held for a later packet."""
        return 0 if self._held is None else len(self._held["t"])

    def state(self) -> dict[str, Any]:
        """Gives the queues, the events that wait in them and what was counted, as plain values."""
        kept: dict[str, Any] = {name: np.array(getattr(self, f"_{name}")) for name in OF_QUEUES}
        kept |= {name: getattr(self, name) for name in COUNTED} | {"base": self._base}
        return kept | {f"held_{name}": np.array(column) for name, column in (self._held or {}).items()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restores the queues and counts that `state` gave."""
        for name in OF_QUEUES:
            setattr(self, f"_{name}", np.array(state[name]))
        for name in COUNTED:
            setattr(self, name, int(state[name]))
        self._base = int(state["base"])
        held = {n.removeprefix("held_"): np.array(v) for n, v in state.items() if n.startswith("held_")}
        self._held = held or None

    def begin(self, fresh: np.ndarray, stamp: int, episodes: np.ndarray) -> None:
        """Begins episodes with an empty queue and jitter of their own; what was still to leave is cut and counted.

        fresh: bool [E], whose. stamp: of their first frame [ns]. episodes: int [E], their numbers.
        """
        if not np.any(fresh):
            return
        self._free[fresh] = 0
        self._origins[fresh] = stamp
        for env in np.flatnonzero(fresh).tolist():
            self._seeds[env] = _seed_of(self._seed + env, int(episodes[env]))
        if self._held is not None:
            stale = np.asarray(fresh, bool)[self._held["env"]]
            self.cut += int(stale.sum())
            self._held = {name: column[~stale] for name, column in self._held.items()}

    def apply(
        self, columns: dict[str, np.ndarray], env_offsets: np.ndarray, t_base: int, stamp: int
    ) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """Returns the events of the packet (t_base, stamp] as they leave: columns and int64 [E + 1] offsets, sorted by
        t, y, x.

        columns: t int64 [n] ns, x, y uint16, p uint8 and perhaps c uint8, of one packet, by environment and, where
        it `queues`, time.
        t_base, stamp: its interval [ns], which starts where the last one ended. Raises ValueError for a packet too long
        for the queue's clock.
        """
        if (int(stamp) - int(t_base)) >> (SPAN_BITS - self._fraction):
            longest = (1 << (SPAN_BITS - self._fraction)) * 1e-9
            raise ValueError(
                f"a packet from {t_base} to {stamp} ns is too long for the readout, which takes {longest:.3g} s; put "
                "frames in between, or cut the sequence where its stamps have a gap"
            )
        self._start(t_base)
        stamps = self._serve(columns, np.ascontiguousarray(env_offsets, np.int64), t_base)
        env = self._environments(np.diff(env_offsets))
        new = {**columns, "t": stamps, "env": env}
        if self._queue.capacity and (turned := stamps == kernels.TURNED_AWAY).any():
            new = {name: column[~turned] for name, column in new.items()}
        if self.waiting and self._held is not None:
            new = {name: np.concatenate((self._held[name], column)) for name, column in new.items()}
        ordered, offsets = self._sorted(new, t_base)
        return self._left_by(ordered, offsets, stamp)

    def apply_batch(
        self, columns: dict[str, np.ndarray], env_offsets: np.ndarray, batch: Batch, begins: np.ndarray, stamp: int
    ) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """Returns the events of a batch as they leave, as `apply` does, after the episodes that it begins have begun.

        columns, env_offsets: as of `apply`. begins: bool [E], environments whose episode the first frame begins. stamp:
        up to which events are [ns].
        """
        end = int(batch.t[0])
        self.begin(begins, end, batch.episodes[0])
        later = np.asarray(batch.begin, np.int64) >> 1
        if batch.count <= 1 or not later.any():
            return self.apply(columns, env_offsets, batch.t_base, stamp)
        # The held frame ends the old episode, whose events leave before the queue starts again.
        old, new = parted(columns, env_offsets, end)
        first = self.apply(*old, batch.t_base, end)
        self.begin(later != 0, int(batch.t[1]), batch.episodes[-1])
        return merged([first, self.apply(*new, end, stamp)], self._envs)

    def flush(self) -> tuple[dict[str, np.ndarray], np.ndarray] | None:
        """Returns the events still held, at the end of a stream, as `apply` gives them; None when there are none."""
        held, self._held = self._held, None
        return None if held is None else self._sorted(held, int(held["t"].min()) - 1)

    def _left_by(
        self, events: dict[str, np.ndarray], offsets: np.ndarray, stamp: int
    ) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """Gives the sorted events up to `stamp`, and holds later ones."""
        ends = [
            offsets[e] + np.searchsorted(events["t"][offsets[e] : offsets[e + 1]], stamp, "right")
            for e in range(self._envs)
        ]
        rest = offsets[1:] - ends
        self._held = None
        if rest.any():
            tails = [slice(a, b) for a, b in zip(ends, offsets[1:])]
            self._held = {name: np.concatenate([c[part] for part in tails]) for name, c in events.items()}
            self._held["env"] = self._environments(rest)
            heads = [slice(a, b) for a, b in zip(offsets[:-1], ends)]
            one = self._envs == 1
            events = {n: c[heads[0]] if one else np.concatenate([c[part] for part in heads]) for n, c in events.items()}
            offsets = offsets - np.append(0, np.cumsum(rest))
        return events, offsets

    def counts(self) -> dict[str, int]:
        """Returns counters that only go up, by name."""
        return {n: getattr(self, n) for n in ("delayed", "delay_ns", "dropped", "cut")}

    def _environments(self, counts: np.ndarray) -> np.ndarray:
        """Tells which environment each event belongs to, int32; counts[e] of them are of environment e."""
        if self._envs == 1:
            return np.zeros(int(counts[0]), np.int32)
        return np.repeat(np.arange(self._envs, dtype=np.int32), counts)

    def _start(self, t_base: int) -> None:
        """Brings the clocks to `t_base`."""
        passed = min(max(t_base - self._base, 0), 1 << (SPAN_BITS - self._fraction)) << self._fraction
        self._free = np.maximum(self._free - passed, 0)
        self._base = t_base

    def _serve(self, columns: dict[str, np.ndarray], offsets: np.ndarray, t_base: int) -> np.ndarray:
        """Computes the stamps of the new events, TURNED_AWAY for those that the full queue turned away."""
        stamps = np.array(columns["t"], np.int64)
        if not len(stamps):
            return stamps
        statistics = np.zeros((self._envs, 4), np.int64)
        given = [offsets, *(np.ascontiguousarray(columns[n]) for n in ("t", "x", "y", "p")), columns.get("c", NONE)]
        given += [self._origins, self._seeds, self._free, stamps, statistics]
        arrays: list[wp.array] = [wp.array(a, copy=False, device="cpu") for a in given]
        wp.launch(kernels.serve, self._envs, [self._queue, t_base, *arrays], device="cpu")
        if self._free.max() >> SPAN_BITS:
            raise ValueError("the readout's queue is longer than its clock; raise readout_rate or limit the queue")
        self.delayed += int(statistics[:, 0].sum())
        self.delay_ns += int(statistics[:, 1].sum())
        self.longest_ns = max(self.longest_ns, int(statistics[:, 2].max()))
        self.dropped += int(statistics[:, 3].sum())
        return stamps

    def _sorted(self, events: dict[str, np.ndarray], t_base: int) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """Sorts events by environment, t, y, x, channel, polarity; gives the offsets of the environments too."""
        env, t = events.pop("env"), events["t"]
        counts = np.bincount(env, minlength=self._envs) if self._envs > 1 else np.array([t.size])
        offsets = np.append(0, np.cumsum(counts)).astype(np.int64)
        if not t.size:
            return events, offsets
        span = int(t.max()) - t_base
        # A mark has no place in these keys.
        if "signal" in events or span >> (self._layout.env - self._layout.t):
            order = np.lexsort((events["p"], events.get("c", np.zeros(t.shape)), events["x"], events["y"], t, env))
            return {name: column[order] for name, column in events.items()}, offsets
        if self._keys.size < t.size:
            self._keys, self._spare = (wp.empty(t.size + t.size // 4, dtype=wp.int64, device="cpu") for _ in range(2))
        ascending = np.ones(1, np.int32)
        given = [env, *(np.ascontiguousarray(events[n]) for n in ("t", "x", "y", "p")), events.get("c", NONE)]
        arrays: list[wp.array] = [wp.array(a, copy=False, device="cpu") for a in given]
        found: wp.array = wp.array(ascending, copy=False, device="cpu")
        wp.launch(kernels.pack, 1, [self._shifts, t_base, *arrays], [self._keys, found], device="cpu")
        if ascending[0]:
            return events, offsets
        keys = sort_keys(self._keys, self._spare, t.size, self._layout, span)
        wp.launch(kernels.tidy, 1, [t.size], [wp.array(keys, copy=False, device="cpu")], device="cpu")
        out = {name: np.empty(t.size, column.dtype) for name, column in events.items()}
        unpack(keys, self._shifts, t_base, out)
        return out, offsets


def _seed_of(seed: int, episode: int) -> int:
    """Computes the seed of an environment's jitter in an episode, whose times may be those of an earlier one."""
    return seed_of_time(seed, episode % 2**64) % 2**64
