"""Implements what the published event models share: parameters, episodes, buffers, the order of events."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import warp as wp

from evis.config.params import Param, ParamError, resolve
from evis.gpu.saved_arrays import joined, part_of, saved, write_back
from nodes.event_sensor.input.limit import MOST_BACKGROUND, REMEDY, check_background_rate, longest_step
from nodes.event_sensor.parameters import LARGEST_SIDE, SENSOR, thresholds_of
from nodes.event_sensor.peers import kernels
from nodes.event_sensor.sensor import Events

THRESHOLDS = ("threshold", "threshold_on", "threshold_off")


def filled(struct: Any, **values: Any) -> Any:
    """Returns a Warp struct with these values."""
    for name, value in values.items():
        setattr(struct, name, value)
    return struct


class Model:
    """Simulates E event cameras of the same size, on the CPU; luminance only.

    Events of a call are sorted by environment, t, y, x and lie in (previous stamp, last stamp]. The first frame of an
    episode sets the reference and fires nothing. A sample that is NaN, infinite or negative leaves its pixel as it was
    and is counted, whatever the published program did. Random numbers are drawn by (seed + env, pixel, frame number),
    so that they depend neither on the batch nor on how frames are cut into calls.
    """

    NAME: ClassVar[str]
    USES: ClassVar[tuple[str, ...]]
    """Parameters of SENSOR that the model has."""
    OWN: ClassVar[Mapping[str, Param]] = {}
    """Its own parameters."""

    def __init__(self, height: int, width: int, envs: int = 1, *, seed: int = 0, **params: Any) -> None:
        """Raises ValueError for a size or a parameter out of range."""
        if not (1 <= height <= LARGEST_SIDE and 1 <= width <= LARGEST_SIDE and envs >= 1):
            raise ValueError(f"event model {self.NAME} cannot have {envs} x {height} x {width} pixels")
        self.height, self.width, self.envs = height, width, envs
        self.params = self._resolve(params)
        self.seed = seed & 0x3FFFFFFF
        self.nonfinite = 0
        self.t_base = 0
        self._pixels = height * width
        self._shift_t = 1 + (self._pixels - 1).bit_length()
        self._shift_env = 63 - (envs - 1).bit_length()
        self._episodes: np.ndarray | None = None
        self._last_stamp = 0
        self._number = 0
        self._counters = wp.zeros(2, dtype=wp.int64, device="cpu")
        self._keys: wp.array = wp.empty(max(4096, envs * self._pixels), dtype=wp.int64, device="cpu")

    def _keep(self, sensor: Any, pixel: Any, kernel: Any = None) -> None:
        """Keeps the model's parameters and makes its state, structs both; kernel: of each_pixel, where that is all."""
        self._sensor, self._kernel = sensor, kernel
        self._before: wp.array = wp.zeros(self.envs * self._pixels, dtype=pixel, device="cpu")
        self._after: wp.array = wp.zeros_like(self._before)

    def _resolve(self, given: dict[str, Any]) -> dict[str, Any]:
        """Returns all parameters of the model, threshold_on and threshold_off filled in."""
        declared = {name: SENSOR[name] for name in (*THRESHOLDS, *self.USES)} | dict(self.OWN)
        for name in sorted(set(given) & set(SENSOR) - set(declared) - {"model"}):
            if given[name] is not None and SENSOR[name].convert(self.NAME, name, given[name]) != SENSOR[name].default:
                raise ParamError(
                    f"event model {self.NAME} has no {name}, which is {given[name]} here; leave it out, and a preset "
                    f"that sets it. The model has {', '.join(sorted(declared))}"
                )
        kept = {name: value for name, value in given.items() if name in declared or name not in SENSOR}
        kept = {name: value for name, value in kept.items() if value is not None}
        params = resolve(f"event model {self.NAME}", declared, kept)
        params["threshold_on"], params["threshold_off"] = thresholds_of(params)
        return params

    def prepare(self, frame: kernels.Frame, images: wp.array, fresh: wp.array) -> None:
        """Prepares a frame: computes, once, what comes before its events. Parameters as in `emit`."""

    def emit(self, frame: kernels.Frame, images: wp.array, fresh: wp.array, keys: wp.array, counters: wp.array) -> None:
        """Writes the events of a frame; may be called again with a longer buffer, so it leaves the state alone.

        Args:
            frame: which frame.
            images: luminance, float32 [E, K, H, W] flat.
            fresh: int32 [E], not 0 where an episode begins.
            keys: the list of events, int64.
            counters: how many there are, and samples that are not usable.
        """
        inputs = [frame, self._sensor, images, fresh, self._before]
        wp.launch(self._kernel, len(self._before), inputs, [self._after, keys, counters], device="cpu")

    def commit(self) -> None:
        """Makes the state after `emit` the state before the next frame."""
        self._before, self._after = self._after, self._before

    def process(self, luminance: np.ndarray, t: np.ndarray, episodes: np.ndarray) -> Events:
        """Returns the events of K frames.

        luminance float32 [E, K, H, W], linear; t int64 [K] ns, ascending; episodes int [E].
        Raises ValueError for shapes that do not fit and stamps that do not ascend.
        """
        t = np.ascontiguousarray(t, dtype=np.int64)
        fresh = self._fresh(np.shape(luminance), t, np.asarray(episodes))
        images: wp.array = wp.array(np.reshape(luminance, -1), dtype=wp.float32, device="cpu", copy=False)
        self.t_base = int(t[0]) if fresh.all() else self._last_stamp
        if (int(t[-1]) - self.t_base).bit_length() > self._shift_env - self._shift_t:
            raise ValueError(
                f"a message of {t[-1] - self.t_base} ns is too long for event model {self.NAME}; its longest step is "
                f"{longest_step(self.t_base, t)}: {REMEDY}"
            )
        leak = self.params.get("leak_rate", 0.0) * self.envs * self._pixels
        check_background_rate(leak, f"{self.envs} x {self._pixels}", self.t_base, t)
        self._counters.zero_()
        starts: wp.array = wp.array(fresh.astype(np.int32), device="cpu")
        none: wp.array = wp.zeros_like(starts)
        before = self.t_base
        for k, stamp in enumerate(t.tolist()):
            self._advance(self._frame(k, len(t), before, stamp), images, none if k else starts)
            before = stamp
        self._episodes, self._last_stamp = np.array(episodes), int(t[-1])
        count, nonfinite = (int(v) for v in self._counters.numpy())
        self.nonfinite += nonfinite
        return self._sorted(count)

    def _fresh(self, shape: tuple[int, ...], t: np.ndarray, episodes: np.ndarray) -> np.ndarray:
        expected = (self.envs, len(t), self.height, self.width)
        if shape != expected or len(t) == 0 or episodes.shape != (self.envs,):
            raise ValueError(
                f"event model {self.NAME} got luminance {shape} with {len(t)} stamps and episodes {episodes.shape}, "
                f"expected {expected} and ({self.envs},)"
            )
        fresh = np.ones(self.envs, bool) if self._episodes is None else episodes != self._episodes
        if np.any(np.diff(t) <= 0) or (not fresh.all() and t[0] <= self._last_stamp):
            raise ValueError(f"event model {self.NAME} got stamps that do not ascend")
        return fresh

    def _frame(self, k: int, count: int, before: int, stamp: int) -> kernels.Frame:
        number = self._number
        self._number = (number + 1) & 0x1FFFFFFF
        return filled(
            kernels.Frame(), k=k, count=count, pixels=self._pixels, seed=self.seed, number=number, t_base=self.t_base,
            before=before, span=stamp - before, shift_t=self._shift_t, shift_env=self._shift_env,
        )  # fmt: skip

    def _advance(self, frame: kernels.Frame, images: wp.array, fresh: wp.array) -> None:
        """Senses one frame; its events are made again when they did not fit."""
        self.prepare(frame, images, fresh)
        counters = self._counters.numpy()
        so_far = counters.copy()
        while True:
            self.emit(frame, images, fresh, self._keys, self._counters)
            if counters[0] <= len(self._keys):
                break
            if counters[0] >= 2 * MOST_BACKGROUND:
                before, stamp = int(frame.before), int(frame.before) + int(frame.span)
                raise ValueError(
                    f"event model {self.NAME} makes {counters[0]} events, too many for a message, from {before} ns to "
                    f"the frame at {stamp} ns: {REMEDY}, or raise the threshold"
                )
            longer: wp.array = wp.empty(2 * int(counters[0]), dtype=wp.int64, device="cpu")
            longer.numpy()[: so_far[0]] = self._keys.numpy()[: so_far[0]]
            self._keys = longer
            counters[:] = so_far
        self.commit()

    def _sorted(self, count: int) -> Events:
        keys = np.sort(self._keys.numpy()[:count])
        pixel = (keys >> 1) & ((1 << (self._shift_t - 1)) - 1)
        y, x = np.divmod(pixel, self.width)
        t = ((keys >> self._shift_t) & ((1 << (self._shift_env - self._shift_t)) - 1)) + self.t_base
        firsts = np.arange(self.envs, dtype=np.int64) << self._shift_env if self.envs > 1 else np.zeros(1, np.int64)
        offsets = np.append(np.searchsorted(keys, firsts), count).astype(np.int64)
        return Events(t, x.astype(np.uint16), y.astype(np.uint16), (keys & 1).astype(np.uint8), None, offsets)

    def state(self) -> dict[str, Any]:
        """Gives what the next events hang on, as plain values; the fixed pattern is that of the seed."""
        kept: dict[str, Any] = {"last_stamp": self._last_stamp, "number": self._number, "t_base": self.t_base}
        kept |= {"nonfinite": self.nonfinite} | joined({"pixels": saved({"pixel": self._before})})
        return kept if self._episodes is None else {**kept, "episodes": np.array(self._episodes)}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restores what `state` gave for a model of the same size, parameters and seed. Raises ValueError."""
        write_back({"pixel": self._before}, part_of(state, "pixels"))
        self._last_stamp, self._number, self.t_base, self.nonfinite = (
            int(state[name]) for name in ("last_stamp", "number", "t_base", "nonfinite")
        )
        self._episodes = np.array(state["episodes"]) if "episodes" in state else None

    def counts(self) -> dict[str, int]:
        """Returns how many samples so far were not finite or negative."""
        return {"nonfinite": self.nonfinite}

    def flush(self) -> Events:
        """Returns no events: none of these models looks ahead, so nothing is held back."""
        return self._sorted(0)
