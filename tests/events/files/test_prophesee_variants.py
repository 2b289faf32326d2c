"""The headers that RAW and DAT files have had over the years, and none; words and records are made here by hand."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from file_cases import save

from evis.events import Events, RecordingError, open_recording
from evis.events.codecs.decoder import decoder_for

N = 2000


def events(start_us: int = 100) -> Events:
    """On 304 x 240, in whole us, going up."""
    rng = np.random.default_rng(3)
    t = (np.cumsum(rng.integers(0, 40, N)) + start_us) * 1000
    return Events.of(t, rng.integers(0, 304, N), rng.integers(0, 240, N), rng.integers(0, 2, N))


def rows(e: Events):
    return zip((e.t // 1000).tolist(), e.x.tolist(), e.y.tolist(), e.p.tolist())


def evt2(e: Events) -> bytes:
    """TIME_HIGH where it changes, then a word an event."""
    out, high = [], -1
    for t, x, y, p in rows(e):
        if t >> 6 != high:
            high = t >> 6
            out.append(8 << 28 | high)
        out.append(p << 28 | (t & 63) << 22 | x << 11 | y)
    return struct.pack(f"<{len(out)}I", *out)


def evt21(e: Events, legacy: bool = False) -> bytes:
    """The same as 64-bit words with one pixel each."""
    out, high = [], -1
    for t, x, y, p in rows(e):
        if t >> 6 != high:
            high = t >> 6
            out.append((8 << 28 | high, 0))
        out.append((p << 28 | (t & 63) << 22 | (x & ~31) << 11 | y, 1 << (x & 31)))
    flat = [half for upper, lower in out for half in ((upper, lower) if legacy else (lower, upper))]
    return struct.pack(f"<{len(flat)}I", *flat)


def evt3(e: Events) -> bytes:
    """Time and row where they change, then a word an event."""
    out, high, low, row = [], -1, -1, -1
    for t, x, y, p in rows(e):
        if t >> 12 != high:
            high, low = t >> 12, -1
            out.append(0x8000 | high & 0xFFF)
        if t & 0xFFF != low:
            low = t & 0xFFF
            out.append(0x6000 | low)
        if y != row:
            row = y
            out.append(row)
        out.append(0x2000 | p << 11 | x)
    return struct.pack(f"<{len(out)}H", *out)


def evt4(e: Events) -> bytes:
    """TIME_HIGH (0xE) where it changes, each third event as a vector (0xC, 0xD) of one pixel, the others alone."""
    out, high = [], -1
    for i, (t, x, y, p) in enumerate(rows(e)):
        if t >> 6 != high:
            high = t >> 6
            out += [0xFFFFFFFF, 0xE << 28 | high]
        if i % 3:
            out.append((0xA + p) << 28 | (t & 63) << 22 | x << 11 | y)
        else:
            out += [(0xC + p) << 28 | (t & 63) << 22 | (x & ~31) << 11 | y, 1 << (x & 31)]
    return struct.pack(f"<{len(out)}I", *out)


def legacy(e: Events) -> bytes:
    return evt21(e, legacy=True)


def read(path) -> tuple[Events, object]:
    with open_recording(path) as recording:
        return recording.read(), recording.info


def same_events(got: Events, expected: Events) -> None:
    for name in "txyp":
        np.testing.assert_array_equal(getattr(got, name), getattr(expected, name), err_msg=name)


HEADERS = [
    ("% evt 3.0\n% geometry 320x240\n% end\n", evt3, (320, 240), "header"),
    ("% evt 3.0\n% geometry 320x240\n", evt3, (320, 240), "header"),
    ("% format EVT3;height=240;width=320\n% end\n", evt3, (320, 240), "header"),
    ("% format EVT3;width=320;height=240\n% end\n", evt3, (320, 240), "header"),
    ("% evt 3.0\n% width 320\n% height 240\n% end\n", evt3, (320, 240), "header"),
    ("% Date 2020-01-01 10:00:00\r\n% evt 3.0\r\n% geometry 320x240\r\n% end\r\n", evt3, (320, 240), "header"),
    ("% evt 2.1\n% geometry 320x240\n% endianness legacy\n% end\n", legacy, (320, 240), "header"),
    ("% evt 2.1\n% geometry 320x240\n% end\n", legacy, (320, 240), "header"),
    ("% format EVT21;endianness=legacy;height=240;width=320\n% end\n", legacy, (320, 240), "header"),
    ("% evt 2.1\n% geometry 320x240\n% end\n", evt21, (320, 240), "header"),
    ("% evt 2.1\n% endianness little\n% geometry 320x240\n% end\n", evt21, (320, 240), "header"),
    ("% integrator_name Prophésée\n% evt 2.0\n% sensor_generation 3.1\n% end\n", evt2, (640, 480), "sensor"),
    ("% evt 2.0\n% plugin_name hal_plugin_gen31_fx3\n", evt2, (640, 480), "sensor"),
    ("% Date 2014-02-28 13:37:42\n% system_ID 28\n% evt 2.0\n", evt2, (640, 480), "system_ID"),
    ("% evt 3.0\n% sensor_name IMX636\n% end\n", evt3, (1280, 720), "sensor"),
    ("% evt\t3.0\n%\n% \n% geometry\t320x240\n% end\n", evt3, (320, 240), "header"),
    ("% evt 4.0\n% geometry 320x240\n% end\n", evt4, (320, 240), "header"),
    ("% format EVT4;height=240;width=320\n% end\n", evt4, (320, 240), "header"),
    ("% evt 3.0\n% generation 4.2\n% end\n", evt3, (1280, 720), "sensor"),
    ("% evt 3.0\n% sensor_name GenX320\n% end\n", evt3, (320, 320), "sensor"),
    ("% Date 2019-01-31 16:00:00\n% serial_number 7\n% end\n", evt2, (304, 240), "events"),
    ("", evt2, (304, 240), "events"),
    ("", evt3, (304, 240), "events"),
    ("", evt21, (304, 240), "events"),
    ("", legacy, (304, 240), "events"),
]


@pytest.mark.parametrize(("header", "encode", "size", "source"), HEADERS)
def test_raw_headers(header, encode, size, source, tmp_path):
    """Events, encoding and size, whichever lines there are."""
    got, info = read(save(tmp_path / "a.raw", header.encode() + encode(events())))
    same_events(got, events())
    encoding = "evt21_legacy" if encode is legacy else encode.__name__
    assert (info.encoding, info.width, info.height, info.geometry_from) == (encoding, *size, source)
    assert any("no header" in w for w in info.warnings) == (not header)


def test_a_turn_of_the_time_behind_an_old_header(tmp_path):
    """EVT3's 24 bits turn in the middle of the file."""
    late = events((1 << 24) - 20_000)
    got, _ = read(save(tmp_path / "a.raw", b"% evt 3.0\n% geometry 320x240\n" + evt3(late)))
    same_events(got, late)


def test_words_of_another_name_need_a_header(tmp_path):
    """Only a file named .raw is taken for words without a header; noise is none either."""
    with pytest.raises(RecordingError, match="not a recording"):
        open_recording(save(tmp_path / "a.xyz", evt3(events())))
    with pytest.raises(RecordingError, match="not a recording"):
        open_recording(save(tmp_path / "a.raw", np.random.default_rng(1).bytes(50_000)))


# -- DAT ---------------------------------------------------------------------------------------------------------------


def dat(e: Events, y_bit: int = 14, p_bit: int = 28) -> bytes:
    """8 bytes an event."""
    return b"".join(struct.pack("<II", t, x | y << y_bit | p << p_bit) for t, x, y, p in rows(e))


SIZE = b"% Height 240\n% Width 304\n"
DATS = [
    (b"% Data file containing CD events.\n% Version 2\n% Date 2017-03-13 10:00:00\n" + SIZE + b"\x0c\x08", 14, 28),
    (b"% Data file containing Event2D events.\n% Version 2\n" + SIZE + b"\x00\x08", 14, 28),
    (b"% Data file containing CD events\r\n% Version 2\r\n% Height 240\r\n% Width 304\r\n\x0c\x08", 14, 28),
    (b"% Data file containing TD data.\n% Version 1\n" + SIZE + b"\x00\x08", 9, 17),
    (b"% Data file containing TD data.\n" + SIZE + b"\x00\x08", 9, 17),
    (b"% Data file containing TD data.\n" + SIZE + b"\x00\x08", 14, 28),
    (b"% Date 2014-01-01 10:00:00\n" + SIZE + b"\x00\x08", 14, 28),
    (b"", 14, 28),
]


@pytest.mark.parametrize(("header", "y_bit", "p_bit"), DATS)
def test_dat_headers(header, y_bit, p_bit, tmp_path):
    """Both layouts, by version or by what fits the sensor, and no header at all."""
    got, info = read(save(tmp_path / "a.dat", header + dat(events(), y_bit, p_bit)))
    same_events(got, events())
    assert (info.width, info.height) == (304, 240)


def test_dat_of_triggers(tmp_path):
    """Value in bits 0-3, channel in bits 26-31."""
    data = b"".join(struct.pack("<II", 100 * i, i & 1 | 6 << 26) for i in range(10))
    head = b"% Data file containing ExtTrigger events\n% Version 2\n\x0e\x08"
    got, info = read(save(tmp_path / "a.dat", head + data))
    assert len(got) == 0 and info.encoding == "trigger"
    np.testing.assert_array_equal(got.triggers.t, np.arange(10) * 100_000)
    np.testing.assert_array_equal(got.triggers.id, np.full(10, 6))
    np.testing.assert_array_equal(got.triggers.value, np.arange(10) % 2)


@pytest.mark.parametrize("backend", ["numpy", "warp"])
@pytest.mark.parametrize("cut", [4, 8, 12, 16, 20])
def test_evt4_words_by_hand(backend, cut):
    """A vector of three pixels whose mask looks like a vector too, its pieces apart; a trigger; what is before time."""
    words = [0xB << 28, 0xE << 28 | 2, 0xD << 28 | 5 << 22 | 64 << 11 | 7, 0xC0000001, 0x9 << 28 | 6 << 22 | 3 << 8 | 1]
    data = struct.pack("<5I", *words)
    decoder = decoder_for("evt4", 1280, 720, backend)
    got = Events.concatenate([decoder.decode(data[:cut]), decoder.decode(data[cut:])])
    assert list(rows(got)) == [(133, 64, 7, 1), (133, 94, 7, 1), (133, 95, 7, 1)]
    assert (got.triggers.t.tolist(), got.triggers.id.tolist(), got.triggers.value.tolist()) == ([134_000], [3], [1])
    assert decoder.counts == {"untimed": 1}


def test_events_images_are_named(tmp_path):
    """What a GenX320 makes of its events is no event stream."""
    with pytest.raises(RecordingError, match="images that the sensor made of its events"):
        open_recording(save(tmp_path / "a.raw", b"% format HISTO3D;height=320;width=320\n% end\n" + bytes(64)))
