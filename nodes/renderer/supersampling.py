"""Radiance as the mean of n x n samples per pixel, with geometry at the pixel's centre."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from evis.scene.model import Camera, Scene
from nodes.renderer import output_kernels
from nodes.renderer.renderer import Renderer

if TYPE_CHECKING:
    from nodes.renderer.path import PathOptions

make_mean = cache(output_kernels.make_mean)


class SupersampledRenderer:
    """As Renderer, with every pixel's radiance the mean of samples x samples samples that cover it evenly.

    Depth, ids, normals and motion belong to the pixel's centre: where a pixel covers two surfaces its radiance is a mix
    of both. An interpolator that moves pixels by their motion smears such mixed pixels; for one that moves samples
    before the mean is taken, apart=True gives the samples themselves, as Renderer(supersampling=n) does.
    """

    def __init__(
        self,
        scene: Scene,
        camera: Camera,
        samples: int,
        envs: int = 1,
        margin: int = 0,
        device: str = "cpu",
        threads: int = 1,
        half: bool = False,
        light_samples: int = 16,
        paths: PathOptions | None = None,
        apart: bool = False,
    ) -> None:
        self.plain = Renderer(scene, camera, envs, margin, device, threads, half)
        self.fine = Renderer(
            scene, camera, envs, margin, device, threads, half and apart, light_samples, samples, paths
        )
        self.samples, self.half, self.apart = samples, half, apart
        self.device = self.plain.device
        self._clipped = wp.zeros(1, dtype=wp.int32, device=self.plain.device)

    def counts(self) -> tuple[int, int]:
        """Samples of the last drawn radiance that were not finite, and pixels clipped to float16; waits for it."""
        not_finite, clipped = self.fine.counts()
        return not_finite, clipped if self.apart else int(self._clipped.numpy()[0])

    @property
    def not_finite(self) -> int:
        """The first of `counts`."""
        return self.counts()[0]

    @property
    def clipped(self) -> int:
        """The second of `counts`."""
        return self.counts()[1]

    def array_shape(self, name: str) -> tuple[tuple[int, ...], np.dtype]:
        """Shape and dtype of an output."""
        return (self.fine if self.apart and name == "radiance" else self.plain).array_shape(name)

    def buffers(self, outputs: Iterable[str]) -> dict[str, wp.array]:
        """As Renderer.buffers."""
        return {n: (self.fine if self.apart and n == "radiance" else self.plain).target(n, None) for n in outputs}

    def prepare(self, outputs: Iterable[str]) -> None:
        """Compile and load the kernels that `outputs` need."""
        wanted = set(outputs)
        self.plain.prepare(wanted - {"radiance"})
        self.fine.prepare(wanted & {"radiance"})

    def render(
        self,
        poses: np.ndarray,
        previous: np.ndarray | str | None = None,
        outputs: Iterable[str] = ("radiance",),
        out: Mapping[str, Any] | None = None,
        t_ns: int = 0,
    ) -> dict[str, Any]:
        """As Renderer.render."""
        wanted, given = set(outputs), out or {}
        images = self.plain.render(poses, previous, wanted - {"radiance"}, out)
        if "radiance" not in wanted:
            return images
        if self.apart:
            return images | self.fine.render(poses, None, ("radiance",), out, t_ns)
        device = self.fine.device
        fine = self.fine.target("radiance", None)
        self.fine.render(poses, None, ("radiance",), {"radiance": fine}, t_ns)
        target = self.plain.target("radiance", given.get("radiance"))
        self._clipped.zero_()
        inputs = [self.samples, fine, target, self._clipped]
        wp.launch(make_mean(self.half), dim=self.plain.shape, inputs=inputs, device=device)
        return images | {"radiance": self.plain.on_host(target, given.get("radiance"))}
