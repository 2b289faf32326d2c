"""Embeds the inner loops of the EVT decoders, in C++ (`evt3_runs.h`, `evt2_runs.h`): runs of words without a turn of
the time."""

from pathlib import Path

import warp as wp

from evis.events.codecs.prophesee import evt2, evt3
from evis.events.codecs.writing_kernels import Sink
from evis.native_code import native_code

RUN = 1024
"""Most words that `evt3_run` takes at a time: what it lays aside for them stays in the cache."""
_OTHERS = sum(1 << kind for kind in range(16) if kind not in evt3.IN_RUNS)
_EVT3 = {
    "RUN": RUN, "ADDRESS": evt3.ADDRESS, "OTHER_KINDS": _OTHERS, "LOW": evt3.LOW, "ROW": evt3.ROW,
    "ADDR_X": evt3.ADDR_X, "ADDR_Y": evt3.ADDR_Y, "TIME_LOW": evt3.TIME_LOW, "TIME_HIGH": evt3.TIME_HIGH,
}  # fmt: skip
_EVT2 = {
    "ADDRESS": evt2.ADDRESS_MASK, "X_SHIFT": evt2.X_SHIFT, "TYPE_SHIFT": evt2.TYPE_SHIFT,
    "LOW_SHIFT": evt2.LOW_SHIFT, "LOW_MASK": evt2.LOW_MASK,
}  # fmt: skip
_EVT3_RUNS, _EVT2_RUNS = ([Path(__file__).with_name(name)] for name in ("evt3_runs.h", "evt2_runs.h"))


@wp.func_native(native_code(_EVT3_RUNS, "return run_of_evt3(words, at, end, since, high, latest, first, to);", _EVT3))
def evt3_run(
    # in
    words: wp.array(dtype=wp.uint16),
    at: wp.int32,
    end: wp.int32,
    since: wp.int64,
    high: wp.int32,
    latest: wp.int32,
    first: wp.int32,
    # out
    to: Sink,
) -> wp.int32:
    """Decodes rows, pixels and low times from word `at` up to the first other word, or a low time behind `latest`.

    Args:
        words: words of EVT3 [n].
        at: first word to decode.
        end: word behind the last.
        since: time of the TIME_HIGH in force [us].
        high: its value, 12 bits.
        latest: last low time that is not later than the limit.
        first: place of the first event.
        to: where events are written; low time and row in its state go on, and out[1] gets the place behind the last
            event.

    Returns:
        the word to go on with.
    """
    ...


@wp.func_native(native_code(_EVT2_RUNS, "return run_of_evt2(words, at, end, since, first, to);", _EVT2))
def evt2_run(
    # in
    words: wp.array(dtype=wp.uint32),
    at: wp.int32,
    end: wp.int32,
    since: wp.int64,
    first: wp.int32,
    # out
    to: Sink,
) -> wp.int32:
    """Decodes events from word `at` up to the first other word.

    Args:
        words: words of EVT2 [n].
        at: first word to decode.
        end: word behind the last.
        since: time of the TIME_HIGH in force [us].
        first: place of the first event.
        to: where events are written.

    Returns:
        the word to go on with.
    """
    ...
