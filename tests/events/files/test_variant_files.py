"""Files as other programs write them: arrays with an event a row, whole files compressed, old and rare headers."""

from __future__ import annotations

import bz2
import gzip
import json
import lzma
import struct
import zipfile

import h5py
import numpy as np
import pytest
from file_cases import aedat3_packet, event_packet, mono, save, small_events
from small_files import CASES, EVENTS
from stream_cases import same

import evis
from evis.cli import main
from evis.events import Events, RecordingError, open_recording

WHOLE = small_events(300)
US = WHOLE.t // 1000


def read(path, **options) -> tuple[Events, object]:
    with open_recording(path, **options) as recording:
        return recording.read(), recording.info


def records(time_name="t", unit=1000, polarity="p"):
    table = np.zeros(len(WHOLE), [(time_name, "<i8"), ("x", "<i2"), ("y", "<u2"), (polarity, "i1")])
    table[time_name], table["x"], table["y"], table[polarity] = WHOLE.t // unit, WHOLE.x, WHOLE.y, WHOLE.p
    return table


SIGNED = np.where(WHOLE.p == 1, 1, -1)
TABLES = {
    "records": records(), "records of dv": records("timestamp", polarity="polarity"),
    "records in ns": records("t_ns", 1),
    "t x y p": np.stack([US, WHOLE.x, WHOLE.y, WHOLE.p], 1), "x y p t": np.stack([WHOLE.x, WHOLE.y, WHOLE.p, US], 1),
    "x y t p": np.stack([WHOLE.x, WHOLE.y, US, SIGNED], 1).astype(np.float64),
    "seconds": np.stack([WHOLE.t / 1e9, WHOLE.x, WHOLE.y, SIGNED], 1),
    "columns in a row": np.asfortranarray(np.stack([US, WHOLE.x, WHOLE.y, WHOLE.p], 1)),
}  # fmt: skip


@pytest.mark.parametrize("name", TABLES)
@pytest.mark.parametrize("packed", [False, True])
def test_an_event_a_row(name, packed, tmp_path):
    """As .npy, and as the only array of an .npz; what is assumed of the times is said."""
    path = tmp_path / ("a.npz" if packed else "a.npy")
    np.savez(path, events=TABLES[name]) if packed else np.save(path, TABLES[name])
    got, info = read(path)
    same(got, WHOLE)
    assert (info.width, info.height) == (34, 34)
    assert any("times are taken as" in w for w in info.warnings) == (name != "records in ns")
    with open_recording(path) as recording:
        recording.seek(int(WHOLE.t[200]))
        assert recording.next_t_ns == int(WHOLE.t[200])


@pytest.mark.parametrize("order", ["C", "F"])
def test_a_cut_array(order, tmp_path):
    """Rows before the cut are events; columns one after the other leave none."""
    np.save(tmp_path / "a.npy", np.asarray(TABLES["t x y p"], order=order))
    data = (tmp_path / "a.npy").read_bytes()
    path = save(tmp_path / "cut.npy", data[: 128 + 32 * 100 + 7])
    if order == "F":
        with pytest.raises(RecordingError, match="cut, and its columns follow one another"):
            open_recording(path)
        return
    got, info = read(path)
    same(got, WHOLE[:100])
    assert info.truncated and "cut: 100 of 300 events are there" in info.warnings


@pytest.mark.parametrize(
    ("array", "text"),
    [
        (np.zeros((5, 3)), "known are an event a row"),
        (np.array([{}], object), "known are an event a row"),
        (np.full((5, 4), 7), "none of its four columns can be the polarity"),
        (np.array([[0.5, 1.5, 2, 1]]), "none of its four columns"),
    ],
)
def test_other_arrays_are_named(array, text, tmp_path):
    """What it is, and what would be read; nothing is unpickled."""
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(RecordingError, match=text):
        open_recording(tmp_path / "a.npy")


@pytest.mark.parametrize("pack", [gzip.compress, bz2.compress, lzma.compress])
@pytest.mark.parametrize("name", ["aedat4", "text", "dat"])
def test_files_compressed_as_a_whole(pack, name, tmp_path):
    """gzip, bzip2 and xz as Zstandard; cut ones give what is before the cut."""
    make, suffix = CASES[name]
    whole = make(tmp_path)
    packed = pack(whole)
    got, info = read(save(tmp_path / f"b{suffix}.gz", packed))
    same(got, EVENTS)
    assert info.path.endswith(".gz") and not info.truncated
    if pack is gzip.compress and name == "text":
        got, info = read(save(tmp_path / "c.gz", packed[: len(packed) // 2]))
        assert info.truncated and 0 < len(got) < len(EVENTS)
        same(got, EVENTS[: len(got)])


def test_layers_of_packing_are_bounded(tmp_path):
    """An archive can hold itself; one packed three times over is read."""
    data = CASES["dat"][0](tmp_path)
    for layer in range(4):
        data = gzip.compress(data)
        path = save(tmp_path / "a.gz", data)
        if layer < 3:
            same(read(path)[0], EVENTS)
        else:
            with pytest.raises(RecordingError, match="packed more than 3 times"):
                open_recording(path)


def test_a_recording_in_a_zip_archive(tmp_path):
    """Alone it is read; with another one the topic says which."""
    (make, _), (other, _) = CASES["raw evt21"], CASES["dat"]
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("night/left.raw", make(tmp_path))
        archive.writestr("night/poses.yaml", "x: 1\n")
        archive.writestr("__MACOSX/night/._left.raw", "\0")
    same(read(tmp_path / "a.zip")[0], EVENTS)
    with zipfile.ZipFile(tmp_path / "a.zip", "a") as archive:
        archive.writestr("night/right.dat", other(tmp_path))
    with pytest.raises(
        RecordingError, match=r"an archive of 2 recordings; name one of night/left.raw, night/right.dat"
    ):
        open_recording(tmp_path / "a.zip")
    same(read(tmp_path / "a.zip", topic="night/right.dat")[0], EVENTS)
    with zipfile.ZipFile(tmp_path / "a.zip", "a") as archive:
        archive.writestr("night/Events.aedat4", CASES["aedat4"][0](tmp_path))
    same(read(tmp_path / "a.zip")[0], EVENTS)


def test_aedat_1(tmp_path):
    """Addresses of 16 bits, big endian, of a DVS128."""
    rows = zip(US.tolist(), WHOLE.x.tolist(), WHOLE.y.tolist(), WHOLE.p.tolist())
    body = b"".join(struct.pack(">Hi", y << 8 | 127 - x << 1 | 1 - p, t) for t, x, y, p in rows)
    head = b"#!AER-DAT1.0\r\n# This is a raw AE data file - do not edit\r\n"
    got, info = read(save(tmp_path / "a.dat", head + body))
    same(got, WHOLE)
    assert (info.format, info.width, info.height) == ("aedat1", 128, 128)


@pytest.mark.parametrize(
    ("chip", "size"),
    [
        ("eu.seebetter.ini.chips.davis.DAVIS240C", (240, 180)),
        ("ch.unizh.ini.jaer.chip.retina.DVXplorer", (640, 480)),
        ("eu.seebetter.ini.chips.davis.Davis208Pixelparade", (208, 192)),
    ],
)
def test_aedat_2_chips(chip, size, tmp_path):
    """The sensor that the header names."""
    rows = zip(US.tolist(), WHOLE.x.tolist(), WHOLE.y.tolist(), WHOLE.p.tolist())
    body = b"".join(struct.pack(">Ii", y << 22 | x << 12 | p << 11, t) for t, x, y, p in rows)
    got, info = read(save(tmp_path / "a.aedat", f"#!AER-DAT2.0\r\n# AEChip: {chip}\r\n".encode() + body))
    same(got, WHOLE)
    assert (info.width, info.height, info.geometry_from) == (*size, "header")


def test_aedat_3_of_two_cameras(tmp_path):
    """Their events are never mixed: the first one's, or those of the source that is asked for."""
    rows = zip(US.tolist(), WHOLE.x.tolist(), WHOLE.y.tolist(), WHOLE.p.tolist())
    packed = [struct.pack("<Ii", x << 17 | y << 2 | p << 1 | 1, t) for t, x, y, p in rows]

    def packet(source, part):
        data = aedat3_packet(1, 8, part)
        return data[:2] + struct.pack("<h", source) + data[4:]

    head = b"#!AER-DAT3.1\r\n#Format: RAW\r\n#Source 1: DAVIS240C\r\n#Source 2: DVS128\r\n#!END-HEADER\r\n"
    data = head + packet(1, packed[:100]) + packet(2, packed[50:90]) + packet(1, packed[100:])
    path = save(tmp_path / "a.aedat", data)
    got, info = read(path)
    same(got, WHOLE)
    assert (info.width, info.height) == (240, 180)
    assert info.warnings == ["sources 1 (DAVIS240C), 2 (DVS128) in one file: read is 1; name another as the topic"]
    got, info = read(path, topic="2")
    same(got, WHOLE[50:90])
    assert (info.width, info.height) == (128, 128)
    with pytest.raises(RecordingError, match=r"no source '7'; it has 1 \(DAVIS240C\), 2 \(DVS128\)"):
        open_recording(path, topic="7")


def text(form):
    rows = zip(US.tolist(), WHOLE.x.tolist(), WHOLE.y.tolist(), WHOLE.p.tolist())
    return "".join(form(i, *row) + "\n" for i, row in enumerate(rows))


TEXTS = {
    "true and false": "t_us,x,y,p\n" + text(lambda i, t, x, y, p: f"{t},{x},{y},{bool(p)}"),
    "a mark of UTF-8": "\ufeff" + text(lambda i, t, x, y, p: f"{t / 1e6:.6f} {x} {y} {p}"),
    "an index of pandas": ",timestamp,x,y,polarity\n" + text(lambda i, t, x, y, p: f"{i},{t},{x},{y},{p}"),
    "more columns": "id, timestamp, x, y, polarity, speed\n"
    + text(lambda i, t, x, y, p: f"7, {t}, {x}, {y}, {p}, 0.5"),
    "exponents": text(lambda i, t, x, y, p: f"{t / 1e6:.9e} {x} {y} {p}"),
}


@pytest.mark.parametrize("name", TEXTS)
def test_text_of_other_programs(name, tmp_path):
    """Columns that are no event's are left out; every line is one."""
    with open_recording(save(tmp_path / "a.csv", TEXTS[name].encode())) as recording:
        same(recording.read(), WHOLE)
        assert recording.counters() == {}


def h5_columns(names, times, group="events", **attributes):
    def build(file):
        there = file.require_group(group)
        for name, values in zip(names, (times, WHOLE.x, WHOLE.y, WHOLE.p)):
            there[name] = values
        file.attrs.update(attributes)

    return build


def h5_eds(file):
    h5_columns("txyp", US, "/")(file)
    file["ms_to_idx"] = np.arange(9)


def h5_sides(file):
    h5_columns("txyp", US)(file)
    file["events/height"], file["events/width"] = 720, 1280


def h5_records(file):
    file["events"] = records()


LAYOUTS = {
    "at the root": (h5_columns("txyp", US, "/"), "columns"),
    "names of tonic": (h5_columns(("timestamps", "x", "y", "polarities"), US), "columns"),
    "e2vid": (h5_columns(("ts", "xs", "ys", "ps"), WHOLE.t / 1e9, sensor_resolution=(34, 34)), "columns"),
    "ns": (h5_columns("txyp", WHOLE.t + 1_600_000_000_000_000_000), "columns"),
    "records": (h5_records, "records"),
    "us as floats": (h5_columns("txyp", US.astype(float)), "columns"),
    "eds": (h5_eds, "eds"),
    "sides beside the events": (h5_sides, "columns"),
}
H5_SIZES = {"e2vid": (34, 34), "eds": (640, 480), "sides beside the events": (1280, 720)}


@pytest.mark.parametrize("name", LAYOUTS)
def test_hdf5_of_other_programs(name, tmp_path):
    """Columns under other names, at the root, in ns; records anywhere."""
    build, layout = LAYOUTS[name]
    with h5py.File(tmp_path / "a.h5", "w") as file:
        build(file)
    got, info = read(tmp_path / "a.h5")
    shift = 1_600_000_000_000_000_000 if name == "ns" else 0
    same(got, Events(WHOLE.t + shift, WHOLE.x, WHOLE.y, WHOLE.p))
    assert info.encoding == layout
    assert (info.width, info.height) == H5_SIZES.get(name, (34, 34))


def test_hdf5_times_that_change_their_kind(tmp_path):
    """Whole us, and then fractions: nobody knows what they are."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, values in zip("txyp", (np.arange(9000.0), np.ones(9000), np.ones(9000), np.ones(9000))):
            file[name] = values
        file["t"][8000] = 8000.5
    with pytest.raises(RecordingError, match="begin with whole us and go on with fractions"):
        read(tmp_path / "a.h5")


@pytest.mark.parametrize("plugin", ["SQLITE3", "MCAP"])
def test_messages_compressed_one_by_one(plugin, tmp_path):
    """As rosbag2 does on demand, in either container."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store, kind = get_typestore(Stores.ROS2_HUMBLE), "event_camera_msgs/msg/EventPacket"
    lines = "std_msgs/Header header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\nstring encoding\n"
    store.register(get_types_from_msg(lines + "bool is_bigendian\nuint8[] events\n", kind))
    writer = rosbag2.Writer(tmp_path / "bag", version=8, storage_plugin=rosbag2.StoragePlugin[plugin])
    writer.set_compression(rosbag2.CompressionMode.MESSAGE, rosbag2.CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/e", kind, typestore=store)
        for i, a in enumerate((0, 45)):
            payload = mono(EVENTS[a : a + 45], 1000)
            writer.write(connection, 1000 + i, event_packet("mono", payload, 34, 34, i, 1000, True))
    same(read(tmp_path / "bag")[0], EVENTS)


@pytest.mark.parametrize("suffix", [".raw", ".aedat4", ".h5", ".txt"])
def test_parts_of_a_recording(suffix, tmp_path, capsys):
    """convert and measure from one time to another, in s after the first event, the end not included."""
    path = tmp_path / f"a{suffix}"
    np.savez(tmp_path / "a.npz", t=WHOLE.t, x=WHOLE.x, y=WHOLE.y, p=WHOLE.p, width=34, height=34)
    assert main(["events", "convert", str(tmp_path / "a.npz"), str(path)]) == 0
    begin, end = WHOLE.t[0] + 10_000_000, WHOLE.t[0] + 30_000_000
    inside = WHOLE[(WHOLE.t >= begin) & (WHOLE.t < end)]
    part = str(tmp_path / "part.npz")
    capsys.readouterr()
    assert main(["events", "convert", str(path), part, "--from", "0.01", "--to", "0.03"]) == 0
    same(read(part)[0], inside)
    capsys.readouterr()
    assert main(["events", "measure", str(path), "--from", "0.01", "--to", "0.03", "--no-rotation", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["events"] == len(inside)
    assert main(["events", "convert", str(path), part, "--from", "2", "--to", "1"]) == 2
    assert "the end must be later than the start" in capsys.readouterr().err


def test_whole_times_that_are_no_integers(tmp_path):
    """us as floating point."""
    np.savez(tmp_path / "a.npz", timestamp=US.astype(np.float64), x=WHOLE.x, y=WHOLE.y, p=WHOLE.p)
    got, info = read(tmp_path / "a.npz")
    same(got, WHOLE)
    assert "the times in timestamp are taken as us" in info.warnings


def test_a_width_that_no_sensor_has_is_not_taken_from_an_archive(tmp_path):
    """The limit is that of all formats, and what reads a recording in windows has the size that the events tell."""
    np.savez(tmp_path / "a.npz", t=WHOLE.t, x=WHOLE.x, y=WHOLE.y, p=WHOLE.p, width=65536, height=34)
    side = int(WHOLE.x.max()) + 1
    with evis.open(tmp_path / "a.npz") as recording:
        assert recording.width == side and sum(len(w) for w in recording.windows(10_000_000)) == len(WHOLE)
    np.savez(tmp_path / "a.npz", t=WHOLE.t, x=WHOLE.x, y=WHOLE.y, p=WHOLE.p, width=65535, height=34)
    with evis.open(tmp_path / "a.npz") as recording:
        assert (recording.width, recording.height) == (65535, 34)
