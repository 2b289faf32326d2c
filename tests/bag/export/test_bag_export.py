"""What `evis bag` writes and prints, read back by other means."""

import json
import struct
import warnings
import zlib

import numpy as np
import pytest
from bag_files import KEYFRAMES, bag, run
from bag_messages import scene

from evis.bag import BagError
from evis.bag.export.topics import export
from evis.bag.info import describe
from evis.bag.preview import tone_map
from evis.bag.threads import Threads
from evis.bag.writer import BagWriter
from evis.cli import main
from evis.media.frames.open import open_frames
from evis.media.frames.source import FrameOptions
from msgs.audit import Audit
from msgs.camera import Depth, EventPacket, Image, Imu, Keyframe
from msgs.header import Header


def exr_channels(path):
    """Channels of a ZIP-compressed scan-line EXR, taken apart by hand from the OpenEXR file layout."""
    data = path.read_bytes()
    assert struct.unpack("<I", data[:4])[0] == 20000630
    at, attributes = 8, {}
    while data[at]:
        name_end = data.index(b"\0", at)
        type_end = data.index(b"\0", name_end + 1)
        (size,) = struct.unpack_from("<I", data, type_end + 1)
        attributes[data[at:name_end].decode()] = data[type_end + 5 : type_end + 5 + size]
        at = type_end + 5 + size
    at += 1
    assert attributes["compression"] == b"\x03"  # ZIP, 16 lines a block
    x0, y0, x1, y1 = struct.unpack("<4i", attributes["dataWindow"])
    width, height = x1 - x0 + 1, y1 - y0 + 1
    kinds, raw = [], attributes["channels"]
    while raw[:1] != b"\0":
        end = raw.index(b"\0")
        kinds.append((raw[:end].decode(), {0: "<u4", 1: "<f2", 2: "<f4"}[struct.unpack_from("<i", raw, end + 1)[0]]))
        raw = raw[end + 17 :]
    result = {name: np.empty((height, width), kind) for name, kind in kinds}
    offsets = struct.unpack_from(f"<{-(-height // 16)}Q", data, at)
    for offset in offsets:
        first, size = struct.unpack_from("<iI", data, offset)
        lines = min(16, y1 - first + 1)
        block = data[offset + 8 : offset + 8 + size]
        full = lines * width * sum(np.dtype(k).itemsize for _, k in kinds)
        if size < full:
            delta = np.frombuffer(zlib.decompress(block), np.uint8).astype(np.int64)
            delta[1:] -= 128
            values = (np.cumsum(delta) % 256).astype(np.uint8)
            half = (len(values) + 1) // 2
            block = np.empty(len(values), np.uint8)
            block[0::2], block[1::2] = values[:half], values[half:]
            block = block.tobytes()
        place = 0
        for y in range(first - y0, first - y0 + lines):
            for name, kind in kinds:
                length = width * np.dtype(kind).itemsize
                result[name][y] = np.frombuffer(block[place : place + length], kind)
                place += length
    return result, attributes


@pytest.mark.parametrize("margin", [0, 1])
def test_keyframes_to_exr(tmp_path, margin):
    result = export(bag(tmp_path / "a.mcap", margin=margin), "/cam0/keyframe", tmp_path / "out")
    assert result["keyframes"] == KEYFRAMES
    assert result["channels"] == sorted(["R", "G", "B", "Z", "motion.x", "motion.y", "id"])
    crop = slice(margin, -margin or None)
    for k in range(KEYFRAMES):
        channels, attributes = exr_channels(tmp_path / "out" / f"{k:06d}.exr")
        truth = scene(k)
        radiance = truth["/cam0/keyframe"].radiance[0, crop, crop]
        motion = truth["/cam0/motion"].motion[0, crop, crop]
        for name, array in {
            "R": radiance[..., 0],
            "G": radiance[..., 1],
            "B": radiance[..., 2],
            "motion.x": motion[..., 0],
            "motion.y": motion[..., 1],
            "Z": truth["/cam0/depth"].depth[0, crop, crop],
            "id": truth["/cam0/ids"].ids[0, crop, crop].astype(np.uint32),
        }.items():
            assert channels[name].dtype == array.dtype and np.array_equal(channels[name], array), name
        assert int(attributes["evis/stamp_ns"]) == truth["/cam0/keyframe"].header.stamp_ns


def test_files_of_another_export_are_counted(tmp_path):
    source = bag(tmp_path / "a.mcap")
    assert "other_files" not in export(source, "/cam0/keyframe", tmp_path / "out")
    assert "other_files" not in export(source, "/cam0/keyframe", tmp_path / "out"), "the same files again"
    for k in (KEYFRAMES, KEYFRAMES + 1):
        (tmp_path / "out" / f"{k:06d}.exr").write_bytes(b"of a longer run")
    status, _, err = run("bag", "export", str(source), "--topic", "/cam0/keyframe", str(tmp_path / "out"))
    assert status == 0 and "holds 2 EXR files that are not of this export" in err


def test_keyframes_in_half_are_clamped_and_counted(tmp_path):
    radiance = np.array([[[[1e6, 1.0, 0.5], [-1e9, 65504.0, np.nan]]]], np.float32)
    with BagWriter(tmp_path / "a.mcap") as writer:
        writer.write("/cam0/keyframe", Keyframe(Header(0), np.zeros(1, np.int32), radiance))
    result = export(tmp_path / "a.mcap", "/cam0/keyframe", tmp_path / "out", half=True)
    assert result["clamped"] == 2 and result["channels"] == ["B", "G", "R"]
    channels, _ = exr_channels(tmp_path / "out" / "000000.exr")
    assert channels["R"].dtype == np.float16 and channels["R"].tolist() == [[65504.0, -65504.0]]
    assert channels["G"].tolist() == [[1.0, 65504.0]] and np.isnan(channels["B"][0, 1])


def test_keyframes_of_several_environments(tmp_path):
    path = bag(tmp_path / "a.mcap", envs=2)
    export(path, "/cam0/keyframe", tmp_path / "all")
    export(path, "/env1/cam0/keyframe", tmp_path / "one")
    for file in (tmp_path / "all" / "env1" / "000002.exr", tmp_path / "one" / "000002.exr"):
        assert np.array_equal(exr_channels(file)[0]["G"], scene(2, 2)["/cam0/keyframe"].radiance[1, ..., 1])


def test_missing_depth_is_left_out(tmp_path):
    with BagWriter(tmp_path / "a.mcap") as writer:
        for k in range(3):
            writer.write("/cam0/keyframe", scene(k)["/cam0/keyframe"])
        writer.write("/cam0/depth", scene(1)["/cam0/depth"])
    export(tmp_path / "a.mcap", "/cam0/keyframe", tmp_path / "out")
    assert ["Z" in exr_channels(tmp_path / "out" / f"{k:06d}.exr")[0] for k in range(3)] == [False, True, False]


@pytest.mark.parametrize("envs", [1, 2])
def test_events_to_npz(tmp_path, envs):
    path = bag(tmp_path / "a.mcap", envs)
    topic = "/cam0/events" if envs == 1 else "/env1/cam0/events"
    export(path, topic, tmp_path / "e.npz")
    with np.load(tmp_path / "e.npz") as arrays:
        for name, dtype in {"t": np.int64, "x": np.uint16, "y": np.uint16, "p": np.uint8, "c": np.uint8}.items():
            packets = [scene(k, envs)["/cam0/events"] for k in range(KEYFRAMES)]
            expected = np.concatenate([getattr(p, name)[p.env_offsets[-2] :] for p in packets])
            assert arrays[name].dtype == dtype and np.array_equal(arrays[name], expected)
    if envs == 2:
        with pytest.raises(BagError, match="2 environments; name one of them: /env0/cam0/events"):
            export(path, "/cam0/events", tmp_path / "f.npz")


def test_other_topics(tmp_path):
    path = bag(tmp_path / "a.mcap")
    export(path, "/state", tmp_path / "s.npz")
    with np.load(tmp_path / "s.npz") as arrays:
        states = [scene(k)["/state"] for k in range(KEYFRAMES)]
        assert arrays["t"].tolist() == [t for state in states for t in state.t.tolist()]
        for name, part in (("pose", 0), ("twist", 1)):
            steps = np.concatenate([state.rows()[part][0] for state in states])
            assert arrays[name].shape[1] == 1 and np.array_equal(arrays[name][:, 0], steps)
        assert arrays["names"].tolist() == states[0].names
    export(path, "/cam0/imu", tmp_path / "i.jsonl")
    lines = [json.loads(line) for line in (tmp_path / "i.jsonl").read_text().splitlines()]
    assert [line["acceleration"] for line in lines] == [
        scene(k)["/cam0/imu"].acceleration.tolist() for k in range(KEYFRAMES)
    ]
    export(path, "/cam0/imu", tmp_path / "i.npz")
    with np.load(tmp_path / "i.npz") as arrays:
        samples = [scene(k)["/cam0/imu"] for k in range(KEYFRAMES)]
        for name in ("t", "acceleration", "angular_velocity"):
            assert np.array_equal(arrays[name], np.concatenate([getattr(one, name) for one in samples]))
    with pytest.raises(BagError, match=r"name it \.npz or \.jsonl"):
        export(path, "/state", tmp_path / "s.csv")
    with pytest.raises(BagError, match="no topic '/cam1/events'; it has"):
        export(path, "/cam1/events", tmp_path / "s.npz")


def test_samples_of_which_each_message_has_as_many_as_it_has(tmp_path):
    """One after another; `offsets` takes the messages apart again."""
    rng = np.random.default_rng(3)
    sent = []
    with BagWriter(tmp_path / "a.mcap") as writer:
        for k, n in enumerate((3, 0, 5, 4)):
            t = np.arange(n, dtype=np.int64) + 10 * k
            sent.append(Imu(Header(10 * k), t, rng.normal(size=(n, 3)), rng.normal(size=(n, 3))))
            writer.write("/cam0/imu", sent[-1])
            worst = rng.integers(0, 9, (n, 3), dtype=np.int32)
            writer.write("/cam0/audit", Audit(Header(10 * k), worst, np.arange(n, dtype=np.float64)))
    told = export(tmp_path / "a.mcap", "/cam0/imu", tmp_path / "i.npz")
    assert told["messages"] == 4 and told["arrays"]["acceleration"] == [12, 3]
    with np.load(tmp_path / "i.npz") as arrays:
        assert arrays["offsets"].tolist() == [0, 3, 3, 8, 12] and arrays["stamp_ns"].tolist() == [0, 10, 20, 30]
        for k, message in enumerate(sent):
            rows = slice(*arrays["offsets"][k : k + 2])
            for name in ("t", "acceleration", "angular_velocity"):
                assert np.array_equal(arrays[name][rows], getattr(message, name))
    export(tmp_path / "a.mcap", "/cam0/audit", tmp_path / "u.npz")
    with np.load(tmp_path / "u.npz") as arrays:
        assert arrays["worst_distance"].tolist() == [0, 1, 2, 0, 1, 2, 3, 4, 0, 1, 2, 3]


@pytest.mark.parametrize(
    ("encoding", "channels", "dtype"),
    [
        ("rgb8", 3, np.uint8),
        ("mono8", 1, np.uint8),
        ("bgr8", 3, np.uint8),
        ("rgb16", 3, np.uint16),
        ("mono16", 1, np.uint16),
    ],
)
def test_images_to_png(tmp_path, encoding, channels, dtype):
    """The pixels as another decoder sees them, and the times that `evis events simulate` takes."""
    rng = np.random.default_rng(1)
    images = [rng.integers(0, np.iinfo(dtype).max, (6, 5, channels), dtype, endpoint=True) for _ in range(3)]
    with BagWriter(tmp_path / "a.mcap") as writer:
        for k, pixels in enumerate(images):
            writer.write("/cam0/image", Image(Header(k * 10**7 + 3, k), pixels, encoding))
    result = export(tmp_path / "a.mcap", "/cam0/image", tmp_path / "out")
    assert result["images"] == 3 and "other_files" not in result
    assert (tmp_path / "out" / "times.txt").read_text().splitlines() == [
        f"{k:06d}.png {k * 10**7 + 3}" for k in range(3)
    ]
    with open_frames(str(tmp_path / "out"), FrameOptions(channels == 3, False, None, "linear", None)) as source:
        (block,) = source.blocks()
    assert block.t.tolist() == [3, 10**7 + 3, 2 * 10**7 + 3]
    want = np.stack(images)[..., ::-1] if encoding == "bgr8" else np.stack(images)
    got = block.image * np.iinfo(dtype).max
    np.testing.assert_allclose(got.reshape(want.shape), want, atol=0.01)
    again = export(tmp_path / "a.mcap", "/cam0/image", tmp_path / "out")
    assert "other_files" not in again
    (tmp_path / "out" / "000003.png").write_bytes(b"of a longer run")
    status, _, err = run("bag", "export", str(tmp_path / "a.mcap"), "--topic", "/cam0/image", str(tmp_path / "out"))
    assert status == 0 and "holds 1 PNG files that are not of this export" in err


def test_images_that_png_does_not_have(tmp_path):
    with BagWriter(tmp_path / "a.mcap") as writer:
        writer.write("/cam0/image", Image(Header(0), np.ones((4, 4, 1), np.float32), "32FC1"))
    with pytest.raises(BagError, match=r"encoding 32FC1, is none that PNG can hold; export to \.npz or \.jsonl"):
        export(tmp_path / "a.mcap", "/cam0/image", tmp_path / "out")


def test_info(tmp_path):
    about = describe(bag(tmp_path / "a.mcap"))
    packets = [scene(k)["/cam0/events"] for k in range(KEYFRAMES)]
    t = np.concatenate([p.t for p in packets])
    events = about["topics"]["/cam0/events"]
    assert (events["type"], events["message"]) == ("event_camera_msgs/msg/EventPacket", "EventPacket")
    assert (events["messages"], events["events"]) == (KEYFRAMES, len(t))
    assert (events["t_first_ns"], events["t_last_ns"], events["width"], events["height"]) == (t[0], t[-1], 7, 5)
    assert about["topics"]["/cam0/keyframe"]["type"] == "sensor_msgs/msg/Image"
    assert about["topics"]["/cam0/labels"]["message"] == "Labels"
    assert about["topics"]["/cam0/imu"]["messages"] == 2 * KEYFRAMES
    assert about["parts"]["/cam0/keyframe/meta"]["part_of"] == "/cam0/keyframe"
    assert about["duration_s"] == pytest.approx((KEYFRAMES - 1) / 30, abs=1e-8)
    assert about["complete"] and about["metadata"] == {"evis": {"seed": "7"}}


def test_info_counts_a_sensors_own_bytes(tmp_path):
    from evis.events.arrays import Events
    from evis.events.codecs.prophesee.evt3 import Encoder

    encoder = Encoder()
    t = np.arange(1, 1001) * 10_000
    zeros = np.zeros(500, np.uint16)
    with BagWriter(tmp_path / "a.mcap") as writer:
        for k in range(2):
            words = encoder.encode(Events(t[k * 500 : k * 500 + 500], zeros, zeros, zeros.astype(np.uint8)))
            raw = np.frombuffer(words, np.uint8)
            packet = EventPacket(
                Header(int(t[k * 500 + 499]), k), np.array([0, 0]), raw=raw, encoding="evt3", width=9, height=8
            )
            writer.write("/cam0/events", packet)
    events = describe(tmp_path / "a.mcap")["topics"]["/cam0/events"]
    assert (events["events"], events["t_first_ns"], events["t_last_ns"]) == (1000, 10_000, 10_000_000)
    export(tmp_path / "a.mcap", "/cam0/events", tmp_path / "e.npz")
    with np.load(tmp_path / "e.npz") as arrays:
        assert np.array_equal(arrays["t"], t)


def test_command_line(tmp_path):
    path = bag(tmp_path / "a.mcap")
    status, out, _ = run("bag", "info", str(path), "--json")
    assert status == 0 and json.loads(out)["topics"]["/state"]["messages"] == KEYFRAMES
    status, out, _ = run("bag", "info", str(path))
    assert status == 0 and "/cam0/events" in out and "seed=7" in out
    path.write_bytes(path.read_bytes()[:-300])
    status, out, _ = run("bag", "info", str(path))
    assert status == 0 and "torn" in out
    status, out, _ = run("bag", "recover", str(path), str(tmp_path / "b.mcap"), "--json")
    assert status == 0 and json.loads(out)["damaged"] == 0 and describe(tmp_path / "b.mcap")["complete"]
    status, out, _ = run("bag", "export", str(tmp_path / "b.mcap"), "--topic", "/cam0/events", str(tmp_path / "e.csv"))
    assert status == 0 and (tmp_path / "e.csv").exists()


@pytest.mark.parametrize(
    ("words", "status", "text"),
    [
        (["bag", "info", "{}/none.mcap"], 1, "cannot read"),
        (["bag", "info", "{}/garbage.mcap"], 1, "not an MCAP bag"),
        (["bag", "info", "{}/ros1.bag"], 1, "is a ROS 1 bag, no MCAP bag; `evis events info` and `convert` read its"),
        (["bag", "play", "{}/ros2.db3", "--no-view"], 1, "is a ROS 2 bag of SQLite, no MCAP bag; `evis events info`"),
        (["bag", "export", "{}/a.mcap", "--topic", "/x", "o.npz"], 1, "no topic '/x'"),
        (["bag", "export", "{}/a.mcap", "--topic", "/cam0/events", "{}/e"], 1, "e: no extension; name it e.npz"),
        (["bag", "recover", "{}/a.mcap", "{}/missing/b.mcap"], 1, "there is no directory"),
        (["bag", "inof", "x"], 2, "did you mean 'info'?"),
        (["bag"], 2, "ACTION"),
        (["bag", "record", "{}/b.mcap", "--duration", "0"], 2, "longer than 0"),
        (["bag", "record", "{}/b.mcap", "--duration", "nan"], 2, "longer than 0"),
        (["bag", "record", "{}/b.mcap", "--preview-hz", "nan"], 2, "--preview-hz is nan; it must be a number"),
        (["bag", "record", "{}/b.mcap", "--preview-hz", "inf"], 2, "--preview-hz is inf; it must be a number"),
    ],
)
def test_command_line_errors(tmp_path, words, status, text):
    """One line on stderr that names the thing, 1 for a failure and 2 for wrong usage."""
    bag(tmp_path / "a.mcap")
    (tmp_path / "garbage.mcap").write_bytes(b"garbage" * 99)
    (tmp_path / "ros1.bag").write_bytes(b"#ROSBAG V2.0\n" * 99)
    (tmp_path / "ros2.db3").write_bytes(b"SQLite format 3\0" * 99)
    code, out, err = run(*(w.format(tmp_path) for w in words))
    assert code == status and out == ""
    assert text in err and err.count("\n") == 1


def test_messages_of_another_recorder_are_named_and_not_denied(tmp_path):
    """A bag as rosbag2 writes it: what the topic holds, and for events what reads them."""
    from mcap.writer import Writer

    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        for topic, kind in (("/dvs/events", "dvs_msgs/msg/EventArray"), ("/points", "sensor_msgs/msg/PointCloud2")):
            channel = writer.register_channel(topic, "cdr", writer.register_schema(kind, "ros2msg", b""))
            writer.add_message(channel, 0, b"", 0)
        writer.finish()
    events = "/dvs/events is dvs_msgs/msg/EventArray; .*; `evis events convert .*a.mcap OUT --topic /dvs/events` writes"
    with pytest.raises(BagError, match=events):
        export(path, "/dvs/events", tmp_path / "a.npz")
    with pytest.raises(BagError, match=r"/points is sensor_msgs/msg/PointCloud2; no such message can be exported$"):
        export(path, "/points", tmp_path / "a.npz")


def test_a_topic_that_a_bag_lacks_is_told_with_how_it_gets_there(tmp_path):
    """Whether it was not asked for, does not exist, or lay behind the tear."""
    path = tmp_path / "a.mcap"
    with BagWriter(path) as writer:
        writer.write("/cam0/imu", Imu(Header(0), np.zeros(1, np.int64), np.zeros((1, 3)), np.zeros((1, 3))))
    with pytest.raises(BagError, match=r"no topic '/cam0/depth'; it has /cam0/imu; .*--record-topics /cam0/depth$"):
        export(path, "/cam0/depth", tmp_path / "depth")
    with pytest.raises(BagError, match=r"no topic '/cam0/evnts'; it has /cam0/imu$"):
        export(path, "/cam0/evnts", tmp_path / "a.npz")
    path.write_bytes(path.read_bytes()[:60])
    with pytest.raises(BagError, match=r"is torn \(.*\); up to there it has no topic '/cam0/imu'; it has none$"):
        export(path, "/cam0/imu", tmp_path / "a.npz")


def test_export_of_a_torn_bag_says_so(tmp_path, capsys):
    """What is there is written, and standard error names the tear and the remedy; of a whole bag, nothing."""
    path = bag(tmp_path / "a.mcap")
    assert main(["bag", "export", str(path), "--topic", "/state", str(tmp_path / "a.npz"), "--json"]) == 0
    whole = capsys.readouterr()
    assert whole.err == "" and json.loads(whole.out)["messages"] == KEYFRAMES
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(path.read_bytes()[:-40])
    assert main(["bag", "export", str(torn), "--topic", "/state", str(tmp_path / "b.npz"), "--json"]) == 0
    said = capsys.readouterr()
    (line,) = said.err.splitlines()
    assert str(torn) in line and "is torn" in line and "`evis bag recover`" in line
    result = json.loads(said.out)
    assert result["problem"] and result["messages"] == KEYFRAMES
    with np.load(tmp_path / "a.npz") as a, np.load(tmp_path / "b.npz") as b:
        assert all(np.array_equal(a[name], b[name]) for name in a.files)


def test_tone_map():
    """Middle grey comes out as sRGB of 0.18/1.18; black, white and NaN stay what they are; monotone everywhere."""
    grey = tone_map(np.full((4, 4, 3), 3.7, np.float32))
    expected = 255 * (1.055 * (0.18 / 1.18) ** (1 / 2.4) - 0.055)
    assert np.abs(grey - expected).max() <= 1  # 8 bits
    ramp = tone_map(np.repeat(np.geomspace(1e-6, 1e6, 999), 3).reshape(1, 999, 3), 1.0)[0, :, 0].astype(int)
    assert (np.diff(ramp) >= 0).all() and ramp[0] == 0 and ramp[-1] == 255
    odd = np.array([[[np.nan, np.inf, -1.0]]], np.float32)
    assert tone_map(odd).tolist() == [[[0, 255, 0]]]
    assert tone_map(np.zeros((2, 2, 3), np.float16)).max() == 0


def test_tone_map_follows_the_srgb_curve():
    x = np.random.default_rng(0).gamma(0.5, 2.0, (50, 3))
    u = x / (1 + x)
    srgb = 255 * np.where(u <= 0.0031308, 12.92 * u, 1.055 * u ** (1 / 2.4) - 0.055)
    # half a code by rounding, and the table's step of 1/4096 where the curve is steepest (12.92 * 255 / 8192)
    assert np.abs(tone_map(x, 1.0) - srgb).max() < 0.5 + 0.41


@pytest.mark.parametrize("shape", [(700, 333, 3), (3, 100_000, 3), (0, 5, 3), (7, 3)])
@pytest.mark.parametrize("count", [1, 3])
def test_tone_map_of_many_pixels_is_that_of_each(shape, count):
    """Rows are shared by threads; what is no number has a colour everywhere, and nobody is warned of it."""
    radiance = np.random.default_rng(0).gamma(0.5, 2.0, shape).astype(np.float32)
    for k, odd in enumerate((np.nan, np.inf, -np.inf, 3e38, -1.0)):
        radiance.flat[k::97] = odd
    threads = Threads(count)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        picture = tone_map(radiance, 4.0, threads)
    threads.close()
    x = np.maximum(4.0 * np.nan_to_num(radiance.astype(np.float64), nan=0.0, posinf=1e300, neginf=-1), 0)
    u = x / (1 + x)
    srgb = 255 * np.where(u <= 0.0031308, 12.92 * u, 1.055 * u ** (1 / 2.4) - 0.055)
    assert picture.shape == shape and np.abs(picture - srgb).max(initial=0) < 0.5 + 0.41


def test_depth_alone(tmp_path):
    with BagWriter(tmp_path / "a.mcap") as writer:
        writer.write("/cam0/depth", Depth(Header(0), np.full((1, 2, 2), np.inf, np.float32)))
    export(tmp_path / "a.mcap", "/cam0/depth", tmp_path / "d.npz")
    with np.load(tmp_path / "d.npz") as arrays:
        assert np.isinf(arrays["depth"]).all() and arrays["depth"].shape == (1, 1, 2, 2)
