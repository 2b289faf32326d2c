"""Simulates a frame camera: frames of light at sub-frame times in, images of exposures out, for environments side by
side."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from evis.gpu.saved_arrays import saved, write_back
from evis.random_numbers import GOLDEN, mix, seed_of_camera
from msgs.own_time import CONFIGURED, NUMBER, ORIGIN, SEED
from nodes.event_sensor.optics.defocus import Defocus
from nodes.frame_camera import exposure_kernels as kernels
from nodes.frame_camera.parameters import Settings
from nodes.frame_camera.timetable import Exposure, Timetable, quadrature, slots_for

SALT = np.uint64(0x4150533A6672616D)
"""Sets the streams of images apart from those of the event sensor with the same seed."""


OTHERS = ("_at", "clipped", "nonfinite", "cut_off")
"""What a camera goes on from besides light and times of exposures."""


@dataclass(frozen=True)
class Shot:
    """Holds one image. stamp_ns: the middle of its exposure, from the first row's start to the last one's end.

    pixels: uint8, or uint16 with the bits at the top, [H, W, C].
    """

    env: int
    number: int
    stamp_ns: int
    exposure_ns: int
    pixels: np.ndarray


class FrameCamera:
    """Exposes and reads out images of E environments from frames that come gap by gap."""

    def __init__(
        self, settings: Settings, seeds: Sequence[int], shape: tuple[int, int, int], device: str = "cpu",
        defocus_px: float = 0.0, name: str = "cam0",
    ) -> None:  # fmt: skip
        """seeds: one of each environment. shape: height, width and channels of the frames. name: of the camera.

        Raises ValueError for a rolling shutter that needs more than the time between two images.
        """
        self._settings, self._seeds, self._shape, self._name = settings, tuple(seeds), shape, name
        envs = len(seeds)
        self._device = wp.get_device(device)
        self._size = int(np.prod(shape))
        rows = shape[0]
        self.tables = [Timetable(settings, rows) for _ in range(envs)]
        self._slots = slots_for(settings, rows)
        self._light: wp.array = wp.zeros((self._slots, envs, self._size), dtype=wp.float64, device=self._device)
        self._before: wp.array = wp.zeros((envs, self._size), dtype=wp.float32, device=self._device)
        self._pixels: wp.array = wp.zeros((envs, self._size), dtype=wp.uint16, device=self._device)
        self._at = np.zeros(envs, np.int64)
        """Own stamp of each environment's last frame [ns]."""
        self._defocus = Defocus(defocus_px, device) if defocus_px > 0 else None
        self._readout = _readout(settings)
        self.clipped = self.nonfinite = self.cut_off = 0
        """Pixels at full scale, pixels whose light is no number or infinite, and exposures that a reset ended."""

    def push(self, frames: Any, t: np.ndarray, anew: np.ndarray, rows: np.ndarray) -> list[Shot]:
        """Takes the frames of a gap and returns the images that end in it, by stamp and environment.

        Args:
            frames: float32 [E, K, H, W(, C)], linear light, of numpy or on the device.
            t: int64 [E, K] ns, their own times in each environment.
            anew: bool [E], environments that begin an episode with the last frame; of them the others are not looked
                at. One that neither begins nor gets later is passed by.
            rows: int64 [E, 4], see msgs.own_time.
        """
        envs, count = t.shape
        flat = self._flat(frames, envs, count)
        for env in np.flatnonzero(anew).tolist():
            self._begin(env, int(t[env, -1]), flat)
        moving = ~anew & (t[:, -1] > self._at)
        shots = self._expose(flat, t, moving, rows) if moving.any() else []
        wp.launch(
            kernels.remember, self._before.shape, [flat, self._array((moving | anew).astype(np.int32)), self._before],
            device=self._device,
        )  # fmt: skip
        self._at = np.where(moving | anew, t[:, -1], self._at)
        return sorted(shots, key=lambda shot: (shot.stamp_ns, shot.env))

    def state(self) -> dict[str, Any]:
        """Gives the light of open exposures, their times, the last frame, and what was counted."""
        kept = saved({"light": self._light, "before": self._before})
        return {**kept, "tables": copy.deepcopy(self.tables), **{name: getattr(self, name) for name in OTHERS}}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Goes on from what `state` gave for a camera of the same settings and environments."""
        arrays = {"light": self._light, "before": self._before}
        write_back(arrays, {name: state[name] for name in arrays})
        self.tables = copy.deepcopy(state["tables"])
        for name in OTHERS:
            setattr(self, name, copy.copy(state[name]))

    @property
    def unfinished(self) -> int:
        """Counts the exposures that have begun and not ended."""
        return sum(table.unfinished for table in self.tables)

    def _begin(self, env: int, stamp: int, flat: wp.array) -> None:
        self.cut_off += self.tables[env].begin(stamp)
        control = self.tables[env].control
        if control.automatic:
            light = flat[env, flat.shape[1] - 1].numpy()
            control.first(light)

    def _expose(self, flat: wp.array, t: np.ndarray, moving: np.ndarray, rows: np.ndarray) -> list[Shot]:
        """One exposure of every environment after the other, until the gap is used up."""
        envs = np.flatnonzero(moving).tolist()
        pending = {env: self.tables[env].within(int(t[env, -1])) for env in envs}
        shots: list[Shot] = []
        while True:
            taken: dict[int, Exposure] = {}
            for env, exposures in list(pending.items()):
                if (exposure := next(exposures, None)) is None:
                    del pending[env]
                else:
                    taken[env] = exposure
            if not taken:
                return shots
            self._gather(flat, t, taken)
            over = {env: exposure for env, exposure in taken.items() if exposure.end <= t[env, -1]}
            if over:
                shots += self._read(over, rows)

    def _gather(self, flat: wp.array, t: np.ndarray, taken: dict[int, Exposure]) -> None:
        """Adds the light of the gap to one exposure of each of these environments."""
        envs, delay, height = len(t), self._settings.line_delay_ns, self._shape[0]
        weights = np.zeros((envs, height if delay else 1, t.shape[1] + 1))
        span, mode = np.zeros((envs, 2), np.int32), np.full(envs, kernels.IDLE, np.int32)
        for env, exposure in taken.items():
            edges = np.concatenate([self._at[env : env + 1], t[env]])
            weights[env] = quadrature(edges, exposure, delay, height)
            used = np.flatnonzero(weights[env].any(axis=0))
            span[env] = (used[0], used[-1]) if used.size else (0, -1)
            mode[env] = kernels.GO_ON if exposure.begun else kernels.BEGIN
            exposure.begun = True
        inputs = [
            flat, self._before, self._array(weights), self._array(span), self._shape[1] * self._shape[2],
            self._array(mode), self._array(self._slots_of(envs, taken)), self._light,
        ]  # fmt: skip
        wp.launch(kernels.expose, (envs, self._size), inputs, device=self._device)

    def _read(self, over: dict[int, Exposure], rows: np.ndarray) -> list[Shot]:
        """Reads out exposures that have ended."""
        envs = len(self.tables)
        slots = self._slots_of(envs, over)
        if self._defocus is not None:
            self._blur(over)
        chosen, exposed = np.zeros(envs, np.int32), np.zeros(envs)
        seeds, numbers = np.zeros(envs, np.uint64), np.zeros(envs, np.int64)
        for env, exposure in over.items():
            chosen[env], exposed[env], numbers[env] = 1, exposure.length * 1e-9, exposure.number
            seeds[env] = self._stream(env, rows[env])
        sums: wp.array = wp.zeros((envs, 3), dtype=wp.int64, device=self._device)
        channels = self._shape[2]
        inputs = [self._light, *map(self._array, (slots, chosen, exposed, seeds, numbers)), channels, self._readout]
        threads = (envs, self._size // channels)
        wp.launch(kernels.read_out, threads, [*inputs, self._pixels, sums], device=self._device)
        summed, pixels = sums.numpy(), self._pixels.numpy()
        self.clipped += int(summed[:, int(kernels.CLIPPED)].sum())
        self.nonfinite += int(summed[:, int(kernels.NONFINITE)].sum())
        eight = self._settings.sensor["image_bits"] == 8
        shots = []
        for env, exposure in over.items():
            level = float(summed[env, int(kernels.LEVEL)]) / (float(kernels.LEVEL_STEPS) * self._size)
            self.tables[env].control.read_out(exposure.end, exposure.length, level)
            self.tables[env].close(exposure)
            middle = (exposure.start + exposure.end) // 2 + int(rows[env, ORIGIN])
            image = pixels[env].astype(np.uint8 if eight else np.uint16).reshape(self._shape)
            shots.append(Shot(env, exposure.number, middle, exposure.length, image))
        return shots

    def _blur(self, over: dict[int, Exposure]) -> None:
        """Blurs gathered light as the lens does, which is the same before and after the exposure."""
        assert self._defocus is not None
        for env, exposure in over.items():
            light = self._light[exposure.number % self._slots, env]
            single: wp.array = wp.empty(self._size, dtype=wp.float32, device=self._device)
            wp.utils.array_cast(light, single)
            wp.utils.array_cast(self._defocus(single.reshape((1, *self._shape))).flatten(), light)

    def _slots_of(self, envs: int, exposures: dict[int, Exposure]) -> np.ndarray:
        slots = np.zeros(envs, np.int32)
        for env, exposure in exposures.items():
            slots[env] = exposure.number % self._slots
        return slots

    def _stream(self, env: int, row: np.ndarray) -> np.uint64:
        """The random stream of an environment's images since its reset."""
        seed = self._seeds[env] if row[SEED] == CONFIGURED else int(row[SEED])
        first = mix(np.array([seed_of_camera(seed, self._name) % 2**64], np.uint64) ^ SALT)
        again = np.array([int(row[NUMBER]) % 2**64], np.uint64)
        return np.uint64(mix(first ^ (again * GOLDEN + np.uint64(2)))[0])

    def _flat(self, frames: Any, envs: int, count: int) -> wp.array:
        """Frames as float32 [E, K, P] on the device, without a copy where they are there."""
        if isinstance(frames, np.ndarray):
            single = np.ascontiguousarray(frames, np.float32).reshape(envs, count, self._size)
            return wp.array(single, dtype=wp.float32, device=self._device, copy=False)
        values = frames.flatten()
        values = values if values.dtype is wp.float32 else values.view(wp.float32).flatten()
        return values.reshape((envs, count, self._size))

    def _array(self, values: np.ndarray) -> wp.array:
        return wp.array(values, device=self._device)


def _readout(settings: Settings) -> Any:
    sensor = settings.sensor
    bits = sensor["image_bits"]
    readout: Any = kernels.Readout()
    for field in ("full_well", "dark_current", "read_noise", "black_level"):
        setattr(readout, field, sensor[field])
    readout.photon_noise = int(sensor["photon_noise"])
    readout.sensitivity, readout.gain = sensor["image_sensitivity"], sensor["image_gain"]
    readout.inverse_gamma, readout.largest = 1.0 / sensor["image_gamma"], float(2**bits - 1)
    readout.shift = 0 if bits == 8 else 16 - bits
    readout.metered = int(settings.exposure_ns == 0)
    return readout
