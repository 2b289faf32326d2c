"""Renders environments whose worlds look different: a renderer for each world, and their images as one batch."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from evis.scene.parts import Parts
from evis.scene.worlds import Group

if TYPE_CHECKING:
    from nodes.renderer.renderer import Renderer
    from nodes.renderer.supersampling import SupersampledRenderer

    AnyRenderer = Renderer | SupersampledRenderer


class SeparateRenderers:
    """Renders E environments in groups of one world each, with the methods of Renderer.

    What a group's renderer draws is what it draws for the same environments by themselves, bit for bit.
    """

    def __init__(self, parts: Parts[AnyRenderer], envs: int) -> None:
        """Takes the renderers of all environments, in groups."""
        self._parts = parts
        self.device = parts.all[0].device
        self._count = envs
        self._own: dict[str, Any] = {}

    def change(self, groups: Sequence[Group], make: Sequence[Callable[[], AnyRenderer]]) -> None:
        """Gives environments whose worlds look otherwise from now on renderers of their own, by group."""
        self._parts.change(groups, make)

    def counts_later(self) -> Callable[[], tuple[int, int]]:
        """Makes a function that gives `counts`, as Renderer does."""
        later = [part.counts_later() for part in self._parts.all]

        def found() -> tuple[int, int]:
            counts = [count() for count in later]
            return sum(n for n, _ in counts), sum(n for _, n in counts)

        return found

    def counts(self) -> tuple[int, int]:
        """Gives pixels of the last drawn light that were not finite, and clipped; waits for it."""
        found = [part.counts() for part in self._parts.all]
        return sum(n for n, _ in found), sum(n for _, n in found)

    def array_shape(self, name: str) -> tuple[tuple[int, ...], np.dtype]:
        """Gives the shape and dtype of an output."""
        shape, dtype = self._parts.all[0].array_shape(name)
        return (self._count, *shape[1:]), dtype

    def begin(self, outputs: Iterable[str]) -> None:
        """Has the kernels that `outputs` need compiled, as Renderer does."""
        wanted = list(outputs)
        for part in self._parts.all:
            part.begin(wanted)

    def prepare(self, outputs: Iterable[str]) -> None:
        """Compiles and loads the kernels that `outputs` need."""
        wanted = list(outputs)
        for part in self._parts.all:
            part.prepare(wanted)

    def buffers(self, outputs: Iterable[str]) -> dict[str, Any]:
        """Gives arrays of all environments on the device, as Renderer.buffers does."""
        for name in outputs:
            if name not in self._own:
                one = self._parts.all[0].buffers([name])[name]
                self._own[name] = wp.empty((self._count, *one.shape[1:]), dtype=one.dtype, device=self.device)
        return {name: self._own[name] for name in outputs}

    def render(
        self,
        poses: np.ndarray,
        previous: np.ndarray | str | None = None,
        outputs: Iterable[str] = ("radiance",),
        out: Mapping[str, Any] | None = None,
        t_ns: int | np.ndarray = 0,
    ) -> dict[str, Any]:
        """Renders the wanted images, with arguments and results as of Renderer.render; `out` must have all of them."""
        targets = {name: (out or {})[name] for name in outputs}
        for part in self._parts.parts:
            mine, live, renderer = part.inputs, part.live, part.made
            before = previous[mine] if isinstance(previous, np.ndarray) else previous
            t = t_ns if isinstance(t_ns, int) else t_ns[mine]
            run = _as_run(part.envs) if live.all() else None
            if run is not None:
                renderer.render(poses[mine], before, targets, {name: to[run] for name, to in targets.items()}, t)
                continue
            drawn = renderer.buffers(targets)
            renderer.render(poses[mine], before, targets, drawn, t)
            for name, to in targets.items():
                _scatter(drawn[name], to, part.envs, live)
        return targets


def _as_run(envs: np.ndarray) -> slice | None:
    """Gives the environments as a slice, where they follow one another."""
    first, last = int(envs[0]), int(envs[-1])
    return slice(first, last + 1) if last - first + 1 == len(envs) else None


def _scatter(images: wp.array, to: Any, envs: np.ndarray, live: np.ndarray) -> None:
    """Copies the images of the live environments of a group to their places among all."""
    if isinstance(to, wp.array):
        for k in np.flatnonzero(live).tolist():
            wp.copy(to[int(envs[k]) : int(envs[k]) + 1], images[k : k + 1])
    else:
        to[envs[live]] = images.numpy()[live]
