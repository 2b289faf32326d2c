"""Draws the audited pixels of every environment when an episode begins, and takes their values from the run's
frames."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from evis.media.colour import luminance_of
from evis.scene.model import Camera, Scene
from nodes.audit.gather_kernels import gather
from nodes.audit.pixels import Blocks, chances, draw, scan_times, scores_of
from nodes.event_sensor.input.further import Further

_ENVS = 3
"""Part of the key of the random numbers that choose environments."""


class Drawing:
    """Draws `count` pixels over E environments, `each` in each of the chosen ones, `envs` int64 [A].

    pixels: int64 [A, n, 2] (x, y). chance: float64 [A n] of each to be drawn. valid: bool [A n], False for places that
    are left over.
    """

    def __init__(self, scene: Scene, camera: Camera, count: int, envs: int, seed: int) -> None:
        """count: pixels asked for; seed: of environment 0."""
        chosen = min(envs, count)
        self.blocks = Blocks.of(camera.height, camera.width, -(-count // chosen))
        rng = np.random.default_rng([_ENVS, seed % 2**64])
        self.envs = np.sort(rng.choice(envs, chosen, replace=False)) if chosen < envs else np.arange(envs)
        self._share, self._seed = chosen / envs, seed
        size = camera.height * camera.width
        self._counts = np.array([min(size, count // chosen + (e < count % chosen)) for e in range(chosen)])
        self.each, self.count = int(self._counts.max()), int(self._counts.sum())
        self.valid = (np.arange(self.each)[None] < self._counts[:, None]).reshape(-1)
        self.pixels = np.zeros((chosen, self.each, 2), np.int64)
        self.chance = np.ones(chosen * self.each)
        self._driven = np.array(
            [i.body >= 0 and scene.bodies[i.body].trajectory is None for i in scene.instances], bool
        )
        known = any(body.trajectory is not None and not body.trajectory.is_static() for body in scene.bodies)
        self._changes = known or any(light.waveform is not None for light in scene.lights)
        self.blocks.serpentine()  # found before the run
        self._score: np.ndarray | None = None

    def begin(
        self, fresh: np.ndarray, episodes: np.ndarray, look: Any, stamp: int, horizon_ns: int, threshold: float
    ) -> None:
        """Draws pixels anew for environments `fresh`, bool [A].

        look: a `PixelLuminance`, by which the image is scanned once from `stamp` on, as far as motion is known.
        """
        if self._score is None:
            self.scan(look, stamp, horizon_ns, threshold)
        assert self._score is not None
        for e in np.flatnonzero(fresh).tolist():
            count, places = int(self._counts[e]), slice(e * self.each, (e + 1) * self.each)
            chance = chances(self._score, count)
            pixels, own = draw(chance, self.blocks, self._seed + int(self.envs[e]), int(episodes[e]))
            self.pixels[e, :count], self.pixels[e, count:] = pixels, pixels[0]
            self.chance[places][:count] = own * self._share

    def values(self, luminance: Any, margin: int) -> np.ndarray:
        """Gives float32 [A, K, n] of frames [E, K, h, w(, 3)], numpy or of a device."""
        where = self.envs[:, None], self.pixels[..., 1] + margin, self.pixels[..., 0] + margin
        if isinstance(luminance, wp.array) and wp.get_device(luminance.device).is_cuda:
            taken = gather(luminance, *where)
        else:
            image = luminance.numpy() if isinstance(luminance, wp.array) else luminance
            taken = np.moveaxis(image[where[0], :, where[1], where[2]], 2, 1)
        if taken.ndim == 4:
            taken = luminance_of(taken)
        return np.ascontiguousarray(taken, np.float32)

    def between(self, further: Further, height: int, width: int) -> Further:
        """Gives further samples, in luminance, of the pixels alone, as of images [A, 1, n].

        further: of images [E, height, width], numpy or of a device.
        """
        pixel = (self.envs[:, None] * height + self.pixels[..., 1]) * width + self.pixels[..., 0]
        first, offset, value = (a.numpy() if isinstance(a, wp.array) else a for a in vars(further).values())
        begins, ends = first[pixel.reshape(-1)].astype(np.int64), first[pixel.reshape(-1) + 1].astype(np.int64)
        each = ends - begins
        starts = np.concatenate([[0], np.cumsum(each)])
        which = np.repeat(begins - starts[:-1], each) + np.arange(starts[-1])
        value = value[which]
        if value.ndim == 2:
            value = luminance_of(value)
        return Further(starts.astype(np.int32), offset[which], np.ascontiguousarray(value, np.float32))

    @property
    def score(self) -> np.ndarray:
        """Returns the score of each pixel, float64 [H, W], after a scan; the chance of being drawn follows it."""
        assert self._score is not None
        return self._score

    def forget(self) -> None:
        """Has the image scanned anew before pixels are drawn."""
        self._score = None

    def scan(self, look: Any, stamp: int, horizon_ns: int, threshold: float) -> None:
        """Finds where the picture will change from `stamp` on: a score for every pixel."""
        pixels = self.blocks.one_each(self._seed)
        times = scan_times(self._seed, stamp, horizon_ns)
        if self._driven.any():
            # Where bodies will be is not known: one look tells where they are, a few what else moves or flickers.
            times = times[::6] if self._changes else times[:1]
        light, instance = look.scan(pixels, times)
        moving = ((instance >= 0) & np.append(self._driven, False)[instance]).any(0)
        self._score = self.blocks.spread(scores_of(light, moving, self.blocks, threshold))
