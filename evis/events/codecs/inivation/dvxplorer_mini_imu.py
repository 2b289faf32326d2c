"""Decodes inertial samples of a DVXplorer Mini: packets of 16 bytes on an endpoint beside the events, without a time.

Byte 0 is 1; byte 1 holds what is there (bit 7 accelerometer, 6 gyroscope, 5 thermometer) and the ranges (bits 3-4 and
0-2, as in a DVXplorer's word); seven int16, little endian, follow. Byte 0 = 0 is a message of the firmware: byte 1 its
code, bytes 2-5 a time, then text.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from evis.events.codecs.inivation.imu import ACCELEROMETER, BOSCH, GYROSCOPE, TEMPERATURE

PACKET = 16
SAMPLE, MESSAGE = 1, 0
"""Kinds of packets, byte 0."""
TURNED = dataclasses.replace(BOSCH, order=(5, 4, 3, 6, 2, 1, 0))
"""The chip lies on its side: gz gy gx az ay ax T on the wire (libcaer, for firmware before 10)."""
STRAIGHT = dataclasses.replace(BOSCH, order=(3, 4, 5, 6, 0, 1, 2))
"""gx gy gz ax ay az T (jAER, for firmware from 10 on)."""


class MiniImu:
    """Converts packets to samples and back. orientation: bits 2, 1, 0 turn x, y, z around."""

    def __init__(self, straight: bool = False, orientation: int = 0) -> None:
        self.chip = STRAIGHT if straight else TURNED
        self._signs = np.array([-1.0 if orientation & bit else 1.0 for bit in (4, 2, 1)])

    def sample(self, packet: bytes) -> np.ndarray | None:
        """Reads [7] acceleration [m/s^2], angular velocity [rad/s], temperature [deg C]; NaN: absent. None if
        damaged.
        """
        if len(packet) != PACKET or packet[0] != SAMPLE:
            return None
        scales = packet[1]
        if not scales >> 5 or scales & self.chip.gyroscope_mask >= len(self.chip.gyroscope_dps):
            return None
        values = self.chip.in_units(np.frombuffer(packet, "<i2", 7, 2).astype(np.float64), scales)
        values[:3] *= self._signs
        values[3:6] *= self._signs
        for kind, part in ((ACCELEROMETER, slice(0, 3)), (GYROSCOPE, slice(3, 6)), (TEMPERATURE, slice(6, 7))):
            if not scales >> 5 & kind:
                values[part] = np.nan
        return values

    def packet(self, acceleration: np.ndarray, angular_velocity: np.ndarray, temperature: float) -> bytes:
        """Encodes a sample of a camera whose chip is not turned (orientation 0), NaN: absent.

        Raises ValueError beyond 16 g and 2000 deg/s.
        """
        wire, scales = self.chip.on_wire(acceleration, angular_velocity, temperature)
        return bytes([SAMPLE, scales]) + np.nan_to_num(wire).astype("<i2").tobytes()


def message_of(packet: bytes) -> str | None:
    """Returns the text of a message of the firmware; None for anything else."""
    if len(packet) < 7 or packet[0] != MESSAGE:
        return None
    return packet[6:].split(b"\0")[0].decode("ascii", "replace") + f" (code {packet[1]})"
