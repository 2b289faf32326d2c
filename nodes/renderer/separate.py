"""Environments whose worlds look different: a renderer for each world, and their images as one batch."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from evis.scene.model import Scene
from evis.scene.worlds import Group

if TYPE_CHECKING:
    from nodes.renderer.renderer import Renderer
    from nodes.renderer.supersampling import SupersampledRenderer

    AnyRenderer = Renderer | SupersampledRenderer


class SeparateRenderers:
    """Renders E environments in groups of one world each, with the methods of Renderer.

    What a group's renderer draws is what it draws for the same environments by themselves, bit for bit.
    """

    def __init__(self, groups: Sequence[Group], make: Callable[[Scene, int], AnyRenderer]) -> None:
        """groups: scenes, each with its environments, int64 ascending. make: a renderer of so many environments."""
        self.envs = [envs for _, envs in groups]
        self.parts = [make(scene, len(envs)) for scene, envs in groups]
        self.device = self.parts[0].device
        self._count = sum(map(len, self.envs))
        self._own: dict[str, Any] = {}

    def counts(self) -> tuple[int, int]:
        """Gives pixels of the last drawn light that were not finite, and clipped; waits for it."""
        found = [part.counts() for part in self.parts]
        return sum(n for n, _ in found), sum(n for _, n in found)

    def array_shape(self, name: str) -> tuple[tuple[int, ...], np.dtype]:
        """Gives the shape and dtype of an output."""
        shape, dtype = self.parts[0].array_shape(name)
        return (self._count, *shape[1:]), dtype

    def prepare(self, outputs: Iterable[str]) -> None:
        """Compiles and loads the kernels that `outputs` need."""
        wanted = list(outputs)
        for part in self.parts:
            part.prepare(wanted)

    def buffers(self, outputs: Iterable[str]) -> dict[str, Any]:
        """Gives arrays of all environments on the device, as Renderer.buffers does."""
        for name in outputs:
            if name not in self._own:
                one = self.parts[0].buffers([name])[name]
                self._own[name] = wp.empty((self._count, *one.shape[1:]), dtype=one.dtype, device=self.device)
        return {name: self._own[name] for name in outputs}

    def render(
        self,
        poses: np.ndarray,
        previous: np.ndarray | str | None = None,
        outputs: Iterable[str] = ("radiance",),
        out: Mapping[str, Any] | None = None,
        t_ns: int = 0,
    ) -> dict[str, Any]:
        """Renders the wanted images, with arguments and results as of Renderer.render; `out` must have all of them."""
        targets = {name: (out or {})[name] for name in outputs}
        for envs, part in zip(self.envs, self.parts):
            before = previous[envs] if isinstance(previous, np.ndarray) else previous
            run = _as_run(envs)
            if run is not None:
                part.render(poses[envs], before, targets, {name: to[run] for name, to in targets.items()}, t_ns)
                continue
            drawn = part.buffers(targets)
            part.render(poses[envs], before, targets, drawn, t_ns)
            for name, to in targets.items():
                _scatter(drawn[name], to, envs)
        return targets


def _as_run(envs: np.ndarray) -> slice | None:
    """The environments as a slice, where they follow one another."""
    first, last = int(envs[0]), int(envs[-1])
    return slice(first, last + 1) if last - first + 1 == len(envs) else None


def _scatter(images: wp.array, to: Any, envs: np.ndarray) -> None:
    """Copies the images of a group to their places among all."""
    if isinstance(to, wp.array):
        for k, env in enumerate(envs.tolist()):
            wp.copy(to[env : env + 1], images[k : k + 1])
    else:
        to[envs] = images.numpy()
