# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Checks the lists of further samples: each pixel's in the order of time, between the frames of its episode; and joins
those of messages in a row."""

import warp as wp

wp.set_module_options({"enable_backward": False})

FINE = 0x7FFFFFFFFFFFFFFF
"""What is found where nothing is wrong."""
REASONS = (
    "do not ascend: first must go from 0 to the number of samples",
    "do not ascend in time",
    "are at or before the start of the interval",
    "are at or after the last frame",
    "are at the stamp of a frame",
    "are before the first frame of its episode",
)
WRONG_LIST, UNORDERED, TOO_EARLY, TOO_LATE, AT_FRAME, NOT_BEGUN = range(6)


@wp.kernel
def check_lists(
    # in
    first: wp.array(dtype=wp.int32),
    offset: wp.array(dtype=wp.int32),
    stamps: wp.array(dtype=wp.int64),
    begins: wp.array(dtype=wp.int32),
    pixels: wp.int32,
    each: wp.int32,
    # out
    found: wp.array(dtype=wp.int64),
):
    """Finds the first pixel whose list is wrong, and why: pixel * 6 + number of the reason.

    stamps: of the frames, from where offsets count. begins: not 0 for environments whose episode begins with the first
    frame. pixels: of an environment. each: pixels of a thread.
    """
    env, thread = wp.tid()
    count = stamps.shape[0]
    last = stamps[count - 1]
    pixel = env * pixels + thread * each
    end = pixel + each
    stop = first[pixel]
    if pixel == 0 and stop != 0:
        wp.atomic_min(found, 0, wp.int64(wp.static(WRONG_LIST)))
    while pixel < end:
        i = stop
        stop = first[pixel + 1]
        wrong = int(-1)
        if i < 0 or stop < i or stop > offset.shape[0]:
            wrong = wp.static(WRONG_LIST)
        before = wp.int64(0)
        k = int(0)
        frame = stamps[0]
        while wrong < 0 and i < stop:
            now = wp.int64(offset[i])
            if now <= before:
                wrong = wp.where(now <= wp.int64(0), wp.static(TOO_EARLY), wp.static(UNORDERED))
            elif now >= last:
                wrong = wp.static(TOO_LATE)
            else:
                while frame < now:
                    k += 1
                    frame = stamps[k]
                if frame == now:
                    wrong = wp.static(AT_FRAME)
                if k == 0 and begins[env] != 0:
                    wrong = wp.static(NOT_BEGUN)
            before = now
            i += 1
        if wrong >= 0:
            wp.atomic_min(found, 0, wp.int64(pixel) * wp.int64(wp.static(len(REASONS))) + wp.int64(wrong))
        pixel += 1
    if end + 1 == first.shape[0] and stop != offset.shape[0]:
        wrong_end = wp.int64(end - 1) * wp.int64(wp.static(len(REASONS))) + wp.int64(wp.static(WRONG_LIST))
        wp.atomic_min(found, 0, wrong_end)


@wp.kernel
def add_counts(
    # in
    first: wp.array(dtype=wp.int32),
    ahead: wp.int32,
    # in and out
    count: wp.array(dtype=wp.int32),
):
    """Adds the number of samples of each pixel q, first[q + 1] - first[q], to count[q + ahead]."""
    q = wp.tid()
    count[q + ahead] += first[q + 1] - first[q]


@wp.kernel
def append_samples(
    # in
    first: wp.array(dtype=wp.int32),
    offset: wp.array(dtype=wp.int32),
    value: wp.array(dtype=wp.float32),
    shared: wp.int32,
    later: wp.int32,
    taken: wp.array(dtype=wp.int32),
    # out
    offsets: wp.array(dtype=wp.int32),
    values: wp.array(dtype=wp.float32),
):
    """Copies the samples of a message, a thread each, to where those of each pixel go on.

    shared: values of a sample. later: by how much offsets grow [ns]. taken: where the first sample of each pixel goes.
    """
    i = wp.tid()
    q = wp.lower_bound(first, i + 1) - 1
    # Lists that do not ascend are found later; they must not be written anywhere else.
    if q < 0 or q + 1 >= first.shape[0]:
        return
    at = taken[q] + i - first[q]
    if at < 0 or at >= offsets.shape[0]:
        return
    offsets[at] = offset[i] + later
    for c in range(shared):
        values[at * shared + c] = value[i * shared + c]
