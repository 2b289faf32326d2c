"""Pixels are drawn with the chances they are said to have, and intervals hold what they are to hold."""

import numpy as np
import pytest
from audit_rig import LIGHT_SCENES, audited, small

from nodes.audit.drawing import Drawing
from nodes.audit.estimate import ratio, student_quantile
from nodes.audit.pixels import Blocks, chances, draw
from nodes.audit.report import Units

HEIGHT, WIDTH = 36, 48
WIDEST = 0.15
"""Widest interval of 256 pixels."""


def test_students_quantiles() -> None:
    """Against tables."""
    table = {1: 12.706, 2: 4.303, 3: 3.182, 4: 2.776, 5: 2.571, 10: 2.228, 30: 2.042, 1e6: 1.960}
    for freedom, wanted in table.items():
        assert student_quantile(freedom) == pytest.approx(wanted, rel=2e-3)


def test_chances_add_up_and_no_pixel_is_taken_twice() -> None:
    rng = np.random.default_rng(2)
    score = np.where(rng.random((HEIGHT, WIDTH)) < 0.02, 50.0, 0.1)
    blocks = Blocks.of(HEIGHT, WIDTH, 16)
    for count in (1, 16, 200, 1000, HEIGHT * WIDTH, 5000):
        chance = chances(score, count)
        assert chance.sum() == pytest.approx(min(count, score.size)) and 0 < chance.min() and chance.max() <= 1
        pixels, own = draw(chance, blocks, 7, 0)
        assert len(np.unique(pixels, axis=0)) == len(pixels) == min(count, score.size)
        assert np.array_equal(own, chance[pixels[:, 1], pixels[:, 0]])


def test_every_pixel_is_drawn_as_often_as_is_said() -> None:
    rng = np.random.default_rng(3)
    score, blocks = rng.random((12, 16)) ** 4, Blocks(12, 16, 4, 6)
    chance, hits, rounds = chances(score, 20), np.zeros((12, 16)), 2000
    for seed in range(rounds):
        pixels, _ = draw(chance, blocks, seed, 0)
        hits[pixels[:, 1], pixels[:, 0]] += 1
    spread = np.sqrt(chance * (1 - chance) / rounds)
    assert (np.abs(hits / rounds - chance) < 4.5 * spread + 1e-12).all()


def test_the_way_goes_through_every_pixel_once() -> None:
    blocks = Blocks.of(35, 47, 16)
    assert np.array_equal(np.sort(blocks.serpentine()), np.arange(35 * 47))
    assert blocks.spread(np.arange(blocks.rows * blocks.columns).reshape(blocks.rows, -1)).shape == (35, 47)


def test_without_events_there_is_no_estimate() -> None:
    none = ratio(np.zeros(5), np.zeros(5), np.full(5, 0.1))
    assert np.isnan([none.value, none.low, none.high]).all()


def test_all_pixels_leave_nothing_open() -> None:
    whole = ratio(np.array([1.0, 2.0]), np.array([4.0, 8.0]), np.ones(2))
    assert whole.value == whole.low == whole.high == 0.25


def covered(units: Units, drawing: Drawing, seeds: int) -> tuple[float, float]:
    """Share of draws whose interval holds the error of all pixels, and their middle width."""
    at = np.zeros((HEIGHT, WIDTH), int)
    at[units.y, units.x] = np.arange(len(units.x))
    true = units.vp.sum() / units.events.sum()
    chance, hits, widths = chances(drawing.score, drawing.count), 0, []
    for seed in range(seeds):
        pixels, own = draw(chance, drawing.blocks, seed, 0)
        k = at[pixels[:, 1], pixels[:, 0]]
        interval = ratio(units.vp[k], units.events[k].astype(float), own)
        hits += interval.low <= true <= interval.high or np.isnan(interval.value)
        widths.append(interval.high - interval.low)
    return hits / seeds, float(np.nanmedian(widths))


def check(name: str, counts: tuple[int, ...], seeds: int) -> None:
    """Draws from what an audit of all pixels found."""
    scene = small(name, WIDTH, HEIGHT)
    units = audited(scene, HEIGHT * WIDTH, seconds=0.2).units()
    least = 0.95 - 1.96 * np.sqrt(0.95 * 0.05 / seeds)
    for count in counts:
        share, width = covered(units, audited(scene, count, seconds=0.2).drawing, seeds)
        assert share >= least, f"{name}: {count} pixels hold the error in {share:.3f} of the draws"
        if count == 256:
            assert width <= WIDEST, f"{name}: {width:.3f} wide"


def test_intervals_hold_the_error_of_all_pixels() -> None:
    check("fast_shadow", (32, 64, 256), 100)


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted(LIGHT_SCENES.glob("*.yaml")), ids=lambda path: path.stem)
def test_intervals_hold_on_every_light_scene(path) -> None:
    check(path.stem, (32, 64, 256), 300)
