"""Which instants between coarse frames there are: as close as the tolerance of time asks for, or it is told."""

import numpy as np
import pytest

from evis.runtime.clock import keyframe_stamp, subframe_stamps
from evis.scene.model import Waveform
from nodes.interpolator.refine.instants import MOST, instants_of
from nodes.interpolator.refine.light.flicker import Flicker


@pytest.mark.parametrize("pixels", [96 * 72, 346 * 260, 1280 * 720])
def test_instants_are_twice_the_tolerance_apart_at_most(pixels):
    made = instants_of(33_333_333, 8, 100_000, pixels, 4, True)
    assert made.reached
    stamps = made.stamps(5, 5 + 33_333_333)
    assert np.diff(stamps).max() <= 200_000
    # The coarse frames are among them, to the nanosecond.
    assert np.isin(subframe_stamps(5, 5 + 33_333_333, 8), stamps).all()
    assert made.slots * pixels <= MOST


def test_every_instant_between_frames_has_a_slot_of_one_window():
    made = instants_of(32_000_000, 8, 100_000, 346 * 260, 4, True)
    seen = [i for first, last in made.windows() for i in made.of_window(first)[: (last - first) * made.inside]]
    each = 1 << made.depth
    assert seen == [i for i in range(1, made.count) if i % each]


def test_a_tolerance_out_of_reach_is_told():
    assert not instants_of(32_000_000, 8, 10, 346 * 260, 4, True).reached
    assert not instants_of(32_000_000, 8, 10_000, 64 * 1280 * 720, 4, True).reached


def test_flashes_ask_for_no_more_instants_than_can_be_counted():
    """Pixels at the instants of a coarse interval are numbered in int32, of all environments together."""
    for pixels, reached in ((1280 * 720, True), (4 * 1280 * 720, False), (4096 * 346 * 260, False)):
        made = instants_of(32_000_000, 8, 100_000, pixels, 1024, True)
        assert made.slots * pixels < 1 << 31 and made.per_window == 1 and made.reached == reached


def test_gaps_of_one_rate_are_divided_alike():
    """Their ends are rounded to nanoseconds, also where an instant more or less hangs on that."""
    stamps = [keyframe_stamp(k, 30.0) for k in range(4)]
    lengths = {int(length) for length in np.diff(stamps)}
    assert lengths == {33_333_333, 33_333_334}
    for frequency, tolerance in ((120.0, 500_000), (1920.0, 33_333_333.3 / 8 / 64)):
        lights = Flicker([Waveform("sine", frequency)], 0.01, "cpu")
        assert all(lights.follows(length) for length in lengths)
        assert len({lights.instants(length) for length in lengths}) == 1
        assert len({instants_of(length, 8, tolerance, 1000, 4, True) for length in lengths}) == 1
    assert not Flicker([Waveform("sine", 1921.0)], 0.01, "cpu").follows(33_333_333)


def test_a_short_gap_needs_none():
    made = instants_of(1_000_000, 8, 100_000, 1000, 4, True)
    assert made.depth == 0 and made.reached


@pytest.mark.parametrize("probes", [4, 8, 32])
def test_every_probe_is_at_an_instant(probes):
    for gap in (3_000_000, 33_333_333):
        made = instants_of(gap, 32 // probes, 100_000, 1280 * 720, probes, False)
        assert (1 << made.depth) % probes == 0
