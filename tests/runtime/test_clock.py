"""Stamps against exact rational arithmetic."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evis.runtime import pacing
from evis.runtime.clock import keyframe_count, keyframe_stamp, subframe_stamps
from evis.runtime.pacing import FAST, Pacer, parse_pace


@given(st.integers(0, 10**12), st.integers(1, 10**5))
def test_keyframe_stamp_is_the_rounded_fraction(k: int, rate: int) -> None:
    assert abs(Fraction(k * 10**9, rate) - keyframe_stamp(k, rate)) <= Fraction(1, 2)


def test_keyframe_stamp_after_ten_hours_has_no_drift() -> None:
    assert keyframe_stamp(30 * 36_000, 30.0) == 36_000 * 10**9
    assert keyframe_stamp(2997 * 36, 29.97) == 3600 * 10**9


@given(st.integers(0, 10**11), st.integers(1, 2000))
def test_keyframe_count(duration: int, rate: int) -> None:
    n = keyframe_count(duration, rate)
    assert keyframe_stamp(n - 1, rate) <= duration < keyframe_stamp(n, rate)


@given(st.integers(0, 10**15), st.integers(0, 10**9), st.integers(1, 1000))
def test_subframes_end_on_b_and_are_rounded_exactly(t_a: int, gap: int, k: int) -> None:
    t = subframe_stamps(t_a, t_a + gap, k)
    assert t.dtype == np.int64 and t[-1] == t_a + gap
    for i in (1, (k + 1) // 2, k):
        assert abs(Fraction(t_a * k + i * gap, k) - int(t[i - 1])) <= Fraction(1, 2)


def test_a_pacer_measures_what_was_reached_over_all_its_rounds(monkeypatch):
    """3 s of stamps at twice real time are due after 1.5 s and took 2 s; 1 s of the next round took 0.5 s, as due."""
    now = [0]
    monkeypatch.setattr(pacing.time, "monotonic_ns", lambda: now[0])
    pacer = Pacer(2.0)
    for at_ms, stamp_ms in ((0, 5000), (700, 6000), (2000, 8000)):
        now[0] = at_ms * 10**6
        pacer.passed(stamp_ms * 10**6)
    assert pacer.result() == {"wanted": 2.0, "reached": 1.5, "late_ms_max": 500}
    pacer.restart()
    for at_ms, stamp_ms in ((9000, 0), (9500, 1000)):
        now[0] = at_ms * 10**6
        assert pacer.passed(stamp_ms * 10**6) == 0
    assert pacer.result() == {"wanted": 2.0, "reached": round(4 / 2.5, 6), "late_ms_max": 500}


def test_pace_words():
    """realtime, fast and numbers; nothing else."""
    words = ("realtime", "fast", "2.0", "0.5", "2x", "1e6")
    assert [parse_pace(word) for word in words] == [1.0, FAST, 2.0, 0.5, 2.0, 1e6]
    for word in ("0", "-1", "nan", "inf", "slow", "x", "1e7", ""):
        with pytest.raises(ValueError, match=f"pace is '{word}', must be realtime, fast or a speed"):
            parse_pace(word)
