"""AEDAT 4 with streams of several cameras and of other kinds, packed here by hand from the flatbuffers' description."""

from __future__ import annotations

import struct

import lz4.frame
import numpy as np
import pytest
from file_cases import save, small_events
from stream_cases import same

from evis.cli import main
from evis.events import Events, RecordingError, open_recording
from evis.recordings.recorded import open_recorded

LEFT, RIGHT = small_events(200, 34, 34, seed=1), small_events(120, 20, 10, seed=2)


def table(kind: bytes, vector: bytes) -> bytes:
    """A size-prefixed buffer whose root table has one field, a vector; `vector` begins with its length."""
    body = struct.pack("<I4s4Hi", 16, kind, 6, 8, 4, 0, 8) + struct.pack("<I", 4) + vector
    return struct.pack("<I", len(body)) + body


def events(part) -> bytes:
    rows = zip((part.t // 1000).tolist(), part.x.tolist(), part.y.tolist(), part.p.tolist())
    return table(b"EVTS", struct.pack("<I", len(part)) + b"".join(struct.pack("<qhhB3x", *row) for row in rows))


def samples(kind: bytes, code: str, rows: list[tuple], absent: int = -1) -> bytes:
    """A vector of tables, one after the other; field `absent` is 0 and so is not written, as flatbuffers does."""
    offsets, tables = [], b""
    begin = 4 * len(rows)
    for row in rows:
        fields, data = [], b""
        for i, (value, c) in enumerate(zip(row, code)):
            fields.append(0 if i == absent else 4 + len(data))
            data += b"" if i == absent else struct.pack("<" + c, value)
        vtable = struct.pack(f"<{2 + len(fields)}H", 4 + 2 * len(fields), 4 + len(data), *fields)
        offsets.append(begin + len(tables) + len(vtable))
        tables += vtable + struct.pack("<i", len(vtable)) + data
    packed = struct.pack(f"<I{len(rows)}I", len(rows), *(o - 4 * i for i, o in enumerate(offsets)))
    return table(kind, packed + tables)


def header(streams: list[dict[str, str]], compression: int) -> bytes:
    nodes = ""
    for i, stream in enumerate(streams):
        outer = "".join(f'<attr key="{k}">{v}</attr>' for k, v in stream.items() if k[0] in "to")
        inner = "".join(f'<attr key="{k}">{v}</attr>' for k, v in stream.items() if k[0] not in "to")
        nodes += f'<node name="{i}">{outer}<node name="info">{inner}</node></node>'
    text = f'<dv version="2.0"><node name="outInfo">{nodes}</node></dv>'.encode()
    # fields: compression at 4, table position (absent), text at 8
    body = struct.pack("<I4s5Hxxi", 20, b"IOHE", 10, 12, 4, 0, 8, 12) + struct.pack("<iI", compression, 4)
    body += struct.pack("<I", len(text)) + text
    return b"#!AER-DAT4.0\r\n" + struct.pack("<I", len(body)) + body


STREAMS = [
    {"typeIdentifier": "EVTS", "originalOutputName": "events", "source": "A_1", "sizeX": "34", "sizeY": "34"},
    {"typeIdentifier": "IMUS", "originalOutputName": "imu", "source": "A_1"},
    {"typeIdentifier": "EVTS", "originalOutputName": "events", "source": "B_2", "sizeX": "20", "sizeY": "10"},
    {"typeIdentifier": "TRIG", "originalOutputName": "triggers", "source": "B_2"},
    {"typeIdentifier": "POSE", "originalOutputName": "poses", "source": "A_1"},
    {"typeIdentifier": "IMUS", "originalOutputName": "imu", "source": "B_2"},
]
IMU = [(100 * i, 20.0 + i, 0.5, -1.0, i / 4, 90.0, -45.0, 10.0) for i in range(6)]


def packed(compression: str) -> bytes:
    """Packets of all streams in turn."""
    packets = []
    for i in range(4):
        packets.append((0, events(LEFT[i * 50 : i * 50 + 50])))
        packets.append((4, samples(b"POSE", "q", [(5,)])))
        packets.append((2, events(RIGHT[i * 30 : i * 30 + 30])))
        packets.append((3, samples(b"TRIG", "qb", [(1000 * i, 2), (1000 * i + 1, 3)])))
        packets.append((5, samples(b"IMUS", "q" + "f" * 7, [(7, *[9.0] * 7)])))
    packets.append((1, samples(b"IMUS", "q" + "f" * 7, IMU[:3])))
    packets.append((1, samples(b"IMUS", "q" + "f" * 7, IMU[3:4], absent=2)))
    packets.append((1, samples(b"IMUS", "q" + "f" * 7, IMU[4:])))
    data = header(STREAMS, 1 if compression else 0)
    for stream, body in packets:
        if compression:
            body = lz4.frame.compress(body)
        data += struct.pack("<ii", stream, len(body)) + body
    return data


@pytest.mark.parametrize("compression", ["", "lz4"])
def test_one_camera_of_two(compression, tmp_path):
    """Events, samples and triggers of the camera that is asked for; poses are no damage."""
    path = save(tmp_path / "a.aedat4", packed(compression))
    with open_recording(path) as recording:
        got = recording.read()
        same(got, LEFT)
        assert recording.counters() == {"packets_left_out": 4}
        assert (recording.info.width, recording.info.height, recording.info.sensor) == (34, 34, "A_1")
        assert recording.info.warnings == ["event streams 0 (A_1), 2 (B_2): this is 0; name another as the topic"]
    assert len(got.triggers) == 0
    np.testing.assert_array_equal(got.imu.t, [1000 * row[0] for row in IMU])
    want = np.array([row[2:5] for row in IMU])
    want[3, 0] = 0.0  # the field that was not written
    np.testing.assert_allclose(got.imu.acceleration, want * 9.80665)
    np.testing.assert_allclose(got.imu.temperature, [row[1] for row in IMU])
    with open_recording(path, topic="B_2") as recording:
        got = recording.read()
        assert (recording.info.width, recording.info.height) == (20, 10) and not recording.info.warnings
    np.testing.assert_array_equal(got.t, RIGHT.t)
    np.testing.assert_array_equal(got.triggers.t, [v * 1000 for i in range(4) for v in (1000 * i, 1000 * i + 1)])
    assert got.triggers.value.tolist() == [0, 1] * 4 and len(got.imu) == 4


def test_a_part_has_the_samples_that_come_late(tmp_path):
    """Samples in packets behind later events: a part of the time has them, and none of the time before."""
    t = np.arange(200_000) * 5_000
    rows = [(10_000 * i + 500, 20.0, *[1.0] * 6) for i in range(100)]
    place = np.arange(10_000) % 30
    data = header(STREAMS[:2], 0)
    for i in range(20):
        body = events(Events.of(t[10_000 * i : 10_000 * i + 10_000], place, place, place % 2))
        data += struct.pack("<ii", 0, len(body)) + body
        body = samples(b"IMUS", "q" + "f" * 7, rows[max(5 * i - 8, 0) : 5 * i - 3] if i else rows[:0])
        data += struct.pack("<ii", 1, len(body)) + body
    path = save(tmp_path / "a.aedat4", data)
    start, stop = 330_000_000, 650_000_000
    want = [1000 * row[0] for row in rows if start <= 1000 * row[0] < stop]
    part = open_recorded(path)[start:stop].read()
    assert part.imu.t.tolist() == want and len(part) == (stop - start) // 5_000
    main(["events", "convert", str(path), str(tmp_path / "b.aedat4"), "--from", "0.33", "--to", "0.65", "--rebase"])
    with open_recording(tmp_path / "b.aedat4") as recording:
        assert recording.read().imu.t.tolist() == [t_ns - start for t_ns in want]


def frame(*fields: tuple[str, int]) -> bytes:
    """A frame of 3 x 2 grey pixels; fields: code and value of t, readout start and end, exposure start and end."""
    numbers = [*fields, ("b", 0), ("h", 3), ("h", 2), ("h", 4), ("h", 5)]
    data, places = b"", []
    for code, value in numbers:
        places.append(4 + len(data) if value else 0)
        data += struct.pack("<" + code, value) if value else b""
    places.append(4 + len(data))
    vtable = struct.pack("<13H", 26, 8 + len(data), *places)
    vector = struct.pack("<II", 4, 6) + bytes(range(6))
    body = struct.pack("<I4s", 8 + len(vtable), b"FRME") + vtable + struct.pack("<i", len(vtable)) + data + vector
    return struct.pack("<I", len(body)) + body


@pytest.mark.parametrize(
    ("times", "want"),
    [
        ((500, 400, 900, 450, 480), (400, 450, 480, 900)),
        ((500, 0, 0, 500, 800), (500, 500, 800, 800)),
        ((500, 0, 0, 300, 350), (300, 300, 350, 500)),
        ((500, 0, 0, 0, 0), (500, 500, 500, 500)),
    ],
)
def test_times_of_frames(times, want, tmp_path):
    """Start, exposure and end never run back, whichever of them the writer left out."""
    body = frame(*(("q", v) for v in times))
    streams = [STREAMS[0], {"typeIdentifier": "FRME", "source": "A_1"}]
    data = header(streams, 0) + struct.pack("<ii", 1, len(body)) + body
    with open_recording(save(tmp_path / "a.aedat4", data)) as recording:
        (found,) = recording.read().frames
        assert not recording.counters()
    assert (found.t_ns, found.exposure_start_ns, found.exposure_end_ns, found.end_ns) == tuple(1000 * v for v in want)
    np.testing.assert_array_equal(found.pixels, np.arange(6).reshape(2, 3))
    assert (found.x0, found.y0) == (4, 5)


def test_a_name_of_two_streams_is_none(tmp_path):
    """`events` would be either of them."""
    with pytest.raises(RecordingError, match="no event stream 'events'; it has 0, 2, A_1, B_2"):
        open_recording(save(tmp_path / "a.aedat4", packed("")), topic="events")


def test_damage_among_poses(tmp_path):
    """The packet behind a damaged header is found by what its stream holds."""
    data = bytearray(packed(""))
    at = data.index(b"POSE", data.index(b"</dv>")) - 16
    data[at : at + 8] = b"\xff" * 8
    with open_recording(save(tmp_path / "a.aedat4", bytes(data))) as recording:
        same(recording.read(), LEFT)
        assert recording.counters() == {"packets_damaged": 1, "packets_left_out": 3}
