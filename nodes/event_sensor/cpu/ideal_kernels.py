# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Computes the ideal sensor's events: straight lines in L between frames, no fault.

What others pay for is not in this kernel.

On a CPU the frames go by in groups of GROUP, a group in blocks of pixels, a block step by step, so that a block's state
stays in the nearest cache; the pixels of a step that leave their inactive range are listed and sensed together. Every
step of a group has a list of events of its own, in the order of pixels, so that a stable sort of each by time is the
whole order.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from nodes.event_sensor.cpu.order_kernels import sort_list
from nodes.event_sensor.cpu.simd_kernels import (
    BLOCK,
    SPARE,
    IdealState,
    Listed,
    commit,
    cross_levels,
    emit_listed,
    keep_last,
    keep_last_of_others,
    leave_further,
    list_active,
    take_samples,
)
from nodes.event_sensor.model.key_kernels import key_head, key_time
from nodes.event_sensor.model.sensor_kernels import EVENTS, Sensor

wp.set_module_options({"enable_backward": False})

GROUP = 8
"""Steps whose events are listed before they are sorted."""
DONE, OUTGROWN, FULL, JOINS = 0, 1, 2, 3
"""How a launch ends: all is done, a step's list or the sorted keys need more room and the next launch goes on. Beyond:
only the events of pixels with further samples have to join the others."""
STATUS, NEEDED, STEP, AT_ENV, AT_GROUP, AT_BLOCK, AT_STEP = range(7)
"""Progress: status, places needed, by which list, and where to go on."""


@wp.struct
class Lists:
    """Holds lists of keys by step of a group: addresses, places, and how many are taken; spare: as long as the
    longest."""

    keys: wp.array(dtype=wp.uint64)
    room: wp.array(dtype=wp.int64)
    taken: wp.array(dtype=wp.int64)
    spare: wp.uint64


@wp.func
def step_start(k: wp.int32, t: wp.array(dtype=wp.int64), t_base: wp.int64):
    """Returns the stamp at which step k begins."""
    start = t_base
    if k > 0:
        start = t[k - 1]
    return start


@wp.func
def forget(index: wp.int32, size: wp.int32, state: IdealState):
    """Takes their reference from the pixels of a block."""
    i = int(0)
    while i < size:
        state.low[index + i] = float(wp.inf)
        i += 1


@wp.func
def pause(status: wp.int32, needed: wp.int64, step: wp.int32, progress: wp.array(dtype=wp.int64)):
    """Writes the status at which a launch ends: why, room needed, and the step to go on with."""
    progress[STATUS] = wp.int64(status)
    progress[NEEDED] = needed
    progress[STEP] = wp.int64(step)


@wp.func
def go_on_at(env: wp.int32, group: wp.int32, block: wp.int32, k: wp.int32, progress: wp.array(dtype=wp.int64)):
    """Writes where the next launch goes on."""
    progress[AT_ENV] = wp.int64(env)
    progress[AT_GROUP] = wp.int64(group)
    progress[AT_BLOCK] = wp.int64(block)
    progress[AT_STEP] = wp.int64(k)


@wp.func
def sort_group(
    # in
    sensor: Sensor,
    env: wp.int32,
    first: wp.int32,
    end: wp.int32,
    t: wp.array(dtype=wp.int64),
    t_base: wp.int64,
    # in and out
    lists: Lists,
    # out
    keys: wp.array(dtype=wp.int64),
    counters: wp.array(dtype=wp.int64),
    progress: wp.array(dtype=wp.int64),
):
    """Sorts the events of steps first to end, puts them behind the keys and empties the lists; False without room."""
    k = int(first)
    while k < end:
        n = lists.taken[k - first]
        at = counters[EVENTS]
        if at + n > sensor.capacity:
            pause(FULL, at + n, 0, progress)
            return False
        start = step_start(k, t, t_base)
        bits = int(0)
        while (t[k] - start) >> wp.int64(bits) > wp.int64(0):
            bits += 1
        add = key_head(sensor, env) | key_time(sensor, start - t_base)
        to = wp.uint64(wp.int64(keys.ptr) + wp.int64(8) * at)
        if n > wp.int64(0):
            sort_list(n, sensor.shift_t, bits, add, lists.keys[k - first], lists.spare, to)
        counters[EVENTS] = at + n
        lists.taken[k - first] = wp.int64(0)
        k += 1
    return True


@lru_cache
def make_sense_ideal(frame: bool, further: bool = False) -> Any:
    """Makes the kernel, for one thread. frame: events carry the stamp of their frame, not of their crossing.

    further: pixels that have further samples between the frames are left as they are, for further_kernels.
    """

    @wp.kernel(module="unique", enable_backward=False)
    def sense_ideal(
        # in
        sensor: Sensor,
        luminance: wp.array(dtype=wp.float32),
        t: wp.array(dtype=wp.int64),
        t_base: wp.int64,
        fresh: wp.array(dtype=wp.int32),
        first: wp.array(dtype=wp.int32),
        shared: wp.int32,
        # in and out
        state: IdealState,
        work: Listed,
        lists: Lists,
        progress: wp.array(dtype=wp.int64),
        # out
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """Senses blocks of pixels from `progress` on; a step of a block is taken as a whole or not at all."""
        count = t.shape[0]
        size = sensor.height * sensor.width * sensor.channels
        stride = wp.int64(size)
        env = wp.int32(progress[AT_ENV])
        group = wp.int32(progress[AT_GROUP])
        block = wp.int32(progress[AT_BLOCK])
        k = wp.int32(progress[AT_STEP])
        progress[STATUS] = wp.int64(DONE)
        while env < fresh.shape[0]:
            images = wp.int64(env) * wp.int64(count) * stride
            while group < count:
                end = wp.min(group + GROUP, count)
                while block < size:
                    many = wp.min(size - block, BLOCK)
                    index = env * size + block
                    at = images + wp.int64(block)
                    if k == 0 and fresh[env] != 0:
                        forget(index, many, state)
                    while k < end:
                        ahead = stride
                        if k + 1 == end:
                            ahead = wp.int64(many) - wp.int64(k - group) * stride
                        here = at + wp.int64(k) * stride
                        n = list_active(luminance, here, ahead, state, index, many, work)
                        if wp.static(further):
                            n = leave_further(first, shared, index, n, work)
                        if n > 0:
                            span = t[k] - step_start(k, t, t_base)
                            take_samples(sensor, luminance, here, stride, k, state, index, n, work)
                            events = cross_levels(sensor, span, state, index, block, n, work)
                            place = lists.taken[k - group]
                            if place + events + wp.int64(SPARE) > lists.room[k - group]:
                                pause(OUTGROWN, place + events + wp.int64(SPARE), k - group, progress)
                                go_on_at(env, group, block, k, progress)
                                return
                            commit(index, n, work, state, counters)
                            emit_listed(sensor, span, wp.static(frame), n, work, lists.keys[k - group], place)
                            lists.taken[k - group] = place + events
                        k += 1
                    if end == count:
                        here = at + wp.int64(count - 1) * stride
                        if wp.static(further):
                            keep_last_of_others(
                                sensor, luminance, here, stride, count, index, many, first, shared, state, work
                            )
                        else:
                            keep_last(sensor, luminance, here, stride, count, index, many, state)
                    block += BLOCK
                    k = group
                if not sort_group(sensor, env, group, end, t, t_base, lists, keys, counters, progress):
                    go_on_at(env, group, size, group, progress)
                    return
                group += GROUP
                block = 0
                k = wp.min(group, count)
            env += 1
            group = 0
            block = 0
            k = 0

    return sense_ideal
