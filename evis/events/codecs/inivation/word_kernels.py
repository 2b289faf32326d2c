"""What the kernels of DAVIS and DVXplorer share: their words' time, and triggers; see `words`."""

import warp as wp

from evis.events.codecs.inivation import words as inivation

INPUT_FALLING = wp.constant(inivation.INPUT_FALLING)
INPUT_RISING = wp.constant(inivation.INPUT_RISING)
INPUT_PULSE = wp.constant(inivation.INPUT_PULSE)
GENERATOR_FALLING = wp.constant(inivation.GENERATOR_FALLING)
GENERATOR_RISING = wp.constant(inivation.GENERATOR_RISING)
MAX_OFFSET_US = wp.constant(wp.int64(inivation.MAX_OFFSET_US))


@wp.func
def first_timed(words: wp.array(dtype=wp.uint16), start: wp.int32):
    """The first word from `start` on that carries time: a time, a wrap or a reset; the end if there is none."""
    i = wp.int32(start)
    end = words.shape[0]
    while i < end:
        word = int(words[i])
        if word >= 0x7000 or word == 1:
            break
        i += 1
    return i


@wp.func
def wrapped(offset: wp.int64, turns: wp.int32):
    """The base of the times [us] after a wrap; it stops at MAX_OFFSET_US."""
    return wp.min(offset + wp.int64(turns << 15), MAX_OFFSET_US)


@wp.func
def is_trigger(special: wp.int32):
    """Whether a special word is a trigger."""
    return (special >= INPUT_FALLING and special <= INPUT_PULSE) or (
        special == GENERATOR_FALLING or special == GENERATOR_RISING
    )


@wp.func
def trigger_channel(special: wp.int32):
    """Channel of a trigger: 0 the input's edges, 1 the generator's, 2 the input's pulses."""
    channel = wp.int32(0)
    if special == INPUT_PULSE:
        channel = 2
    elif special >= GENERATOR_FALLING:
        channel = 1
    return channel


@wp.func
def trigger_rises(special: wp.int32):
    """Value of a trigger: 1 for a rising edge or a pulse."""
    return wp.where(special == INPUT_RISING or special == INPUT_PULSE or special == GENERATOR_RISING, 1, 0)
