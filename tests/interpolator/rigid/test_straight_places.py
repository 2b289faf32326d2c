"""Where a keyframe counts as straight, cubic convolution and linear interpolation are the same."""

import numpy as np
import warp as wp

from nodes.interpolator.rigid import keyframe_kernels

HEIGHT, WIDTH, LIMIT = 40, 60, 1e-3


def keys(values: np.ndarray, f: float) -> np.ndarray:
    """Interpolates between the middle two of four by cubic convolution (Keys 1981, a = -1/2)."""
    a, b, c, d = values
    return b + 0.5 * f * (c - a + f * (2 * a - 5 * b + 4 * c - d + f * (3 * (b - c) + d - a)))


def support_of(logs: np.ndarray, limit: float) -> tuple[np.ndarray, np.ndarray]:
    """Gives what is known of each place, and whether it counts as straight."""
    shape = (1, *logs.shape)
    found = wp.zeros(shape, dtype=wp.int32, device="cpu")
    patch, inverse = (wp.full(shape, 1, dtype=dtype, device="cpu") for dtype in (wp.int32, wp.float32))
    given = wp.array(logs[None].astype(np.float32), device="cpu")
    moving = wp.array([1, 1], dtype=wp.int32, device="cpu")
    launched = [WIDTH, limit, moving, patch, inverse, given]
    wp.launch(keyframe_kernels.find_support, (1, HEIGHT, 1), launched, [found], device="cpu")
    support = found.numpy()[0]
    return support, (support >= 0) & ((support & int(keyframe_kernels.STRAIGHT)) != 0)


def test_straight_places_are_interpolated_alike() -> None:
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    # Ever steeper waves to the right, on a slope: of a slope alone all would be straight.
    logs = 0.3 * x - 0.1 * y + 1e-5 * np.exp(x / 6.0) * np.sin(0.9 * x) * np.cos(0.7 * y)
    support, flagged = support_of(logs, LIMIT)
    assert (support[1 : HEIGHT - 2, 1 : WIDTH - 2] >> 2 == 1).all()
    assert flagged[1 : HEIGHT - 2, 2:12].all() and not flagged[:, -12:].any()
    worst = 0.0
    for j, i in np.argwhere(flagged):
        four = logs[j - 1 : j + 3, i - 1 : i + 3]
        for fy in np.linspace(0, 1, 9):
            for fx in np.linspace(0, 1, 9):
                cubic = keys([keys(row, fx) for row in four], fy)
                rows = (1 - fx) * four[1:3, 1] + fx * four[1:3, 2]
                worst = max(worst, abs(cubic - ((1 - fy) * rows[0] + fy * rows[1])))
    # Not far below the limit either, or places would be missed; float32 rounds logarithms of up to 20 to 1e-6.
    assert 0.2 * LIMIT < worst < LIMIT + 1e-5


def test_nobody_asks_of_a_negative_limit() -> None:
    assert not support_of(np.zeros((HEIGHT, WIDTH)), -1.0)[1].any()
