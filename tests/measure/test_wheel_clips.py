"""Six clips of a wheel flicked by hand against their reference, and the reference against two other ways to its speed.

Eight samples of one clip are wrong in the reference; that is shown here, and only those are ever left out.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from wheel_evidence import CLIPS, WINDOWS, Clip, line_speed, load, passage_speed

from evis.events.measure import Measurement

FLAWED = "11_35_50"
FLAWED_US = (472_000, 500_000)
SLOW = [
    name if name in ("11_35_33", FLAWED) else pytest.param(name, marks=pytest.mark.slow) for name in CLIPS
]  # fmt: skip
OFF = "eight samples of this clip's reference are off by 11 to 25 %, see test_eight_samples_of_the_reference_are_wrong"


@lru_cache
def measured(name: str) -> tuple[Clip, np.ndarray, np.ndarray]:
    """The clip, stamps [us from the first event] and speeds [rad/s] of the series that is found in it."""
    clip = load(name)
    measurement = Measurement(*clip.size)
    for first in range(0, len(clip.t), 50_000):
        measurement.add(*(v[first : first + 50_000] for v in (clip.t, clip.x, clip.y, clip.p)))
    found = measurement.report()["rotation"]
    assert found["confidence"] >= 0.5 and not found["steady"]
    stamps = np.array([t for t, _ in found["series"]]) - clip.t[0]
    return clip, stamps / 1e3, np.array([omega for _, omega in found["series"]])


def wrong(clip: Clip) -> np.ndarray:
    """Samples of the reference [s] that a line fitted to the end contradicts by more than a tenth."""
    off = np.abs(clip.omega / line_speed(clip) - 1) > 0.10
    return off & (clip.windows == WINDOWS)


def errors(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Relative deviations: of our series at the reference's stamps, and at our stamps within the reference's extent."""
    clip, t, omega = measured(name)
    inside = (t >= clip.at[0]) & (t <= clip.at[-1])
    there = np.interp(t[inside], clip.at, clip.omega)
    return np.abs(np.interp(clip.at, t, omega) / clip.omega - 1), np.abs(omega[inside] / there - 1)


@pytest.mark.parametrize(
    "name",
    [name for name in SLOW if name != FLAWED]
    + [pytest.param(FLAWED, marks=[pytest.mark.slow, pytest.mark.xfail(reason=OFF, strict=True)])],
)
def test_within_ten_per_cent_of_the_reference(name):
    """95th percentile, whichever of the two series is brought to the other's stamps."""
    clip, t, _ = measured(name)
    assert t[0] <= clip.at[0] + 20_000 and t[-1] >= clip.at[-1] - 20_000
    assert np.diff(t[(t > clip.at[0]) & (t < clip.at[-1])]).max() <= 40_000
    for error in errors(name):
        assert np.percentile(error, 95) <= 0.10


@pytest.mark.slow
def test_all_clips_together():
    """All 798 samples, the wrong ones among them: 95 % within 10 %."""
    error = np.concatenate([errors(name)[0] for name in CLIPS])
    assert len(error) == 798 and np.percentile(error, 95) <= 0.10


@pytest.mark.parametrize("name", SLOW)
def test_within_eight_per_cent_of_a_line_fitted_to_the_end(name):
    """The reference's own method, without its error; every sample of all six clips."""
    clip, t, omega = measured(name)
    assert np.percentile(np.abs(np.interp(clip.at, t, omega) / line_speed(clip) - 1), 95) <= 0.08


@pytest.mark.parametrize("name", CLIPS)
def test_how_the_reference_was_made(name):
    """A line through the edge per 3 ms, the slope of its angle over nine of them: all samples but eight within 6 %."""
    clip = load(name)
    whole = clip.windows == WINDOWS
    off, error = wrong(clip), np.abs(line_speed(clip) / clip.omega - 1)
    assert off.sum() == (8 if name == FLAWED else 0)
    assert np.median(error[whole & ~off]) <= 0.01 and error[whole & ~off].max() <= 0.06


def test_eight_samples_of_the_reference_are_wrong():
    """Two windows of 3 ms whose line was fitted badly explain them; three other ways agree on another speed.

    The wheel is pushed aside there and its rim makes events too, below and beside the edge. A line that is not fitted
    to the end still leans to them: with 5 improvements instead of 20 it is off the same way.
    """
    clip, t, omega = measured(FLAWED)
    off = wrong(clip)
    at, reference = clip.at[off], clip.omega[off]
    assert at.min() > FLAWED_US[0] and at.max() < FLAWED_US[1]
    line, passage, ours = line_speed(clip)[off], passage_speed(clip, at), np.interp(at, t, omega)
    for a, b in ((line, passage), (line, ours), (passage, ours)):
        assert np.abs(a / b - 1).max() <= 0.09
    for speed in (line, passage):
        assert np.abs(reference / speed - 1).min() >= 0.10
    # each of the three is above the reference where it is too low, and below where it is too high
    assert np.all(np.sign([line, passage, ours] - reference) == np.sign(line - reference))
    early = line_speed(clip, turns=5)[off]
    assert np.all((early - line) * (reference - line) > 0)


def test_two_windows_explain_the_eight_samples():
    """An angle that is 0.14 and 0.15 rad too large in the windows at 484.5 and 487.5 ms, in a slope over nine."""
    clip = load(FLAWED)
    near = (clip.at > FLAWED_US[0]) & (clip.at < FLAWED_US[1])
    late = (np.array([484_500, 487_500]) - clip.at[near, None]) * 1e-6
    each_s = 3e-3 * np.arange(-4, 5)
    slope = np.where(np.abs(late) < 0.0135, late, 0) / (each_s**2).sum()
    excess = clip.omega[near] - line_speed(clip)[near]
    wrong_rad, *_ = np.linalg.lstsq(slope, excess, rcond=None)
    assert np.all((wrong_rad > 0.12) & (wrong_rad < 0.17))
    assert np.abs((excess - slope @ wrong_rad) / clip.omega[near]).max() <= 0.05
