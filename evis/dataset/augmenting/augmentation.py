"""Draws what is changed of a window, with its labels: by what window it is, never by the order of calls."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from evis.dataset.draws import key_of, uniform
from evis.dataset.errors import DatasetError

COUNTERPART = {"forward_flow": "backward_flow", "backward_flow": "forward_flow"}
"""What a flow over an interval becomes where time runs backwards."""
UNMIRRORED = ("poses", "velocities", "accelerations", "joints", "boxes3d", "contacts")
"""Labels of a world, whose mirror image would be another one."""


@dataclass(frozen=True)
class Drawn:
    """Describes the augmentation that was drawn for one window.

    top, left, height, width: of what stays [px]. key: of what is drawn for each event.
    """

    key: np.uint64
    flip_x: bool
    flip_y: bool
    reverse: bool
    top: int
    left: int
    height: int
    width: int


@dataclass(frozen=True)
class Augment:
    """Describes how windows are changed, events and labels alike.

    flip_x, flip_y: how likely a window is mirrored from left to right, from top to bottom. reverse: how likely its time
    runs backwards, with ON for OFF. crop: (height, width) px of a part at a random place. drop: share of events that
    are left out. noise: events a second and pixel of a Poisson process that is added, with the label of noise.
    """

    flip_x: float = 0.0
    flip_y: float = 0.0
    reverse: float = 0.0
    crop: tuple[int, int] | None = None
    drop: float = 0.0
    noise: float = 0.0

    def check(self, labels: tuple[str, ...]) -> None:
        """Raises DatasetError for a value out of range, and for labels that do not follow what is asked for."""
        for name in ("flip_x", "flip_y", "reverse", "drop"):
            if not (_is_number(share := getattr(self, name)) and 0 <= share <= 1):
                raise DatasetError(f"{name} of Augment is {getattr(self, name)!r}; it is a share, from 0 to 1")
        if not (_is_number(self.noise) and 0 <= self.noise < float("inf")):
            raise DatasetError(f"noise of Augment is {self.noise!r}; it is a rate per pixel, 0 Hz or more")
        if self.crop is not None and not _is_size(self.crop):
            raise DatasetError(f"crop of Augment is {self.crop!r}; it is (height, width) in pixels")
        if self.flip_x or self.flip_y:
            fixed = [kind for kind in labels if kind in UNMIRRORED]
            if fixed:
                raise DatasetError(f"a mirrored image has no {fixed[0]}: leave out flip_x and flip_y, or these labels")
        if self.flip_x and "disparity" in labels:
            raise DatasetError("in a mirrored pair left is right: leave out flip_x, or the labels disparity")

    def counterparts(self, labels: tuple[str, ...]) -> dict[str, str]:
        """Returns the kind that each label is made of where time runs backwards; empty where it never does."""
        return {kind: COUNTERPART.get(kind, kind) for kind in labels} if self.reverse else {}

    def drawn(self, seed: int, epoch: int, sequence: int, window: int, height: int, width: int) -> Drawn:
        """Draws what is done with a window. Raises DatasetError for a crop that is larger than the camera's image."""
        if self == Augment():
            return Drawn(np.uint64(0), False, False, False, 0, 0, height, width)
        crop = self.crop or (height, width)
        if crop[0] > height or crop[1] > width:
            raise DatasetError(f"crop={self.crop} of a camera of ({height}, {width}) px; crops are smaller")
        key = key_of(seed, "augment", epoch, sequence, window)
        u = [uniform(key, n) for n in range(5)]
        return Drawn(
            key=key_of(key, "events"),
            flip_x=u[0] < self.flip_x,
            flip_y=u[1] < self.flip_y,
            reverse=u[2] < self.reverse,
            top=int(u[3] * (height - crop[0] + 1)),
            left=int(u[4] * (width - crop[1] + 1)),
            height=crop[0],
            width=crop[1],
        )


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | np.number)


def _is_size(value: Any) -> bool:
    if not isinstance(value, tuple | list) or len(value) != 2:
        return False
    return all(isinstance(n, int | np.integer) and n > 0 for n in value)
