"""Computes the time surface: how long ago each pixel saw its latest event, as a value that fades."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import warp as wp

from evis.events.representations.columns import (
    NEVER,
    POLARITIES,
    TYPES,
    Columns,
    Representation,
    check_choice,
    check_positive,
)
from evis.events.representations.surface_kernels import latest_kernel, surface_kernel

DECAYS = ("exponential", "linear")

for _types in TYPES:
    wp.overload(latest_kernel, _types)


class TimeSurface:
    """Keeps the latest event of every pixel, over as many packets as come.

    Args:
        tau_ns: time constant of the decay [ns].
        decay: exponential, exp(-age / tau), after X. Lagorce et al., TPAMI 2017, eq. (2); or linear,
            max(0, 1 - age / tau).
        polarity: split ([2, H, W], OFF first), signed ([H, W], minus where the latest event is OFF), or merged.
        height, width: of the array; None = what the events say.
    """

    def __init__(
        self,
        tau_ns: int,
        *,
        decay: str = "exponential",
        polarity: str = "split",
        height: int | None = None,
        width: int | None = None,
    ) -> None:
        """Makes an empty surface. Raises ValueError."""
        check_positive("tau_ns", tau_ns)
        check_choice("decay", decay, DECAYS)
        check_choice("polarity", polarity, POLARITIES)
        self._tau_ns, self._decay, self._polarity = int(tau_ns), DECAYS.index(decay), polarity
        self._height, self._width = height, width
        self._latest: Any = None
        self._seen = np.zeros(0, np.int64)

    def __deepcopy__(self, memo: dict[int, Any]) -> TimeSurface:
        """Copies the surface with what it has seen, on its device."""
        made = copy.copy(self)
        made._latest = None if self._latest is None else wp.clone(self._latest)
        made._seen = self._seen.copy()
        return made

    def update(self, events: Any, at: Any = None) -> Representation:
        """Adds events and returns the surface.

        Args:
            events: anything with attributes or items t [n, int64 ns], x, y, p; with env_offsets [E + 1] a batch.
            at: when the surface is looked at [ns], one time or int64 [E], not before the times of earlier calls; later
                events are left out and counted. None = the last event so far.

        Returns:
            values float32 [2, H, W] or [H, W], in a batch with E before: 0 where nothing was seen, and the counts of
            events outside. Raises ValueError.
        """
        columns = Columns(events, self._height, self._width)
        shape = (columns.envs, 2, columns.height, columns.width)
        if self._latest is None:
            self._latest = wp.full(shape, wp.int64(NEVER), dtype=wp.int64, device=columns.device)
            self._seen = np.full(columns.envs, NEVER, np.int64)
        if self._latest.shape != shape or self._latest.device != columns.device:
            raise ValueError(
                f"events of {columns.envs} x {columns.height} x {columns.width} on {columns.device}; the surface has "
                f"{self._latest.shape[0]} x {self._latest.shape[2]} x {self._latest.shape[3]} on {self._latest.device}"
            )
        last = self._last_times(columns, at)
        window = columns.window((np.full(columns.envs, NEVER, np.int64), last))
        outputs = [self._latest, columns.outside]
        wp.launch(
            latest_kernel, columns.count, inputs=[*columns.per_event, window], outputs=outputs, device=columns.device
        )
        self._seen = last.copy()
        return columns.result(*self._faded(columns))

    def _last_times(self, columns: Columns, at: Any) -> np.ndarray:
        """Returns the time at which each environment is looked at, int64 [E]. Raises ValueError where time
        steps back."""
        if at is None:
            return np.maximum(columns.window(None).numpy()[:, 1], self._seen)
        last = columns.times(at, "last")
        if (last < self._seen).any():
            env = int(np.argmax(last < self._seen))
            raise ValueError(f"the surface was looked at {self._seen[env]} ns, and time goes back to {last[env]} ns")
        return last

    def _faded(self, columns: Columns) -> tuple[Any, tuple[int, ...]]:
        shape = (columns.height, columns.width)
        channels = 2 if self._polarity == "split" else 1
        values: Any = wp.empty((columns.envs, channels, *shape), dtype=wp.float32, device=columns.device)
        at: Any = wp.array(self._seen, dtype=wp.int64, device=columns.device)
        inputs = [self._latest, at, wp.int64(self._tau_ns), self._decay, POLARITIES.index(self._polarity)]
        wp.launch(surface_kernel, (columns.envs, *shape), inputs=inputs, outputs=[values], device=columns.device)
        return values, (2, *shape) if channels == 2 else shape

    def reset(self, envs: Any = None) -> None:
        """Forgets the events of some environments (their numbers), or of all."""
        if self._latest is None:
            return
        for env in range(len(self._seen)) if envs is None else envs:
            self._latest[int(env)].fill_(wp.int64(NEVER))
            self._seen[int(env)] = NEVER


def time_surface(
    events: Any,
    tau_ns: int,
    *,
    at: Any = None,
    decay: str = "exponential",
    polarity: str = "split",
    height: int | None = None,
    width: int | None = None,
) -> Representation:
    """Computes the time surface of these events alone; arguments and result are those of `TimeSurface` and its
    `update`."""
    return TimeSurface(tau_ns, decay=decay, polarity=polarity, height=height, width=width).update(events, at)
