"""Frames of a recording on the wire of an emulated DAVIS346: those that it could have sent, the others counted."""

from __future__ import annotations

import numpy as np
import pytest

from evis.events import Events
from evis.events.arrays import Frame
from evis.events.codecs.decoder import decoder_for
from nodes.camera.emulated.reencode import Reencoder
from nodes.camera.usb.models import MODELS

GREY = np.arange(12, dtype=np.uint16).reshape(3, 4) << 6


def frame(t_us: int, pixels: np.ndarray = GREY, x0: int = 2, exposure_us: int = 300, length_us: int = 900) -> Frame:
    t = [1000 * (t_us + dt) for dt in (0, 100, 100 + exposure_us, length_us)]
    return Frame(t[0], pixels, t[1], t[2], x0, 5, t[3])


@pytest.mark.parametrize(
    "other",
    [
        frame(1500),
        frame(3000, np.repeat(GREY[..., None], 3, 2)),
        frame(3000, GREY.astype(np.float32)),
        frame(3000, x0=344),
        frame(3000, exposure_us=-50),
    ],
    ids=["during another", "colour", "no pixel values", "outside", "exposure that ends first"],
)
def test_frames_that_a_davis_cannot_send(other):
    """Left out alone and counted: what comes before and after arrives."""
    model = MODELS["davis346"]
    encoder = Reencoder(model)
    events = Events.of(np.arange(50) * 100_000, np.arange(50), np.arange(50), np.ones(50, np.int64))
    events.frames = [frame(1000), other, frame(5000)]
    got = decoder_for(model.encoding, model.width, model.height, "numpy").decode(encoder.encode(events))
    assert encoder.counts == {"frames_left_out": 1}
    assert [f.t_ns // 1000 for f in got.frames] == [1000, 5000]
    assert len(got) == 50
    for found in got.frames:
        np.testing.assert_array_equal(found.pixels, GREY)
        assert (found.x0, found.y0) == (2, 5)
