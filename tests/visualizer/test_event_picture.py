"""Frames beside events: what is drawn where and when, against values worked out by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from evis.media.pictures.event_pictures import ON_BLACK, faded_events
from evis.media.pictures.footage import Footage, make_animation, make_still

MS = 1_000_000
GROUND, ON, OFF = (np.array(colour, np.float32) for colour in ON_BLACK)


def footage(frames: int = 4) -> Footage:
    """Grey frames of 100 ms, brighter each; one ON event per ms that runs along a row, an OFF one in the corner."""
    pictures = np.stack([np.full((30, 40, 3), 40 * k, np.uint8) for k in range(frames)]) if frames else np.empty((0, 1))
    t = np.arange(300, dtype=np.int64) * MS
    x = (np.arange(300) % 40).astype(np.uint16)
    y = np.full(300, 15, np.uint16)
    p = np.ones(300, np.uint8)
    x[0], y[0], p[0] = 0, 0, 0
    return Footage(pictures, np.arange(frames, dtype=np.int64) * 100 * MS, t, x, y, p, 40, 30)


def test_events_fade_and_the_newest_wins() -> None:
    t = np.array([0, 10, 20, 30], np.int64) * MS
    x, y = np.array([1, 2, 2, 9]), np.array([3, 4, 4, 4])
    p = np.array([1, 1, 0, 1])
    picture = faded_events(t, x, y, p, 5, 6, 20 * MS, 10 * MS)
    assert picture.shape == (6, 5, 3)
    assert np.allclose(picture[4, 2], OFF)
    assert np.allclose(picture[3, 1], GROUND + np.exp(-2) * (ON - GROUND), atol=0.51)
    assert (picture == GROUND.astype(np.uint8)).all(axis=-1).sum() == 28


def test_no_events_is_an_empty_picture() -> None:
    nothing = np.empty(0, np.int64)
    assert (faded_events(nothing, nothing, nothing, nothing, 4, 4, 0, 1) == GROUND.astype(np.uint8)).all()


def test_animation_has_the_right_pace(tmp_path: Path) -> None:
    """300 ms at ten times slower and 20 pictures per second: one per 5 ms, shown 50 ms each."""
    out = tmp_path / "a.gif"
    assert make_animation(footage(), out, fps=20, slow_motion=10) == 61
    with Image.open(out) as gif:
        assert gif.n_frames == 61 and gif.info["duration"] == 50 and gif.info["loop"] == 0
        seen = []
        for k in range(61):
            gif.seek(k)
            seen.append(np.asarray(gif.convert("RGB")).astype(int))
    # The left picture changes with the frames, at 100, 200 and 300 ms.
    left = [s[20, 20].mean() for s in seen]
    assert np.abs(np.array(left) - np.repeat([0, 40, 80, 120], [20, 20, 20, 1])).max() < 12
    # The right one shows the event of each picture's own time: k * 5 ms is event 5 k, in column 5 k mod 40.
    for k in (10, 33, 59):
        pixel = seen[k][6 + 15, 6 + 40 + 6 + (5 * k) % 40]
        assert np.abs(pixel - ON).max() < 30


def test_part_and_limits(tmp_path: Path) -> None:
    out = tmp_path / "a.gif"
    assert make_animation(footage(), out, fps=10, slow_motion=1, from_ns=100 * MS, to_ns=250 * MS) == 2
    with pytest.raises(ValueError, match="would have 3001 pictures"):
        make_animation(footage(), out, fps=100, slow_motion=100)
    with pytest.raises(ValueError, match="no frames"):
        make_animation(footage(0), out)


def test_still(tmp_path: Path) -> None:
    make_still(footage(), tmp_path / "s.png", scale=3)
    with Image.open(tmp_path / "s.png") as image:
        assert image.size == (3 * (6 + 40 + 6 + 40 + 6), 3 * (6 + 30 + 20))
        assert np.abs(np.asarray(image)[60, 60].astype(int) - 40).max() < 3


def test_captions_say_the_rates() -> None:
    assert footage().captions == ("frames, 10 per second", "events, 0.00 million per second")
