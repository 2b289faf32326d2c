"""DAVIS346 words written by hand: times, frames and their faults, inertial samples, triggers."""

from __future__ import annotations

import numpy as np
import pytest

from evis.events.codecs.inivation.davis import Decoder

BOTH = pytest.mark.parametrize("backend", ["numpy", "warp"])
RESET_COLUMN, SIGNAL_COLUMN, COLUMN_END = 11, 12, 13


def decode(words, backend="numpy", width=346, height=260, orientation=0):
    decoder = Decoder(width, height, backend)
    decoder.aps_orientation = orientation
    return decoder.decode(np.array(words, "<u2").tobytes()), decoder


def column(kind: int, samples) -> list[int]:
    return [kind, *(0x4000 | int(v) for v in samples), COLUMN_END]


def frame(reset: np.ndarray, signal: np.ndarray, start: int = 9, region=()) -> list[int]:
    """Words of a frame whose arrays are [columns, samples of a column], in the order of the readout."""
    words = [start]
    for value in region:
        words += [0x5100 | value >> 8, 0x5200 | value & 0xFF]
    words += [0x8000 | 20, 14, 0x8000 | 30, 15]
    for i in range(len(reset)):
        words += column(RESET_COLUMN, reset[i]) + column(SIGNAL_COLUMN, signal[i])
    return [*words, 0x8000 | 40, 10]


@BOTH
def test_events_take_the_time_and_row_in_force(backend):
    """Times, rows, both polarities, a wrap that counts three turns, a wrap that sets the time itself."""
    words = [0x2001, 0x8005, 0x1007, 0x2009, 0x300A, 0x7003, 0x200B, 0x8001, 0x1008, 0x300C]
    events, decoder = decode(words, backend)
    assert (events.t // 1000).tolist() == [5, 5, 3 * 32768, 3 * 32768 + 1]
    assert (events.x.tolist(), events.y.tolist(), events.p.tolist()) == ([9, 10, 11, 12], [7, 7, 7, 8], [0, 1, 0, 1])
    assert decoder.counts == {"untimed": 1}


@BOTH
def test_a_time_that_steps_back_is_kept(backend):
    """No clamp, no turn: only wrap words move the base."""
    events, _ = decode([0x8064, 0x2001, 0x8060, 0x2001], backend)
    assert (events.t // 1000).tolist() == [100, 96]


@BOTH
def test_timestamp_reset_starts_at_zero_and_breaks_what_is_half_read(backend):
    """The base goes to 0; a frame and an inertial sample that were open are lost, and counted."""
    words = [0x7002, 0x8001, 0x2001, 9, 5, 0x5300, 0x0001, 0x2002, 0x8007, 0x2003, 10, 7]
    events, decoder = decode(words, backend)
    assert (events.t // 1000).tolist() == [65537, 0, 7]
    # the open ones, and the ends that then belong to nothing
    assert decoder.counts == {"timestamp_resets": 1, "imu_damaged": 2, "frames_damaged": 2}


@BOTH
def test_triggers(backend):
    """Edges of the input (0), of the generator (1), and pulses (2)."""
    events, _ = decode([0x8005, 2, 3, 4, 0x8006, 16, 17], backend)
    edges = events.triggers
    got = list(zip((edges.t // 1000).tolist(), edges.id.tolist(), edges.value.tolist()))
    assert got == [(5, 0, 0), (5, 0, 1), (5, 2, 1), (6, 1, 0), (6, 1, 1)]


@BOTH
def test_frame_is_reset_minus_signal(backend):
    """Clamped at 0, shifted up by 6; white where the light was too strong; events in between do not disturb it."""
    reset = np.array([[800, 700, 600], [1000, 500, 300]])
    signal = np.array([[300, 900, 599], [0, 499, 100]])
    words = [0x8001, *frame(reset, signal)]
    words[12:12] = [0x1001, 0x2002, 0x8003]
    events, decoder = decode(words, backend, width=2 + 1, height=3)
    assert decoder.counts == {"frames_damaged": 1} and not events.frames  # three columns are expected
    events, decoder = decode(words, backend, width=2, height=3)
    assert (len(events), decoder.counts) == (0, {"outside": 1})
    (got,) = events.frames
    expected = np.array([[500, 1023], [0, 1], [1, 1023]]) << 6
    np.testing.assert_array_equal(got.pixels, expected.astype(np.uint16))
    assert got.pixels.dtype == np.uint16
    assert (got.t_ns, got.exposure_start_ns, got.exposure_end_ns, got.end_ns) == (1000, 20_000, 30_000, 40_000)


@pytest.mark.parametrize("orientation", range(8))
def test_orientation_register(orientation):
    """Flip y, flip x, columns as rows: as libcaer places each sample."""
    w, h = 4, 3
    across, along = (h, w) if orientation & 4 else (w, h)
    value = np.arange(12).reshape(across, along) + 1
    expected = np.zeros((h, w), np.uint16)
    for c in range(across):
        for r in range(along):
            x = across - 1 - c if orientation & 2 else c
            y = along - 1 - r if orientation & 1 else r
            if orientation & 4:
                x, y = y, x
            expected[y, x] = value[c, r] << 6
    events, decoder = decode([0x8001, *frame(np.full((across, along), 1000), 1000 - value)], "numpy", w, h, orientation)
    assert decoder.counts == {}
    np.testing.assert_array_equal(events.frames[0].pixels, expected)


@BOTH
def test_region_of_interest(backend):
    """First column, first row, last column, last row, in two pieces each; an impossible one damages the frame."""
    reset, signal = np.full((2, 3), 900), np.full((2, 3), 400)
    events, decoder = decode([0x8001, *frame(reset, signal, 8, (300, 10, 301, 12))], backend)
    assert (events.frames[0].x0, events.frames[0].y0, events.frames[0].pixels.shape) == (300, 10, (3, 2))
    assert (events.frames[0].pixels == 500 << 6).all() and decoder.counts == {}
    for region in ((300, 10, 299, 12), (345, 10, 346, 12), (300, 10)):
        events, decoder = decode([0x8001, *frame(reset, signal, 8, region)], backend)
        assert not events.frames and decoder.counts == {"frames_damaged": 1}


@BOTH
def test_damaged_frames_are_counted_and_the_next_one_is_whole(backend):
    """A sample lost, a column lost, no end, no start: none of these frames is given, none stops the next."""
    good = frame(np.full((4, 3), 900), np.full((4, 3), 100))
    sample, no_column = good.copy(), good.copy()
    del sample[8]
    del no_column[6:11]
    words = [0x8001, *sample, *no_column, *good[:30], *good[20:], *good[:10], *good]
    events, decoder = decode(words, backend, 4, 3)
    # the third and fourth pieces make one frame with too many samples
    assert [f.pixels.tolist() for f in events.frames] == [[[800 << 6] * 4] * 3]
    assert decoder.counts == {"frames_damaged": 4}
    endless = [0x8001, 9, *[0x4001] * 5000]
    assert decode(endless, backend, 4, 3)[1].counts == {"frames_damaged": 1}


@BOTH
def test_inertial_samples(backend):
    """All kinds; temperature left out; gyroscope alone; bytes missing; a scale word missing."""
    data = np.array([16384, -8192, 0, 340, 131, -262, 0], ">i2").view(np.uint8)

    def sample(scales, values):
        return [5, 0x5300 | scales, *(0x5000 | int(v) for v in values), 7]

    words = [0x8009, *sample(0xE0 | 1 << 2 | 1, data), *sample(0xC0, np.delete(data, [6, 7]))]
    words += [*sample(0x40, data[8:]), *sample(0xE0, data[:-1]), 5, *(0x5000 | int(v) for v in data), 7]
    events, decoder = decode(words, backend)
    imu, g = events.imu, 9.80665
    assert decoder.counts == {"imu_damaged": 2} and imu.t.tolist() == [9000] * 3
    # +-4 g and +-500 deg/s, then +-2 g and +-250 deg/s
    np.testing.assert_allclose(imu.acceleration, [[2 * g, -g, 0], [g, -g / 2, 0], [np.nan] * 3], atol=1e-12)
    unit = np.radians(250 / 32768)
    np.testing.assert_allclose(imu.angular_velocity, np.array([[262, -524, 0], [131, -262, 0], [131, -262, 0]]) * unit)
    np.testing.assert_allclose(imu.temperature, [36, np.nan, np.nan])


def test_vectors_that_are_not_whole_are_left_out():
    """One NaN in a vector: the vector is not sent; the others are."""
    from evis.events import Events, Imu
    from evis.events.codecs.inivation.davis import Encoder

    events = Events.empty()
    events.imu = Imu(
        np.array([5000]), np.array([[1.0, np.nan, 2.0]]), np.array([[0.5, 0.25, -0.5]]), np.array([np.nan])
    )
    imu = Decoder().decode(Encoder().encode(events)).imu
    assert np.isnan(imu.acceleration).all() and np.isnan(imu.temperature).all()
    np.testing.assert_allclose(imu.angular_velocity, [[0.5, 0.25, -0.5]], atol=np.radians(250) / 32768)


def test_what_a_davis_cannot_send_is_refused():
    """Frames off the sensor, with times that run back, that overlap; samples beyond the largest scale."""
    from evis.events import Events, Frame, Imu
    from evis.events.codecs.inivation.davis import Encoder

    def refused(match, **fields):
        events = Events.empty()
        for name, value in fields.items():
            setattr(events, name, value)
        with pytest.raises(ValueError, match=match):
            Encoder().encode(events)

    pixels = np.zeros((20, 30), np.uint16)
    refused("not inside", frames=[Frame(0, pixels, 0, 1, 340, 0, 1)])
    refused("run back", frames=[Frame(10, pixels, 0, 1)])
    refused("follow one another", frames=[Frame(0, pixels, 0, 5000, 0, 0, 9000), Frame(8000, pixels, 8000, 9000)])
    zero = np.zeros((1, 3))
    refused("16 g", imu=Imu(np.array([0]), zero + 500, zero, np.array([20.0])))
    refused("deg/s", imu=Imu(np.array([0]), zero, zero + 50, np.array([20.0])))
