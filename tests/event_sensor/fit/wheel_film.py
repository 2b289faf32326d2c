"""A wheel, half black and half white, that turns and slows down, drawn from its definition; and events of it."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import erf

from nodes.event_sensor.simulate import simulate

HUB = (31.3, 27.8)
SIZE = (56, 64)
WHITE, CONTRAST = 0.889, 2.1
STILL_S, MOVING_S = 0.4, 0.45
FASTEST, SLOWING = 45.0, 6.0
"""Speed at the start [rad/s] and its rate of decay [1/s]."""
FRAME_NS = 250_000


def angle(s):
    """Of the border [rad], s seconds after it starts to move."""
    return 2.5 + FASTEST / SLOWING * -np.expm1(-SLOWING * np.clip(s, 0, MOVING_S))


def frame(t_ns, blur=0.6):
    """Light [H, W]: white on the side that the border turns away from."""
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    psi = angle(t_ns * 1e-9 - STILL_S)
    beyond = math.sin(psi) * (x - HUB[0]) - math.cos(psi) * (y - HUB[1])
    white = 0.5 * (1 + erf(beyond / blur / math.sqrt(2)))
    black = WHITE * math.exp(-CONTRAST)
    return (black + (WHITE - black) * white).astype(np.float32)


def record(**sensor):
    """Events of a sensor: t, x, y, p."""
    end = round((STILL_S + MOVING_S) * 1e9)
    moving = np.arange(round(STILL_S * 1e9), end, FRAME_NS)
    times = np.concatenate([np.arange(0, moving[0], 10_000_000), moving, np.arange(end, end + 300_000_000, 10_000_000)])
    packets = list(simulate(((int(t), frame(t)) for t in times), **sensor))
    return [np.concatenate([getattr(packet, name) for packet in packets]) for name in "txyp"]
