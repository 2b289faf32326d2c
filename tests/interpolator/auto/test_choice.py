"""The rule of interpolator:=auto on candidates whose best is known by hand."""

import pytest

from nodes.interpolator.auto.choice import Candidate, choose, with_steps_between

DENSE_FAST = Candidate("none", 250, 1, 0.50, 1.0)
DENSE = Candidate("none", 1000, 1, 0.10, 4.0)
DENSE_MORE = Candidate("none", 4000, 1, 0.01, 16.0)
SPLAT = Candidate("splat", 125, 8, 0.20, 1.5)
RIGID = Candidate("rigid", 31.25, 32, 0.115, 2.0)
RIGID_DEAR = Candidate("rigid", 250, 4, 0.105, 3.5)
ALL = [DENSE_FAST, DENSE, DENSE_MORE, SPLAT, RIGID, RIGID_DEAR]


@pytest.mark.parametrize(
    "error,rtf,best",
    [
        (None, None, RIGID),  # the cheapest within 1.2 of 0.10, the least at 1000 frames per second
        (0.11, None, RIGID_DEAR),
        (0.2, None, SPLAT),
        (0.6, None, DENSE_FAST),
        (0.05, None, DENSE_MORE),
        (None, 1 / 2.0, RIGID),
        (None, 0.6, SPLAT),
        (None, 1 / 20, DENSE_MORE),
        (0.3, 0.3, SPLAT),  # both: the cheapest that keeps both
    ],
)
def test_the_best_one_is_taken(error, rtf, best):
    choice = choose(ALL, error, rtf)
    assert choice.candidate is best and choice.met
    assert choose(ALL[::-1], error, rtf).candidate is best


@pytest.mark.parametrize(
    "error,rtf,best,text",
    [
        (0.001, None, DENSE_MORE, "error of 0.001"),
        (None, 2.0, DENSE_FAST, "real-time factor of 2"),
        (0.01, 0.5, RIGID, "error of 0.01"),  # the real-time factor counts first
    ],
)
def test_what_cannot_be_had_is_said_and_met_as_nearly_as_can_be(error, rtf, best, text):
    choice = choose(ALL, error, rtf)
    assert choice.candidate is best and not choice.met and text in choice.why


def test_candidates_that_measurements_do_not_tell_apart_go_by_the_other_figure():
    near = Candidate("rigid", 62.5, 32, 0.0101, 5.0)
    assert choose([*ALL, near], None, 1 / 20).candidate is near
    same = [Candidate("splat", 125, 8, 0.1, 2.0), Candidate("rigid", 125, 8, 0.1, 2.0)]
    assert choose(same).candidate is choose(same[::-1]).candidate


@pytest.mark.parametrize(
    "rates,text",
    [
        ([(60, 4), (60, 4)], "the least found at 240 frames per second"),
        ([(60, 4), (60, 8), (100, 64)], "the least found at up to 480 frames per second"),
        ([(1000, 8)], "the least found at 8000 frames per second"),
    ],
)
def test_the_reason_names_the_frames_per_second_that_were_compared(rates, text):
    assert choose([Candidate("rigid", rate, k, 0.3, 1.0) for rate, k in rates]).why.endswith(text)


def test_without_any_change_there_is_no_error():
    choice = choose([Candidate("rigid", 30, 8, 0.0, 0.1), Candidate("none", 250, 1, 0.0, 1.0)])
    assert choice.candidate.method == "rigid" and choice.why == "the cheapest without error"


def test_a_slower_rate_than_a_thousand_is_its_own_measure():
    only = [Candidate("rigid", 10, 4, 0.8, 0.1), Candidate("none", 10, 4, 0.7, 0.2)]
    assert choose(only).candidate is only[0]
    beyond = [Candidate("rigid", 4000, 2, 0.012, 9.0), Candidate("none", 4000, 2, 0.01, 20.0)]
    assert choose(beyond).candidate is beyond[0]


def test_nonsense_has_one_clear_line():
    with pytest.raises(ValueError, match="nothing to choose from"):
        choose([])
    with pytest.raises(ValueError, match="wanted_error is -1"):
        choose(ALL, -1.0)


def test_between_two_that_were_measured_the_error_is_a_power_of_the_frame_rate():
    """Error 1 / rate^2 and cost 1 + rate / 1000: what lies between is on the same curve."""
    measured = [Candidate("rigid", 100, k, 4.0 / k**2, 1 + k / 10) for k in (4, 8)]
    dense = [Candidate("none", rate, 1, 0.1, 1.0) for rate in (500, 1000)]
    found = with_steps_between([*measured, *dense, Candidate("splat", 50, 8, 0.5, 1.0)])
    assert [c.upsampling for c in found if c.method == "rigid"] == [4, 8, 5, 6, 7]
    assert [c.keyframe_rate for c in found if c.method == "none"] == [500, 1000, 625, 750, 875]
    assert sum(c.method == "splat" for c in found) == 1
    for c in found:
        if c.method == "rigid":
            assert c.error == pytest.approx(4.0 / c.upsampling**2, rel=1e-4)
            assert c.seconds == pytest.approx(1 + c.upsampling / 10)
