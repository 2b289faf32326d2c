"""AEDAT 2.0, 3.1 and 4: frames, inertial samples and triggers, damage, seeking by the table."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from file_cases import AEDAT3_HEAD, aedat2_davis, aedat3, aedat3_packet, save, small_events
from stream_cases import same

from evis.events import Events, open_recording, open_writer
from evis.events.arrays import Frame

# what aedat 2.3.0 gives of aestream_davis.aedat4 (pip install aedat; for packet in aedat.Decoder(file): ...), in us,
# g and deg/s; frames as (begin, end, exposure begin, exposure end, sum of the pixels)
TRIGGERS = [1633953690976518, 1633953690981291, 1633953690990743, 1633953691007091, 1633953691016518]
SOURCES = [(3, 1), (3, 0), (2, 0), (2, 1), (3, 1)]  # exposure start, end, readout end, start, exposure start
IMU_T = 1633953690976628
TEMPERATURE, ACCELERATION = 27.752941131591797, (-0.0604248046875, -0.9912109375, -0.097412109375)
ANGULAR = (6.454467296600342, 2.578735113143921, -0.1678466647863388)
FRAMES = [
    (1633953690967091, 1633953690990743, 1633953690976518, 1633953690981291, 4587151),
    (1633953691007091, 1633953691030743, 1633953691016518, 1633953691021291, 4603536),
    (1633953691047091, 1633953691070744, 1633953691056518, 1633953691061291, 4618543),
]


def test_everything_in_a_davis_recording(recording_path):
    """Triggers, IMU samples and frames as the aedat library gives them, in SI units."""
    with open_recording(recording_path("aedat4/aestream_davis.aedat4")) as recording:
        events = recording.read()
        assert recording.info.sensor == "DAVIS346_00000104" and recording.info.serial == "00000104"
    edges = events.triggers
    assert len(edges) == 15 and (edges.t[:5] // 1000).tolist() == TRIGGERS
    assert list(zip(edges.id[:5].tolist(), edges.value[:5].tolist())) == SOURCES
    assert len(events.imu) == 130 and int(events.imu.t[0]) == IMU_T * 1000
    np.testing.assert_allclose(events.imu.temperature[0], TEMPERATURE)
    np.testing.assert_allclose(events.imu.acceleration[0], np.array(ACCELERATION) * 9.80665)
    np.testing.assert_allclose(events.imu.angular_velocity[0], np.radians(ANGULAR))
    found = [
        (f.t_ns // 1000, f.end_ns // 1000, f.exposure_start_ns // 1000, f.exposure_end_ns // 1000, int(f.pixels.sum()))
        for f in events.frames
    ]
    assert found == FRAMES and events.frames[0].pixels.shape == (260, 346)


def packets(data: bytes, begin: int, end: int) -> list[tuple[int, int, int]]:
    """(place of the payload, stream, size)."""
    found, at = [], begin
    while at < end:
        stream, size = struct.unpack_from("<ii", data, at)
        found.append((at + 8, stream, size))
        at += 8 + size
    return found


@pytest.fixture
def davis(recording_path):
    """The bytes of a real file, its packets, and its events."""
    path = recording_path("aedat4/aestream_davis.aedat4")
    data = path.read_bytes()
    begin = 18 + struct.unpack_from("<I", data, 14)[0]
    with open_recording(path) as recording:
        return data, packets(data, begin, 1190063), recording.read()


@pytest.mark.parametrize("damage", ["compressed", "size", "stream", "magic", "all"])
def test_a_damaged_packet_is_lost_alone(damage, davis, tmp_path):
    """Whatever is destroyed of one event packet: all other events come, and the loss is counted and named."""
    data, places, events = davis
    start, _, size = [p for p in places if p[1] == 0][2]
    broken = bytearray(data)
    if damage == "compressed":
        broken[start + size // 2 : start + size // 2 + 400] = b"\xff" * 400
    elif damage == "size":
        broken[start - 4 : start] = struct.pack("<i", 2**31 - 1)
    elif damage == "stream":
        broken[start - 8 : start - 4] = struct.pack("<i", 77)
    elif damage == "magic":
        broken[start : start + 4] = b"    "
    else:
        broken[start - 8 : start + size] = bytes(size + 8)
    with open_recording(save(tmp_path / "a.aedat4", bytes(broken))) as recording:
        left = recording.read()
        assert recording.counters() == {"packets_damaged": 1}
        assert f"byte {start - 8} is damaged" in recording.info.warnings[0] and not recording.info.truncated
    lost = len(events) - len(left)
    assert 0 < lost < 15_000
    first = int(np.argmax(left.t != events.t[: len(left)]))
    np.testing.assert_array_equal(left.t, np.delete(events.t, slice(first, first + lost)))
    assert len(left.imu) == 130 and len(left.frames) == 3


def test_without_a_table_it_reads_the_same(davis, tmp_path):
    """A recorder that died wrote no table and says -1 in the header; seeking then reads from the start."""
    data, _, events = davis
    position = data.index(struct.pack("<q", 1190063))
    torn = data[:position] + struct.pack("<q", -1) + data[position + 8 : 1190063]
    with open_recording(save(tmp_path / "a.aedat4", torn)) as recording:
        same(recording.read(), events)
        assert not recording.info.truncated
        recording.seek(int(events.t[90_000]))
        assert recording.next_t_ns is not None and abs(recording.next_t_ns - int(events.t[90_000])) < 2_000_000


def test_a_table_that_lies_is_not_believed(davis, tmp_path):
    """Garbage in place of the table: events and seeking as without it."""
    data, _, events = davis
    with open_recording(save(tmp_path / "a.aedat4", data[:1190063] + b"\xee" * 500)) as recording:
        assert len(recording.read()) == len(events)
        recording.seek(int(events.t[50_000]))
        assert int(recording.read().t[0]) == int(events.t[50_000])


def test_seeking_reads_only_what_it_needs(tmp_path):
    """The table leads to the packet: what comes before is destroyed and nobody notices."""
    events = small_events(60_000, 300, 200)
    with open_writer(tmp_path / "a.aedat4", 300, 200, "lz4") as writer:
        writer.write(events)
    data = bytearray((tmp_path / "a.aedat4").read_bytes())
    begin = 18 + struct.unpack_from("<I", data, 14)[0]
    data[begin + 100 : begin + 5000] = bytes(4900)
    with open_recording(save(tmp_path / "b.aedat4", bytes(data))) as recording:
        recording.seek(int(events.t[40_000]))
        rest = recording.read()
        assert not recording.counters()
    np.testing.assert_array_equal(rest.t, events.t[np.searchsorted(events.t, events.t[40_000]) :])


@pytest.mark.parametrize(("exposure", "t_us"), [((20_000, 31_000), 25), ((0, 0), 10)])
def test_the_time_of_a_written_frame_is_the_middle_of_its_exposure(exposure, t_us, tmp_path):
    """Field 0 of the format's table; a frame without an exposure has that of its readout."""
    events = Events.empty()
    events.frames = [Frame(10_000, np.zeros((3, 2), np.uint8), *exposure, end_ns=40_000)]
    with open_writer(tmp_path / "a.aedat4", 2, 3, "none") as writer:
        writer.write(events)
    data = (tmp_path / "a.aedat4").read_bytes()
    body = data[data.index(b"FRME", 18 + struct.unpack_from("<I", data, 14)[0]) - 8 :]
    root = 4 + struct.unpack_from("<I", body, 4)[0]
    vtable = root - struct.unpack_from("<i", body, root)[0]
    (place,) = struct.unpack_from("<H", body, vtable + 4)
    assert struct.unpack_from("<q", body, root + place) == (t_us,)
    with open_recording(tmp_path / "a.aedat4") as recording:
        (found,) = recording.read().frames
    assert (found.t_ns, found.end_ns) == (10_000, 40_000)


def test_aedat3_events_frames_imu_and_triggers(tmp_path):
    """Packets made from libcaer's structures, with overflowing time, invalid events and a packet of an unknown kind."""
    rng = np.random.default_rng(1)
    pixels = rng.integers(0, 65536, (4, 6)).astype("<u2")
    frame = struct.pack("<I4i2i2i", 1 | 1 << 1, 10, 40, 20, 30, 6, 4, 2, 1) + pixels.tobytes()
    imu = struct.pack("<Ii7f", 1, 55, 0.5, -1.0, 0.25, 90.0, -45.0, 10.0, 31.5)
    special = [struct.pack("<Ii", code << 1 | 1, 60 + i) for i, code in enumerate((2, 3, 0, 4))]
    polarity = [struct.pack("<Ii", 7 << 17 | 9 << 2 | 1 << 1 | valid, 70 + valid) for valid in (1, 0, 1)]
    data = AEDAT3_HEAD + aedat3_packet(2, len(frame), [frame]) + aedat3_packet(3, 36, [imu])
    data += aedat3_packet(0, 8, special) + aedat3_packet(5, 16, [b"\1"]) + aedat3_packet(1, 8, polarity, overflow=2)
    with open_recording(save(tmp_path / "a.aedat", data)) as recording:
        events = recording.read()
        assert (recording.info.width, recording.info.height, recording.info.sensor) == (346, 260, "DAVIS346")
        assert recording.counters() == {"packets_left_out": 1}
    assert events.t.tolist() == [(71 + 2 * 2**31) * 1000] * 2
    assert (events.x.tolist(), events.y.tolist(), events.p.tolist()) == ([7, 7], [9, 9], [1, 1])
    assert events.triggers.value.tolist() == [1, 0, 1] and events.triggers.t.tolist() == [60_000, 61_000, 63_000]
    np.testing.assert_array_equal(events.frames[0].pixels, pixels)
    found = events.frames[0]
    assert (found.t_ns, found.end_ns, found.exposure_ns, found.x0, found.y0) == (10_000, 40_000, 10_000, 2, 1)
    np.testing.assert_allclose(events.imu.acceleration, [np.array([0.5, -1.0, 0.25]) * 9.80665])
    np.testing.assert_allclose(events.imu.angular_velocity, [np.radians([90.0, -45.0, 10.0])])
    assert events.imu.temperature.tolist() == [31.5]


def test_aedat3_special_events_are_triggers_with_the_ids_of_aedat4(tmp_path):
    """All of libcaer's, 0 to 17; a counter that turns and a row without events (0 and 5) are none."""
    data = AEDAT3_HEAD + aedat3_packet(0, 8, [struct.pack("<Ii", code << 1 | 1, code) for code in range(18)])
    with open_recording(save(tmp_path / "a.aedat", data)) as recording:
        found = recording.read().triggers
    reset, inputs, generator = [(4, 1)], [(i, v) for i in (0, 5, 6) for v in (1, 0, 1)], [(1, 1), (1, 0)]
    frames = [(2, 1), (2, 0), (3, 1), (3, 0)]
    assert list(zip(found.id.tolist(), found.value.tolist())) == reset + inputs + generator + frames
    assert found.t.tolist() == [code * 1000 for code in range(18) if code not in (0, 5)]


def test_aedat3_seeks_by_packet(tmp_path):
    """Over many packets, to events at and between their borders."""
    events = small_events(1000, 346, 260)
    with open_recording(save(tmp_path / "a.aedat", aedat3(events))) as recording:
        for i in (0, 49, 50, 51, 777, 999):
            recording.seek(int(events.t[i]))
            np.testing.assert_array_equal(recording.read().t, events.t[np.searchsorted(events.t, events.t[i]) :])


def davis_address(x, y, kind, value):
    return 1 << 31 | y << 22 | x << 12 | kind << 10 | value


def test_aedat2_frames_imu_and_triggers(tmp_path):
    """A frame is its reset reads minus its signal reads; seven IMU words are a sample; bit 10 is the external input."""
    rng = np.random.default_rng(3)
    words, expected = [], []
    for k in range(3):
        reset, signal = rng.integers(500, 1024, (3, 4)), rng.integers(0, 600, (3, 4))
        expected.append(np.clip(reset - signal, 0, 1023) << 6)
        t = 1000 * k
        words += [(davis_address(x, y, 0, int(reset[y, x])), t + x) for x in range(4) for y in range(3)]
        words += [(davis_address(x, y, 1, int(signal[y, x])), t + 100 + x) for x in range(4) for y in range(3)]
        if k == 1:
            raw = [4096, -4096, 0, 340, 328, 0, -328]
            words += [(1 << 31 | i << 28 | (v & 0xFFFF) << 12 | 3 << 10, t + 200) for i, v in enumerate(raw)]
            words += [(1 << 10 | 1 << 11, t + 300), (5 << 22 | 6 << 12 | 1 << 11, t + 301), (1 << 10, t + 302)]
    head = aedat2_davis(Events.empty())
    data = head + b"".join(struct.pack(">Ii", a & 0xFFFFFFFF, t) for a, t in words)
    with open_recording(save(tmp_path / "a.aedat", data)) as recording:
        events = recording.read()
        assert (recording.info.width, recording.info.height) == (346, 260)
    assert (events.t.tolist(), events.x.tolist(), events.y.tolist(), events.p.tolist()) == ([1_301_000], [6], [5], [1])
    assert events.triggers.value.tolist() == [1, 0]
    assert len(events.frames) == 3
    for frame, pixels, k in zip(events.frames, expected, range(3)):
        np.testing.assert_array_equal(frame.pixels, pixels)
        assert (frame.t_ns, frame.exposure_end_ns) == (1_000_000 * k, 1_000_000 * k + 100_000)
    # 4096 a g, 32.8 a degree/s, 340 a kelvin above 35 deg C
    np.testing.assert_allclose(events.imu.acceleration, [[9.80665, -9.80665, 0]])
    np.testing.assert_allclose(events.imu.angular_velocity, [np.radians([10, 0, -10])])
    assert events.imu.temperature.tolist() == [36.0]


def test_aedat2_time_turns_after_35_minutes(tmp_path):
    """jAER's signed 32-bit time goes on from its largest to its smallest value."""
    times = [2**31 - 1000, 2**31 - 1, -(2**31), -(2**31) + 500]
    rows = b"".join(struct.pack(">Ii", 1 << 12, t) for t in times)
    with open_recording(save(tmp_path / "a.aedat", aedat2_davis(Events.empty()) + rows)) as recording:
        assert (recording.read().t // 1000).tolist() == [2**31 - 1000, 2**31 - 1, 2**31, 2**31 + 500]
