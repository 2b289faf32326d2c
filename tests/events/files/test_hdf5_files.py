"""HDF5: the three modes of ECF, the layouts of the data sets, damaged chunks and cut files."""

from __future__ import annotations

import ctypes
import struct

import h5py
import numpy as np
import pytest
from file_cases import save, small_events
from hypothesis import given, settings
from hypothesis import strategies as st
from stream_cases import random_events, same

from evis.events import Events, RecordingError, open_recording, open_writer
from evis.events.files.hdf5 import ecf
from evis.events.files.reading import forked_trial as trial
from evis.events.files.reading.decompress import DamagedError

MODES = ["yxp", "xp", "masked"]


def runs(values, most, code, shift):
    """Run lengths, one value at a time: value << shift | count, the largest count says that a u16 follows."""
    out, i = b"", 0
    while i < len(values):
        n = 1
        while i + n < len(values) and values[i + n] == values[i]:
            n += 1
        word = int(values[i]) << shift | min(n, most)
        out += struct.pack(code, word) + (struct.pack("<H", n) if n >= most else b"")
        i += n
    return out


def chunk(t, x, y, p, mode) -> bytes:
    """A chunk by the format's description, one event at a time, in each of its modes."""
    n = len(t)
    out = struct.pack("<Iq", n << 2 | {"yxp": 2, "xp": 1, "masked": 0}[mode], t[0])
    now, i = t[0], 0
    while i < n:
        count = 1
        while i + count < n and t[i + count] == t[i]:
            count += 1
        step = t[i] - now
        if step >= 15:
            while step:
                out += bytes([0xF0 | step & 15])
                step >>= 4
        out += bytes([step << 4 | min(count, 15)]) + (struct.pack("<H", count) if count >= 15 else b"")
        now, i = t[i], i + count
    if mode == "yxp":
        bits = [y[k] << 12 | x[k] << 1 | p[k] for k in range(n)] + [0] * (-n % 4)
        for k in range(0, len(bits), 4):
            a, b, c, d = bits[k : k + 4]
            out += struct.pack("<III", a << 8 | b & 0xFF, b >> 8 << 16 | c & 0xFFFF, c >> 16 << 24 | d)
        return out
    out += runs(y, 31, "<H", 5)
    if mode == "xp":
        bits = [x[k] << 1 | p[k] for k in range(n)] + [0] * (-n % 4)
        for k in range(0, len(bits), 4):
            a, b, c, d = bits[k : k + 4]
            out += struct.pack("<HHH", a << 4 | b & 15, b >> 4 << 8 | c & 0xFF, c >> 8 << 12 | d)
        return out
    k = 0
    while k < n:
        first, mask = x[k], 0
        k += 1
        while k < n and x[k - 1] < x[k] <= first + 5:
            mask |= 1 << 5 - (x[k] - first)
            k += 1
        out += struct.pack("<H", first << 5 | mask)
    return out + runs(p, 127, "B", 7)


@st.composite
def bursts(draw):
    """Rows that fire together, runs of equal times and polarities, jumps in time of all sizes."""
    n = draw(st.integers(1, 300))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    longest = draw(st.sampled_from([1, 3, 40, 200]))
    repeat = lambda values: np.repeat(values, rng.integers(1, longest + 1, n))[:n]
    t = np.cumsum(repeat(rng.choice([0, 1, 14, 15, 16, 255, 70000, 10**9], n)) * (rng.random(n) < 0.5))
    x = (repeat(rng.integers(0, 2040, n)) + rng.integers(0, 6, n)) % 2048
    return [
        c.astype(np.int64).tolist() for c in (t, x, repeat(rng.integers(0, 2048, n)), repeat(rng.integers(0, 2, n)))
    ]


@settings(max_examples=150, deadline=None)
@given(columns=bursts(), mode=st.sampled_from(MODES))
def test_ecf_decodes_what_the_description_says(columns, mode):
    """Both decoders, on chunks from a plain encoder; and every chunk that is cut is refused."""
    data = chunk(*columns, mode)
    for backend in ("numpy", "warp"):
        for got, expected in zip(ecf.decode(data, backend), columns):
            np.testing.assert_array_equal(got, expected)
        with pytest.raises(DamagedError):
            ecf.decode(data[: 4 + len(data) // 2], backend)


@settings(max_examples=100, deadline=None)
@given(columns=bursts())
def test_ecf_encoder(columns):
    """What is encoded decodes to the same."""
    t, x, y, p = (np.array(c, d) for c, d in zip(columns, (np.int64, np.uint16, np.uint16, np.uint8)))
    for got, expected in zip(ecf.decode(ecf.encode(t, x, y, p)), (t, x, y, p)):
        np.testing.assert_array_equal(got, expected)


@settings(max_examples=300, deadline=None)
@given(data=st.binary(max_size=200), n=st.integers(0, 80), mode=st.integers(0, 3))
def test_ecf_of_garbage(data, n, mode):
    """The loop and the kernel agree on any bytes: the same events, or both refuse."""
    data = struct.pack("<Iq", n << 2 | mode, 7) + data
    results = []
    for backend in ("numpy", "warp"):
        try:
            results.append(ecf.decode(data, backend))
        except DamagedError:
            results.append(None)
    assert (results[0] is None) == (results[1] is None)
    for a, b in zip(*[r or [] for r in results]):
        np.testing.assert_array_equal(a, b)


def test_a_damaged_chunk_is_left_out_alone(tmp_path):
    """Of four chunks the second is destroyed: the events of the others come, the loss is counted and named."""
    events = small_events(60_000, 640, 480)
    with open_writer(tmp_path / "a.h5", 640, 480, "ecf") as writer:
        writer.write(events)
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        file["CD/events"].id.write_direct_chunk((16384,), b"\xff" * 50, 0)
    with open_recording(tmp_path / "a.h5") as recording:
        left = recording.read()
        assert recording.counters() == {"chunks_damaged": 1}
        assert "event 16384" in recording.info.warnings[0]
    np.testing.assert_array_equal(left.t, np.delete(events.t, slice(16384, 32768)))


COUNT = 90_000
CUTS = (0.03, 0.1, 0.31, 0.5, 0.72, 0.9, 0.985)


def whole_events() -> Events:
    """Four neighbours of a row at a time, in whole us."""
    rng = np.random.default_rng(5)
    t = np.cumsum(rng.integers(0, 3, COUNT)) * 1000
    x, y = rng.integers(0, 346, COUNT), np.repeat(rng.integers(0, 260, COUNT // 4), 4)
    return Events.of(t, x, y, rng.integers(0, 2, COUNT))


def columns_file(path, events, how, latest=False, **options):
    """DSEC's layout, each column at once or all of them in turns."""
    arrays = {"p": events.p, "t": (events.t // 1000).astype("u4"), "x": events.x, "y": events.y}
    with h5py.File(path, "w", libver="latest" if latest else None) as file:
        group = file.create_group("events")
        for name, values in arrays.items():
            if how == "once":
                group.create_dataset(name, data=values, **options)
            else:
                group.create_dataset(name, (0,), values.dtype, maxshape=(None,), **options)
        for a in range(0, COUNT, 5000) if how == "turns" else []:
            for name, values in arrays.items():
                group[name].resize((a + 5000,))
                group[name][a:] = values[a : a + 5000]
        file["ms_to_idx"] = np.zeros(5, "u8")


def ends_of(data_set, count):
    """Where in the file the bytes of the first events end: (events, byte), as the library says of the whole file."""
    if data_set.get_create_plist().get_layout() != h5py.h5d.CHUNKED:
        size = data_set.get_storage_size() // data_set.shape[0]
        return [(n, data_set.get_offset() + n * size) for n in range(0, count + 1, count // 100)]
    chunks = [data_set.get_chunk_info(i) for i in range(data_set.get_num_chunks())]
    length = data_set.get_create_plist().get_chunk()[0]
    return [(min(c.chunk_offset[0] + length, count), c.byte_offset + c.size) for c in chunks]


def least_before(path, names, cut):
    """Events of which all data lie before byte `cut`."""
    with h5py.File(path) as file:
        found = []
        for name in names:
            n = 0
            for events, end in sorted(ends_of(file[name].id, COUNT)):
                if end > cut:
                    break
                n = events
            found.append(n)
    return min(found)


def check_cuts(path, names, tmp_path, most=2**62):
    """What a cut file gives are its first events: all that lie before the cut, and none that it does not have."""
    events, data = whole_events(), path.read_bytes()
    for part in CUTS:
        cut = int(part * len(data))
        due = least_before(path, names, cut)
        try:
            with open_recording(save(tmp_path / "cut.h5", data[:cut])) as recording:
                left, counters = recording.read(), recording.counters()
                assert recording.info.truncated and "cut" in recording.info.warnings[0]
        except RecordingError as error:
            assert "cut.h5: cut" in str(error) and due == 0
            continue
        assert due <= len(left) <= min(due + most, COUNT)
        same(left, events[: len(left)])
        assert counters.get("events_behind_cut", 0) == COUNT - len(left)


@pytest.mark.parametrize("encoding", ["ecf", "plain"])
def test_a_cut_file_of_prophesee(encoding, tmp_path):
    """With the first events of the chunk that is cut."""
    with open_writer(tmp_path / "a.h5", 346, 260, encoding) as writer:
        writer.write(whole_events())
    check_cuts(tmp_path / "a.h5", ["CD/events"], tmp_path, most=16384)


@pytest.mark.parametrize("how", ["once", "turns"])
@pytest.mark.parametrize("options", [{}, {"chunks": (5000,), "compression": "gzip"}, {"chunks": (5000,)}])
@pytest.mark.parametrize("latest", [False, True])
def test_cut_columns(how, options, latest, tmp_path):
    """An event counts when it has all four columns; what HDF5 itself reads behind the cut are zeros."""
    if how == "turns" and not options:
        options = {"chunks": (5000,), "compression": "lzf"}
    columns_file(tmp_path / "a.h5", whole_events(), how, latest, **options)
    check_cuts(tmp_path / "a.h5", [f"events/{c}" for c in "xytp"], tmp_path)


def test_a_cut_file_of_mvsec(tmp_path):
    """Rows of four numbers in chunks, in the group of a group."""
    events = whole_events()
    rows = np.stack([events.x, events.y, events.t / 1e9, events.p * 2.0 - 1], 1).astype(np.float64)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("davis/left/events", data=rows, chunks=(3000, 4), compression="gzip")
    check_cuts(tmp_path / "a.h5", ["davis/left/events"], tmp_path)


def test_chunks_whose_index_is_behind_the_cut(tmp_path):
    """A tree of more than 64 chunks moves its first leaf behind them: ECF is found without it, other chunks are not."""
    events = random_events(4, 70 * 16384)
    events.t[:] = np.sort(events.t)
    with open_writer(tmp_path / "a.h5", 640, 480, "ecf") as writer:
        writer.write(events)
    data = (tmp_path / "a.h5").read_bytes()
    cut = len(data) // 2
    with open_recording(save(tmp_path / "b.h5", data[:cut])) as recording:
        left = recording.read()
        assert "found by what they begin with" in recording.info.warnings[1]
        assert recording.counters() == {"events_behind_cut": len(events) - len(left)}
    assert len(left) > 30 * 16384
    same(left, events[: len(left)])


def test_a_library_that_hangs_or_crashes():
    """The trial tells both from what ends by itself, also with an exception."""
    assert trial.outcome_of(lambda: None) == trial.outcome_of(lambda: 1 / 0) == ""
    assert trial.outcome_of(lambda: ctypes.string_at(0)) == "crashes"
    assert trial.outcome_of(lambda: all(iter(int, 1)) or sum(iter(int, 1)), cpu_s=1) == "hangs"


def test_a_file_cut_anywhere_is_told_in_plain_words(tmp_path):
    """One line that says cut, without the library's own text, or the events before the cut."""
    path = tmp_path / "a.hdf5"
    with open_writer(path, 1280, 720) as writer:
        writer.write(random_events(3, 60_000))
    data = path.read_bytes()
    refused = 0
    for size in range(1000, len(data), len(data) // 40):
        try:
            with open_recording(save(tmp_path / "cut.hdf5", data[:size])) as recording:
                recording.read()
                said = " ".join(recording.info.warnings)
                assert recording.info.truncated
        except RecordingError as error:
            refused += 1
            said = str(error)
            assert f"has {size} of its {len(data)} bytes" in said and "no event to be had" in said
        assert "cut" in said and "\n" not in said
        assert not any(word in said.lower() for word in ("object", "unable", "can't", "header", "visit"))
    assert refused


def test_the_topic_of_an_ecf_file(tmp_path):
    """Its own group may be named; another one is an error that names it."""
    path = tmp_path / "a.hdf5"
    with open_writer(path, 34, 34) as writer:
        writer.write(small_events())
    with open_recording(path, topic="CD/events") as recording:
        same(recording.read(), small_events())
    with pytest.raises(RecordingError, match="no events in 'left'; they are in CD/events"):
        open_recording(path, topic="left")


def test_dsec_and_tum_vie(tmp_path):
    """Columns in us with an offset (DSEC) and without (TUM-VIE), compressed as theirs; the index tells them apart."""
    plugin = pytest.importorskip("hdf5plugin")
    events = small_events(5000, 640, 480)
    for name, offset in (("dsec", 51_648_500_652), ("tum-vie", None)):
        with h5py.File(tmp_path / f"{name}.h5", "w") as file:
            for column, dtype in (("x", "u2"), ("y", "u2"), ("p", "u1")):
                data = getattr(events, column).astype(dtype)
                file.create_dataset(f"events/{column}", data=data, chunks=(1000,), **plugin.Blosc(cname="zstd"))
            file["events/t"] = (events.t // 1000).astype("u4" if offset else "i8")
            file["ms_to_idx" if offset else "events/ms_to_idx"] = np.zeros(5, "u8")
            if offset:
                file["t_offset"] = np.int64(offset)
        with open_recording(tmp_path / f"{name}.h5") as recording:
            assert recording.info.encoding == name and recording.info.geometry_from == "sensor"
            assert recording.info.width == (640 if offset else 1280)
            got = recording.read()
            np.testing.assert_array_equal(got.t, events.t + (offset or 0) * 1000)
            same(got[:], Events(got.t, events.x, events.y, events.p))
            recording.seek(int(got.t[3000]))
            assert recording.next_t_ns == int(got.t[3000])


def test_columns_of_different_lengths(tmp_path):
    """Rows that all columns have are read, and it is told how many others there are."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, length in (("t", 60), ("x", 60), ("y", 40), ("p", 55)):
            file[f"events/{name}"] = np.arange(length) % 2 if name == "p" else np.arange(length)
    with open_recording(tmp_path / "a.h5") as recording:
        assert recording.read().x.tolist() == list(range(40))
        told = "columns of different lengths (t 60, x 60, y 40, p 55): 20 rows that not all of them have are left out"
        assert told in recording.info.warnings


def test_mvsec_has_two_cameras(tmp_path):
    """Rows of x, y, t in seconds since 1970 as float64 (exact to 0.24 us), and polarity -1 or 1."""
    events = small_events(500, 346, 260)
    seconds = 1.5e9 + events.t / 1e9
    rows = np.stack([events.x, events.y, seconds, np.where(events.p == 1, 1, -1)], 1).astype(np.float64)
    with h5py.File(tmp_path / "a.hdf5", "w") as file:
        file["davis/left/events"], file["davis/right/events"] = rows, rows[:100]
        file["davis/left/imu"] = np.zeros((3, 6))
    with open_recording(tmp_path / "a.hdf5") as recording:
        assert (recording.info.width, recording.info.height, recording.info.encoding) == (346, 260, "mvsec")
        got = recording.read()
        np.testing.assert_allclose(got.t - 1_500_000_000_000_000_000, events.t, atol=240)
        np.testing.assert_array_equal(got.p, events.p)
        np.testing.assert_array_equal(got.x, events.x)
        assert "davis/right/events" in recording.info.warnings[0]
    with open_recording(tmp_path / "a.hdf5", topic="davis/right/events") as recording:
        assert len(recording.read()) == 100


def test_rows_of_whole_numbers(tmp_path):
    """v2e: t in us, x, y, p as uint32, and other tables beside it."""
    events = small_events(400, 346, 260)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        rows = np.stack([events.t // 1000, events.x, events.y, events.p], 1).astype("u4")
        file.create_dataset("events", data=rows, maxshape=(None, 4), compression="gzip")
        file["frame_ts"] = np.arange(5)
    with open_recording(tmp_path / "a.h5") as recording:
        same(recording.read(), events)
        assert recording.info.encoding == "v2e" and "taken as t in us" in recording.info.warnings[0]
        recording.seek(int(events.t[200]))
        assert recording.next_t_ns == int(events.t[200])


def test_a_length_that_cannot_be_is_refused(tmp_path):
    """2^60 events in a file of a few kB, with and without compression: an error, not an endless stream of zeros."""
    kind = np.dtype([("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")])
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("CD/events", (2**60,), kind, chunks=(16384,))
        file["CD/events"][:100] = np.zeros(100, kind)
    with h5py.File(tmp_path / "b.h5", "w") as file:
        for name in "xytp":
            file.create_dataset(f"events/{name}", (2**60,), "i8", chunks=(16384,), compression="gzip")
    for name in ("a.h5", "b.h5"):
        with pytest.raises(RecordingError, match="damaged: 1152921504606846976 events in"):
            open_recording(tmp_path / name)


def test_other_hdf5_files_are_named(tmp_path):
    """No events in it; no such group; and a file that is no HDF5 behind its signature."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["weights"] = np.zeros(3)
    with pytest.raises(RecordingError, match="without events"):
        open_recording(tmp_path / "a.h5")
    with pytest.raises(RecordingError, match="HDF5"):
        open_recording(save(tmp_path / "b.h5", b"\x89HDF\r\n\x1a\n" + bytes(200)))
    with h5py.File(tmp_path / "c.h5", "w") as file:
        for name in "txyp":
            file[f"events/{name}"] = np.ones((5, 1), np.int64)
    with pytest.raises(RecordingError, match="t in /events has 2 axes, not one"):
        open_recording(tmp_path / "c.h5")
