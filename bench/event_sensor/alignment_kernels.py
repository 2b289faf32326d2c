"""Pairs the events of two streams by dynamic programming, a pixel and polarity per thread."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def pair_events(
    # in
    first: wp.int32,
    t_a: wp.array(dtype=wp.int64),
    offsets_a: wp.array(dtype=wp.int64),
    t_b: wp.array(dtype=wp.int64),
    offsets_b: wp.array(dtype=wp.int64),
    unpaired: wp.int64,
    cells: wp.array(dtype=wp.int64),
    rows: wp.array(dtype=wp.int64),
    # scratch
    row: wp.array(dtype=wp.int64),
    choice: wp.array(dtype=wp.uint8),
    # out
    partner: wp.array(dtype=wp.int64),
):
    """Pairs the events of two streams at least cost, one pixel and polarity per thread.

    choice: 0 = pair, 1 = event of a alone, 2 = event of b alone."""
    i_group = wp.tid()
    g = first + i_group
    a0 = offsets_a[g]
    b0 = offsets_b[g]
    n_a = offsets_a[g + 1] - a0
    n_b = offsets_b[g + 1] - b0
    one = wp.int64(1)
    zero = wp.int64(0)
    c0 = cells[i_group]
    r0 = rows[i_group]
    j = wp.int64(0)
    while j <= n_b:
        row[r0 + j] = j * unpaired
        j += one
    i = wp.int64(0)
    while i < n_a:
        ta = t_a[a0 + i]
        diagonal = row[r0]
        row[r0] = (i + one) * unpaired
        j = zero
        while j < n_b:
            pair = diagonal + wp.abs(ta - t_b[b0 + j])
            diagonal = row[r0 + j + one]
            alone_a = diagonal + unpaired
            alone_b = row[r0 + j] + unpaired
            best = wp.min(pair, wp.min(alone_a, alone_b))
            code = wp.where(best == pair, 0, wp.where(best == alone_a, 1, 2))
            choice[c0 + i * n_b + j] = wp.uint8(code)
            row[r0 + j + one] = best
            j += one
        i += one
    i = n_a
    j = n_b
    while i > zero and j > zero:
        code = wp.int32(choice[c0 + (i - one) * n_b + j - one])
        if code == 0:
            partner[b0 + j - one] = a0 + i - one
        if code != 2:
            i -= one
        if code != 1:
            j -= one
