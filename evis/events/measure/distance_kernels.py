"""Computes the sums of the metrics, in Warp kernels."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def victor_purpura_kernel(
    # in
    t_a: wp.array(dtype=wp.int64),
    offsets_a: wp.array(dtype=wp.int64),
    t_b: wp.array(dtype=wp.int64),
    offsets_b: wp.array(dtype=wp.int64),
    q_per_ns: wp.float64,
    row: wp.array(dtype=wp.float64),
    # out
    distance: wp.array(dtype=wp.float64),
):
    """Computes the Victor-Purpura distance of one pair of spike trains per thread (Victor & Purpura 1996).

    Args:
        t_a: times of the first trains, one train behind the other [ns].
        offsets_a: where each of them begins, and the end of the last [pairs + 1].
        t_b: times of the second trains [ns].
        offsets_b: where each of them begins, and the end of the last [pairs + 1].
        q_per_ns: cost of moving a spike by 1 ns.
        row: scratch, the dynamic programme's current line, n_b + 1 entries per pair.
        distance: gets the distance of each pair [pairs].
    """
    g = wp.tid()
    a0 = offsets_a[g]
    b0 = offsets_b[g]
    n_a = wp.int32(offsets_a[g + 1] - a0)
    n_b = wp.int32(offsets_b[g + 1] - b0)
    r0 = b0 + wp.int64(g)
    one = wp.float64(1.0)
    for j in range(n_b + 1):
        row[r0 + wp.int64(j)] = wp.float64(j)
    for i in range(n_a):
        diagonal = wp.float64(row[r0])
        row[r0] = wp.float64(i) + one
        for j in range(n_b):
            at = r0 + wp.int64(j)
            apart = wp.abs(wp.float64(t_a[a0 + wp.int64(i)] - t_b[b0 + wp.int64(j)]))
            shift = diagonal + q_per_ns * apart
            diagonal = row[at + wp.int64(1)]
            row[at + wp.int64(1)] = wp.min(shift, wp.min(diagonal + one, row[at] + one))
    distance[g] = row[r0 + wp.int64(n_b)]
