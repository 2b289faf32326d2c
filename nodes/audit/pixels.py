"""Draws the pixels to audit from the seed, more of them where the picture is going to change.

A pixel's chance of being drawn is known and never 0, so that sums weighted by its inverse are unbiased whatever the
picture does (Horvitz and Thompson, "A generalization of sampling without replacement from a finite universe", 1952).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from nodes.audit.brightness import log_level

EVEN, EVEN_OF_MANY, MANY = 0.4, 0.7, 128
"""Share of the pixels that are drawn evenly over the image: of fewer than MANY, and of more, for which those that have
events where none were expected are what makes the interval wide."""

BLOCKS, BLOCKS_EACH = 480, 27
"""Blocks, about square, that an image is scanned by, one pixel in each: at least, and for each pixel that is drawn."""

INSTANTS = 24
"""Instants of a scan."""

_SCAN, _DRAW = 1, 2
"""What random numbers are for: a part of their key."""


@dataclass(frozen=True)
class Blocks:
    """Cuts an image of height x width into about square blocks."""

    height: int
    width: int
    rows: int
    columns: int

    @staticmethod
    def of(height: int, width: int, pixels: int) -> Blocks:
        """Makes blocks to draw `pixels` by, none smaller than a pixel."""
        count = max(BLOCKS, BLOCKS_EACH * pixels)
        rows = min(height, max(1, round((count * height / width) ** 0.5)))
        return Blocks(height, width, rows, min(width, max(1, round(count / rows))))

    def edges(self) -> tuple[np.ndarray, np.ndarray]:
        """Gives the first row of each row of blocks and the first column of each column, and the image's ends."""
        return (
            np.arange(self.rows + 1) * self.height // self.rows,
            np.arange(self.columns + 1) * self.width // self.columns,
        )

    @cache  # noqa: B019 (a few hundred kilobytes for each size of image)
    def serpentine(self) -> np.ndarray:
        """Gives all pixels, int64 [H W] indices, block by block, to and fro."""
        row, column = np.divmod(np.arange(self.height * self.width), self.width)
        y, x = self.edges()
        r, c = np.searchsorted(y, row, "right") - 1, np.searchsorted(x, column, "right") - 1
        return np.lexsort((column, row, np.where(r % 2 == 0, c, -c), r))

    def one_each(self, seed: int) -> np.ndarray:
        """Gives a pixel int64 [R C, 2] (x, y) of each block, drawn evenly."""
        y, x = self.edges()
        part = np.random.default_rng([_SCAN, seed % 2**64]).random((2, self.rows, self.columns))
        row = y[:-1, None] + (part[0] * np.diff(y)[:, None]).astype(np.int64)
        column = x[None, :-1] + (part[1] * np.diff(x)[None]).astype(np.int64)
        return np.stack([column, row], -1).reshape(-1, 2)

    def spread(self, score: np.ndarray) -> np.ndarray:
        """Gives each pixel [H, W] the score of its block [R, C]."""
        y, x = self.edges()
        return score.repeat(np.diff(y), 0).repeat(np.diff(x), 1)


def scan_times(seed: int, start_ns: int, horizon_ns: int) -> np.ndarray:
    """Gives ascending times int64 [INSTANTS] ns, one in each equal part of the time to come."""
    part = np.random.default_rng([_SCAN, seed % 2**64, 1]).random(INSTANTS)
    return start_ns + ((np.arange(INSTANTS) + part) / INSTANTS * horizon_ns).astype(np.int64)


def scores_of(luminance: np.ndarray, moving: np.ndarray, blocks: Blocks, threshold: float) -> np.ndarray:
    """Gives each block's score float64 [R, C], about the root of how many events a pixel of it has.

    luminance: float [T, R C] of a pixel of each block. moving: bool [R C], whether it has shown a body that is moved
    by forces, whose way is not known. Neighbours count, for a pixel is not its block.
    """
    crossed = np.abs(np.diff(log_level(luminance), axis=0)).sum(0) / threshold
    crossed = np.maximum(np.where(crossed > 0.05, crossed, 0.0), 3.0 * moving).reshape(blocks.rows, blocks.columns)
    return np.sqrt(_smoothed(_smoothed(crossed)))


def _smoothed(values: np.ndarray) -> np.ndarray:
    """The mean over a block and its neighbours."""
    padded = np.pad(values, 1, "edge")
    rows = padded[:-2] + 2 * padded[1:-1] + padded[2:]
    return (rows[:, :-2] + 2 * rows[:, 1:-1] + rows[:, 2:]) / 16


def chances(score: np.ndarray, count: int) -> np.ndarray:
    """Gives the chance float64 [H, W] of each pixel to be among `count`, at most 1; they add up to `count`.

    score: float64 [H, W]. A share of the draws does not look at it.
    """
    even = EVEN if count < MANY else EVEN_OF_MANY
    size = score.size
    if count >= size:
        return np.ones(score.shape)
    total = score.sum()
    wanted = np.full(score.shape, 1.0 / size) if total <= 0 else even / size + (1 - even) * score / total
    chance = np.minimum(count * wanted, 1.0)
    while True:
        sure = chance >= 1.0
        rest = wanted * ~sure
        scaled = np.where(sure, 1.0, rest * ((count - sure.sum()) / rest.sum()))
        if (scaled <= 1.0).all():
            return scaled
        chance = np.minimum(scaled, 1.0)


def draw(chance: np.ndarray, blocks: Blocks, seed: int, episode: int) -> tuple[np.ndarray, np.ndarray]:
    """Draws pixels int64 [N, 2] (x, y) with their chances float64 [N], systematically along the blocks.

    chance: float64 [H, W] with a whole sum N. Going through the image block by block, to and fro, pixels are taken at
    even steps of the running sum of chances from a random start, so that the pixels are spread over the image.
    """
    place = blocks.serpentine()
    count = round(float(chance.sum()))
    running = np.cumsum(chance.reshape(-1)[place])
    start = np.random.default_rng([_DRAW, seed % 2**64, episode % 2**32]).random()
    taken = place[np.minimum(np.searchsorted(running, start + np.arange(count), "right"), len(place) - 1)]
    return np.stack([taken % blocks.width, taken // blocks.width], -1), chance.reshape(-1)[taken]
