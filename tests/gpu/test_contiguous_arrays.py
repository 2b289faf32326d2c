"""Arrays behind each other in memory, as one, and the parts of one."""

import numpy as np
import pytest
import warp as wp

from evis.gpu.in_a_row import joined, parted


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


@pytest.mark.parametrize("on_device", [False, True])
def test_parts_are_slices(on_device):
    """They are where slices of the whole are and say the same of themselves; one may be empty, also at the end."""
    whole = np.arange(24, dtype=np.float32).reshape(4, 2, 3)
    if on_device:
        whole = wp.array(whole, device="cpu")
    ends = [1, 1, 3, 4, 4]
    parts = parted(whole, ends)
    assert [part.shape for part in parts] == [(1, 2, 3), (0, 2, 3), (2, 2, 3), (1, 2, 3), (0, 2, 3)]
    for part, (start, end) in zip(parts, [(0, 1), (1, 1), (1, 3), (3, 4)]):
        want = whole[start:end]
        assert np.array_equal(np.asarray(part), np.asarray(want))
        if on_device:
            own = {name: value for name, value in vars(want).items() if name != "_ref"}
            assert own == {name: vars(part)[name] for name in own} and part._ref is whole
    one = joined(parts)
    assert np.array_equal(np.asarray(one), np.asarray(whole)) and (not on_device or one.ptr == whole.ptr)


@pytest.mark.parametrize("on_device", [False, True])
def test_parts_end_with_the_array(on_device):
    whole = np.zeros((4, 2), np.float32)
    with pytest.raises(ValueError, match="before row 5 of an array that has 4"):
        parted(wp.array(whole, device="cpu") if on_device else whole, [2, 5])


def test_parts_of_nothing():
    """An array without elements has no memory."""
    assert [part.shape for part in parted(wp.empty(0, dtype=wp.int16, device="cpu"), [0, 0])] == [(0,), (0,)]


def test_parts_keep_their_memory_and_are_kernels_arguments():
    """A part holds the whole, and can be written by a kernel and read by numpy."""
    (_, last) = parted(wp.zeros((3, 5), dtype=wp.float32, device="cpu"), [2, 3])
    last.fill_(4.0)
    assert np.array_equal(last.numpy(), np.full((1, 5), 4.0))
    assert np.array_equal(wp.clone(last).numpy(), np.full((1, 5), 4.0))
