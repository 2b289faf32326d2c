"""The keys of one bucket, put in order by a block: against numpy."""

import numpy as np
import pytest
import warp as wp

from nodes.event_sensor.cuda.sort_kernels import BLOCK, MOST, MOST_OF_BIN, ROOM, sort_bucket

DEVICES = ["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)]
FIRST = 5
"""Where the bucket begins: keys before and behind it must stay."""


@wp.kernel
def sort_one(bucket: wp.array(dtype=wp.int64), spare: wp.array(dtype=wp.int64), first: int, count: int):
    """Sorts a bucket by one block."""
    _, _lane = wp.tid()
    sort_bucket(bucket, spare, first, count)


def spread(rng, count):
    return rng.integers(0, 1 << 40, count)


def few_times(rng, count):
    """Two instants far apart, and pixels below them: all keys come into two bins."""
    return (rng.integers(0, 2, count) << 40) + rng.integers(0, 1 << 18, count)


def in_turn(rng, count):
    return np.arange(count)[::-1] * 1000


def lopsided(rng, count):
    return np.append(rng.integers(0, 1 << 10, count - 1), (1 << 62) - 1)


def same(rng, count):
    return np.full(count, 12345)


def columns_that_fire_together(rng, count):
    """Sixteen instants with some hundred pixels each, as a ramp that drifts makes them, and few events between."""
    together = (rng.integers(1, 17, count) * 123_456 << 20) + rng.integers(0, 1 << 18, count)
    return np.where(rng.random(count) < 0.9, together, rng.integers(0, 1 << 42, count))


def twice_as_far(rng, count):
    """Keys by powers of two: most bins stay empty at every level, and the first of each holds most keys."""
    return (1 << rng.integers(0, 62, count)) + rng.integers(0, 3, count)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("made", [spread, few_times, in_turn, lopsided, same, columns_that_fire_together, twice_as_far])
@pytest.mark.parametrize(
    "count", [1, 2, BLOCK - 1, MOST_OF_BIN, MOST_OF_BIN + 1, 1800, ROOM - 1, ROOM, ROOM + 1, 5 * ROOM, MOST]
)
def test_a_bucket_in_order(device, made, count):
    keys = made(np.random.default_rng(count), count + FIRST + 3).astype(np.int64)
    bucket = wp.array(keys, dtype=wp.int64, device=device)
    spare: wp.array = wp.zeros_like(bucket)
    wp.launch_tiled(sort_one, dim=[1], inputs=[bucket, spare, FIRST, count], block_dim=BLOCK, device=device)
    want = keys.copy()
    want[FIRST : FIRST + count].sort()
    assert np.array_equal(bucket.numpy(), want)
    written = np.flatnonzero(spare.numpy())
    assert not len(written) or (written[0] >= FIRST and written[-1] < FIRST + count)
