"""Where each field of an event's key starts: 63 bits that sort to environment, time, row, column.

A key holds, from the top: environment, t - t_base [ns], y, x, colour channel (2 bits), polarity (1 bit). Columns take
bits(W - 1), rows bits(H - 1), environments bits(E - 1); the rest is for time: 42 bits (73 minutes) for one environment
of 346x260, at least 28 bits (268 ms) ever. A message that is longer is refused, nothing wraps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nodes.event_sensor.message_limit import REMEDY, longest_step

KEY_BITS = 63


@dataclass(frozen=True)
class KeyLayout:
    """Where each field of a key starts."""

    x: int
    y: int
    t: int
    env: int

    @staticmethod
    def of(height: int, width: int, envs: int) -> KeyLayout:
        """Layout for images of this size. Raises ValueError when no useful room for time is left."""
        x = 3
        y = x + (width - 1).bit_length()
        t = y + (height - 1).bit_length()
        env = KEY_BITS - (envs - 1).bit_length()
        if env - t < 28:
            raise ValueError(f"{envs} environments of {width}x{height} pixels are too many for one event sensor")
        return KeyLayout(x, y, t, env)

    def check_span(self, t_base: int, t: np.ndarray) -> None:
        """Raise ValueError when a message from t_base [ns] with frames at t [ns] is too long for the key."""
        bits = self.env - self.t
        span_ns = int(t[-1]) - t_base
        if span_ns >> bits:
            raise ValueError(
                f"a message of {span_ns} ns is too long for the event sensor: at this image size and number of "
                f"environments it takes up to {(1 << bits) - 1} ns; its longest step is {longest_step(t_base, t)}: "
                f"{REMEDY}"
            )
