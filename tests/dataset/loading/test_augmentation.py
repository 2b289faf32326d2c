"""Changes of windows against their definitions, event by event, and against what flow and light do."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.stats
from made_set import HEIGHT, WIDTH, same

import evis
from evis.dataset import Augment
from evis.dataset.augmenting.arrays import uniforms
from evis.dataset.augmenting.changed_labels import placed_labels
from evis.dataset.draws import key_of, poisson
from evis.dataset.loading.windows import Windows
from evis.random_numbers import GOLDEN, mix, open_uniform

Made = tuple[Path, Path]
KINDS = ("forward_flow", "backward_flow", "boxes", "depth", "events")


def windows(small: Made, augment: Augment | None = None, labels: tuple[str, ...] = KINDS, **how: Any) -> Windows:
    return evis.dataset.open(small[1]).windows(**{"seconds": 1 / 30, **how}, labels=labels, augment=augment)


def rotation(flow: np.ndarray) -> float:
    """How much a flow [H, W, 2] turns about the middle of the image: its angular momentum."""
    y, x = np.mgrid[:HEIGHT, :WIDTH] - np.array([(HEIGHT - 1) / 2, (WIDTH - 1) / 2])[:, None, None]
    return float(np.nansum(x * flow[..., 1] - y * flow[..., 0]))


def inside(x: float, y: float, margin: float = 0.0) -> bool:
    """Whether a place is in a crop of 12 x 17."""
    return bool(-margin <= x <= 16 + margin and -margin <= y <= 11 + margin)


def rows(sample: dict[str, Any]) -> list[tuple[Any, ...]]:
    """The events with their labels, one by one."""
    columns = [sample["events"][n] for n in "txyp"] + [sample["event_instance"], sample["event_signal"]]
    return [tuple(int(v) for v in row) + tuple(f) for *row, f in zip(*columns, sample["event_flow"].tolist())]


@pytest.mark.parametrize(("flip_x", "flip_y"), [(1.0, 0.0), (0.0, 1.0), (1.0, 1.0)])
def test_mirrored(small: Made, flip_x: float, flip_y: float) -> None:
    """Every event, box and flow by its definition; one mirror turns a rotation round, two leave it."""
    plain, turned = windows(small), windows(small, Augment(flip_x=flip_x, flip_y=flip_y))
    sx, sy = 1 - 2 * int(flip_x), 1 - 2 * int(flip_y)
    for k in (1, 9):
        a, b = plain[k], turned[k]
        at = lambda x, y: (WIDTH - 1 - x if flip_x else x, HEIGHT - 1 - y if flip_y else y)
        want = [(t, *at(x, y), p, i, s, u * sx, v * sy) for t, x, y, p, i, s, u, v in rows(a)]
        np.testing.assert_array_equal(np.array(rows(b)), np.array(want))
        for y in range(0, HEIGHT, 5):
            for x in range(0, WIDTH, 7):
                mx, my = at(x, y)
                assert b["depth"][my, mx] == a["depth"][y, x]
                assert b["forward_valid"][my, mx] == a["forward_valid"][y, x]
                for way in ("forward_flow", "backward_flow"):
                    np.testing.assert_array_equal(b[way][my, mx], a[way][y, x] * np.float32([sx, sy]))
        for old, new in zip(a["box"], b["box"]):
            corners = sorted([at(old[0], old[1]), at(old[2], old[3])])
            assert new.tolist() == [min(c[0] for c in corners), min(c[1] for c in corners),
                                    max(c[0] for c in corners), max(c[1] for c in corners)]  # fmt: skip
        assert abs(rotation(a["forward_flow"])) > 1000
        assert np.isclose(rotation(b["forward_flow"]), sx * sy * rotation(a["forward_flow"]), rtol=1e-4)


def test_time_runs_backwards(small: Made) -> None:
    """The change of light over the window changes its sign at every pixel, and the disk turns the other way."""
    for k in (1, 9):
        a, b = windows(small)[k], windows(small, Augment(reverse=1.0))[k]
        assert (np.diff(b["events"]["t"]) >= 0).all()
        assert b["t0_ns"] <= b["events"]["t"][0] and b["events"]["t"][-1] < b["t1_ns"]
        light = []
        for w in (a, b):
            image = np.zeros((HEIGHT, WIDTH), int)
            np.add.at(image, (w["events"]["y"], w["events"]["x"]), 2 * w["events"]["p"].astype(int) - 1)
            light.append(image)
        assert light[0].any() and np.array_equal(light[1], -light[0])
        turn = a["t0_ns"] + a["t1_ns"] - 1
        want = [(turn - t, x, y, 1 - p, i, s, -u, -v) for t, x, y, p, i, s, u, v in rows(a)][::-1]
        np.testing.assert_array_equal(np.array(rows(b)), np.array(want))
        assert np.sign(rotation(b["forward_flow"])) == -np.sign(rotation(a["forward_flow"]))
        same(b["forward_flow"], a["backward_flow"])
        same(b["backward_valid"], a["forward_valid"])
        assert b["flow_t"].tolist() == a["flow_t"].tolist()
        assert b["forward_flow_ns"] == b["backward_flow_ns"] == a["t1_ns"]
        # What stands at an instant is that of the window's start, which is where it ends now.
        truth = evis.dataset.open(small[1])[b["sequence"]].labels("depth", a["t0_ns"], a["t0_ns"] + 1)
        same(b["depth"], truth["depth"][0])
        assert b["depth_ns"] == a["t1_ns"]


def test_flow_backwards_in_time_needs_only_what_it_is_made_of(small: Made) -> None:
    """Forward flow alone is asked for, and backward flow is read for it."""
    one = windows(small, Augment(reverse=1.0), ("forward_flow",))[4]
    assert "backward_flow" not in one
    same(one["forward_flow"], windows(small)[4]["backward_flow"])


def test_cropped(small: Made) -> None:
    """A part of all images at the same place; flow that leaves it is not valid; boxes are cut."""
    crop = Augment(crop=(12, 17))
    seen = set()
    for k in range(12):
        a, b = windows(small)[k], windows(small, crop)[k]
        assert b["depth"].shape == (12, 17)
        places = [
            (top, left)
            for top in range(HEIGHT - 11)
            for left in range(WIDTH - 16)
            if np.array_equal(a["depth"][top : top + 12, left : left + 17], b["depth"])
            and np.array_equal(a["forward_flow"][top : top + 12, left : left + 17], b["forward_flow"], equal_nan=True)
        ]
        ((top, left),) = places
        seen.add((top, left))
        want = [(t, x - left, y - top, *rest) for t, x, y, *rest in rows(a) if inside(x - left, y - top)]
        np.testing.assert_array_equal(np.array(rows(b)), np.array(want))
        for y in range(12):
            for x in range(17):
                u, v = b["forward_flow"][y, x]
                stays = inside(x + u, y + v, 0.5)
                assert b["forward_valid"][y, x] == (a["forward_valid"][top + y, left + x] and stays)
        for box, name in zip(b["box"], b["box_id"]):
            x0, y0, x1, y1 = a["box"][list(a["box_id"]).index(name)]
            assert box.tolist() == [max(x0 - left, 0), max(y0 - top, 0), min(x1 - left, 16), min(y1 - top, 11)]
            assert box[0] <= box[2] and box[1] <= box[3]
    assert len(seen) > 6  # anywhere


def test_boxes_out_of_the_crop_are_gone() -> None:
    drawn = Augment(crop=(10, 10)).drawn(0, 0, 0, 0, 100, 100)
    x, y = drawn.left, drawn.top
    box = np.float32([[x - 9, y, x - 1, y + 5], [x - 9, y, x, y + 5], [x, y + 10, x + 3, y + 12]])
    got = placed_labels({"box": box, "box_id": np.array([4, 5, 6])}, drawn, 100, 100)
    assert got["box"].tolist() == [[0, 0, 0, 5]] and got["box_id"].tolist() == [5]


def test_dropped_and_added(small: Made) -> None:
    """Shares and rates as asked within their spread; what is added says that it is noise, and all stays in order."""
    a = windows(small)[2]
    n = len(a["events"]["t"])
    dropped = windows(small, Augment(drop=0.25))[2]
    assert abs(len(dropped["events"]["t"]) - 0.75 * n) < 5 * np.sqrt(n * 0.25 * 0.75)
    whole = {str(row) for row in rows(a)}
    assert {str(row) for row in rows(dropped)} <= whole
    noisy = windows(small, Augment(noise=40.0))[2]
    added, expected = len(noisy["events"]["t"]) - n, 40 * HEIGHT * WIDTH / 30
    assert abs(added - expected) < 5 * np.sqrt(expected)
    assert np.count_nonzero(noisy["event_signal"] == 0) == added + np.count_nonzero(a["event_signal"] == 0)
    assert (np.diff(noisy["events"]["t"]) >= 0).all()
    e = noisy["events"]
    assert noisy["t0_ns"] <= e["t"][0] and e["t"][-1] < noisy["t1_ns"]
    assert e["x"].max() < WIDTH and e["y"].max() < HEIGHT
    alone = [row for row in rows(noisy) if str(row) not in whole]
    places, instance, flow = np.array(alone)[:, :4], np.array(alone)[:, 4], np.array(alone)[:, 6:]
    assert not instance.any() and np.isnan(flow).all()
    for column, most in ((1, WIDTH), (2, HEIGHT), (3, 2)):
        assert abs(places[:, column].mean() - (most - 1) / 2) < 5 * most / np.sqrt(12 * added)


@pytest.mark.parametrize("mean", [0.0, 0.02, 3.7, 399.9, 400.1, 5000.0])
def test_the_number_of_added_events_is_poissons(mean: float) -> None:
    """As scipy has the law, by Kolmogorov and Smirnov's distance: 1.95 / sqrt(n) is its 0.1 % point, less of steps."""
    drawn = np.array([poisson(key_of("test", n), mean) for n in range(4000)])
    below = np.searchsorted(np.sort(drawn), drawn, "right") / len(drawn)
    assert np.abs(below - scipy.stats.poisson.cdf(drawn, mean)).max() < 1.95 / np.sqrt(len(drawn))
    assert abs(drawn.mean() - mean) <= 5 * np.sqrt(mean / len(drawn))
    # The variance of a sample's variance: (mu_4 - sigma^4) / n with mu_4 = mean (1 + 3 mean).
    assert abs(drawn.var() - mean) <= 5 * np.sqrt((mean + 2 * mean**2) / len(drawn))


def test_a_draw_is_of_seed_epoch_and_window(small: Made) -> None:
    """Not of the order in which windows are read, and another in another epoch."""
    every = Augment(flip_x=0.5, flip_y=0.5, reverse=0.5, crop=(20, 20), drop=0.1, noise=20.0)
    one, two = windows(small, every, seed=3), windows(small, every, seed=3)
    there = [one.sample(k, 1) for k in range(6)]
    for k in (5, 0, 3):
        same(two.sample(k, 1), there[k])
    assert any(one.sample(k, 0)["depth"].tobytes() != there[k]["depth"].tobytes() for k in range(6))
    assert windows(small, every, seed=4).sample(2, 1)["depth"].tobytes() != there[2]["depth"].tobytes()


def test_random_numbers_are_those_of_the_house() -> None:
    key = key_of("a")
    with np.errstate(over="ignore"):
        first = mix(np.array([key + np.uint64(2)]))
        want = open_uniform(mix(first + np.arange(1, 1001, dtype=np.uint64) * GOLDEN))
    got = uniforms(key, 2, 1000, np.empty(0))
    assert np.array_equal(got, want)
    assert 0.45 < got.mean() < 0.55
