"""Makes textures by code from a seed: linear reflectance, float32 [h, w, 3], row 0 at the top (v = 1).

The renderer does not antialias, so a texture is made finely and then filtered down to `size` texels; a scene chooses
about one texel per pixel.
"""

from __future__ import annotations

from functools import lru_cache
from math import floor

import numpy as np

FINE = 1024
"""Texels along each side before filtering."""
KEPT = 6
"""Patterns that are kept unfiltered, 8 MB each: scenes that are loaded again often differ in their filter alone."""
RADII = 12
"""Radius of the largest leaf over that of the smallest."""


def blobs(size: int, seed: int, feature: float, low: float = 0.0, high: float = 1.0) -> np.ndarray:
    """Makes white noise, blurred with a Gaussian of standard deviation `feature` (of the width), cut at its median.

    float32 [size, size], tileable, half of it `low` and half `high` (before the filter).
    """
    smooth = _blurred_noise(seed, feature)
    return _shrink(np.where(smooth > np.median(smooth), high, low), size)


def noise(size: int, seed: int, feature: float, low: float = 0.0, high: float = 1.0) -> np.ndarray:
    """Makes blurred white noise as `blobs` does, without the cut: smooth grey values with their mean midway and clipped
    at 2.5 standard deviations.
    """
    smooth = _blurred_noise(seed, feature)
    unit = np.clip(0.5 + (smooth - smooth.mean()) / (5.0 * smooth.std()), 0.0, 1.0)
    return _shrink(low + (high - low) * unit, size)


def leaves(
    size: int, seed: int, feature: float, low: float = 0.0, high: float = 1.0, colour: float = 1.0
) -> np.ndarray:
    """Makes opaque leaves, disks and squares, that cover each other: edges and corners of all sizes, as pictures of
    the world have them (the dead leaves model; Lee, Mumford and Huang, Int. J. Computer Vision 41, 2001).

    float32 [size, size, 3], tileable. feature: radius of the largest leaf, of the width. Radii r are distributed as
    r^-3 down to a twelfth of that. colour: 0 = all leaves grey, 1 = channels independent.
    """
    fine = 2 * size
    random = np.random.Generator(np.random.Philox(key=[seed, 2]))
    least, most = feature / RADII, feature
    # So many that of the ground a share of e^-5 stays bare: a leaf has pi times the mean of r^2.
    count = int(5 * (least**-2 - most**-2) / (2 * np.pi * np.log(RADII)))
    radius = (least**-2 + random.random(count) * (most**-2 - least**-2)) ** -0.5
    x, y, turn = random.random(count), random.random(count), random.random(count) * np.pi
    angular = random.random(count) < 0.5
    value = random.random((count + 1, 3)) ** 2  # as many dark ones as the logarithm of light asks for
    value = low + (high - low) * (colour * value + (1 - colour) * value[:, :1])
    image = np.full((fine, fine, 3), value[-1], np.float32)
    texel = np.arange(3 * fine) + 0.5
    cosine, sine = np.cos(turn), np.sin(turn)
    for k in range(count):
        half = radius[k] * (np.pi**0.5 / 2 if angular[k] else 1.0) * fine  # of a square's side, as large as the disk
        reach = half * (2**0.5 if angular[k] else 1.0)
        left, top, n = floor(x[k] * fine - reach), floor(y[k] * fine - reach), int(2 * reach) + 2
        dx = texel[:n] + (left - x[k] * fine)
        dy = (texel[:n] + (top - y[k] * fine))[:, None]
        if angular[k]:
            c, s = cosine[k], sine[k]
            inside = (np.abs(c * dx + s * dy) < half) & (np.abs(c * dy - s * dx) < half)
        else:
            inside = dx * dx + dy * dy < half**2
        if left >= 0 and top >= 0 and left + n <= fine and top + n <= fine:
            image[top : top + n, left : left + n][inside] = value[k]
        else:
            rows, columns = np.nonzero(inside)
            image[(top + rows) % fine, (left + columns) % fine] = value[k]
    return 0.25 * (image[::2, ::2] + image[1::2, ::2] + image[::2, 1::2] + image[1::2, 1::2])


def checker(size: int, cells: int, low: float = 0.0, high: float = 1.0) -> np.ndarray:
    """Makes cells x cells squares, float32 [size, size]; the top left one is `low`."""
    index = np.arange(FINE) * cells // FINE
    return _shrink(np.where((index[:, None] + index) % 2 == 1, high, low), size)


def bricks(size: int, rows: int, low: float, high: float, joint: float, seed: int) -> np.ndarray:
    """Makes rows of bricks twice as long as high, every other row shifted by half a brick, between joints of value
    `low`.

    float32 [size, size], tileable for an even number of rows. joint: width of a joint as a fraction of a row. Every
    brick has its own value within the upper 40 % of [low, high]. rows: even.
    """
    t = (np.arange(FINE) + 0.5) / FINE
    y = t[:, None] * rows
    row = np.floor(y).astype(int)
    x = t[None, :] * (rows // 2) + 0.5 * (row % 2)
    column = np.floor(x).astype(int) % (rows // 2)
    value = np.random.Generator(np.random.Philox(key=seed)).random((rows, rows // 2))
    face = low + (high - low) * (0.6 + 0.4 * value[row, column])
    in_joint = (y - row < joint) | ((x - np.floor(x)) * 2 < joint)
    return _shrink(np.where(in_joint, low, face), size)


def planks(size: int, count: int, low: float, high: float, joint: float, seed: int) -> np.ndarray:
    """Makes boards side by side with grain along v, each of its own value, between dark joints; tileable.

    Args:
        size: width and height [texels].
        count: boards.
        low: value of the joints, and the least of the boards.
        high: the greatest value of the boards.
        joint: width of a joint as a fraction of a board.
        seed: decides grain and values.

    Returns:
        float32 [size, size].
    """
    random = np.random.Generator(np.random.Philox(key=[seed, 1]))
    grain = random.standard_normal((FINE, FINE))
    fy, fx = np.fft.fftfreq(FINE)[:, None], np.fft.rfftfreq(FINE)[None, :]
    # Long and thin: a Gaussian of 60 texels along the boards and 1.5 across.
    filtered = np.fft.rfft2(grain) * np.exp(-2.0 * np.pi**2 * ((60 * fy) ** 2 + (1.5 * fx) ** 2))
    grain = np.fft.irfft2(filtered, grain.shape)
    x = (np.arange(FINE) + 0.5) / FINE * count
    board = np.floor(x).astype(int)
    unit = np.clip(0.35 + 0.4 * random.random(count)[board] + 0.12 * grain / grain.std(), 0.05, 1.0)
    return _shrink(np.where(x - board < joint, low, low + (high - low) * unit), size)


def add_wedge(image: np.ndarray, angle: float, value: float) -> np.ndarray:
    """Adds a sector of `angle` rad around the upward direction painted with one grey value, its edge one texel soft."""
    size = len(image)
    centre = np.arange(size) + 0.5 - 0.5 * size
    x, y = centre[None, :], -centre[:, None]
    radius = np.hypot(x, y)
    # Signed distance [texels] from the sector's straight edges, positive inside.
    inside = radius * np.sin(np.clip(0.5 * angle - np.abs(np.arctan2(x, y)), -np.pi / 2, np.pi / 2))
    cover = np.clip(inside + 0.5, 0.0, 1.0)
    return (image + cover * (value - image)).astype(np.float32)


@lru_cache(maxsize=KEPT)
def _blurred_noise(seed: int, feature: float) -> np.ndarray:
    white = np.random.Generator(np.random.Philox(key=seed)).standard_normal((FINE, FINE))
    smooth = _gaussian(white, feature * FINE)
    smooth.flags.writeable = False
    return smooth


def _gaussian(image: np.ndarray, sigma: float) -> np.ndarray:
    """Periodic Gaussian blur, sigma in texels, by its exact Fourier transform."""
    fy = np.fft.fftfreq(image.shape[0])[:, None]
    fx = np.fft.rfftfreq(image.shape[1])[None, :]
    return np.fft.irfft2(np.fft.rfft2(image) * np.exp(-2.0 * (np.pi * sigma) ** 2 * (fx * fx + fy * fy)), image.shape)


def _shrink(image: np.ndarray, size: int) -> np.ndarray:
    """Resample to size x size texels: a Gaussian of half a new texel, then bilinear."""
    ratio = len(image) / size
    smooth = _gaussian(image, 0.5 * ratio) if ratio > 1.0 else image
    position = (np.arange(size) + 0.5) * ratio - 0.5
    first = np.floor(position).astype(int)
    weight = position - first
    rows = [smooth[(first + i) % len(image)] for i in (0, 1)]
    mixed = rows[0] * (1 - weight)[:, None] + rows[1] * weight[:, None]
    columns = [mixed[:, (first + i) % len(image)] for i in (0, 1)]
    return (columns[0] * (1 - weight) + columns[1] * weight).astype(np.float32)
