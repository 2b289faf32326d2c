"""The keys of one bucket, put in order by a block: against numpy."""

import numpy as np
import pytest
import warp as wp

from nodes.event_sensor.cuda.sort_kernels import BLOCK, MOST_OF_BIN, ROOM, sort_bucket

DEVICES = ["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)]
FIRST = 5
"""Where the bucket begins: keys before and behind it must stay."""


@wp.kernel
def sort_one(bucket: wp.array(dtype=wp.int64), first: int, count: int):
    """Sorts a bucket by one block."""
    _, _lane = wp.tid()
    sort_bucket(bucket, first, count)


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


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("made", [spread, few_times, in_turn, lopsided, same])
@pytest.mark.parametrize(
    "count", [1, 2, MOST_OF_BIN + 1, BLOCK - 1, BLOCK + 1, 1800, ROOM // 2, ROOM // 2 + 1, ROOM, ROOM + 1, 5 * ROOM]
)
def test_a_bucket_in_order(device, made, count):
    keys = made(np.random.default_rng(count), count + FIRST + 3).astype(np.int64)
    bucket = wp.array(keys, dtype=wp.int64, device=device)
    wp.launch_tiled(sort_one, dim=[1], inputs=[bucket, FIRST, count], block_dim=BLOCK, device=device)
    want = keys.copy()
    want[FIRST : FIRST + count].sort()
    assert np.array_equal(bucket.numpy(), want)
