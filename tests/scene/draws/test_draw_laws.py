"""The laws of random values against the closed-form distributions, and what a value depends on."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from evis.scene.draws import Choice, Draws, Law, Normal, Uniform, uniform, would_draw

COUNT = 4000
LEAST = 1e-4
"""Of a p-value: one of ten thousand seeds would fail, and this one is fixed."""


def drawn(law: Law, place: str = "lights.lamp.intensity") -> np.ndarray:
    """One value for each of COUNT seeds that follow one another, as environments have them."""
    return np.array([Draws(seed).value(place, law) for seed in range(COUNT)])


@pytest.mark.parametrize(
    ("law", "distribution"),
    [
        (Uniform(-2.0, 3.0), stats.uniform(-2.0, 5.0)),
        (Uniform(0.01, 100.0, log=True), stats.loguniform(0.01, 100.0)),
        (Normal(5.0, 0.5), stats.norm(5.0, 0.5)),
        (Normal(5.0, 0.5, 4.8, 5.1), stats.truncnorm(-0.4, 0.2, 5.0, 0.5)),
        (Normal(0.0, 1.0, 8.0, 9.0), stats.truncnorm(8.0, 9.0)),
        (Normal(0.0, 1.0, -9.0, -8.0), stats.truncnorm(-9.0, -8.0)),
        (Normal(1.0, 2.0, low=0.0), stats.truncnorm(-0.5, np.inf, 1.0, 2.0)),
    ],
)
def test_values_have_the_distribution(law: Law, distribution: stats.rv_continuous) -> None:
    """Kolmogorov and Smirnov, also far out in the tails of a normal distribution."""
    assert stats.kstest(drawn(law), distribution.cdf).pvalue > LEAST


def test_whole_numbers_and_choices_are_as_frequent() -> None:
    whole = drawn(Uniform(3.0, 7.0, whole=True))
    assert whole.dtype.kind == "i" and set(whole) == {3, 4, 5, 6, 7}
    assert stats.chisquare(np.bincount(whole)[3:]).pvalue > LEAST
    chosen = drawn(Choice(("red", "blue", "blue")))
    counts = [np.sum(chosen == name) for name in ("red", "blue")]
    assert stats.chisquare(counts, [COUNT / 3, 2 * COUNT / 3]).pvalue > LEAST


def test_places_and_seeds_are_independent() -> None:
    """Neighbouring seeds at one place, and neighbouring places of one seed: pairs fill the square evenly."""
    by_seed = np.array([uniform(seed, "bodies.a.position[0]") for seed in range(COUNT + 1)])
    other = np.array([uniform(seed, "bodies.a.position[1]") for seed in range(COUNT)])
    by_place = np.array([uniform(7, f"bodies.b_{k}.position[0]") for k in range(COUNT + 1)])
    for a, b in ((by_seed[:-1], by_seed[1:]), (by_seed[:-1], other), (by_place[:-1], by_place[1:])):
        cells = np.histogram2d(a, b, 8, [[0, 1], [0, 1]])[0]
        assert stats.chisquare(cells.ravel()).pvalue > LEAST
        assert abs(np.corrcoef(a, b)[0, 1]) < 4 / math.sqrt(COUNT)


@pytest.mark.parametrize("law", [Uniform(2.0, 2.0), Uniform(2.0, 2.0, log=True), Normal(2.0, 0.0), Choice((2.0, 2.0))])
def test_a_law_without_spread_is_not_random(law: Law) -> None:
    draws = Draws(1)
    assert draws.value("x", law) == 2.0
    assert draws.made == {}


def test_ends_are_kept() -> None:
    """Whatever rounding does."""
    for u in (5e-324, 0.5, math.nextafter(1.0, 0.0)):
        for law in (Uniform(0.1, 0.3), Uniform(0.1, 0.3, log=True), Normal(0.2, 0.1, 0.1, 0.3)):
            assert 0.1 <= law.value(u) <= 0.3
        assert Uniform(1.0, 6.0, whole=True).value(u) in range(1, 7)


def test_another_seed_that_draws_the_same_is_told() -> None:
    draws = Draws(0)
    first = draws.value("material", Choice(("a", "b")))
    same = [seed for seed in range(100) if would_draw(draws.made.values(), seed)]
    assert same == [seed for seed in range(100) if Draws(seed).value("material", Choice(("a", "b"))) == first]
    assert 30 < len(same) < 70
