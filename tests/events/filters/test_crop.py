"""A rectangle of pixels, against coordinates taken one by one."""

from __future__ import annotations

import numpy as np
import pytest

from evis.events import Events, Frame, Triggers
from evis.events.filters import cropped
from evis.events.filters.crop import check_rectangle


def test_a_rectangle_has_the_events_of_its_pixels():
    rng = np.random.default_rng(1)
    t = np.sort(rng.integers(0, 10**9, 2000))
    x, y, p, c = (rng.integers(0, most, 2000) for most in (30, 20, 2, 3))
    part = cropped(Events.of(t, x, y, p, c), (7, 4, 11, 9))
    wanted = [(t[i], x[i] - 7, y[i] - 4, p[i], c[i]) for i in range(2000) if 7 <= x[i] <= 17 and 4 <= y[i] <= 12]
    assert part.c is not None and part.x.dtype == part.y.dtype == np.uint16
    assert list(zip(*(values.tolist() for values in (part.t, part.x, part.y, part.p, part.c)))) == wanted


def test_frames_are_cut_and_triggers_stay():
    """A frame of a region of interest: each of its pixels says where on the sensor it is."""
    rows, columns = np.mgrid[5:15, 10:30]
    pixels = (rows * 100 + columns).astype(np.uint16)
    frames = [Frame(7, pixels, 3, 5, 10, 5, 9), Frame(8, pixels[:2, :2], 3, 5, 10, 5, 9)]
    edges = Triggers(np.array([6]), np.array([1], np.uint8), np.array([1], np.uint8))
    whole = Events.empty().beside(Events.empty())
    whole.frames, whole.triggers = frames, edges
    part = cropped(whole, (15, 8, 40, 3))
    assert len(part.triggers) == 1
    (frame,) = part.frames
    assert (frame.x0, frame.y0, frame.t_ns, frame.end_ns, frame.exposure_ns) == (0, 0, 7, 9, 2)
    assert (frame.pixels == [[row * 100 + column for column in range(15, 30)] for row in (8, 9, 10)]).all()
    (frame,) = cropped(whole, (8, 7, 4, 4)).frames
    assert (frame.x0, frame.y0) == (2, 0) and frame.pixels.tolist() == [
        [710, 711],
        [810, 811],
        [910, 911],
        [1010, 1011],
    ]


@pytest.mark.parametrize("rectangle", [(0, 0, 31, 20), (30, 0, 1, 1), (0, 0, 0, 5), (-1, 0, 5, 5), (0, 19, 1, 2)])
def test_a_rectangle_outside_of_the_sensor_is_named(rectangle):
    with pytest.raises(ValueError, match=r"crop .* is not inside the sensor of 30x20"):
        check_rectangle(rectangle, 30, 20)
