"""CDR bytes against rosbags, an independent implementation, and `mono` events against a recorded bag."""

import hashlib
import json
import os
from pathlib import Path

import numpy as np
import pytest
from bag_messages import mono_payloads
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from evis.bag import BagError
from evis.bag.ros import messages, transforms
from evis.bag.ros.cdr import CdrReader
from evis.bag.ros.schemas import DEFINITIONS
from evis.events.codecs.event_camera_msgs import mono

STORE = get_typestore(Stores.ROS2_HUMBLE)
EVENT_PACKET = (
    "std_msgs/Header header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\nstring encoding\n"
    "bool is_bigendian\nuint8[] events\n"
)
STORE.register(get_types_from_msg(EVENT_PACKET, "event_camera_msgs/msg/EventPacket"))
T = STORE.types
FRAMES = ["", "c", "ca", "cam", "cam0", "cam_left", "a/ä"]
STAMP = 1_234_567_890_123_456_789


def header(frame):
    seconds, nanoseconds = divmod(STAMP, 10**9)
    return T["std_msgs/msg/Header"](T["builtin_interfaces/msg/Time"](seconds, nanoseconds), frame)


def serialized(message):
    return bytes(STORE.serialize_cdr(message, message.__msgtype__))


def joined(buffers):
    return b"".join(bytes(b) for b in buffers)


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("encoding", ["rgb8", "32FC3", "x"])
def test_image(frame, encoding):
    data = np.arange(24, dtype=np.uint8)
    theirs = T["sensor_msgs/msg/Image"](header(frame), 2, 4, encoding, 0, 12, data)
    ours = joined(messages.image(STAMP, frame, 2, 4, encoding, 12, data.data))
    assert ours == serialized(theirs)
    back = messages.read_image(memoryview(serialized(theirs)))
    assert (back.stamp_ns, back.height, back.width, back.encoding, back.step) == (STAMP, 2, 4, encoding, 12)
    assert bytes(back.data) == data.tobytes()


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("coefficients", [0, 4, 5])
@pytest.mark.parametrize("model", ["plumb_bob", "equidistant"])
@pytest.mark.parametrize("baseline", [0.0, 0.06])
def test_camera_info(frame, coefficients, model, baseline):
    """P[3] = -fx B, as sensor_msgs/CameraInfo says of the right camera of a pair."""
    d, k = np.arange(coefficients) / 7, np.arange(1, 10).reshape(3, 3) / 3
    roi = T["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    p = np.hstack([k, np.zeros((3, 1))]).ravel()
    p[3] = -k[0, 0] * baseline if baseline else 0.0
    theirs = T["sensor_msgs/msg/CameraInfo"](
        header(frame), 260, 346, model, d, k.ravel(), np.eye(3).ravel(), p, 0, 0, roi
    )
    ours = joined(messages.camera_info(STAMP, frame, 260, 346, model, d, k, baseline))
    assert ours == serialized(theirs)
    stamp, height, width, name, distortion, intrinsic, apart = messages.read_camera_info(memoryview(ours))
    assert apart == pytest.approx(baseline, rel=1e-12)
    assert (stamp, height, width, name) == (STAMP, 260, 346, model)
    assert np.array_equal(distortion, d) and np.array_equal(intrinsic, k)


@pytest.mark.parametrize("frame", FRAMES)
def test_imu(frame):
    w, a = np.array([0.1, -2, np.pi]), np.array([9.81, 0, -1e-300])
    vector, unknown = T["geometry_msgs/msg/Vector3"], np.zeros(9)
    unknown[0] = -1
    theirs = T["sensor_msgs/msg/Imu"](
        header(frame),
        T["geometry_msgs/msg/Quaternion"](0, 0, 0, 1),
        unknown,
        vector(*w),
        np.zeros(9),
        vector(*a),
        np.zeros(9),
    )
    assert joined(messages.imu(STAMP, frame, w, a)) == serialized(theirs)
    stamp, velocity, acceleration = messages.read_imu(memoryview(serialized(theirs)))
    assert stamp == STAMP and np.array_equal(velocity, w) and np.array_equal(acceleration, a)


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("encoding", ["mono", "evt3"])
@pytest.mark.parametrize("size", [0, 8, 3])
def test_event_packet(frame, encoding, size):
    events = np.arange(size, dtype=np.uint8)
    kind = T["event_camera_msgs/msg/EventPacket"]
    theirs = kind(header(frame), 260, 346, 2**40 + 1, 2**63 - 1, encoding, False, events)
    ours = messages.RosEvents(STAMP, 260, 346, 2**40 + 1, 2**63 - 1, encoding, events.data)
    assert joined(messages.event_packet(ours, frame)) == serialized(theirs)
    back = messages.read_event_packet(memoryview(serialized(theirs)))
    assert (back.seq, back.base_ns, back.encoding, bytes(back.events)) == (
        2**40 + 1,
        2**63 - 1,
        encoding,
        events.tobytes(),
    )


@pytest.mark.parametrize("frame", ["", "w", "world", "world12"])
@pytest.mark.parametrize("names", [("a",), ("cam0", "", "ab", "abcdefgh"), ("link/ä", "b", "ccc")])
@pytest.mark.parametrize("steps", [1, 2, 5])
def test_transforms(frame, names, steps):
    rng = np.random.default_rng(steps)
    pose = rng.normal(size=(steps, len(names), 7))
    t = rng.integers(0, 2**31 * 10**9, steps)
    vector, quaternion = T["geometry_msgs/msg/Vector3"], T["geometry_msgs/msg/Quaternion"]
    stamped = []
    for i in range(steps):
        time = T["builtin_interfaces/msg/Time"](*(int(v) for v in divmod(t[i], 10**9)))
        for j, name in enumerate(names):
            p = [float(v) for v in pose[i, j]]
            where = T["geometry_msgs/msg/Transform"](vector(*p[:3]), quaternion(*p[3:]))
            stamped.append(T["geometry_msgs/msg/TransformStamped"](T["std_msgs/msg/Header"](time, frame), name, where))
    theirs = serialized(T["tf2_msgs/msg/TFMessage"](stamped))
    assert transforms.pack(frame, [(names, t, pose)]) == theirs
    assert np.array_equal(transforms.unpack(memoryview(theirs), frame, [(names, steps)])[0], pose)
    for first in range(len(names) + 1):
        head, tail = (names[:first], t, pose[:, :first]), (names[first:], t[-1:], pose[-1:, first:])
        apart = transforms.pack(frame, [head, tail])
        chosen = [stamped[i * len(names) + j] for i in range(steps) for j in range(first)]
        chosen += stamped[(steps - 1) * len(names) + first :]
        assert apart == serialized(T["tf2_msgs/msg/TFMessage"](chosen))
        back = transforms.unpack(memoryview(apart), frame, [(names[:first], steps), (names[first:], 1)])
        assert np.array_equal(back[0], head[2]) and np.array_equal(back[1], tail[2])


def test_no_transforms_at_all():
    theirs = serialized(T["tf2_msgs/msg/TFMessage"]([]))
    assert transforms.pack("world", [((), np.zeros(2, np.int64), np.zeros((2, 0, 7)))]) == theirs


@pytest.mark.parametrize("name", sorted(DEFINITIONS))
def test_definitions_are_ros_definitions(name):
    """Parsed by rosbags, our texts give the same types (fields and dependencies) as the ROS 2 distribution's."""
    ours = get_types_from_msg(DEFINITIONS[name], name)
    assert ours[name] == STORE.fielddefs[name]
    for dependency, fields in ours.items():
        assert fields == STORE.fielddefs[dependency], dependency


def test_truncated_cdr_is_an_error():
    raw = joined(messages.image(0, "cam0", 1, 1, "mono8", 1, memoryview(b"x")))
    for size in range(len(raw)):
        with pytest.raises(BagError):
            messages.read_image(memoryview(raw[:size]))


def test_big_endian_cdr_is_refused():
    with pytest.raises(BagError, match="little-endian"):
        CdrReader(b"\x00\x00\x00\x00rest", "x")


@pytest.mark.parametrize("stamp", [-1, 2**31 * 10**9])
def test_times_that_ros_cannot_hold(stamp):
    with pytest.raises(BagError, match=r"0 to 2\^31 s"):
        messages.image(stamp, "", 0, 0, "mono8", 0, memoryview(b""))


def test_mono_of_a_recorded_bag():
    """The recording's checksums, and its very bytes when packed again."""
    root = Path(os.environ.get("EVIS_TEST_DATA", Path(__file__).parents[3] / "shared" / "data"))
    path = root / "ros" / "codecs_mono_cd_0.db3"
    if not path.exists():
        pytest.skip(f"no recording at {path}; set EVIS_TEST_DATA")
    truth = json.loads((root / "ground_truth.json").read_text())["files"]["ros/codecs_mono_cd_0.db3"]
    assert hashlib.sha256(path.read_bytes()).hexdigest() == truth["file_sha256"]
    columns = []
    for payload in mono_payloads(path):
        packet = messages.read_event_packet(memoryview(payload))
        assert (packet.width, packet.height, packet.encoding) == (truth["width"], truth["height"], "mono")
        events = mono.unpack(np.frombuffer(packet.events, "<u8"), packet.base_ns)
        assert mono.pack(*events, packet.base_ns).tobytes() == bytes(packet.events)
        columns.append(events)
    t, x, y, p = (np.concatenate(c) for c in zip(*columns))
    assert [len(t), int(t.sum()), int(x.sum()), int(y.sum()), int(p.sum())] == [
        truth["n"],
        truth["sum_t"],
        truth["sum_x"],
        truth["sum_y"],
        truth["n_on"],
    ]
    assert [int(v[0]) for v in (t, x, y, p)] == truth["first"] and [int(v[-1]) for v in (t, x, y, p)] == truth["last"]


def test_mono_bit_fields():
    words = mono.pack(np.array([7]), np.array([3], np.uint16), np.array([5], np.uint16), np.array([1], np.uint8), 2)
    assert int(words[0]) == 1 << 63 | 5 << 48 | 3 << 32 | 5


@pytest.mark.parametrize("count", [0, 1, 65_535, 65_536, 200_001])
def test_mono_of_many_events_is_each_by_itself(count):
    """Against Python's integers, also for rows, polarities and times of more bits than there are."""
    rng = np.random.default_rng(count)
    t, base = rng.integers(-(2**40), 2**40, count), 12_345_678_901
    x, y = rng.integers(0, 2**16, (2, count), np.uint16)
    p = rng.integers(0, 2**8, count, np.uint8)
    words = mono.pack(t, x, y, p, base)
    for k in rng.integers(0, count, 500) if count else ():
        fields = int(t[k]) - base & 0xFFFFFFFF, int(x[k]) << 32, (int(y[k]) & 0x7FFF) << 48, (int(p[k]) & 1) << 63
        assert int(words[k]) == sum(fields)


def test_split_covers_times_that_no_packet_could():
    rng = np.random.default_rng(1)
    for t in (rng.integers(0, 2**35, 200), np.sort(rng.integers(0, 2**36, 200)), np.array([0, 2**32, 0, 2**32 - 1])):
        runs = mono.split(t, -1)
        assert [r[0] for r in runs] == [0, *(r[1] for r in runs[:-1])] and runs[-1][1] == len(t)
        for first, end, base in runs:
            assert end > first and (t[first:end] >= base).all() and (t[first:end] - base < 2**32).all()
