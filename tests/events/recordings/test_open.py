"""`evis.open`: the same events as the readers give, of every format, whole, in slices and damaged."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_files import CASES, EVENTS, OTHERS

import evis
from evis.events import Events, RecordingError, open_recording, open_writer
from evis.recordings import windows as windows_module

FORMATS = CASES | OTHERS


def make(name: str, folder: Path) -> Path:
    """A whole file of a format."""
    contents, suffix = FORMATS[name]
    data = contents(folder)
    path = folder / f"recording{suffix}"
    path.write_bytes(data)
    return path


def npz(path: Path, events: Events, width: int = 40, height: int = 30) -> Path:
    with open_writer(path, width, height) as writer:
        writer.write(events)
    return path


def same(a: Any, b: Any) -> bool:
    return all(np.array_equal(getattr(a, n), getattr(b, n)) for n in "txyp")


@pytest.mark.parametrize("name", FORMATS)
def test_every_format(name: str, tmp_path: Path) -> None:
    """Events, counts, size, slices; twice, as it is read anew each time."""
    path = make(name, tmp_path)
    with open_recording(path) as reader:
        whole = reader.read()
    assert len(whole) == len(EVENTS)
    with evis.open(path) as rec:
        assert (rec.width, rec.height) == (reader.info.width, reader.info.height)
        for _ in range(2):
            assert same(rec.read(), whole)
        assert same(Events.concatenate([window.events for window in rec]), whole)
        counts = rec.counts
        assert (counts.events, counts.on, counts.off) == (90, int(whole.p.sum()), 90 - int(whole.p.sum()))
        assert (rec.start_ns, rec.end_ns) == (whole.t[0], whole.t[-1])
        assert rec.duration_ns == whole.t[-1] - whole.t[0]
        a, b = int(whole.t[20]), int(whole.t[70])
        if (np.diff(whole.t) >= 0).all():
            assert same(rec[a:b].read(), whole[(whole.t >= a) & (whole.t < b)])
        assert {"t", "x", "y", "p"} <= rec.numpy().keys()


@pytest.mark.parametrize("cut", [0.3, 0.6, 0.95])
@pytest.mark.parametrize("name", CASES)
def test_cut_files_give_what_the_readers_give(name: str, cut: float, tmp_path: Path) -> None:
    path = make(name, tmp_path)
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * cut)])
    try:
        with open_recording(path) as reader:
            whole = reader.read()
    except RecordingError as error:
        with pytest.raises(RecordingError) as met:
            evis.open(path).read()
        assert str(met.value) == str(error)
        return
    rec = evis.open(path)
    assert same(rec.read(), whole)
    assert rec.info.truncated == reader.info.truncated and rec.info.warnings == reader.info.warnings
    assert rec.counts.dropped == reader.counters()


def test_a_slice_of_a_slice(tmp_path: Path) -> None:
    """Times are exact to the ns; 2^53 ns is 104 days, and later times are exact too."""
    base = 2**60
    t = base + np.arange(100, dtype=np.int64)
    rec = evis.open(npz(tmp_path / "late.npz", Events.of(t, t % 40, t % 30, t % 2)))
    assert rec[base + 10 : base + 20].numpy()["t"].tolist() == list(range(base + 10, base + 20))
    assert rec[base + 10 :][: base + 13].numpy()["t"].tolist() == [base + 10, base + 11, base + 12]
    assert rec[: base + 2][base + 50 :].counts.events == 0
    assert rec[np.int64(base + 98) :].counts.events == 2


@pytest.mark.parametrize("dt", [1, 7, 1000])
@pytest.mark.parametrize("overlap", [0, 0.4])
def test_windows_by_time(dt: int, overlap: float, tmp_path: Path) -> None:
    """Each is what lies in [start, end), they follow one another, and none is left out."""
    t = np.array([3, 3, 4, 9, 10, 30, 31, 31, 31, 55])
    rec = evis.open(npz(tmp_path / "a.npz", Events.of(t, t % 40, t % 30, t % 2)))
    overlap = int(dt * overlap)
    windows = list(rec.windows(dt, overlap=overlap))
    for k, window in enumerate(windows):
        assert (window.start_ns, window.end_ns) == (3 + k * (dt - overlap), 3 + k * (dt - overlap) + dt)
        assert window.t.tolist() == t[(t >= window.start_ns) & (t < window.end_ns)].tolist()
        assert (window.width, window.height) == (40, 30)
    assert windows[-1].t[-1] == 55 and (len(windows) == 1 or windows[-2].end_ns <= 55)


def test_windows_of_a_slice_begin_with_it(tmp_path: Path) -> None:
    t = np.arange(100) * 10
    rec = evis.open(npz(tmp_path / "a.npz", Events.of(t, t % 40, t % 30, t % 2)))
    windows = list(rec[95:335].windows(100))
    assert [(w.start_ns, len(w)) for w in windows] == [(95, 10), (195, 10), (295, 4)]


@pytest.mark.parametrize("suffix", [".npz", ".dat", ".aedat4"])
@pytest.mark.parametrize(("count", "overlap"), [(1, 0), (7, 0), (7, 3), (30, 29), (90, 0), (1000, 5)])
def test_windows_by_count(suffix: str, count: int, overlap: int, tmp_path: Path) -> None:
    path = tmp_path / f"a{suffix}"
    with open_writer(path, 34, 34) as writer:
        for a in range(0, 90, 30):
            writer.write(EVENTS[a : a + 30])
    rec = evis.open(path)
    t, step = rec.numpy()["t"], count - overlap
    expected = [t[a : a + count].tolist() for a in range(0, max(90 - overlap, 1), step)]
    assert [w.t.tolist() for w in rec.windows(count=count, overlap=overlap)] == expected


def test_windows_across_blocks(tmp_path: Path) -> None:
    """In small packets: the same as of one block."""
    path = tmp_path / "a.aedat4"
    rng = np.random.default_rng(0)
    t = np.sort(rng.integers(0, 10**6, 3000)) * 1000
    events = Events.of(t, rng.integers(0, 40, 3000), rng.integers(0, 30, 3000), rng.integers(0, 2, 3000))
    with open_writer(path, 40, 30) as writer:
        for a in range(0, 3000, 100):
            writer.write(events[a : a + 100])
    one = npz(tmp_path / "a.npz", events)
    pairs = [list(zip(evis.open(path).windows(d, overlap=o), evis.open(one).windows(d, overlap=o), strict=True))
             for d, o in ((10**7, 0), (10**8, 99_000_000), (10**10, 0))]  # fmt: skip
    assert all(same(a, b) and a.start_ns == b.start_ns for pair in pairs for a, b in pair)


def test_times_that_begin_anew(tmp_path: Path) -> None:
    """As in a bag of several episodes: nothing is put off until the times have caught up."""
    t = np.concatenate([np.arange(0, 100, 10), np.arange(5, 55, 10)])
    windows = list(evis.open(npz(tmp_path / "a.npz", Events.of(t, t % 40, t % 30, t % 2))).windows(50))
    assert [(w.start_ns, w.t.tolist()) for w in windows] == [
        (0, [0, 10, 20, 30, 40]),
        (50, [50, 60, 70, 80, 90]),
        (5, [5, 15, 25, 35, 45]),
    ]


def test_events_out_of_order_stay_in_place(tmp_path: Path) -> None:
    t = np.array([0, 9, 12, 8, 13, 25])
    windows = list(evis.open(npz(tmp_path / "a.npz", Events.of(t, t, t, t % 2))).windows(10))
    assert [w.t.tolist() for w in windows] == [[0, 9], [12, 8, 13], [25]]


def test_a_jump_of_the_times_does_not_go_on_for_ever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(windows_module, "MOST_EMPTY", 1000)
    t = np.array([0, 1, 2**62])
    rec = evis.open(npz(tmp_path / "a.npz", Events.of(t, [1, 2, 3], [1, 2, 3], [1, 0, 1])))
    with pytest.raises(RecordingError, match="windows of 1000 ns and more: slice the recording"):
        for _ in rec.windows(1000):
            pass
    assert [len(w) for w in rec.windows(count=2)] == [2, 1]


def test_memory_of_a_long_recording_is_bounded(tmp_path: Path) -> None:
    """Windows and counts hold a block at a time: 6 M events of 13 bytes in 80 MB would show."""
    import tracemalloc

    path, n = tmp_path / "long.dat", 200_000
    with open_writer(path, 640, 480) as writer:
        x = np.arange(n) % 640
        for k in range(30):
            writer.write(Events.of((np.arange(n) + k * n) * 1000, x, x % 480, x % 2))
    tracemalloc.start()
    total = sum(len(window) for window in evis.open(path).windows(10_000_000))
    assert total == evis.open(path).counts.events == 30 * n
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 40e6


def test_representations_take_windows(tmp_path: Path) -> None:
    from evis.events.representations import count_image, voxel_grid

    rec = evis.open(npz(tmp_path / "a.npz", EVENTS, 34, 34))
    total = sum(int(count_image(w).values.sum()) for w in rec.windows(2_000_000))
    assert total == len(EVENTS)
    window = next(rec.windows(10**9))
    assert voxel_grid(window, 5, window=(window.start_ns, window.end_ns)).values.shape == (5, 34, 34)


BAD: list[tuple[str, type[Exception], Any]] = [
    ("times are whole ns, not 0.1", TypeError, lambda rec: rec[0.1:0.2]),
    ("sliced by time, rec\\[start_ns:stop_ns\\], not by 3", TypeError, lambda rec: rec[3]),
    ("has no step", ValueError, lambda rec: rec[0:10:2]),
    ("by dt or by count", ValueError, lambda rec: rec.windows()),
    ("by dt or by count", ValueError, lambda rec: rec.windows(5, count=5)),
    ("dt is 0.01; it must be a whole number of ns", ValueError, lambda rec: rec.windows(0.01)),
    ("count is 0", ValueError, lambda rec: rec.windows(count=0)),
    ("do not advance", ValueError, lambda rec: rec.windows(5, overlap=5)),
    ("no bag with messages", RecordingError, lambda rec: rec.messages("/cam0/labels")),
]


@pytest.mark.parametrize(("text", "kind", "call"), BAD)
def test_bad_input_is_named(text: str, kind: type[Exception], call: Any, tmp_path: Path) -> None:
    rec = evis.open(npz(tmp_path / "a.npz", EVENTS, 34, 34))
    with pytest.raises(kind, match=text):
        call(rec)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    npz(tmp_path / "disk.npz", EVENTS)
    with pytest.raises(RecordingError, match=r"no such file.*disk.npz"):
        evis.open(tmp_path / "disc.npz")
    (tmp_path / "noise.bin").write_bytes(bytes(range(256)) * 40)
    with pytest.raises(RecordingError, match=r"noise\.bin"):
        evis.open(tmp_path / "noise.bin").read()


def test_closed_is_closed(tmp_path: Path) -> None:
    with evis.open(npz(tmp_path / "a.npz", EVENTS, 34, 34)) as rec:
        assert rec.counts.events == 90
    with pytest.raises(RecordingError, match="has been closed"):
        rec.read()
    with pytest.raises(RecordingError, match="has been closed"):
        rec[0:1].read()
