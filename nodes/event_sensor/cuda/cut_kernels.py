# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Where the events of several messages that were sensed at once are cut apart."""

import warp as wp


@wp.kernel(enable_backward=False)
def count_up_to(t: wp.array(dtype=wp.int64), ends: wp.array(dtype=wp.int64), count: wp.array(dtype=wp.int32)):
    """Counts the ascending times t that lie before or at each end."""
    k = wp.tid()
    low, high = int(0), int(t.shape[0])
    while low < high:
        middle = (low + high) // 2
        if t[middle] <= ends[k]:
            low = middle + 1
        else:
            high = middle
    count[k] = low
