"""A launch that is made once runs again on what its arrays hold by then, whole and in parts."""

import numpy as np
import warp as wp

from evis.gpu.exchange import cpu_array
from evis.gpu.repeated_launch import RepeatedLaunch

wp.set_module_options({"enable_backward": False})


@wp.kernel
def square(start: int, given: wp.array(dtype=wp.float64), found: wp.array(dtype=wp.float64)):
    i = start + wp.tid()
    found[i] = given[i] * given[i]


def test_arrays_are_read_at_each_run() -> None:
    given, found = np.arange(5.0), np.full(5, -1.0)
    launch = RepeatedLaunch(square, [cpu_array(given), cpu_array(found)])
    launch.whole(5)
    assert found.tolist() == [0, 1, 4, 9, 16]
    given += 10
    launch.whole(5)
    assert found.tolist() == [100, 121, 144, 169, 196]
    given += 10
    launch.whole(2)
    assert found.tolist() == [400, 441, 144, 169, 196], "as many threads as were asked for this time"
    launch.part(3, 2)
    assert found.tolist() == [400, 441, 144, 529, 576]
