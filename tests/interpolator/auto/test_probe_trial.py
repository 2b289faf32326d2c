"""What is run again before a choice, and what trials make of predictions, on costs that are known by hand."""

import functools
import math

import numpy as np
import pytest

from evis.scene import load_scene
from nodes.interpolator.auto.chain import Chain
from nodes.interpolator.auto.choice import Candidate, choose
from nodes.interpolator.auto.cost import FullSize
from nodes.interpolator.auto.setting import Setting
from nodes.interpolator.auto.trial import Measured, Trial, believed, in_doubt, settle, way_of

DENSE = Candidate("none", 1000, 1, 0.10, 6.0)
RIGID = Candidate("rigid", 31.25, 32, 0.12, 2.0)
RIGID_LESS = Candidate("rigid", 31.25, 16, 0.25, 1.4)
SPLAT = Candidate("splat", 125, 8, 0.20, 1.5)
ALL = [DENSE, RIGID, RIGID_LESS, SPLAT]


@functools.cache
def disk():
    return load_scene("spinning_disk", {"width": 48, "height": 36})


def setting(duration_ns=200_000_000):
    return Setting(disk(), disk().camera("cam0"), duration_ns)


def rule(error=None, rtf=None):
    return lambda candidates: choose(candidates, error, rtf)


def test_without_trials_predictions_stand_and_are_in_doubt():
    assert believed(ALL, []) == [(c, 0.3) for c in ALL]


def test_a_trial_is_believed_and_corrects_what_is_like_it():
    """Rigid took 1.1 times what was predicted: so will rigid at half the K, with little doubt, and splat, with much."""
    known = believed([*ALL, Candidate("rigid", 250, 4, 0.11, 4.0)], [Trial("rigid", 31.25, 32, 2.2)])
    assert [c.seconds for c, _ in known] == pytest.approx([6.6, 2.2, 1.54, 1.65, 4.4])
    assert [doubt for _, doubt in known] == [0.3, 0.0, 0.05, 0.3, 0.12]
    both = believed(ALL, [Trial("rigid", 31.25, 32, 2.2), Trial("splat", 125, 8, 1.5 / 1.1)])
    # Dense rendering by the geometric mean of both, which is 1.
    assert both[0][0].seconds == pytest.approx(6.0) and both[3][0].seconds == pytest.approx(1.5 / 1.1)


@pytest.mark.parametrize(
    "error,rtf,expected",
    [
        # rigid (2.0) may cost 1.54 and be the best within 1.6; splat, which is chosen (1.5), may not keep it.
        (None, 1 / 1.6, [SPLAT, RIGID]),
        # Nothing else can come below 100 s, or do better than dense rendering.
        (None, 0.01, []),
        # The cheapest with 0.25: splat may be cheaper than rigid at 1.4, which may be dearer.
        (0.25, None, [RIGID_LESS, SPLAT]),
        # Nothing but dense rendering has an error of 0.1.
        (0.1, None, []),
    ],
)
def test_only_what_may_change_the_choice_is_in_doubt(error, rtf, expected):
    found = in_doubt(believed(ALL, []), rule(error, rtf))
    assert [way_of(c) for c in found[: len(expected)]] == [way_of(c) for c in expected]
    others = {way_of(c) for c in found} - {way_of(c) for c in expected}
    assert others <= ({way_of(RIGID)} if error == 0.25 else set())


class Costs:
    """In place of Chain: true costs by way, and what was asked for."""

    def __init__(self, true, spent=0.0):
        self.true, self.asked, self.spent = true, [], spent

    def gaps(self, way, seconds):
        return 5

    def takes(self, way, seconds):
        return self.spent

    def seconds(self, way, seconds):
        self.asked.append(way)
        return self.true[way]


@pytest.mark.parametrize("rtf", [1 / 1.3, 1 / 1.45, 1 / 1.6, 1 / 1.9, 1 / 2.2, 1 / 7])
@pytest.mark.parametrize("off", [(0.85, 0.85, 1.2), (1.2, 1.2, 0.85), (1.15, 0.9, 1.0), (0.9, 1.2, 0.9)])
def test_wrong_predictions_end_in_the_right_choice(monkeypatch, off, rtf):
    """Every way takes up to a fifth more or less than predicted, differently for each method: at any real-time factor
    the choice is the one that true costs lead to."""
    by_method = dict(zip(("none", "rigid", "splat"), off))
    true = {way_of(c): c.seconds * by_method[c.method] for c in ALL}
    costs = Costs(true)
    monkeypatch.setattr("nodes.interpolator.auto.trial.Chain", lambda s: costs)
    measured = Measured(list(ALL))
    chosen = settle(setting(), measured, wanted_rtf=rtf)
    truth = choose([Candidate(*way_of(c), c.error, true[way_of(c)]) for c in ALL], wanted_rtf=rtf)
    assert way_of(chosen.candidate) == way_of(truth.candidate) and chosen.met == truth.met
    assert len(costs.asked) == len(set(costs.asked)) == len(measured.trials)
    # All of it is known from now on.
    costs.asked.clear()
    assert settle(setting(), measured, wanted_rtf=rtf) == chosen and not costs.asked


def test_what_takes_too_long_to_try_is_not_tried(monkeypatch):
    costs = Costs({}, spent=math.inf)
    monkeypatch.setattr("nodes.interpolator.auto.trial.Chain", lambda s: costs)
    measured = Measured(list(ALL))
    assert settle(setting(), measured, wanted_rtf=1 / 1.6).candidate == SPLAT
    assert not costs.asked and not measured.trials


def test_physics_is_part_of_what_a_trial_took(monkeypatch):
    costs = Costs({way_of(c): c.seconds - 0.5 for c in ALL})
    monkeypatch.setattr("nodes.interpolator.auto.trial.Chain", lambda s: costs)
    measured = Measured(list(ALL), moving=0.5)
    settle(setting(), measured, wanted_rtf=1 / 1.6)
    assert measured.trials and all(
        t.seconds == dict((way_of(c), c.seconds) for c in ALL)[way_of(t)] for t in measured.trials
    )


def test_kept_and_read_again():
    measured = Measured(list(ALL), 0.25, [Trial("splat", 125.0, 8, 1.6)])
    assert Measured.of_json(measured.as_json()) == measured
    with pytest.raises((TypeError, KeyError)):
        Measured.of_json({"candidates": [{"method": "splat"}]})


@pytest.mark.parametrize("way", [("none", 250.0, 1), ("none", 125.0, 4), ("splat", 125.0, 4), ("rigid", 62.5, 4)])
def test_a_trial_runs_the_real_thing(monkeypatch, way):
    """By a clock of one tick per reading every gap takes one: the rate is the time per simulated second."""
    s = setting()
    ticks = iter(range(1000))
    monkeypatch.setattr(Setting, "clock", lambda self: float(next(ticks)))
    chain = Chain(s)
    rate = way[1] * way[2] if way[0] == "none" else way[1]
    assert 1 <= chain.gaps(way, 1.0) <= 0.2 * rate - 1 and chain.rounds(way, 1.0) >= 2
    assert chain.seconds(way, 1.0) == pytest.approx(rate)


@pytest.mark.parametrize(
    "way,seconds,gaps,rounds",
    [
        # 0.2 s in all, of gaps of 16 ms; one of half a second; as many as are allowed, of a millisecond; none of a run
        # that has but one.
        (("rigid", 62.5, 8), 1.0, 7, 2),
        (("rigid", 20.0, 8), 10.0, 1, 1),
        (("none", 250.0, 1), 0.25, 40, 4),
        (("rigid", 5.0, 8), 1.0, 0, None),
    ],
)
def test_a_trial_is_as_long_as_it_needs_to_be(way, seconds, gaps, rounds):
    chain = Chain(setting())
    assert chain.gaps(way, seconds) == gaps
    if rounds is not None:
        assert chain.rounds(way, seconds) == rounds
        gap_s = seconds / way[1]
        assert chain.takes(way, seconds) == pytest.approx((rounds * (gaps + 2) + 1) * gap_s)


def test_cuts_lie_where_the_change_is():
    """Change in two places, twice as much on the right: the first part has all of the left one and a quarter of the
    right one's columns; where nothing changes they are in the middle."""
    full = FullSize(setting(), None, [])
    change = np.zeros((36, 48), np.float32)
    change[4:6, 4:8] = 1.0
    change[28:30, 36:44] = 1.0
    full._changes = [change]
    (x0, y0, *size), (x1, y1, *_) = full.cuts((8, 6), 2)
    assert size == [8, 6]
    assert 0 <= x0 <= 6 and y0 in range(1, 5) and x1 in range(34, 40) and y1 in range(24, 28)
    full._changes = [0 * change]
    assert full.cuts((8, 6), 2) == [(20, 15, 8, 6)] * 2
    assert full.cuts((80, 60), 1) == [(0, 0, 48, 36)]
