"""Division by a product and a shift, against Python's integers."""

import numpy as np
import pytest
import warp as wp

from evis.gpu.division_kernels import Divisor, divided, divisor

LARGEST = 2**31 - 1


@wp.kernel
def divide(by: Divisor, a: wp.array(dtype=int), out: wp.array(dtype=int)):
    """Divides every number."""
    i = wp.tid()
    out[i] = divided(a[i], by)


def dividends(by):
    """Gives numbers about multiples of the divisor, where a quotient that is off by one shows, and the largest."""
    multiples = np.unique(np.geomspace(1, max(LARGEST // by, 1), 400).astype(np.int64)) * by
    about = np.concatenate([multiples - 1, multiples, multiples + 1, [0, LARGEST - 1, LARGEST]])
    return np.unique(about[(about >= 0) & (about <= LARGEST)])


@pytest.mark.parametrize("by", [1, 2, 3, 7, 346, 260, 641, 1 << 20, (1 << 20) + 1, 99_999_989, 1 << 30, LARGEST])
def test_quotients_are_exact(by):
    a = dividends(by)
    out = wp.zeros(len(a), dtype=int, device="cpu")
    wp.launch(divide, len(a), [divisor(by), wp.array(a.astype(np.int32), device="cpu")], [out], device="cpu")
    assert out.numpy().tolist() == [int(n) // by for n in a]


@pytest.mark.parametrize("by", [0, -1, 1 << 31])
def test_what_cannot_be_divided_by_is_refused(by):
    with pytest.raises(ValueError, match=f"a divisor is {by};"):
        divisor(by)
