"""Lays out the key of an event: 63 bits whose order is environment, time, row, column.

A key holds, from the top: environment, t - t_base [ns], y, x, colour channel (2 bits), polarity (1 bit), and, where
events are marked, whether noise made it (1 bit, at the bottom, so that no order hangs on it). Columns take
bits(W - 1), rows bits(H - 1), environments bits(E - 1); the rest is for time: 42 bits (73 minutes) for one environment
of 346x260, at least 28 bits (268 ms) ever. A message that is longer is refused, nothing wraps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nodes.event_sensor.input.limit import REMEDY, longest_step

KEY_BITS = 63
LEAST_TIME_BITS = 28
"""Bits for time below which a sensor is refused: 268 ms, eight gaps of 30 keyframes per second."""


@dataclass(frozen=True)
class KeyLayout:
    """Gives the first bit of each field of a key."""

    x: int
    y: int
    t: int
    env: int

    @staticmethod
    def of(height: int, width: int, envs: int, marked: bool = False) -> KeyLayout:
        """Chooses the layout for images of this size. marked: with a bit for noise. Raises ValueError when no useful
        room for time is left.
        """
        x = 4 if marked else 3
        y = x + (width - 1).bit_length()
        t = y + (height - 1).bit_length()
        env = KEY_BITS - (envs - 1).bit_length()
        if env - t < LEAST_TIME_BITS:
            raise ValueError(f"{envs} environments of {width}x{height} pixels are too many for one event sensor")
        return KeyLayout(x, y, t, env)

    @property
    def marked(self) -> bool:
        """Tells whether keys have a bit for noise."""
        return self.x == 4

    def without_mark(self) -> KeyLayout:
        """Gives the layout of keys of a marked one that were shifted by the bit for noise."""
        return KeyLayout(self.x - 1, self.y - 1, self.t - 1, self.env - 1)

    def check_span(self, t_base: int, t: np.ndarray) -> None:
        """Raises ValueError when a message from t_base [ns] with frames at t [ns] is too long for the key."""
        bits = self.env - self.t
        span_ns = int(t[-1]) - t_base
        if span_ns >> bits:
            raise ValueError(
                f"a message of {span_ns} ns is too long for the event sensor: at this image size and number of "
                f"environments it takes up to {(1 << bits) - 1} ns; its longest step is {longest_step(t_base, t)}: "
                f"{REMEDY}"
            )
