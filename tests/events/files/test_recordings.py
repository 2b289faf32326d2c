"""Recording files: real ones, damaged ones, strange ones; what is written can be read by others."""

from __future__ import annotations

import io
import resource
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stream_cases import random_events, same, sha256_us

from evis.events import Events, RecordingError, open_recording, open_writer
from evis.events.codecs.prophesee import evt2, evt3
from evis.events.files.prophesee.raw import guess_encoding

REAL = ["derived/gen31_vga_from_bag1.raw", "prophesee/faery_evt2.raw"]
CODECS = {"evt2": evt2, "evt3": evt3}
HEADER = b"% evt 3.0\n% format EVT3;height=480;width=640\n% geometry 640x480\n% end\n"


HEADS = [b"", b"% ", HEADER, b"% evt 2.0\n", b"% system_ID 49\n", b"PK\x03\x04"]


def raw_file(tmp_path, data: bytes, header: bytes = HEADER):
    path = tmp_path / "a.raw"
    path.write_bytes(header + data)
    return path


@pytest.mark.parametrize("name", REAL)
@pytest.mark.parametrize("backend", ["numpy", "warp"])
def test_real_recordings(name, backend, truth, recording_path):
    """Size, events and hash of the real files; the EVT2 file names its sensor only by system_ID."""
    with open_recording(recording_path(name), backend) as recording:
        assert (recording.info.width, recording.info.height) == (640, 480)
        assert recording.info.geometry_from == ("system_ID" if "faery" in name else "header")
        assert not recording.info.truncated and not recording.info.warnings
        events = recording.read()
    assert sha256_us(events) == truth[name]["sha256"]


@pytest.mark.parametrize("name", REAL)
@pytest.mark.parametrize("backend", ["numpy", "warp"])
def test_windows_are_exact_and_complete(name, backend, truth, recording_path):
    """Consecutive 7 ms windows hold all events in order, and no event after their end."""
    with open_recording(recording_path(name), backend) as recording:
        first, parts, wire, step = recording.next_t_ns, [], 0, 7_000_000
        assert first == truth[name]["first"][0] * 1000 - (5000 if "gen31" in name else 0)  # a trigger comes first there
        stop = first
        while recording.next_t_ns is not None:
            stop += step
            parts.append(recording.read_until(stop))
            wire += len(recording.raw)
            assert not len(parts[-1]) or parts[-1].t.max() <= stop
            assert recording.next_t_ns is None or recording.next_t_ns > stop
    assert sha256_us(Events.concatenate(parts)) == truth[name]["sha256"]
    data = recording_path(name).read_bytes()
    header = data.index(b"% end\n") + 6 if b"% end\n" in data[:1000] else data.index(b"% evt 2.0\n") + 10
    assert wire == len(data) - header


@pytest.mark.parametrize("codec", ["evt2", "evt3"])
def test_every_prefix_gives_the_events_before_the_cut(codec, tmp_path):
    """A file cut at any byte gives a prefix of the events, all whose words are complete, and says that it was cut."""
    events = random_events(2, 60, triggers=4)
    data = CODECS[codec].Encoder().encode(events)
    header = HEADER if codec == "evt3" else HEADER.replace(b"evt 3.0", b"evt 2.0").replace(b"EVT3", b"EVT2")
    size = CODECS[codec].Decoder.word.itemsize
    for cut in range(len(data) + 1):
        with open_recording(raw_file(tmp_path, data[:cut], header)) as recording:
            got = recording.read()
            assert recording.info.truncated == bool(cut % size)
            assert bool(recording.info.warnings) == bool(cut % size or not cut)
        n = len(CODECS[codec].Decoder(640, 480).decode(data[: cut - cut % size]))
        same(got[:], events[:n])
        assert len(got) == n
    assert n == len(events)


def test_every_cut_header_is_a_clear_error_or_no_events(tmp_path):
    """A file cut inside its header never gives events that are not there."""
    for cut in range(1, len(HEADER)):
        path = tmp_path / "a.raw"
        path.write_bytes(HEADER[:cut])
        try:
            with open_recording(path) as recording:
                assert len(recording.read()) == 0
        except RecordingError as e:
            assert "a.raw" in str(e)


@pytest.mark.parametrize(
    ("name", "header", "record"),
    [
        ("a.dat", b"% Data file containing CD events.\n% Version 2\n% Height 28\n% Width 28\n\x0c\x08", "<u4,<u4"),
        ("a.aedat", b"#!AER-DAT2.0\r\n# This is a raw AE data file\r\n# AEChip: eu.seebetter.DAVIS346\r\n", ">u4,>u4"),
    ],
)
def test_the_text_of_a_cut_header_is_no_event(name, header, record, tmp_path):
    """Records of 8 bytes would fit into what is left of a line; a whole file gives its event."""
    path = tmp_path / name
    for cut in range(len(name) + 4, len(header)):
        path.write_bytes(header[:cut])
        with open_recording(path) as recording:
            assert len(recording.read()) == 0
            inside_a_line = not header[:cut].endswith(b"\n")
            assert recording.info.truncated or not inside_a_line
            assert any("cut inside the header" in w for w in recording.info.warnings) or not inside_a_line
    path.write_bytes(header + np.array([(1000, 3)] if name == "a.dat" else [(3 << 12, 1000)], record).tobytes())
    with open_recording(path) as recording:
        assert recording.read().x.tolist() == [3]


def test_geometry_from_largest_coordinates(tmp_path):
    """No geometry and an unknown sensor: the largest coordinates, with a warning; and nothing is dropped."""
    data = evt3.Encoder().encode(Events.of([1000, 2000, 3000], [5, 1200, 7], [9, 2, 701], [1, 0, 1]))
    with open_recording(raw_file(tmp_path, data, b"% evt 3.0\n% serial_number 42\n% end\n")) as recording:
        info = recording.info
        assert (info.width, info.height, info.geometry_from, info.serial) == (1201, 702, "events", "42")
        assert "1201x702" in info.warnings[0]
        assert recording.read().t.tolist() == [1_000_000 // 1000, 2000, 3000]


@pytest.mark.parametrize("geometry", [b"% geometry 0x0\n", b"% geometry 99999x99999\n", b"% geometry axb\n"])
def test_impossible_geometry_is_not_believed(geometry, tmp_path):
    """A header that lies about the size falls back to the system_ID table."""
    path = raw_file(tmp_path, evt3.Encoder().encode(random_events(1, 50)), b"% evt 3.0\n% system_ID 49\n" + geometry)
    with open_recording(path) as recording:
        assert (recording.info.width, recording.info.height) == (1280, 720)
        assert len(recording.read()) == 50


def test_events_outside_the_sensor_are_counted(tmp_path):
    """Rows and columns beyond the geometry are dropped, and it is said how many."""
    data = evt3.Encoder().encode(Events.of([1000, 2000, 3000], [5, 700, 7], [9, 2, 480], [1, 0, 1]))
    with open_recording(raw_file(tmp_path, data)) as recording:
        assert recording.read().x.tolist() == [5]
        assert recording.counters() == {"events_outside": 2}


@pytest.mark.parametrize("codec", ["evt2", "evt3"])
def test_encoding_is_found_in_the_words(codec, tmp_path):
    """A header that does not name the encoding: the word types tell."""
    events = random_events(7, 3000, step_us=400)
    data = CODECS[codec].Encoder().encode(events)
    assert guess_encoding(data) == codec
    with open_recording(raw_file(tmp_path, data, b"% system_ID 49\n% end\n")) as recording:
        assert recording.info.encoding == codec
        same(recording.read(), events)


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"", "empty"),
        (b"hello, world", "not a recording"),
        (b"\x89HDF\r\n\x1a\n", "HDF5"),
        (b"SQLite format 3\0" + bytes(200), "SQLite"),
        (b"#ROSBAG V1.2\n", "another version"),
        (b"% nothing known\n% end\n\0\0", "damaged RAW header"),
        (b"% evt 9.0\n% end\n\0\0", "evt9.0 is not supported"),
        (b"% serial_number 1\n% end\n" + bytes(range(256)) * 8, "no encoding"),
        (b"PK\x03\x04garbage", "damaged or truncated"),
        (b"PK\x05\x06" + bytes(18), "no array t, x, y, p"),
    ],
)
def test_what_cannot_be_read_is_named(content, text, tmp_path):
    """One line with the file and what it is instead."""
    path = tmp_path / "strange.raw"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=text) as error:
        open_recording(path)
    assert "strange.raw" in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("told", ["2.0", "2.1", "3.0"])
@pytest.mark.parametrize("encoding", ["evt2", "evt21", "evt3"])
def test_a_header_with_the_wrong_encoding_is_told(encoding, told, tmp_path):
    """It names how many words do not fit and what fits; a right header brings no warning."""
    with open_writer(tmp_path / "right.raw", 640, 480, encoding) as writer:
        writer.write(random_events(4, 30_000))
    words = (tmp_path / "right.raw").read_bytes().partition(b"% end\n")[2]
    path = raw_file(tmp_path, words, f"% evt {told}\n% geometry 640x480\n% end\n".encode())
    with open_recording(path) as recording:
        named, warnings = recording.info.encoding, recording.info.warnings
        recording.read()
    if named == encoding:
        assert warnings == []
    else:
        (text,) = [w for w in warnings if not w.startswith("cut inside a word")]  # of a length for shorter words
        assert f"are unknown to {named}" in text and int(text.split()[0]) > 0
        assert f"they read as {encoding}: the header may name the wrong encoding" in text


def test_garbage_under_a_good_header_is_told(tmp_path):
    """Where nothing fits, no encoding is proposed."""
    words = np.random.default_rng(0).integers(0, 256, 1 << 18, np.uint8).tobytes()
    with open_recording(raw_file(tmp_path, words)) as recording:
        (text,) = recording.info.warnings
        assert "unknown to evt3" in text and "no other known encoding" in text


def test_a_topic_of_a_file_without_topics(tmp_path):
    """Refused, and not ignored."""
    with open_writer(tmp_path / "a.npz", 640, 480) as writer:
        writer.write(random_events(4, 100))
    for path in (tmp_path / "a.npz", raw_file(tmp_path, b"")):
        with pytest.raises(RecordingError, match="has no topics; leave out the topic '/x'"):
            open_recording(path, topic="/x")


def test_missing_file_names_the_nearest(tmp_path):
    """A typing error in the name."""
    (tmp_path / "recording.raw").write_bytes(HEADER)
    with pytest.raises(RecordingError, match="did you mean 'recording"):
        open_recording(tmp_path / "recordin.raw")
    with pytest.raises(RecordingError, match="not a file"):
        open_recording(tmp_path)


@settings(max_examples=120, deadline=None)
@given(head=st.sampled_from(HEADS), data=st.binary(max_size=300))
def test_garbage_never_crashes(head, data, tmp_path_factory):
    """Whatever is in a file: events in range, or a RecordingError."""
    path = tmp_path_factory.mktemp("garbage") / "a.raw"
    path.write_bytes(head + data)
    try:
        with open_recording(path) as recording:
            events = recording.read()
            assert not len(events) or (events.x.max() < recording.info.width and events.y.max() < recording.info.height)
    except RecordingError as e:
        assert str(path) in str(e)


@settings(max_examples=60, deadline=None)
@given(at=st.integers(0, 2000), byte=st.integers(0, 255), cut=st.integers(0, 3000))
def test_damaged_npz_is_an_error_or_reads(at, byte, cut, tmp_path_factory):
    """One wrong byte, or a cut: an error with the file's name, or whole numbers of the right types; never a crash."""
    path = tmp_path_factory.mktemp("npz") / "a.npz"
    with open_writer(path, 640, 480) as writer:
        writer.write(random_events(1, 40))
    data = bytearray(path.read_bytes())
    data[at % len(data)] = byte
    path.write_bytes(data[: max(len(data) - cut, 1)] if cut < 1000 else data)
    try:
        with open_recording(path) as recording:
            events = recording.read()
        assert events.t.dtype == np.int64 and events.x.dtype == np.uint16
    except RecordingError as e:
        assert str(path) in str(e)


@pytest.mark.parametrize("suffix", [".raw", ".npz"])
def test_written_files_read_back(suffix, tmp_path):
    """In several writes; the size of the sensor is kept, and the same events make the same bytes."""
    events = random_events(9, 2000)
    for name in ("a", "b"):
        with open_writer(tmp_path / (name + suffix), 700, 500) as writer:
            for a in range(0, 2000, 300):
                writer.write(events[a : a + 300])
    with open_recording(tmp_path / ("a" + suffix)) as recording:
        assert (recording.info.width, recording.info.height) == (700, 500)
        same(recording.read(), events)
    assert (tmp_path / ("a" + suffix)).read_bytes() == (tmp_path / ("b" + suffix)).read_bytes()


def test_npz_is_what_numpy_makes(tmp_path):
    """numpy reads ours, and ours reads numpy's, compressed or not, without a size inside."""
    events = random_events(4, 500)
    with open_writer(tmp_path / "ours.npz", 640, 480) as writer:
        writer.write(events)
    with np.load(tmp_path / "ours.npz", allow_pickle=False) as archive:
        assert [archive[n].dtype.str for n in "txyp"] == ["<i8", "<u2", "<u2", "|u1"]
        for n in "txyp":
            np.testing.assert_array_equal(archive[n], getattr(events, n))
    for save in (np.savez, np.savez_compressed):
        save(tmp_path / "theirs.npz", t=events.t, x=events.x.astype(np.int32), y=events.y, p=events.p.astype(bool))
        with open_recording(tmp_path / "theirs.npz") as recording:
            assert recording.info.geometry_from == "events" and recording.info.width == events.x.max() + 1
            same(recording.read(), events)


def test_written_raw_is_read_by_the_evt3_library(tmp_path):
    """Header and words as other programs expect them."""
    library = pytest.importorskip("evt3")
    events = random_events(6, 3000)
    with open_writer(tmp_path / "a.raw", 640, 480, "evt3") as writer:
        writer.write(events)
    theirs = library.decode_file(str(tmp_path / "a.raw"))
    assert (theirs.sensor_width, theirs.sensor_height) == (640, 480)
    np.testing.assert_array_equal(theirs.t.astype(np.int64) * 1000, events.t)
    np.testing.assert_array_equal(theirs.x, events.x)


@pytest.mark.parametrize(
    ("arrays", "text"),
    [
        ({"t": np.zeros(3, complex)}, "t is complex128"),
        ({"t": np.array([0.5, np.nan, 1])}, "t holds a value that is not finite"),
        ({"x": np.array([1, 2, 70000])}, "x runs from 1 to 70000"),
        ({"p": np.array([0, 1, 2])}, "p must be 0"),
        ({"y": np.zeros(2, np.uint16)}, "different lengths"),
        ({"t": np.array([None] * 3, object)}, "t is"),
    ],
)
def test_npz_of_other_things_is_refused(arrays, text, tmp_path):
    """Other numbers, values out of range, unequal lengths, pickled objects."""
    base = {n: np.arange(3) % 2 for n in "txyp"}
    np.savez(tmp_path / "a.npz", **(base | arrays))
    with pytest.raises(RecordingError, match=text), open_recording(tmp_path / "a.npz") as recording:
        recording.read()


def test_polarity_minus_one_is_off(tmp_path):
    """Some tools write -1 for OFF."""
    np.savez(tmp_path / "a.npz", t=np.arange(3), x=np.arange(3), y=np.arange(3), p=np.array([-1, 1, -1]))
    with open_recording(tmp_path / "a.npz") as recording:
        assert recording.read().p.tolist() == [0, 1, 0]


def test_colour_is_kept(tmp_path):
    """The optional colour channel goes through .npz."""
    events = Events.of([1, 2], [1, 2], [1, 2], [0, 1], [2, 1])
    with open_writer(tmp_path / "a.npz", 4, 4) as writer:
        writer.write(events)
    with open_recording(tmp_path / "a.npz") as recording:
        assert recording.read().c.tolist() == [2, 1]


def test_a_failed_write_leaves_nothing(tmp_path):
    """The old file stays as it was, and no partial one is left."""
    (tmp_path / "a.raw").write_bytes(b"old")
    with pytest.raises(ValueError, match="x up to 2047"), open_writer(tmp_path / "a.raw", 2048, 2048) as writer:
        writer.write(Events.of([1], [5000], [1], [1]))
    assert [p.name for p in tmp_path.iterdir()] == ["a.raw"]
    assert (tmp_path / "a.raw").read_bytes() == b"old"


def test_writers_name_what_they_cannot_do(tmp_path):
    """Extension, size, encoding, folder."""
    for arguments, text in [
        (("a.xyz", 4, 4), "cannot write '.xyz'"),
        (("a.raw", 5000, 4), "1 to 2048"),
        (("a.raw", 4, 4, "evt9"), "evt9"),
        (("a.npz", 4, 4, "evt3"), "for .raw"),
        (("none/a.raw", 4, 4), "folder"),
    ]:
        with pytest.raises(RecordingError, match=text):
            open_writer(tmp_path / arguments[0], *arguments[1:])


def test_text_is_exact(tmp_path):
    """Nanoseconds survive in both text forms."""
    events = Events.of([1_633_953_690_975_950_001, 1_633_953_690_975_950_002], [3, 4], [5, 6], [1, 0])
    for name in ("a.csv", "a.txt"):
        with open_writer(tmp_path / name, 10, 10) as writer:
            writer.write(events)
    assert (tmp_path / "a.csv").read_text().splitlines()[1] == "1633953690975950001,3,5,1"
    assert (tmp_path / "a.txt").read_text().splitlines()[1] == "1633953690.975950002 4 6 0"


def test_a_header_that_promises_more_than_there_is_gives_what_there_is(tmp_path):
    """A header inside the archive that promises 10^15 events: the ten that are there, and a word on the others."""
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<i8", "fortran_order": False, "shape": (10**15,)})
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        for name in "txyp":
            archive.writestr(name + ".npy", head.getvalue() + bytes(80))
    with open_recording(tmp_path / "a.npz") as recording:
        assert sum(len(block) for block in recording.blocks()) == 10
        assert recording.info.truncated
        assert any("ends at event 10 of 1000000000000000" in warning for warning in recording.info.warnings)


@pytest.mark.parametrize("name", ["a.raw", "a.npz", "a.txt"])
def test_a_full_disk_is_named(name, tmp_path):
    """A write that fails names the file and the cause, and leaves nothing behind."""
    events = random_events(1, 20_000)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, before[1]))
    try:
        with pytest.raises(RecordingError, match=f"{name}: writing failed"), open_writer(tmp_path / name, 9, 9) as out:
            out.write(events)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(tmp_path.iterdir())
