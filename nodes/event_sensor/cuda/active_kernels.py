# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Finds the pixels that may have an event in a call, on a GPU: the first pass of the ideal sensor, over all pixels.

It reads every sample of a frame and the inactive range once and writes the last sample: 4 K + 12 bytes a pixel for K
frames. Pixels that have further samples between the frames are listed too.
"""

import warp as wp

from evis.gpu.append_kernels import take_place_of_many
from nodes.event_sensor.cuda.call_kernels import ACTIVE, BLOCKED, IMAGES, STAMPS
from nodes.event_sensor.cuda.further_kernels import further_entries
from nodes.event_sensor.cuda.ideal_kernels import IdealState, in_range
from nodes.event_sensor.model.sensor_kernels import EVENTS, Sensor

wp.set_module_options({"enable_backward": False})

Places = wp.types.vector(length=4, dtype=wp.int64)
BLOCK = 256
EACH = 4
"""Pixels that a thread looks at, BLOCK apart, so that enough loads are under way."""


@wp.func
def earlier_call_waits(sensor: Sensor, before: wp.array(dtype=wp.int64)):
    """Tells whether the call before, whose counters these are, did not end: the state is not yet that after it."""
    return before[BLOCKED] != wp.int64(0) or before[EVENTS] > sensor.capacity


@wp.kernel
def find_active(
    # in
    sensor: Sensor,
    call: wp.array(dtype=wp.int64),
    frames: wp.int32,
    size: wp.int32,
    before: wp.array(dtype=wp.int64),
    # in and out
    state: IdealState,
    # out
    active: wp.array(dtype=wp.vec2i),
    filled: wp.array(dtype=wp.int32),
    counters: wp.array(dtype=wp.int64),
):
    """Lists the active pixels, each with the sample to go on from. A thread is EACH pixels and channels.

    Args:
        sensor, call, frames: as in source.Source.
        size: pixels and channels of an environment.
        before: counters of the call before.
        state: the last sample of inactive pixels is kept in it.
        active: number of a pixel, and of the sample to go on from, which is 0.
        filled: events in each bucket, set to 0.
        counters: of this call, int64 [COUNTS].
    """
    thread = wp.tid()
    if thread < filled.shape[0]:
        filled[thread] = 0
    first = thread // wp.static(BLOCK) * wp.static(BLOCK * EACH) + thread % wp.static(BLOCK)
    stopped = earlier_call_waits(sensor, before)
    if thread == 0:
        counters[BLOCKED] = wp.where(stopped, wp.int64(1), wp.int64(0))
    if stopped or first >= active.shape[0]:
        return
    images = wp.array(ptr=wp.uint64(call[IMAGES]), shape=(1,), dtype=wp.float32)
    stride = wp.int64(size)
    low = wp.vec4f()
    high = wp.vec4f()
    v = wp.vec4f()
    good = wp.vec4i()
    at = Places()
    for j in range(wp.static(EACH)):
        i = wp.min(first + j * wp.static(BLOCK), active.shape[0] - 1)
        env = i // size
        at[j] = wp.int64(env) * stride * wp.int64(frames) + wp.int64(i - env * size)
        low[j] = state.low[i]
        high[j] = state.high[i]
        v[j] = images[at[j]]
    for j in range(wp.static(EACH)):
        good[j] = in_range(v[j], low[j], high[j])
    k = int(1)
    while k < frames:
        more = wp.vec4f()
        step = wp.int64(wp.min(k + 1, frames - 1) - k) * stride
        for j in range(wp.static(EACH)):
            at[j] = at[j] + stride
            more[j] = images[at[j]]
            v[j] = images[at[j] + step]
            at[j] = at[j] + step
        for j in range(wp.static(EACH)):
            good[j] = good[j] & in_range(more[j], low[j], high[j]) & in_range(v[j], low[j], high[j])
        k += 2
    for j in range(wp.static(EACH)):
        i = first + j * wp.static(BLOCK)
        if i < active.shape[0]:
            entries = further_entries(call, i)
            resting = good[j] != 0 and entries[0] == entries[1]
            if resting and call[STAMPS + frames + i // size] == wp.int64(0):
                state.last[i] = v[j]
            else:
                active[take_place_of_many(counters, ACTIVE)] = wp.vec2i(i, 0)
