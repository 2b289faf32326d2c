"""Observations of the examples against the controllers' own way to find things, on events made here."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from evis.env.observation import Moment, Setting

EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "tasks"
SIZE = WIDTH, HEIGHT = 32, 24


@pytest.fixture
def examples(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(EXAMPLES))
    import changed_pixels
    import observed

    yield SimpleNamespace(observed=observed, midway=changed_pixels.midway)
    for name in ("observed", "changed_pixels"):
        sys.modules.pop(name, None)


def block(column: int, row: int, sign: int, count: int) -> np.ndarray:
    """Events x, y, p of a square of 3 pixels that all changed `count` times."""
    x, y = np.meshgrid(np.arange(column - 1, column + 2), np.arange(row - 1, row + 2))
    return np.repeat(np.stack((x.ravel(), y.ravel(), np.full(9, sign))), count, axis=1)


def moment(*envs: np.ndarray) -> Moment:
    x, y, p = np.concatenate(envs, axis=1)
    offsets = np.cumsum([0, *(e.shape[1] for e in envs)])
    events = SimpleNamespace(x=x.astype(np.uint16), y=y.astype(np.uint16), p=p.astype(np.uint8), env_offsets=offsets)
    none = np.zeros(len(envs), np.int64)
    return Moment(SimpleNamespace(events=events), none, none, none[:, None], np.ones(len(envs), bool))


def test_a_mover_is_where_the_controllers_find_it(examples) -> None:
    """In two environments, beside a background of few events; what is quiet keeps its place until it is forgotten."""
    mover = examples.observed.Mover(least=3)
    assert mover.begin(Setting(2, HEIGHT, WIDTH, 50.0, (), (0, 0), None)).shape == (6,)
    background = block(25, 20, 1, 2)
    scenes = [
        np.concatenate((block(20, 8, 1, 4), block(16, 7, 0, 4), background), axis=1),
        np.concatenate((block(4, 15, 1, 3), block(9, 12, 0, 3), background), axis=1),
    ]
    values = mover.values(moment(*scenes))
    for found, (x, y, p) in zip(values, scenes):
        middle = (found[:2] + found[2:4]) / 2
        pixels = (middle + 1) / 2 * (np.array(SIZE) - 1)
        np.testing.assert_allclose(pixels, examples.midway(x, y, p, SIZE, 3), rtol=1e-5)
        assert (found[4:] == 1).all()
    after = mover.values(moment(background, block(5, 15, 1, 3)))
    np.testing.assert_array_equal(after[0], [*values[0, :4], 0, 0])
    assert after[1, 0] > values[1, 0] and (after[1, 2:4] == values[1, 2:4]).all() and list(after[1, 4:]) == [1, 0]
    mover.forget(np.array([0]))
    assert not mover.values(moment(background, background))[0].any()


def test_a_mover_looks_no_lower_than_it_is_told(examples) -> None:
    mover = examples.observed.Mover(least=3, bottom=0.5)
    mover.begin(Setting(1, HEIGHT, WIDTH, 50.0, (), (0, 0), None))
    assert not mover.values(moment(block(10, 18, 1, 5))).any()
    assert mover.values(moment(block(10, 6, 1, 5)))[0, 4] == 1


def test_centroids_of_bands_fade(examples) -> None:
    """A band's column is the mean of its events' columns, older ones less by exp(-1); its count is of this step."""
    centroids = examples.observed.Centroids(bands=2, fade=1.0)
    centroids.begin(Setting(1, HEIGHT, WIDTH, 50.0, (), (0, 0), None))
    centroids.values(moment(block(10, 5, 1, 1)))
    upper, lower = centroids.values(moment(block(20, 5, 1, 2)))[0]
    column = (9 * np.exp(-1) * 10 + 18 * 20) / (9 * np.exp(-1) + 18)
    np.testing.assert_allclose(upper, [0, 2 * column / (WIDTH - 1) - 1, np.log(19)], rtol=1e-5)
    assert not lower.any()


def test_training_without_its_packages_says_what_to_install() -> None:
    """As `python examples/tasks/train.py` does, in one line."""
    code = "import runpy, sys; sys.modules['torch'] = None; sys.path[:0] = sys.argv[1:2]; runpy.run_path(sys.argv[2])"
    words = [sys.executable, "-c", code, str(EXAMPLES), str(EXAMPLES / "train.py")]
    ended = subprocess.run(words, capture_output=True, text=True, check=False)
    assert ended.returncode == 1 and "pip install 'evis[rl,bench]'" in ended.stderr
    assert len(ended.stderr.splitlines()) == 1
