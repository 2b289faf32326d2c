"""What is written reads back bit for bit, here and in other libraries."""

from __future__ import annotations

import hashlib

import h5py
import numpy as np
import pytest
from golden_case import golden_events
from stream_cases import random_events, same

from evis.events import Events, RecordingError, Triggers, open_recording, open_writer
from evis.recordings.recorded import open_recorded

# sha256 of what the writers make of `golden_events`. These very bytes were read by, with equal t, x, y, p:
# aedat4: aedat 2.3.0 and dv_processing 2.0.4 (triggers too); dat, evt2: expelliarmus 1.1.12; es: event_stream 1.6.3;
# evt3: evt3 0.4.1 and evlib; evt21: evlib. By: pip install of these in a fresh environment, then each one's decoder on
# the file and numpy.array_equal against golden_events.
GOLDEN = {
    (".aedat4", "none"): "c323c36d48627c57bc9ecec2889167b7e66deab5de1400c14604cfe218a56f51",
    (".dat", ""): "c8c93d37920df0215142b918e5077f4110ff529d3aeacf9b9a9624051c1a5270",
    (".es", ""): "0df9b265372d05a74d3c799979969422026e2108e998ce0c609f7b3f2d8ad6a9",
    (".raw", "evt2"): "f8331d2d37260ea2e85bd613cc9f44bd0af29ad4cb35d08f4444bb38186734ae",
    (".raw", "evt3"): "7fa64ceb76145bb10b2bc4f0498c3b5188d4d73f8fe4432eafbd433ae9fbc2ea",
    (".raw", "evt21"): "63c2517448a984494725440ef37f8fd1e8cb684195fad9e057f1af0caadca12a",
}
ALL = [
    (".raw", "evt2"), (".raw", "evt21"), (".raw", "evt21_legacy"), (".raw", "evt3"), (".dat", ""), (".es", ""),
    (".aedat4", "zstd"), (".aedat4", "lz4"), (".aedat4", "none"), (".h5", "ecf"), (".hdf5", "plain"), (".npz", ""),
    (".txt", ""), (".csv", ""),
]  # fmt: skip


def in_order(events: Events) -> Events:
    order = np.argsort(events.t, kind="stable")
    return Events(events.t[order], events.x[order], events.y[order], events.p[order], triggers=events.triggers)


def write(path, events, encoding, step=3000):
    with open_writer(path, 640, 480, encoding) as writer:
        for a in range(0, len(events), step):
            part = events[a : a + step]
            until = events.t[a + step] if a + step < len(events) else np.iinfo(np.int64).max
            start = events.t[a] if a else 0
            mine = (events.triggers.t >= start) & (events.triggers.t < until)
            part.triggers = Triggers(*(getattr(events.triggers, n)[mine] for n in ("t", "id", "value")))
            writer.write(part)


@pytest.mark.parametrize(("suffix", "encoding"), GOLDEN)
def test_bytes_that_other_libraries_read(suffix, encoding, tmp_path):
    """The writers still make the bytes that were checked with other readers."""
    with open_writer(tmp_path / f"a{suffix}", 320, 240, encoding) as writer:
        writer.write(golden_events())
    assert hashlib.sha256((tmp_path / f"a{suffix}").read_bytes()).hexdigest() == GOLDEN[suffix, encoding]


@pytest.mark.parametrize(("suffix", "encoding"), ALL)
def test_round_trip_and_seeking(suffix, encoding, tmp_path):
    """Events in order of time, in several writes; every seek finds the first event that is not earlier."""
    events = in_order(random_events(3, 20_000, triggers=40))
    path = tmp_path / f"a{suffix}"
    write(path, events, encoding)
    with open_recording(path) as recording:
        assert (recording.info.width, recording.info.height) == (640, 480)
        read = recording.read()
        assert not recording.info.truncated and not recording.counters()
        same(read[:], events[:])
        assert len(read.triggers) in (0, 40)
        for t in (0, int(events.t[7000]), int(events.t[7000]) + 1, int(events.t[-1]), 5, int(events.t[-1]) + 1):
            recording.seek(t)
            rest = recording.read()
            at = int(np.searchsorted(events.t, t))
            assert len(rest) == len(events) - at
            np.testing.assert_array_equal(rest.t, events.t[at:])


@pytest.mark.parametrize(("suffix", "encoding"), [(".aedat4", "none"), (".h5", "ecf"), (".raw", "evt3")])
def test_a_part_has_the_triggers_of_its_time(suffix, encoding, tmp_path):
    """Of a file that was written at once and is larger than a block: neither its start nor its end loses any."""
    n, whole = 300_000, 1_000_000_000
    t = np.arange(n, dtype=np.int64) * (whole // n // 1000 * 1000)
    edges = np.arange(5_000_000, t[-1], 10_000_000)
    events = Events.of(t, np.arange(n) % 64, np.arange(n) % 48, np.arange(n) % 2)
    events.triggers = Triggers(edges, np.zeros(len(edges), np.uint8), (np.arange(len(edges)) % 2).astype(np.uint8))
    with open_writer(tmp_path / f"a{suffix}", 64, 48, encoding) as writer:
        writer.write(events)
    for start, stop in ((0, whole // 10), (whole // 5, whole // 2), (whole * 3 // 5, whole)):
        part = open_recorded(tmp_path / f"a{suffix}")[start:stop].read()
        np.testing.assert_array_equal(part.triggers.t, edges[(edges >= start) & (edges < stop)])
        np.testing.assert_array_equal(part.t, t[(t >= start) & (t < stop)])


@pytest.mark.parametrize(("suffix", "encoding"), [case for case in ALL if case[0] != ".es"])
def test_times_that_step_back_are_kept(suffix, encoding, tmp_path):
    """A sensor's disorder of some us survives every format but .es, which says that it cannot hold it."""
    events = random_events(4, 20_000)
    assert (np.diff(events.t) < 0).any()
    write(tmp_path / f"a{suffix}", events, encoding)
    with open_recording(tmp_path / f"a{suffix}") as recording:
        same(recording.read()[:], events[:])


def test_es_refuses_what_it_cannot_hold(tmp_path):
    """Steps back and pauses of hours, with a remedy, and no file is left."""
    for t, text in (
        ([2000, 1000], "step back"),
        ([10**18, 10**18 + 1], "--rebase"),
        ([-2000, 1000], "-2000.*--rebase"),
    ):
        with pytest.raises(RecordingError, match=text), open_writer(tmp_path / "a.es", 9, 9) as writer:
            writer.write(Events.of(t, [1, 2], [1, 2], [0, 1]))
    assert not list(tmp_path.iterdir())


def test_dat_keeps_the_disorder_around_a_turn(tmp_path):
    """Events of 4294.967296 s, where its 32 bits turn, that came some us late."""
    turn = 1 << 32
    t = np.array([*range(0, turn, turn // 8), turn - 20, turn + 2, turn - 3, turn + 5, turn - 1, turn + 9]) * 1000
    with open_writer(tmp_path / "a.dat", 64, 48) as writer:
        writer.write(Events.of(t, np.arange(len(t)), np.arange(len(t)), np.zeros(len(t), np.uint8)))
    with open_recording(tmp_path / "a.dat") as recording:
        np.testing.assert_array_equal(recording.read().t, t)


def test_dat_refuses_what_it_cannot_hold(tmp_path):
    """Times beyond its 32 bits, and coordinates beyond its 14."""
    for t, x, text in ((5 * 10**15, 1, "--rebase"), (1, 20000, "16383")):
        with pytest.raises(RecordingError, match=text), open_writer(tmp_path / "a.dat", 9, 9) as writer:
            writer.write(Events.of([t], [x], [1], [1]))


def test_hdf5_is_what_h5py_reads(tmp_path):
    """Plain HDF5 in the layout of Prophesee's tools, read by the library itself; the index points where it says."""
    events = golden_events()
    with open_writer(tmp_path / "a.h5", 320, 240, "plain") as writer:
        writer.write(events)
    with h5py.File(tmp_path / "a.h5") as file:
        rows, index, edges = file["CD/events"][:], file["CD/indexes"][:], file["EXT_TRIGGER/events"][:]
        assert file.attrs["geometry"] == "320x240"
    np.testing.assert_array_equal(rows["t"] * 1000, events.t)
    np.testing.assert_array_equal(rows["x"], events.x)
    np.testing.assert_array_equal(edges["t"] * 1000, events.triggers.t)
    for number, t in index.tolist():
        assert t % 2000 == 0 and rows["t"][number] >= t and (number == 0 or rows["t"][number - 1] < t)


def test_frames_imu_and_triggers_go_through_aedat4(recording_path, tmp_path):
    """A whole DAVIS recording, written and read: the pixels, samples and edges are those of the original."""
    with open_recording(recording_path("aedat4/aestream_davis.aedat4")) as recording:
        first = recording.read()
    with open_writer(tmp_path / "a.aedat4", 346, 260) as writer:
        writer.write(first)
    with open_recording(tmp_path / "a.aedat4") as recording:
        second = recording.read()
    same(first, second)
    np.testing.assert_array_equal(first.imu.t, second.imu.t)
    np.testing.assert_allclose(first.imu.acceleration, second.imu.acceleration, rtol=1e-6)  # float32 on disk
    for a, b in zip(first.frames, second.frames, strict=True):
        np.testing.assert_array_equal(a.pixels, b.pixels)
        assert (a.t_ns, a.end_ns, a.exposure_ns) == (b.t_ns, b.end_ns, b.exposure_ns)
