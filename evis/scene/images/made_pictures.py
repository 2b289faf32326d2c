"""Makes pictures of a scene file by code, beside the reading of the rest of it."""

from __future__ import annotations

import os
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np

from evis.scene.images import textures

SMALL = 512
"""Texels along the side of pictures that are kept for other scenes, 3 MB at most."""
KEPT = 16
"""How many of these, the last ones."""
MOST_AT_ONCE = 4
"""One takes some 50 MB while it is made."""

Recipe = tuple[Callable[..., np.ndarray], tuple[Any, ...], tuple[float, float] | None]
"""What makes a picture, with its arguments, of which the first is its size; angle [rad] and value of its wedge."""


_kept: OrderedDict[Recipe, np.ndarray] = OrderedDict()
"""Small pictures that are full, shared by scenes that differ in other things, as the sequences of a data set do."""


class MadePictures:
    """Makes pictures on threads of its own: whoever asks goes on reading, and waits for all of them at the end."""

    def __init__(self) -> None:
        self._pool: ThreadPoolExecutor | None = None
        self._begun: list[tuple[Recipe, np.ndarray, Future[None]]] = []

    def begin(self, recipe: Recipe) -> np.ndarray:
        """Gives a picture, linear float32 [size, size, 3], that is full after `wait`, and then read-only."""
        if recipe in _kept:
            _kept.move_to_end(recipe)
            return _kept[recipe]
        if self._pool is None:
            self._pool = ThreadPoolExecutor(min(MOST_AT_ONCE, len(os.sched_getaffinity(0))), "picture")
        size = recipe[1][0]
        image = np.empty((size, size, 3), np.float32)
        self._begun.append((recipe, image, self._pool.submit(_fill, image, *recipe)))
        return image

    def wait(self) -> None:
        """Returns when all pictures are full."""
        if self._pool is not None:
            self._pool.shutdown()
        for recipe, image, maker in self._begun:
            maker.result()
            image.flags.writeable = False
            if len(image) <= SMALL:
                _kept[recipe] = image
                while len(_kept) > KEPT:
                    _kept.popitem(last=False)
        self._pool, self._begun = None, []


def _fill(
    image: np.ndarray,
    make: Callable[..., np.ndarray],
    arguments: tuple[Any, ...],
    sector: tuple[float, float] | None,
) -> None:
    made = make(*arguments)
    made = made if sector is None else textures.add_wedge(made, *sector)
    np.clip(made if made.ndim == 3 else made[..., None], 0.0, 1.0, out=image)
