"""The readout: how events get from the pixels to the outside, and what that does to their times.

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

import numpy as np
import warp as wp

from nodes.event_sensor import readout_kernels as kernels

SPAN_BITS = 62
"""The queue's clock counts up to 2^62 units after a packet's start."""


class Readout:
    """Readouts of E cameras of width x height pixels.

    readout_rate: events per second, 0 = no limit, else at least 1. timestamp_jitter_us: standard deviation [us], 0 =
    none; environment e draws from seed + e, by pixel, polarity and time of the event alone. queue: most events that may
    wait in one camera; further ones are dropped and counted; 0 = no limit. Raises ValueError.

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
        self._size = (width, height)
        self._envs = envs
        self._sigma = 1e3 * timestamp_jitter_us
        service = 1e9 / readout_rate if readout_rate else 0.0
        # 2^20 units per service time at least: the rate is met within 5e-7.
        self._fraction = max(0, 20 - math.floor(math.log2(service))) if service else 0
        values = {
            "service": round(service * 2**self._fraction),
            "fraction": self._fraction,
            "capacity": queue,
            "sigma": self._sigma,
            "seed": seed & (2**64 - 1),
            "width": width,
            "height": height,
        }
        self._queue = kernels.Queue()
        for name, value in values.items():
            setattr(self._queue, name, value)
        self._free = np.zeros(envs, np.int64)
        self._base = 0
        self._held: dict[str, np.ndarray] | None = None
        self.delayed = self.delay_ns = self.longest_ns = self.dropped = self.cut = 0

    @property
    def latency_ns(self) -> int:
        """Mean of the delay that the jitter adds [ns]."""
        return round(float(kernels.REACH) * self._sigma)

    @property
    def waiting(self) -> int:
        """Events held for a later packet."""
        return 0 if self._held is None else len(self._held["t"])

    def apply(
        self,
        columns: dict[str, np.ndarray],
        env_offsets: np.ndarray,
        t_base: int,
        stamp: int,
        fresh: np.ndarray | None = None,
    ) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """Events of the packet (t_base, stamp] as they leave: columns and int64 [E + 1] offsets, sorted by t, y, x.

        columns: t int64 [n] ns, x, y uint16, p uint8 and perhaps c uint8, of one packet, by environment and time.
        t_base, stamp: its interval [ns], which starts where the last one ended. fresh: bool [E], environments that
        start again here with an empty queue. Raises ValueError for a packet too long for the queue's clock.
        """
        if (int(stamp) - int(t_base)) >> (SPAN_BITS - self._fraction):
            longest = (1 << (SPAN_BITS - self._fraction)) * 1e-9
            raise ValueError(f"a packet of {stamp - t_base} ns is too long for the readout; it takes {longest:.3g} s")
        self._start(t_base, fresh)
        stamps = self._serve(columns, np.ascontiguousarray(env_offsets, np.int64), t_base)
        new = {**columns, "t": stamps, "env": np.repeat(np.arange(self._envs, dtype=np.int32), np.diff(env_offsets))}
        if self.waiting and self._held is not None:
            new = {name: np.concatenate((self._held[name], column)) for name, column in new.items()}
        gone = new["t"] < 0
        later = new["t"] > stamp
        self._held = {name: column[later] for name, column in new.items()} if later.any() else None
        if later.any() or gone.any():
            new = {name: column[~(later | gone)] for name, column in new.items()}
        return self._sorted(new, t_base)

    def flush(self) -> tuple[dict[str, np.ndarray], np.ndarray] | None:
        """Events still held, at the end of a stream, as `apply` gives them; None when there are none."""
        held, self._held = self._held, None
        return None if held is None else self._sorted(held, int(held["t"].min()) - 1)

    def counts(self) -> dict[str, int]:
        """Counters that only go up, by name."""
        return {n: getattr(self, n) for n in ("delayed", "delay_ns", "dropped", "cut")}

    def _start(self, t_base: int, fresh: np.ndarray | None) -> None:
        """Bring the clocks to `t_base`, and empty the queues of fresh environments."""
        passed = min(max(t_base - self._base, 0), 1 << (SPAN_BITS - self._fraction)) << self._fraction
        self._free = np.maximum(self._free - passed, 0)
        self._base = t_base
        if fresh is None or not np.any(fresh):
            return
        self._free[np.asarray(fresh, bool)] = 0
        if self._held is not None:
            stale = np.asarray(fresh, bool)[self._held["env"]]
            self.cut += int(stale.sum())
            self._held = {name: column[~stale] for name, column in self._held.items()}

    def _serve(self, columns: dict[str, np.ndarray], offsets: np.ndarray, t_base: int) -> np.ndarray:
        """Stamps of the new events, -1 for those that the full queue turned away."""
        stamps = np.empty(len(columns["t"]), np.int64)
        if not len(stamps):
            return stamps
        statistics = np.zeros((self._envs, 4), np.int64)
        none = np.zeros(0, np.uint8)
        given = [offsets, *(np.ascontiguousarray(columns[n]) for n in ("t", "x", "y", "p")), columns.get("c", none)]
        arrays: list[wp.array] = [
            wp.array(a, copy=False, device="cpu") for a in (*given, self._free, stamps, statistics)
        ]  # fmt: skip
        wp.launch(kernels.serve, self._envs, [self._queue, t_base, *arrays], device="cpu")
        if self._free.max() >> SPAN_BITS:
            raise ValueError("the readout's queue is longer than its clock; raise readout_rate or limit the queue")
        self.delayed += int(statistics[:, 0].sum())
        self.delay_ns += int(statistics[:, 1].sum())
        self.longest_ns = max(self.longest_ns, int(statistics[:, 2].max()))
        self.dropped += int(statistics[:, 3].sum())
        return stamps

    def _sorted(self, events: dict[str, np.ndarray], t_base: int) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """By environment, t, y, x, channel, polarity; offsets of the environments."""
        env = events.pop("env")
        order = self._order(events, env, t_base)
        if order is not None:
            events = {name: column[order] for name, column in events.items()}
            env = env[order]
        return events, np.searchsorted(env, np.arange(self._envs + 1)).astype(np.int64)

    def _order(self, events: dict[str, np.ndarray], env: np.ndarray, t_base: int) -> np.ndarray | None:
        """Indices that sort; None where nothing is to do."""
        t = events["t"]
        if not len(t):
            return None
        channel = events.get("c", np.zeros(1, np.uint8))
        bits_x, bits_y, bits_env = ((n - 1).bit_length() for n in (*self._size, self._envs))
        shift = 3 + bits_x + bits_y
        room = 63 - shift - bits_env
        if int(t.max()) - t_base >> room:
            return np.lexsort((events["p"], np.broadcast_to(channel, t.shape), events["x"], events["y"], t, env))
        key = (t - t_base) << shift
        key |= events["y"].astype(np.int64) << (3 + bits_x)
        key |= events["x"].astype(np.int64) << 3
        key |= channel.astype(np.int64) << 1
        key |= events["p"]
        if self._envs > 1:
            key |= env.astype(np.int64) << (63 - bits_env)
        return None if np.all(key[1:] >= key[:-1]) else np.argsort(key, kind="stable")
