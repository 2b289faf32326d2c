"""Arrays behind each other in memory, as one."""

import numpy as np
import pytest
import warp as wp

from evis.gpu.in_a_row import joined


@pytest.mark.parametrize("on_device", [False, True])
def test_neighbours_are_joined_without_a_copy(on_device):
    whole = np.arange(24, dtype=np.float32).reshape(4, 2, 3)
    if on_device:
        whole = wp.array(whole, device="cpu")
    one = joined([whole[0:1], whole[1:3], whole[3:4]])
    start = (lambda a: a.ptr) if on_device else (lambda a: a.ctypes.data)
    assert start(one) == start(whole) and one.shape == (4, 2, 3)


@pytest.mark.parametrize("on_device", [False, True])
def test_others_are_copied_in_their_order(on_device):
    whole = np.arange(24, dtype=np.float32).reshape(4, 2, 3)
    want = whole[[2, 0, 1]]
    if on_device:
        whole = wp.array(whole, device="cpu")
    one = joined([whole[2:3], whole[0:2]])
    assert np.array_equal(one.numpy() if on_device else one, want)


@pytest.mark.parametrize("on_device", [False, True])
def test_neighbours_by_chance_are_copied(on_device):
    """Of memory that was allocated apart, across whose border a GPU copies nothing."""
    memory = np.arange(8, dtype=np.float32)
    if on_device:
        parts = [wp.array(ptr=memory.ctypes.data + at, shape=(4,), dtype=wp.float32, device="cpu") for at in (0, 16)]
    else:
        parts = [np.frombuffer(memory.data[start : start + 4], np.float32) for start in (0, 4)]
    one = joined(parts)
    assert (one.ptr if on_device else one.ctypes.data) != memory.ctypes.data
    assert np.array_equal(one.numpy() if on_device else one, memory)
