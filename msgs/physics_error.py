"""Defines what physics says at its end: how far its bodies are from where exact integration would have them."""

from __future__ import annotations

from dataclasses import dataclass

from msgs.header import Header, Message


@dataclass
class PhysicsError(Message):
    """Carries the largest errors up to header.stamp_ns of the body that is furthest off.

    body: its name. position_m: error of its position [m]. rotation_rad: of its rotation [rad], at most pi.
    """

    header: Header
    body: str = ""
    position_m: float = 0.0
    rotation_rad: float = 0.0
