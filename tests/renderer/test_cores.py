"""How many threads share an image."""

import os

import pytest

from nodes.renderer.cores import threads_for


@pytest.mark.parametrize(
    "asked, pixels, cores, count",
    [
        (3, 100, 1, 3),
        (0, 96 * 72, 64, 1),
        (0, 346 * 260, 64, 2),
        (0, 346 * 260, 1, 1),
        (0, 640 * 480, 4, 4),
        (0, 1024 * 128 * 128, 64, 8),
        (0, 0, 64, 1),
    ],
)
def test_threads_are_as_many_as_cores_and_pixels_are_worth(monkeypatch, asked, pixels, cores, count):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(cores)))
    assert threads_for(asked, pixels) == count
