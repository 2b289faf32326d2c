"""DAT, N-MNIST, Event Stream, text and RAW: what is special about each."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from file_cases import nmnist, save, small_events, text_zip
from hypothesis import given, settings
from hypothesis import strategies as st
from stream_cases import random_events, same

from evis.events import Events, RecordingError, open_recording, open_writer
from evis.events.codecs.prophesee import evt3
from evis.events.files.es.decoder import EsDecoder
from evis.events.files.text.columns import find_format
from evis.events.files.text.numbers import parse_lines


def read(path, **options):
    with open_recording(path, **options) as recording:
        return recording.read(), recording.info, recording.counters()


# -- DAT -------------------------------------------------------------------------------------------------------------


def test_dat_time_turns_after_71_minutes(tmp_path):
    """The 32-bit time is continued over its turn; a step back of some us is none."""
    times = [2**32 - 50, 2**32 - 1, 2**32 - 3, 2, 70, 69]
    head = b"% Data file containing Event2D events.\n% Version 2\n% Width 640\n% Height 480\n\x0c\x08"
    data = head + b"".join(struct.pack("<II", t, 3 | 4 << 14 | 1 << 28) for t in times)
    events, info, _ = read(save(tmp_path / "a.dat", data))
    assert (events.t // 1000).tolist() == [2**32 - 50, 2**32 - 1, 2**32 - 3, 2**32 + 2, 2**32 + 70, 2**32 + 69]
    assert (events.x[0], events.y[0], events.p[0], info.width) == (3, 4, 1, 640)


def test_dat_refuses_a_pause_that_its_counter_cannot_tell(tmp_path):
    """And says where such events go; the counter has 32 bits of us."""
    events = Events.of(np.array([0, 1 << 31]) * 1000, x=[0, 1], y=[0, 1], p=[0, 1])
    told = r"pause of 2147 s; write \.npz"
    with pytest.raises(RecordingError, match=told), open_writer(tmp_path / "a.dat", 9, 9) as out:
        out.write(events)


def test_dat_of_other_events_is_named(tmp_path):
    """Type and size of the events are told."""
    with pytest.raises(RecordingError, match="type 0x0F with 8"):
        read(save(tmp_path / "a.dat", b"% Data file\n\x0f\x08" + bytes(80)))


def test_dat_without_a_size(tmp_path):
    """The largest coordinates, with a warning, or the size of the user."""
    data = b"% Data file\n\x00\x08" + struct.pack("<II", 1, 9 | 7 << 14)
    _, info, _ = read(save(tmp_path / "a.dat", data))
    assert (info.width, info.height, info.geometry_from) == (10, 8, "events") and info.warnings
    _, info, _ = read(tmp_path / "a.dat", size=(64, 32))
    assert (info.width, info.height, info.geometry_from, info.warnings) == (64, 32, "option", [])


# -- N-MNIST ---------------------------------------------------------------------------------------------------------


def test_nmnist_overflow_row(tmp_path):
    """A record in row 240 adds 2^13 us to all that follow; a fall of the 23-bit time is a turn of it."""
    events = Events.of([1_000, 5_000_000, 8_388_000_000], [1, 2, 3], [4, 5, 6], [1, 0, 1])
    mark = bytes((0, 240, 0, 0, 1))
    data = nmnist(events[:1]) + mark + nmnist(events[1:]) + nmnist(Events.of([2_000], [7], [8], [1]))
    got, info, _ = read(save(tmp_path / "a.bin", data))
    assert (got.t // 1000).tolist() == [1, 5000 + 8192, 8_388_000 + 8192, 2 + 2**23 + 8192]
    assert got.p.tolist() == [1, 0, 1, 1] and (info.width, info.height) == (34, 34)


def test_nmnist_by_content(tmp_path):
    """Without its name, if it has enough events; other binary files are not taken for it."""
    events = small_events(400)
    got, info, _ = read(save(tmp_path / "unnamed", nmnist(events)))
    assert info.format == "nmnist"
    same(got, events)
    rng = np.random.default_rng(1)
    for other in (rng.bytes(4000), bytes(4000), b"some text, and more of it. " * 100, bytes(range(256)) * 16):
        with pytest.raises(RecordingError, match="not a recording"):
            read(save(tmp_path / "other", other))


# -- Event Stream ----------------------------------------------------------------------------------------------------


@settings(max_examples=300, deadline=None)
@given(data=st.binary(max_size=300), cut=st.integers(0, 300), atis=st.booleans())
def test_es_loop_and_kernel_agree_on_any_bytes(data, cut, atis):
    """In one piece or two, in Python or Warp: the same events and the same rest."""
    results = []
    for backend in ("numpy", "warp"):
        for pieces in ([data], [data[:cut], data[cut:]]):
            decoder = EsDecoder("atis" if atis else "dvs", backend)
            parts = [decoder.decode(piece) for piece in pieces]
            results.append((Events.concatenate([e for e, _ in parts]), sum(n for _, n in parts), decoder.pending))
    for events, exposures, pending in results[1:]:
        same(events, results[0][0])
        assert (exposures, pending) == results[0][1:]


def test_es_atis(tmp_path):
    """Exposure measurements are left out and counted; overflows add 63 us a step; padding adds nothing."""
    data = b"Event Stream\x02\x00\x00\x02" + struct.pack("<HH", 304, 240)
    data += bytes([0xFD, 5 << 2 | 2]) + struct.pack("<HH", 10, 20)  # 63 + 5 us, ON
    data += bytes([3 << 2 | 1]) + struct.pack("<HH", 10, 20)  # exposure
    data += bytes([0xFC, 0xFF, 1 << 2]) + struct.pack("<HH", 11, 21)  # padding, 3 x 63 + 1 us, OFF
    events, info, counters = read(save(tmp_path / "a.es", data))
    assert (events.t // 1000).tolist() == [68, 68 + 3 + 190] and events.p.tolist() == [1, 0]
    assert events.x.tolist() == [10, 11] and counters == {"exposures_left_out": 1} and info.encoding == "atis"


def test_es_of_other_types_is_named(tmp_path):
    """Colour and generic streams hold no polarity events."""
    for kind, name in ((0, "generic"), (4, "color"), (9, "9")):
        with pytest.raises(RecordingError, match=f"type {name}"):
            read(save(tmp_path / "a.es", b"Event Stream\x02\x00\x00" + bytes([kind]) + bytes(20)))
    with pytest.raises(RecordingError, match=r"version 1\.2\.3"):
        read(save(tmp_path / "a.es", b"Event Stream\x01\x02\x03\x01" + bytes(20)))


# -- text ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "t_ns", "x"),
    [
        ("0.003811000 96 133 1\n0.003820001 127 171 0\n", [3_811_000, 3_820_001], [96, 127]),
        (
            "1633953690.975950001 3 5 1\n1633953690.975950002 4 6 0\n",
            [1633953690975950001, 1633953690975950002],
            [3, 4],
        ),
        ("1000 3 5 1\n2000 4 6 -1\n", [1_000_000, 2_000_000], [3, 4]),
        ("3,5,1,1000\n4,6,0,2000\n", [1_000_000, 2_000_000], [3, 4]),
        ("t,x,y,p\n1000,3,5,1\n2000,4,6,0\n", [1000, 2000], [3, 4]),
        ("x y p t_us\n3 5 1 1000\n4 6 0 2000\n", [1_000_000, 2_000_000], [3, 4]),
        ("# comment\n640 480\n1.5e-3 3 5 1\r\n2.5e-3 4.0 6 0\r\n", [1_500_000, 2_500_000], [3, 4]),
        ("1000 3 5 1.0\n2000 4 6 0.0\n", [1_000_000, 2_000_000], [3, 4]),
        ("1000 3.0 5 1\n2000 4.0 6 0\n", [1_000_000, 2_000_000], [3, 4]),
        ("-0.5 3 5 1\n0.25 4 6 0\n", [-500_000_000, 250_000_000], [3, 4]),
        ("  1.0\t3 5   1\n\n2. 4 6 0", [1_000_000_000, 2_000_000_000], [3, 4]),
    ],
)
def test_text_of_many_kinds(text, t_ns, x, tmp_path):
    """Orders of columns, units, separators, exponents: times exactly as written."""
    events, info, _ = read(save(tmp_path / "a", text.encode()))
    assert events.t.tolist() == t_ns and events.x.tolist() == x
    assert events.p.tolist() == [1, 0] and info.format == "text"


@settings(max_examples=200, deadline=None)
@given(
    rows=st.lists(
        st.tuples(
            st.integers(-(10**17), 10**17), st.integers(0, 65535), st.integers(0, 65535), st.sampled_from([-1, 0, 1])
        ),
        min_size=1,
    ),
    digits=st.integers(0, 11),
)
def test_text_numbers_are_exact(rows, digits):
    """Fast and slow ways against Python's own integers: seconds with any number of digits, rounded at most once."""
    from decimal import ROUND_HALF_UP, Decimal

    lines = [f"{Decimal(t).scaleb(-digits):f} {x} {y} {p}" for t, x, y, p in rows]
    form = find_format(b"0.5 1 1 1\n")
    data = ("\n".join(lines) + "\n").encode()
    expected = [int((Decimal(t).scaleb(9 - digits)).to_integral_value(ROUND_HALF_UP)) for t, *_ in rows]
    for text in (data, data + b"# a comment makes it go line by line\n"):
        t, x, y, p, bad = parse_lines(text, form)
        fits = [k for k, v in enumerate(expected) if -(2**63) <= v < 2**63]
        assert bad == len(rows) - len(fits)
        assert t.tolist() == [expected[k] for k in fits]
        assert [(int(a), int(b)) for a, b in zip(x, y)] == [(rows[k][1], rows[k][2]) for k in fits]
        assert p.tolist() == [int(rows[k][3] == 1) for k in fits]


def test_many_events_at_time_0_leave_the_time_the_time(tmp_path):
    """The column that alone has fractions is the time, where columns of pixels go up and it does not."""
    n = 64
    events = Events.of(
        np.repeat([0, 9_000_000_007], n), np.tile(np.arange(n), 2), np.ones(2 * n, int), np.zeros(2 * n, int)
    )
    with open_writer(tmp_path / "a.txt", n, 2) as writer:
        writer.write(events)
    got, _, counters = read(tmp_path / "a.txt")
    same(got, events)
    assert not counters


@pytest.mark.parametrize("name", ["a.csv", "a.txt"])
def test_the_last_times_of_int64_are_read_back(name, tmp_path):
    """Of both signs."""
    events = Events.of([-(2**63), -(2**62), 2**62, 2**63 - 1], [1, 2, 3, 4], [0] * 4, [1] * 4)
    with open_writer(tmp_path / name, 8, 8) as writer:
        writer.write(events)
    got, _, counters = read(tmp_path / name)
    same(got, events)
    assert not counters


def test_bad_lines_are_counted(tmp_path):
    """Words in the middle, coordinates out of range, three numbers: left out, counted, named once."""
    text = "0.1 1 2 1\nhello\n0.2 1 2 0\n0.3 70000 2 1\n0.4 1 2\n0.5 3 4 1\n"
    lines = "".join(f"{i / 100} 5 6 1\n" for i in range(100))
    events, info, counters = read(save(tmp_path / "a.txt", (lines + text).encode()))
    assert len(events) == 103 and counters == {"lines_left_out": 3} and len(info.warnings) == 2


@pytest.mark.parametrize(
    ("text", "t_ns", "left_out"),
    [
        ("t,x,y,p\nfoo\n2000,3,3,0\n3000,3,3,0\n", [2000, 3000], 1),
        ("t,x,y,p\n1000,-1,3,1\n2000,3,3,0\n3000,3,3,0\n", [2000, 3000], 1),
        ("1000 -1 3 1\n2000 3 3 0\n3000 3 3 0\n", [2_000_000, 3_000_000], 1),
        ("5 3 1\n2000 3 3 0\n3000 3 3 0\n", [2_000_000, 3_000_000], 1),
        ("0.01 7x 3 1\n0.02 3 3 0\n0.03 3 3 0\n", [20_000_000, 30_000_000], 1),
        ("999999999999999999 99999 3 1\n2000 3 3 0\n3000 3 3 0\n", [2_000_000, 3_000_000], 1),
    ],
)
def test_a_bad_first_line_is_left_out_and_counted(text, t_ns, left_out, tmp_path):
    """As one in the middle is."""
    events, _, counters = read(save(tmp_path / "a.txt", text.encode()))
    assert events.t.tolist() == t_ns and counters == {"lines_left_out": left_out}


@pytest.mark.parametrize(
    "text", ["time,lat,lon,flag\n1,2,3,1\n2,3,4,0\n", "a title\n1 2 3 1\n", "1 2 3 5\n2 3 4 6\n3 4 5 1\n"]
)
def test_other_tables_are_not_taken_for_events(text, tmp_path):
    with pytest.raises(RecordingError, match="not a recording"):
        read(save(tmp_path / "a.txt", text.encode()))


@pytest.mark.parametrize("name", ["a.csv", "a.txt"])
def test_text_of_no_event_is_read_back(name, tmp_path):
    with open_writer(tmp_path / name, 64, 48) as writer:
        writer.write(Events.empty())
    events, info, counters = read(tmp_path / name)
    assert not len(events) and info.format == "text" and not counters and not info.truncated
    assert read(tmp_path / name, size=(64, 48))[1].width == 64


def test_e2vid_zip(tmp_path):
    """Size on the first line, deflated; of a cut archive the lines before the cut."""
    events = small_events(3000, 640, 480)
    data = text_zip(events)
    got, info, _ = read(save(tmp_path / "a.zip", data))
    same(got, events)
    assert (info.width, info.height, info.format, info.warnings) == (640, 480, "text.zip", [])
    with open_recording(tmp_path / "a.zip") as recording:
        recording.seek(int(events.t[2000]))
        np.testing.assert_array_equal(recording.read().t, events.t[np.searchsorted(events.t, events.t[2000]) :])
    got, info, _ = read(save(tmp_path / "b.zip", data[: len(data) // 2]))
    assert 1000 < len(got) < 2000 and info.truncated and "the archive has no list" in info.warnings[0]
    same(got, events[: len(got)])


def test_text_is_bisected(tmp_path):
    """Seeking in a large file does not read what comes before: it is not even text."""
    lines = "".join(f"{i / 1e6:.6f} {i % 640} {i % 480} {i % 2}\n" for i in range(300_000)).encode()
    broken = lines[:2_000] + b"?" * 500_000 + lines[502_000:]
    with open_recording(save(tmp_path / "a.txt", broken), size=(640, 480)) as recording:
        recording.seek(250_000_000)
        assert recording.next_t_ns == 250_000_000
        assert len(recording.read()) == 50_000 and not recording.counters()


# -- RAW -------------------------------------------------------------------------------------------------------------


def test_raw_in_the_middle_of_a_time_high(tmp_path):
    """Words before the first TIME_HIGH have no time: counted and dropped, all events behind it come."""
    events = random_events(5, 3000, step_us=400)
    data = evt3.Encoder().encode(events)
    words = np.frombuffer(data, "<u2")
    highs = np.flatnonzero(words >> 12 == 8)
    header = b"% evt 3.0\n% geometry 640x480\n% end\n"
    got, _, counters = read(save(tmp_path / "a.raw", header + data[2 * (highs[3] + 1) :]))
    assert counters["words_before_time"] == highs[4] - highs[3] - 1
    later = events.t // 1000 >= (int(words[highs[4]]) & 0xFFF) << 12
    assert len(got) <= int(later.sum()) + 10
    np.testing.assert_array_equal(got.t[-1000:], events.t[-1000:])


def test_raw_with_a_wrong_header_and_the_size_of_the_user(tmp_path):
    """A header of EVT2 over EVT3 words gives no wrong times silently: unknown words are counted. A size is taken."""
    data = evt3.Encoder().encode(random_events(5, 3000))
    wrong = b"% evt 2.0\n% format EVT2\n% geometry 640x480\n% end\n"
    events, _, counters = read(save(tmp_path / "a.raw", wrong + data))
    assert len(events) < 3000 and sum(counters.values()) > 500
    right = b"% evt 3.0\n% serial_number 1\n% end\n"
    events, info, counters = read(save(tmp_path / "b.raw", right + data), size=(1280, 720))
    assert (len(events), info.width, info.geometry_from, counters) == (3000, 1280, "option", {})


@pytest.mark.parametrize("encoding", ["evt2", "evt21", "evt21_legacy", "evt3"])
def test_raw_encoding_is_found_in_the_words(encoding, tmp_path):
    """A header that names no encoding, for each of them."""
    events = random_events(7, 3000, step_us=400)
    with open_writer(tmp_path / "a.raw", 640, 480, encoding) as writer:
        writer.write(events)
    data = (tmp_path / "a.raw").read_bytes()
    words = data[data.index(b"% end\n") + 6 :]
    got, info, _ = read(save(tmp_path / "b.raw", b"% system_ID 49\n% end\n" + words))
    assert info.encoding == encoding
    same(got, events)


@pytest.mark.parametrize("encoding", ["evt2", "evt21", "evt21_legacy", "evt3"])
def test_raw_that_starts_late_is_not_taken_for_another(encoding, tmp_path):
    """The counter of EVT3 turns 1024 times before the first event, that of the others once: nothing is to be told."""
    events = Events.of(((1 << 34) + np.arange(40)) * 1000, np.arange(40), np.arange(40), np.arange(40) % 2)
    with open_writer(tmp_path / "a.raw", 64, 48, encoding) as writer:
        writer.write(events)
    got, info, _ = read(tmp_path / "a.raw")
    same(got, events)
    assert not info.warnings


def test_raw_seeks_back_and_forth_over_turns_of_the_counter(tmp_path):
    """EVT3 times turn every 16.8 s: the turns are right after every seek, also back to a place seen before."""
    rng = np.random.default_rng(2)
    n = 400_000
    t = np.cumsum(rng.integers(0, 300, n)) * 1000
    events = Events.of(t, rng.integers(0, 640, n), rng.integers(0, 480, n), rng.integers(0, 2, n))
    with open_writer(tmp_path / "a.raw", 640, 480) as writer:
        writer.write(events)
    with open_recording(tmp_path / "a.raw") as recording:
        for i in (n - 5, 3, n // 2, n // 3, n - 5):
            recording.seek(int(t[i]))
            assert recording.next_t_ns == int(t[i])
            window = recording.read_until(int(t[i]) + 5_000_000)
            a, b = np.searchsorted(t, t[i]), np.searchsorted(t, t[i] + 5_000_000, "right")
            np.testing.assert_array_equal(window.t, t[a:b])
