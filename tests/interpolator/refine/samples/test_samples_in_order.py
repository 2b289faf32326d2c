"""Samples of single pixels are put in order of pixel and time, by either kernel, as numpy does it."""

import numpy as np
import pytest
import warp as wp

from nodes.interpolator.refine.samples.request_kernels import PARTS
from nodes.interpolator.refine.samples.sort_kernels import count_samples, make_sort, place_samples

PIXELS, INNER, INSTANTS = 60, 20, 40


def in_order(kernel, pixels, instants, values, since):
    first, taken = wp.zeros(PIXELS + 1, dtype=wp.int32), wp.zeros(PIXELS, dtype=wp.int32)
    order, offset = wp.empty(pixels.size, dtype=wp.int32), wp.empty(pixels.size, dtype=wp.int32)
    value = wp.empty(pixels.size, dtype=wp.float32)
    given = [wp.array(each, dtype=wp.int32) for each in (pixels, instants)]
    wp.launch(count_samples, pixels.size, [given[0], first])
    wp.utils.array_scan(first, first, inclusive=True)
    wp.launch(place_samples, pixels.size, [given[0], first, taken, order])
    shared = [wp.array(values, dtype=wp.float32), wp.array(since, dtype=wp.int32), order]
    if kernel == "rank":
        wp.launch(make_sort(1)[1], pixels.size, [INNER, first, *given, *shared], [offset, value])
    else:
        wp.launch(make_sort(1)[0], PIXELS, [0, INNER, first, given[1], *shared], [offset, value])
    return first.numpy(), offset.numpy(), value.numpy()


@pytest.mark.parametrize("kernel", ["sort_each", "rank"])
@pytest.mark.parametrize("count", [1, 7, 300, 20_000])
def test_by_pixel_and_time(kernel, count):
    """Pixels without a sample, with one, and with hundreds, of which many are of the same instant."""
    rng = np.random.default_rng(count)
    pixels = np.minimum(rng.integers(0, PIXELS, count), rng.integers(0, PIXELS, count))
    instants, values = rng.integers(0, INSTANTS * PARTS, count), rng.random(count).astype(np.float32)
    since = np.cumsum(rng.integers(1000, 30_000, (PIXELS // INNER, INSTANTS)), 1)
    first, offset, value = in_order(kernel, pixels, instants, values, since)
    np.testing.assert_array_equal(first, np.searchsorted(np.sort(pixels), np.arange(PIXELS + 1)))
    order = np.lexsort((np.arange(count), instants, pixels))
    np.testing.assert_array_equal(value, values[order])
    edges = np.concatenate([np.zeros((PIXELS // INNER, 1), int), since], 1)
    i, part, env = instants[order] // PARTS, instants[order] % PARTS, pixels[order] // INNER
    exact = edges[env, i] + (edges[env, np.minimum(i + 1, INSTANTS)] - edges[env, i]) * part // PARTS
    np.testing.assert_array_equal(offset, exact)
