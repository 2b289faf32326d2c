"""Resizes linear frames: pixels are averaged where they get larger, and interpolated where they get smaller."""

from __future__ import annotations

import numpy as np


class Resize:
    """Gives frames another size, row by row and column by column.

    An axis that shrinks takes the mean over the area of each new pixel, which is what a coarser sensor sees of the same
    light; one that grows is interpolated linearly between the centres of pixels. Sums run in a fixed order, so that the
    same frames give the same bytes on every machine.
    """

    def __init__(self, before: tuple[int, int], after: tuple[int, int]) -> None:
        """before, after: (height, width) [px]."""
        self._rows, self._columns = (taps(n, m) for n, m in zip(before, after))
        self._keep = tuple(n == m for n, m in zip(before, after))

    def __call__(self, image: np.ndarray) -> np.ndarray:
        """Resizes frames.

        Args:
            image: float32 [T, H, W] or [T, H, W, 3], linear.

        Returns:
            float32 [T, h, w] or [T, h, w, 3].
        """
        for axis, (index, weight), keep in ((1, self._rows, self._keep[0]), (2, self._columns, self._keep[1])):
            if keep:
                continue
            shape = [1] * image.ndim
            shape[axis] = -1
            with np.errstate(invalid="ignore"):  # infinite samples become NaN at times, which the sensor counts alike
                total = np.take(image, index[0], axis) * weight[0].reshape(shape)
                for at, share in zip(index[1:], weight[1:]):
                    total += np.take(image, at, axis) * share.reshape(shape)
            image = total
        return image


def taps(n: int, m: int) -> tuple[np.ndarray, np.ndarray]:
    """Finds which of n pixels make each of m, and with which weights.

    Returns:
        Indices int64 [K, m] and weights float32 [K, m] that add up to 1; a pixel that is not needed has weight 0.
    """
    place = np.arange(m)
    if m < n:  # in parts of a pixel of which one has m
        low = place * n
        index = low // m + np.arange(-(-n // m) + 1)[:, None]
        share = np.minimum((index + 1) * m, low + n) - np.maximum(index * m, low)
        weight = np.maximum(share, 0) / n
    else:  # in parts of which a pixel has 2 m
        first, rest = np.divmod((2 * place + 1) * n - m, 2 * m)
        index = first + np.arange(2)[:, None]
        weight = np.stack([2 * m - rest, rest]) / (2 * m)
    # What is not needed names a pixel that is: 0 times infinity would be NaN.
    index = np.where(weight > 0, index, index[weight.argmax(axis=0), place])
    return np.clip(index, 0, n - 1), weight.astype(np.float32)
