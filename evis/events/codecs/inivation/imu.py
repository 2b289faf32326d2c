"""Decodes inertial samples in iniVation streams: a start word, one with scales and kinds, two bytes a value, an end
word."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evis.events.arrays import STANDARD_GRAVITY, Imu
from evis.events.codecs.inivation.words import IMU_END, IMU_START

TEMPERATURE, GYROSCOPE, ACCELEROMETER = 1, 2, 4
"""Kinds of values in one sample, bits 5-7 of the word with the scales."""
_MAX_WORDS = 64
_MINE = np.zeros(1 << 16, bool)
_MINE[[1, IMU_START, IMU_END]] = _MINE[0x5000:0x5100] = _MINE[0x5300:0x5400] = True


@dataclass(frozen=True)
class ImuChip:
    """Converts a chip's numbers to units.

    accelerometer_shift: place of its two scale bits, +-(2 << scale) g. gyroscope_dps: full range [deg/s] by scale.
    temperature: (per count, at 0) [deg C]. order: where ax ay az T gx gy gz are among the seven values on the wire.
    """

    accelerometer_shift: int
    gyroscope_dps: tuple[int, ...]
    gyroscope_mask: int
    temperature: tuple[float, float]
    order: tuple[int, ...]

    def sample(self, words: np.ndarray) -> np.ndarray | None:
        """Reads [7] acceleration, angular velocity, temperature of the words between start and end; None if damaged."""
        data = words & 0xFF
        is_scale = words >> 8 == 0x53
        if np.count_nonzero(is_scale) != 1 or not is_scale[0]:
            return None
        scales, kinds = int(data[0]), int(data[0]) >> 5
        raw = data[1:].astype(np.uint8).tobytes()
        present = [ACCELEROMETER] * 3 + [TEMPERATURE] + [GYROSCOPE] * 3
        use = np.array([bool(kinds & kind) for kind in present])
        range_at = scales & self.gyroscope_mask
        if not kinds or len(raw) != 2 * np.count_nonzero(use) or range_at >= len(self.gyroscope_dps):
            return None
        wire = np.full(7, np.nan)
        wire[use] = np.frombuffer(raw, ">i2")
        return self.in_units(wire, scales)

    def in_units(self, wire: np.ndarray, scales: int) -> np.ndarray:
        """Converts the wire's seven values to [7] acceleration [m/s^2], angular velocity [rad/s], temperature [deg
        C].
        """
        per_g, per_dps = self._units(scales >> self.accelerometer_shift & 3, scales & self.gyroscope_mask)
        wire = wire[list(self.order)]
        values = np.empty(7)
        values[:3] = wire[:3] / per_g * STANDARD_GRAVITY
        values[3:6] = np.radians(wire[4:] / per_dps)
        values[6] = wire[3] * self.temperature[0] + self.temperature[1]
        return values

    def words(self, acceleration: np.ndarray, angular_velocity: np.ndarray, temperature: float) -> np.ndarray:
        """Encodes the words of one sample, in the finest scales that hold it, without vectors with NaN. Raises
        ValueError.
        """
        wire, scales = self.on_wire(acceleration, angular_velocity, temperature)
        raw = wire[~np.isnan(wire)].astype(">i2").tobytes()
        body = 0x5000 | np.frombuffer(raw, np.uint8).astype(np.int64)
        return np.concatenate([[IMU_START, 0x5300 | scales], body, [IMU_END]])

    def on_wire(
        self, acceleration: np.ndarray, angular_velocity: np.ndarray, temperature: float
    ) -> tuple[np.ndarray, int]:
        """Returns the seven whole numbers of a sample as float64 (NaN: absent), and the byte of kinds and scales.
        ValueError as `words`.
        """
        g, dps = (
            np.asarray(v, np.float64) + (0 if np.isfinite(v).all() else np.nan)
            for v in (acceleration, angular_velocity)
        )
        g, dps = g / STANDARD_GRAVITY, np.degrees(dps)
        accelerometer, range_at = 0, min(range(len(self.gyroscope_dps)), key=self.gyroscope_dps.__getitem__)
        kinds = 0
        if not np.isnan(g).any():
            kinds |= ACCELEROMETER
            accelerometer = next((s for s in range(4) if np.abs(g).max() < (2 << s) * 0.9999), -1)
        if not np.isnan(dps).any():
            kinds |= GYROSCOPE
            by_range = sorted(range(len(self.gyroscope_dps)), key=self.gyroscope_dps.__getitem__)
            range_at = next((s for s in by_range if np.abs(dps).max() < self.gyroscope_dps[s] * 0.9999), -1)
        if not np.isnan(temperature):
            kinds |= TEMPERATURE
        if accelerometer < 0 or range_at < 0 or not kinds:
            limits = f"16 g and {max(self.gyroscope_dps)} deg/s"
            raise ValueError(f"an inertial sample of {np.round(g, 1)} g, {np.round(dps)} deg/s is beyond {limits}")
        per_g, per_dps = self._units(accelerometer, range_at)
        heat = (temperature - self.temperature[1]) / self.temperature[0]
        wire = np.concatenate([g * per_g, [np.clip(heat, -32768, 32767)], dps * per_dps])
        placed = np.empty(7)
        placed[list(self.order)] = np.rint(wire)
        return placed, kinds << 5 | accelerometer << self.accelerometer_shift | range_at

    def _units(self, accelerometer: int, range_at: int) -> tuple[float, float]:
        return 32768 / (2 << accelerometer), 32768 / self.gyroscope_dps[range_at]


INVENSENSE = ImuChip(2, (250, 500, 1000, 2000), 3, (1 / 340, 35.0), (0, 1, 2, 3, 4, 5, 6))
"""MPU-6050 and relatives, in the DAVIS346."""
BOSCH = ImuChip(3, (2000, 1000, 500, 250, 125), 7, (1 / 512, 23.0), (1, 0, 2, 3, 5, 4, 6))
"""BMI160, in the DVXplorer, turned: x and y are exchanged on the wire."""


class ImuReader:
    """Assembles samples from words that come in pieces. A sample's time is that of its end.

    orientation: what the camera's register says of how the chip is mounted; bits 2, 1, 0 turn x, y, z around.
    """

    def __init__(self, chip: ImuChip, orientation: int = 0) -> None:
        self.chip = chip
        self._signs = np.array([-1.0 if orientation & bit else 1.0 for bit in (4, 2, 1)])
        self._open: np.ndarray | None = None

    def feed(self, t_us: np.ndarray, words: np.ndarray) -> tuple[Imu, int]:
        """Takes words and returns (samples completed, number of samples damaged). t_us int64 [n]; words uint16 [n],
        others than inertial are skipped.
        """
        mine = np.flatnonzero(_MINE[words])
        if not len(mine):
            return Imu(), 0
        t_us, words = t_us[mine], words[mine]
        times, samples, damaged, begin = [], [], 0, 0
        for i in np.flatnonzero(words < 8):
            body = words[begin:i] if self._open is None else np.concatenate([self._open, words[begin:i]])
            is_open = self._open is not None
            if words[i] == IMU_END:
                sample = self.chip.sample(body) if is_open and 0 < len(body) <= _MAX_WORDS else None
                if sample is None:
                    damaged += 1
                else:
                    times.append(int(t_us[i]) * 1000)
                    samples.append(sample)
            else:
                damaged += is_open
            self._open = words[:0] if words[i] == IMU_START else None
            begin = int(i) + 1
        if self._open is not None:
            self._open = np.concatenate([self._open, words[begin:]])
            if len(self._open) > _MAX_WORDS:
                self._open, damaged = None, damaged + 1
        if not samples:
            return Imu(), damaged
        values = np.array(samples)
        acceleration, angular_velocity = values[:, :3] * self._signs, values[:, 3:6] * self._signs
        return Imu(np.array(times, np.int64), acceleration, angular_velocity, values[:, 6].copy()), damaged
