"""A small data set of labelled sequences, made once, and the definition that its windows are held against."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from evis.dataset.making.make import make, store_path
from evis.dataset.making.tasks import Answer, Answerer
from evis.dataset.recipe import Plan
from evis.dataset.recipe_file import read_recipe

RECIPE = """\
layout: npz
sequences: 3
duration: 0.2
splits: {train: 0.6, test: 0.4}
labels: [forward_flow, backward_flow, boxes, depth, events]
arguments: {width: 40, height: 32, shot_rate: 5.0}
scenes:
  spinning_disk:
    arguments:
      omega: {from: 15, to: 70}
"""
HEIGHT, WIDTH = 32, 40
PERIOD_NS = 1e9 / 30


class Here:
    """Makes sequences in this process."""

    count = 1

    def __init__(self, out: str) -> None:
        self._answerer, self._answers = Answerer(out), list[Answer]()

    def assign(self, worker: int, plans: Sequence[Plan]) -> None:
        told = self._answerer.answers([plan.as_dict() for plan in plans])
        self._answers += [Answer(worker, **fields) for fields in told]

    def wait(self, timeout_s: float) -> list[Answer]:
        found, self._answers = self._answers, []
        return found

    def close(self) -> None:
        pass


def made(folder: Path, *changes: tuple[str, str]) -> tuple[Path, Path]:
    """Makes the data set; returns recipe and folder. changes: texts of the recipe, and what stands there instead."""
    text = RECIPE
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    recipe, out = folder / "small.yaml", folder / "d"
    recipe.write_text(text)
    done = make(read_recipe(recipe), store_path(str(out)), Here)
    assert not done.failed and not done.stopped
    return recipe, out


def same(a: Any, b: Any) -> None:
    """Asserts that two samples or batches are equal to the byte."""
    if isinstance(a, dict):
        assert list(a) == list(b)
        for name in a:
            same(a[name], b[name])
        return
    x, y = np.asarray(a), np.asarray(b)
    assert (x.dtype, x.shape, x.tobytes()) == (y.dtype, y.shape, y.tobytes())
