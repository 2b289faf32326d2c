"""Reads the time and the triggers of DAVIS and DVXplorer words in their kernels; see `words`."""

import warp as wp

from evis.events.codecs.inivation.words import (
    GENERATOR_FALLING,
    GENERATOR_RISING,
    INPUT_FALLING,
    INPUT_PULSE,
    INPUT_RISING,
    MAX_OFFSET_US,
    NOW,
    OFFSET,
    OUTSIDE,
    RESET_WORD,
    RESETS,
    TIMED,
    TRIGGERS,
    UNKNOWNS,
    UNTIMED,
    WRAP_CODE,
    WRAP_SHIFT,
)
from evis.events.codecs.writing_kernels import Sink

LATEST_OFFSET = wp.constant(wp.int64(MAX_OFFSET_US))
FIRST_TIMED = WRAP_CODE << 12
"""From this word on, all carry the time."""
INPUT_CHANNEL, PULSE_CHANNEL, GENERATOR_CHANNEL = (
    TRIGGERS[w][0] for w in (INPUT_RISING, INPUT_PULSE, GENERATOR_RISING)
)


@wp.struct
class Clock:
    """Holds the current time and the counts: the part of the state that DAVIS and DVXplorer share.

    timed: a time has come. offset, now: base of the times and time [us].

    The kernels set its fields one by one in their loops: with a struct assigned as a whole the compiler keeps it in
    memory, which made them four times as slow.
    """

    timed: wp.int64
    offset: wp.int64
    now: wp.int64
    outside: wp.int64
    untimed: wp.int64
    unknown: wp.int64
    resets: wp.int64


@wp.func
def clock_of(to: Sink):
    """Reads the clock from the state."""
    clock = Clock()
    clock.timed = to.state[TIMED]
    clock.offset = to.state[OFFSET]
    clock.now = to.state[NOW]
    clock.outside = to.state[OUTSIDE]
    clock.untimed = to.state[UNTIMED]
    clock.unknown = to.state[UNKNOWNS]
    clock.resets = to.state[RESETS]
    return clock


@wp.func
def keep_clock(
    clock: Clock,
    # out
    to: Sink,
):
    """Writes the clock to the state."""
    to.state[TIMED] = clock.timed
    to.state[OFFSET] = clock.offset
    to.state[NOW] = clock.now
    to.state[OUTSIDE] = clock.outside
    to.state[UNTIMED] = clock.untimed
    to.state[UNKNOWNS] = clock.unknown
    to.state[RESETS] = clock.resets


@wp.func
def first_timed(words: wp.array(dtype=wp.uint16), start: wp.int32):
    """Finds the first word from `start` on that carries time: a time, a wrap or a reset; the end if there is none."""
    i = wp.int32(start)
    end = words.shape[0]
    while i < end:
        word = int(words[i])
        if word >= FIRST_TIMED or word == RESET_WORD:
            break
        i += 1
    return i


@wp.func
def wrapped(offset: wp.int64, turns: wp.int32):
    """Computes the base of the times [us] after a wrap; it stops at MAX_OFFSET_US."""
    return wp.min(offset + wp.int64(turns << WRAP_SHIFT), LATEST_OFFSET)


@wp.func
def is_trigger(special: wp.int32):
    """Tells whether a special word is a trigger."""
    return (special >= INPUT_FALLING and special <= INPUT_PULSE) or (
        special == GENERATOR_FALLING or special == GENERATOR_RISING
    )


@wp.func
def trigger_channel(special: wp.int32):
    """Returns the channel of a trigger: 0 the input's edges, 1 the generator's, 2 the input's pulses."""
    channel = wp.int32(INPUT_CHANNEL)
    if special == INPUT_PULSE:
        channel = PULSE_CHANNEL
    elif special >= GENERATOR_FALLING:
        channel = GENERATOR_CHANNEL
    return channel


@wp.func
def trigger_rises(special: wp.int32):
    """Returns the value of a trigger: 1 for a rising edge or a pulse."""
    return wp.where(special == INPUT_RISING or special == INPUT_PULSE or special == GENERATOR_RISING, 1, 0)
