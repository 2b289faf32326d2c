"""What a recipe draws: strata are even, grids whole, and a sequence depends on the recipe and its number alone."""

from __future__ import annotations

from collections import Counter
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from small_recipe import write

import evis
from evis.dataset.draws import Axis, draw
from evis.dataset.errors import DatasetError
from evis.dataset.recipe import Recipe
from evis.dataset.recipe_file import read_recipe

OTHERS = (
    "balls", "cart_pole", "drone", "falling_objects", "fidget_spinner", "flying_shapes", "pan_tilt", "pong",
    "robot_arm", "stereo_room", "tunnel_exit", "warehouse",
)  # fmt: skip
"""Scenes beside the recipe's own."""


@pytest.mark.parametrize("count", [1, 7, 40])
def test_a_latin_hypercube_has_one_value_in_each_stratum(count: int) -> None:
    """Of every component, in every block; and the order of one axis says nothing of another's."""
    axes = [Axis("a", low=(0.0,), high=(1.0,)), Axis("b", low=(-1.0, 2.0), high=(1.0, 3.0), vector=True)]
    for block in range(2):
        sets = [draw(axes, "latin", 5, "s", block * count + n, count) for n in range(count)]
        columns = np.array([[s["a"], (s["b"][0] + 1) / 2, s["b"][1] - 2] for s in sets])
        assert (np.sort((columns * count).astype(int), axis=0) == np.arange(count)[:, None]).all()
        if count == 40:
            assert np.abs(np.corrcoef(columns.T) - np.eye(3)).max() < 0.5


def test_random_values_are_uniform() -> None:
    """By the Kolmogorov-Smirnov distance, whose 0.1 % point at n = 2000 is 1.95 / sqrt(n)."""
    axis = Axis("a", low=(1.0,), high=(100.0,), log=True)
    values = np.sort([draw([axis], "random", 1, "s", n, 1)["a"] for n in range(2000)])
    expected = np.log(values) / np.log(100)
    assert np.abs(expected - (np.arange(2000) + 0.5) / 2000).max() < 1.95 / np.sqrt(2000)


def test_whole_numbers_reach_both_ends_evenly() -> None:
    axis = Axis("a", low=(2.0,), high=(5.0,), whole=True)
    found = Counter(draw([axis], "latin", 0, "s", n, 400)["a"] for n in range(400))
    assert found == {2: 100, 3: 100, 4: 100, 5: 100}


def test_whole_numbers_of_a_log_scale_are_rarer_the_larger_they_are() -> None:
    """Each k as often as a log-uniform number of [1, 11) lies in [k, k + 1): to one stratum at each end."""
    axis = Axis("a", low=(1.0,), high=(10.0,), whole=True, log=True)
    found = Counter(draw([axis], "latin", 0, "s", n, 4000)["a"] for n in range(4000))
    for k in range(1, 11):
        assert abs(found[k] - 4000 * np.log((k + 1) / k) / np.log(11)) <= 2


def test_a_grid_has_every_combination_once(tmp_path: Path) -> None:
    """The number of sequences follows from it, and further ones begin again with other seeds."""
    changes = ("latin", "grid"), ("sequences: 5\n", ""), ("to: 70}", "to: 70, steps: 3}")
    recipe = read_recipe(write(tmp_path, *changes))
    assert recipe.count == 6
    plans = recipe.sequences(12)
    found = [(plan.arguments["omega"], plan.arguments["texture"]) for plan in plans]
    assert sorted(found[:6]) == sorted(product([15.0, 42.5, 70.0], [0, 1])) and found[6:] == found[:6]
    assert len({plan.seed for plan in plans}) == 12


def grid(tmp_path: Path, omegas: int, splits: str, more: str = "") -> Recipe:
    """A grid of so many omegas with two textures."""
    changes = ("latin", "grid"), ("to: 70}", f"to: 70, steps: {omegas}}}"), ("{train: 0.6, test: 0.4}", splits)
    return read_recipe(write(tmp_path, *changes, ("sequences: 5\n", f"sequences: 5\n{more}")))


def test_a_combination_of_a_grid_is_in_one_split(tmp_path: Path) -> None:
    """However often the grid begins again and with several seeds; a whole grid has the shares to one combination."""
    recipe = grid(tmp_path, 25, "{train: 0.8, val: 0.1, test: 0.1}", "seeds: 2\n")
    places: dict[tuple, set[str]] = {}
    for plan in recipe.sequences(5 * 2 * 50):
        places.setdefault((plan.arguments["omega"], plan.arguments["texture"]), set()).add(plan.split)
    assert len(places) == 50 and all(len(splits) == 1 for splits in places.values())
    found = Counter(split for splits in places.values() for split in splits)
    assert abs(found["train"] - 40) <= 1 and abs(found["val"] - 5) <= 1 and abs(found["test"] - 5) <= 1


def test_no_value_of_a_grid_is_in_one_split_alone(tmp_path: Path) -> None:
    """Of 13 values that change fastest beside 8 others: 13 steps of the golden ratio end nearly where they began."""
    tilt = ("texture: {choices: [0, 1]}", "tilt: {from: 25, to: 45, steps: 13}")
    plans = read_recipe(write(tmp_path, ("latin", "grid"), ("to: 70}", "to: 70, steps: 8}"), tilt)).sequences(104)
    trained = Counter(plan.arguments["tilt"] for plan in plans if plan.split == "train")
    assert len(trained) == 13 and abs(sum(trained.values()) - 62) <= 1 and min(trained.values()) < 8


def test_a_scene_of_one_combination_has_the_shares_by_its_seeds(tmp_path: Path) -> None:
    """For nothing else is drawn of it."""
    path = write(tmp_path, ("latin", "grid"), ("omega: {from: 15, to: 70}", "omega: 20"), ("{choices: [0, 1]}", "0"))
    assert abs(Counter(plan.split for plan in read_recipe(path).sequences(100))["train"] - 60) <= 1


def test_a_split_without_a_combination_is_not_looked_for_without_end(tmp_path: Path) -> None:
    recipe = grid(tmp_path, 2, "{train: 0.98, val: 0.01, test: 0.01}")
    there = {plan.split for plan in recipe.sequences(40)}
    assert len(there) < 3 and {split for split in recipe.splits if recipe.makes(split)} == there
    missing = next(split for split in recipe.splits if split not in there)
    with pytest.raises(DatasetError, match=f"the split '{missing}' of small has a share of 0.01: no sequence is ever"):
        evis.dataset.stream(recipe, split=missing, seconds=0.05, arrays="numpy")


def test_a_sequence_does_not_depend_on_how_many_there_are(tmp_path: Path) -> None:
    path = write(tmp_path)
    one = read_recipe(path)
    assert one.sequences(50)[:3] == one.sequences(3) == [read_recipe(path).sequence(n) for n in range(3)]


def test_seeds_splits_and_weights(tmp_path: Path) -> None:
    """Several seeds of a draw are in one split; splits and scenes have their shares in every stretch."""
    longer = ("duration: 0.1", "duration: {from: 0.1, to: 0.2}\nseeds: 2")
    plans = read_recipe(write(tmp_path, longer, ("scenes:", "scenes:\n  fidget_spinner: {weight: 3}"))).sequences(400)
    for first, second in zip(plans[::2], plans[1::2]):
        assert first.arguments == second.arguments and first.duration_s == second.duration_s
        assert first.split == second.split and first.seed != second.seed
    assert Counter(plan.scene for plan in plans[:40]) == {"spinning_disk": 10, "fidget_spinner": 30}
    for start in (0, 200):
        assert abs(Counter(plan.split for plan in plans[start : start + 200])["train"] - 120) <= 4
    assert len({plan.path for plan in plans}) == 400


def test_a_latin_hypercube_has_the_durations_of_all_draws(tmp_path: Path) -> None:
    """Of ten draws with four seeds each, one in each tenth of the range."""
    changes = ("sequences: 5", "sequences: 40\nseeds: 4"), ("duration: 0.1", "duration: {from: 1, to: 2}")
    durations = {plan.duration_s for plan in read_recipe(write(tmp_path, *changes)).sequences()}
    assert sorted(int(10 * (duration - 1)) for duration in durations) == list(range(10))


@pytest.mark.parametrize("scenes", [2, 5, 8, 13])
def test_every_scene_has_the_shares_of_the_splits(tmp_path: Path, scenes: int) -> None:
    """Of 20 draws each, whatever the number of scenes: 0.8, 0.1 and 0.1, to one draw."""
    others = "".join(f"\n  {name}: {{}}" for name in OTHERS[: scenes - 1])
    splits = ("{train: 0.6, test: 0.4}", "{train: 0.8, val: 0.1, test: 0.1}")
    plans = read_recipe(write(tmp_path, splits, ("scenes:", f"scenes:{others}"))).sequences(20 * scenes)
    found = Counter((plan.scene_name, plan.split) for plan in plans)
    for name in {plan.scene_name for plan in plans}:
        for split, share in (("train", 16), ("val", 2), ("test", 2)):
            assert abs(found[name, split] - share) <= 1


@pytest.mark.parametrize(
    ("before", "after", "error"),
    [
        ("omega:", "omegga:", "small.yaml:10: neither scene spinning_disk nor simulator.yaml has 'omegga'"),
        ("from: 15, to: 70", "from: 70, to: 15", "small.yaml:10: the range of 'omega' is empty"),
        ("from: 15, to: 70", "from: 15, to: 99", "small.yaml:10: omega is 99.0 rad/s, the most is 70"),
        ("from: 15, to: 70", "from: 15", "small.yaml:10: 'omega' needs `from:` and `to:`"),
        ("choices: [0, 1]", "choices: []", "small.yaml:11: choices of 'texture' must be a list"),
        ("choices: [0, 1]", "choices: [0, 9]", "small.yaml:11: texture is 9, the most is 4"),
        ("spinning_disk", "spining_disk", "small.yaml:8: no launch file or scene 'spining_disk'"),
        ("sampling: latin", "sampling: latim", "did you mean 'latin'?"),
        ("layout: npz", "layuot: npz", "small.yaml:1: a recipe has no 'layuot'; did you mean 'layout'?"),
        ("train: 0.6, test: 0.4", "val: 0.6, Val: 0.4", "small.yaml:5: the splits val and Val are one folder"),
        ("test: 0.4", "test: 0.5", "small.yaml:5: the splits are 1.1 in all; they must be 1"),
        ("shot_rate: 3.0", "seed: 3", "small.yaml:6: 'seed' is no argument of a recipe's scene"),
        ("sampling: latin", "sampling: grid", "small.yaml:10: a grid needs `steps:` of the range of 'omega'"),
        ("sequences: 5\n", "", "does not say how many `sequences:` there are"),
        ("0.1", "{from: 0.1, to: 0.2, steps: 3}", "small.yaml:3: a duration is drawn from its range, in a grid too"),
        ("sampling: latin", "outputs: []", "small.yaml:4: sequences without outputs and labels would be empty"),
        (
            "latin\nsplits: {train: 0.6, test: 0.4}\narguments: {",
            "grid\narguments: {texture: {from: 0, to: 2, steps: 5}, ",
            "small.yaml:5: the grid has the value 0 of 'texture' more than once; give each once",
        ),
    ],
)
def test_a_wrong_recipe_is_refused_with_its_line(before: str, after: str, error: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError) as caught:
        read_recipe(write(tmp_path, (before, after)))
    assert error in str(caught.value) and "\n" not in str(caught.value)
