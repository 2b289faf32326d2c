"""Computes radiance as the mean of n x n samples per pixel, with geometry at the pixel's centre."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from evis.gpu.host_copies import HostCopies
from evis.scene.model import Camera, Scene
from nodes.renderer.renderer import LIGHT, Renderer
from nodes.renderer.shading.radiance_kernels import make_image, make_mean

if TYPE_CHECKING:
    from nodes.renderer.paths.paths import PathOptions


class SupersampledRenderer:
    """Renders as Renderer does, with every pixel's light the mean of samples x samples samples that cover it evenly.

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
        # Means that were not finite, of which there are none, and those that were clipped.
        self._host_counts: HostCopies | None = None
        self._counts = wp.zeros((2, 1), dtype=wp.int32, device=self.plain.device)

    def counts(self) -> tuple[int, int]:
        """Gives samples of the last drawn light that were not finite, and pixels clipped to float16; waits for it."""
        not_finite, clipped = self.fine.counts()
        return not_finite, clipped if self.apart else int(self._counts.numpy()[1, 0])

    def counts_later(self) -> Callable[[], tuple[int, int]]:
        """Makes a function that gives `counts` of the images launched by now, and waits for these alone."""
        if self._host_counts is None:
            self._host_counts = HostCopies(self._counts)
        fine, own = self.fine.counts_later(), self._host_counts.take()

        def found() -> tuple[int, int]:
            not_finite, clipped = fine()
            return not_finite, clipped if self.apart else int(own()[1, 0])

        return found

    def array_shape(self, name: str) -> tuple[tuple[int, ...], np.dtype]:
        """Gives the shape and dtype of an output."""
        return self._renderer_sized_as(name).array_shape(name)

    def buffers(self, outputs: Iterable[str]) -> dict[str, wp.array]:
        """Gives arrays on the device, as Renderer.buffers does."""
        return {name: self._renderer_sized_as(name).target(name, None) for name in outputs}

    def _renderer_sized_as(self, name: str) -> Renderer:
        """Gives the renderer whose images have the size of an output."""
        return self.fine if self.apart and name in LIGHT else self.plain

    def begin(self, outputs: Iterable[str]) -> None:
        """Has the kernels that `outputs` need compiled, as Renderer does."""
        wanted = set(outputs)
        self.plain.begin(wanted.difference(LIGHT))
        self.fine.begin(wanted.intersection(LIGHT))

    def prepare(self, outputs: Iterable[str]) -> None:
        """Compiles and loads the kernels that `outputs` need."""
        wanted = set(outputs)
        self.plain.prepare(wanted.difference(LIGHT))
        self.fine.prepare(wanted.intersection(LIGHT))

    def render(
        self,
        poses: np.ndarray,
        previous: np.ndarray | str | None = None,
        outputs: Iterable[str] = ("radiance",),
        out: Mapping[str, Any] | None = None,
        t_ns: int | np.ndarray = 0,
    ) -> dict[str, Any]:
        """Renders the wanted images, with arguments and results as of Renderer.render."""
        wanted, given = set(outputs), out or {}
        light = wanted.intersection(LIGHT)
        images = self.plain.render(poses, previous, wanted - light, out)
        if not light:
            return images
        if self.apart:
            return images | self.fine.render(poses, None, light, out, t_ns)
        fine = self.fine.target("radiance", None)
        self.fine.render(poses, None, ("radiance",), {"radiance": fine}, t_ns)
        targets = {name: self.plain.target(name, given.get(name)) for name in light}
        image = make_image(self.half)()
        for name, target in targets.items():
            setattr(image, name, target)
        image.not_finite, image.clipped = self._counts[0], self._counts[1]
        self._counts.zero_()
        wp.launch(make_mean(self.half), self.plain.shape, [self.samples, fine, image], device=self.device)
        return images | {name: self.plain.on_host(target, given.get(name)) for name, target in targets.items()}
