"""Events under the names that other programs give them: columns of text, arrays of .npz, members of archives, files
that are compressed as a whole, bags in several files."""

from __future__ import annotations

import zipfile

import numpy as np
import pytest
from file_cases import event_packet, save, small_events
from small_files import CASES, EVENTS, OTHERS
from stream_cases import random_events, same

from evis.events import Events, RecordingError, open_recording
from evis.events.codecs.prophesee.evt3 import Encoder

WHOLE = small_events(60)


def lines(form: str, events: Events = WHOLE) -> str:
    """One line an event; `form` with s, us, ns, x, y, p to be filled in."""
    rows = zip(events.t.tolist(), events.x.tolist(), events.y.tolist(), events.p.tolist())
    return "".join(form.format(s=f"{t / 1e9:.6f}", us=t // 1000, ns=t, x=x, y=y, p=p) + "\n" for t, x, y, p in rows)


TEXTS = [
    ("t,x@34,y@40,on\n", "{us},{x},{y},{p}", (34, 40)),
    ("timestamp,x,y,polarity\n", "{us},{x},{y},{p}", None),
    ("timestamp_us;x;y;p\n", "{us};{x};{y};{p}", None),
    ("t_ns,x,y,p\n", "{ns},{x},{y},{p}", None),
    ("t,x,y,p\n", "{ns},{x},{y},{p}", None),
    ("%geometry:50,44\n", "{x},{y},{p},{us}", (50, 44)),
    ("# geometry 50x44\n", "{s} {x} {y} {p}", (50, 44)),
    ("50 44\n", "{s} {x} {y} {p}", (50, 44)),
    ("# timestamps x y polarity\n", "{s}\t{x}\t{y}\t{p}", None),
    ("", "{us} {x} {y} {p}", None),
    ("", "{x} {y} {us} {p}", None),
    ("", "{p} {us} {x} {y}", None),
    ("", "{x}.0 {y}.0 {p}.0 {us}.000", None),
    ("# events t x y p\n# of a night\n", "{s} {x} {y} {p}", None),
    ("t [s],x [px],y [px],p\n", "{s},{x},{y},{p}", None),
    ("t [us],x,y,p\n", "{us},{x},{y},{p}", None),
    ("t (ns),xs,ys,ps\n", "{ns},{x},{y},{p}", None),
]


@pytest.mark.parametrize(("head", "form", "size"), TEXTS)
def test_names_and_units_of_text(head, form, size, tmp_path):
    """Every program has its own; the size of the sensor too, where the file says it."""
    with open_recording(save(tmp_path / "a.csv", (head + lines(form)).encode())) as recording:
        same(recording.read(), WHOLE)
        if size:
            assert (recording.info.width, recording.info.height, recording.info.geometry_from) == (*size, "header")


def test_whole_seconds_are_seconds(tmp_path):
    """With a point, beside coordinates without; or in a column that says so."""
    t = np.arange(5) * 1_000_000_000
    for head, form in (("", "{} 1 2 1"), ("t [s],x,y,p\n", "{},1,2,1"), ("t_s x y p\n", "{} 1 2 1")):
        text = head + "".join(form.format(f"{i}.0" if not head else i) + "\n" for i in range(5))
        with open_recording(save(tmp_path / "a.txt", text.encode())) as recording:
            np.testing.assert_array_equal(recording.read().t, t)


@pytest.mark.parametrize("times", [1, 40])
@pytest.mark.parametrize(
    ("head", "form"), [("t,x,y,p,label\n", "{s},{x},{y},{p},car"), ("kind,x,y,p,t\n", "a-b,{x},{y},{p},{s}")]
)
def test_a_further_column_of_words(head, form, times, tmp_path):
    """Changes nothing of the others, in a file of any length: times in seconds stay seconds."""
    (tmp_path / "a.csv").write_text(head + lines(form) * times)
    with open_recording(tmp_path / "a.csv") as recording:
        found = recording.read()
    assert len(found) == 60 * times
    same(found[:60], WHOLE)


def test_times_since_1970_can_only_be_ns(tmp_path):
    """1.6e18 in a line of names without a unit."""
    late = Events(WHOLE.t + 1_600_000_000_000_000_000, WHOLE.x, WHOLE.y, WHOLE.p)
    text = "timestamp,x,y,polarity\n" + lines("{ns},{x},{y},{p}", late)
    with open_recording(save(tmp_path / "a.csv", text.encode())) as recording:
        same(recording.read(), late)


def archive(path, members):
    with zipfile.ZipFile(path, "w") as out:
        for name, text in members.items():
            out.writestr(name, text)
    return path


def test_the_events_of_an_archive_are_found(tmp_path):
    """Beside calibration, images and poses; with two files of events the topic says which."""
    members = {
        "slider/calib.txt": "199.0 198.8 132.1 110.7 -0.36 0.15 -0.0003 -0.0002 0.0\n",
        "slider/imu.txt": "0.01 0 0 9.8 0 0 0\n" * 9,
        "slider/images.txt": "0.003 images/frame_0.png\n" * 9,
        "slider/images/frame_0.png": "x",
        "__MACOSX/slider/._events.txt": "\0\1",
        "slider/events.txt": lines("{s} {x} {y} {p}"),
    }
    with open_recording(archive(tmp_path / "a.zip", members)) as recording:
        same(recording.read(), WHOLE)
    members["slider/more.txt"] = lines("{s} {x} {y} {p}", WHOLE[:20])
    path = archive(tmp_path / "b.zip", members)
    with pytest.raises(RecordingError, match=r"5 text files, 2 of them events; name one of .*slider/more.txt"):
        open_recording(path)
    with open_recording(path, topic="slider/more.txt") as recording:
        same(recording.read(), WHOLE[:20])
    with pytest.raises(RecordingError, match="no text file 'x' in the archive"):
        open_recording(path, topic="x")


@pytest.mark.parametrize("name", ["events", "a b/d\u00e9j\u00e0 vu/\u4e8b\u4ef6.TXT", "events.log"])
def test_text_of_any_name_in_an_archive(name, tmp_path):
    """Where nothing is named as text, what holds events is it."""
    path = archive(tmp_path / "a.zip", {"readme.md": "# Night\n", name: "40 44\n" + lines("{s} {x} {y} {p}")})
    with open_recording(path) as recording:
        same(recording.read(), WHOLE)
        assert (recording.info.width, recording.info.height) == (40, 44)


@pytest.mark.parametrize(
    ("names", "times", "unit"),
    [
        ("ts xs ys ps", WHOLE.t // 1000, "us"),
        ("timestamps x y polarity", WHOLE.t / 1e9, "s"),
        ("t_us x y p", WHOLE.t // 1000, "us"),
        ("t_ns x y on", WHOLE.t, ""),
        ("t x y pol", WHOLE.t, "ns"),
        ("t x y p", WHOLE.t / 1e9, "s"),
    ],
)
def test_arrays_of_other_names(names, times, unit, tmp_path):
    """Times by name: t and t_ns are ns, others us, or s where they have a fraction; which is said."""
    arrays = (times, WHOLE.x.astype(np.int16), WHOLE.y, np.where(WHOLE.p == 1, 1, -1).astype(np.int8))
    np.savez(tmp_path / "a.npz", **dict(zip(names.split(), arrays)))
    with open_recording(tmp_path / "a.npz") as recording:
        same(recording.read(), WHOLE)
        said = [w for w in recording.info.warnings if "are taken as" in w]
        assert [w.endswith(f"as {unit}") for w in said] == ([True] if unit else [])


@pytest.mark.parametrize("kind", ["f4", "f8", ">u2", "u8"])
@pytest.mark.parametrize("column", [False, True])
def test_arrays_of_other_types(kind, column, tmp_path):
    """Coordinates as any number, arrays of one column; pixels that are none are refused."""
    shape = (-1, 1) if column else (-1,)
    arrays = {"x": WHOLE.x.astype(kind), "y": WHOLE.y.astype(kind), "p": WHOLE.p.astype(kind), "t_ns": WHOLE.t}
    np.savez(tmp_path / "a.npz", **{n: a.reshape(shape) for n, a in arrays.items()})
    with open_recording(tmp_path / "a.npz") as recording:
        same(recording.read(), WHOLE)
    if kind[0] == "f":
        np.savez(tmp_path / "b.npz", **{**arrays, "x": arrays["x"] + np.float32(0.25)})
        with pytest.raises(RecordingError, match="x has values that are no pixels"):
            open_recording(tmp_path / "b.npz")


def test_arrays_that_are_missing_are_named(tmp_path):
    """With what is there."""
    np.savez(tmp_path / "a.npz", x=np.arange(3), y=np.arange(3), frames=np.zeros(2))
    with pytest.raises(RecordingError, match="no array t, p in the archive; it has frames, x, y"):
        open_recording(tmp_path / "a.npz")


@pytest.mark.parametrize("name", ["db3", "mcap", "raw evt3", "text", "hdf5 plain"])
def test_a_file_compressed_as_a_whole(name, tmp_path, monkeypatch):
    """As rosbag2 does; the unpacked copy never has a name for long, and a file that is cut says so."""
    import zstandard

    make, suffix = (CASES | OTHERS)[name]
    packed = zstandard.ZstdCompressor().compress(make(tmp_path))
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    with open_recording(save(tmp_path / f"bag_0{suffix}.zstd", packed)) as recording:
        assert not list((tmp_path / "temporary").iterdir())
        same(recording.read(), EVENTS)
        recording.seek(int(EVENTS.t[40]))
        assert recording.next_t_ns == int(EVENTS.t[40])
        assert recording.info.path.endswith(".zstd") and recording.info.size_bytes == len(packed)
    with pytest.raises(RecordingError, match=r"cut.zstd: its compressed data are damaged or cut"):
        open_recording(save(tmp_path / "cut.zstd", packed[:30]))


def test_a_bag_in_several_files(tmp_path):
    """All of them are read, in the order of their numbers, and EVT3 goes on from one to the next."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    events = random_events(3, 4000)
    events.t[:] = np.sort(events.t) + (1 << 24) * 1000 - 4_000_000  # the 24 bits turn in the second file
    encoder, store = Encoder(), get_typestore(Stores.ROS2_HUMBLE)
    text = "std_msgs/Header header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\nstring encoding\n"
    kind = "event_camera_msgs/msg/EventPacket"
    store.register(get_types_from_msg(text + "bool is_bigendian\nuint8[] events\n", kind))
    (tmp_path / "bag").mkdir()
    for i, number in enumerate((0, 2, 10, 11)):
        payload = encoder.encode(events[i * 1000 : i * 1000 + 1000])
        with rosbag2.Writer(tmp_path / f"part{i}", version=8) as writer:
            connection = writer.add_connection("/e", kind, typestore=store)
            writer.write(connection, 1000 + i, event_packet("evt3", payload, 640, 480, i, 0, True))
        (part,) = (tmp_path / f"part{i}").glob("*.db3")
        part.rename(tmp_path / "bag" / f"bag_{number}.db3")
    save(tmp_path / "bag" / "metadata.yaml", b"rosbag2_bagfile_information:\n")
    with open_recording(tmp_path / "bag") as recording:
        same(recording.read(), events)
        recording.seek(int(events.t[3500]))
        assert recording.next_t_ns == int(events.t[3500])
    save(tmp_path / "bag" / "bag_10.db3", b"SQLite format 3\0" + bytes(200))
    with open_recording(tmp_path / "bag") as recording:
        left = recording.read()
        same(left[:2000], events[:2000])
        # behind the gap only what follows the next TIME_HIGH has a time
        np.testing.assert_array_equal(left.t[2000:], events.t[4000 - (len(left) - 2000) :])
        assert any("left out" in w and "bag_10.db3" in w for w in recording.info.warnings)
        assert recording.counters()["messages_missing"] == 1
