"""Looks for the neighbours of events in a Warp kernel (one thread: each event depends on those before it)."""

import warp as wp

wp.set_module_options({"enable_backward": False})

NEVER = wp.constant(wp.int64(-9223372036854775807))


@wp.kernel
def beside_another(
    # in
    t: wp.array(dtype=wp.int64),
    x: wp.array(dtype=wp.uint16),
    y: wp.array(dtype=wp.uint16),
    within_ns: wp.int64,
    # in and out
    latest: wp.array2d(dtype=wp.int64),
    # out
    kept: wp.array(dtype=wp.uint8),
):
    """Tells of each event whether one of its pixel's eight neighbours had one at most a time before.

    Args:
        t, x, y: the events, in the order in which they came [n].
        within_ns: the time [ns].
        latest: time of the last event so far of each pixel [H, W, ns].
        kept: gets 1 where there was one, or where the event is outside of the sensor [n].
    """
    rows = latest.shape[0]
    columns = latest.shape[1]
    for i in range(t.shape[0]):
        row = wp.int32(y[i])
        column = wp.int32(x[i])
        found = wp.uint8(0)
        if row >= rows or column >= columns:
            found = wp.uint8(1)
        else:
            for k in range(9):
                r = row + k / 3 - 1
                c = column + k % 3 - 1
                if k != 4 and r >= 0 and r < rows and c >= 0 and c < columns:
                    before = latest[r, c]
                    # never = so long ago that the difference has no place in 64 bits
                    if before != NEVER and t[i] - before <= within_ns:
                        found = wp.uint8(1)
            latest[row, column] = t[i]
        kept[i] = found
