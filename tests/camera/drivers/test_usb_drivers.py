"""Every driver on its emulated device: what a recording holds comes out, once and in order."""

from __future__ import annotations

import hashlib
import itertools
import json
import time

import numpy as np
import pytest
from usb_rig import DATA, MS, joined, played, random_recording, run, same, silent

from evis.events import Events, open_recording
from evis.events.arrays import Imu
from evis.events.codecs.encoder import encoder_for
from nodes.camera.usb.models import MODELS


def real(name: str):
    if not (DATA / name).exists():
        pytest.skip(f"no recording {DATA / name} (set EVIS_TEST_DATA)")
    return DATA / name, json.loads((DATA / "ground_truth.json").read_text())["files"][name]


@pytest.mark.parametrize("name", MODELS)
def test_every_model_streams_a_recording(name, tmp_path):
    """Opened, configured, started, read to the end: all events with their times, in packets that tile the time."""
    model = MODELS[name]
    sent = random_recording(tmp_path / "a.npz", model.width, model.height)
    driver = played(name, tmp_path / "a.npz")
    readings = run(driver)
    assert same(joined(readings), sent)
    assert not driver.counters()
    for before, after in itertools.pairwise(readings):
        assert after.t0_ns == before.stamp_ns and after.stamp_ns - after.t0_ns == 10 * MS
    assert all(((r.events.t > r.t0_ns) & (r.events.t <= r.stamp_ns)).all() for r in readings)


@pytest.mark.parametrize(
    ("model", "name"),
    [
        ("silkyevcam", "derived/gen31_vga_from_bag1.raw"),
        ("evk4", "derived/gen31_vga_from_bag1.raw"),
        ("evk4", "prophesee/faery_evt2.raw"),
        ("dvxplorer", "derived/gen31_vga_from_bag1.raw"),
        ("davis346", "wheel/wheel_2024_11_26_11_34_19_crop100.aedat4"),
        ("davis346", "aedat4/aestream_davis.aedat4"),
        ("dvs128", "nmnist/tonic_sample_nmnist.bin"),
        ("evk3_genx320", "nmnist/tonic_sample_nmnist.bin"),
    ],
)
def test_real_recordings_arrive_with_the_known_hash(model, name):
    """The recording's own bytes or encoded anew: the hash that other readers found."""
    path, known = real(name)
    events = joined(run(played(model, path)))
    digest = hashlib.sha256()
    for array in (events.t // 1000, events.x, events.y, events.p):
        digest.update(array.tobytes())
    assert (len(events), digest.hexdigest()) == (known["n"], known["sha256"])


def test_wire_bytes_of_a_raw_file_are_not_touched():
    """A camera of the file's encoding sends the file's bytes; with raw the packets carry all of them."""
    path, _ = real("derived/gen31_vga_from_bag1.raw")
    wire = b"".join(r.raw.tobytes() for r in run(played("silkyevcam", path), raw=True))
    data = path.read_bytes()
    assert data.endswith(wire) and len(data) - len(wire) < 600


def test_triggers_of_the_real_recording():
    """Edges come through the driver as the bag that the file was made from has them."""
    path, _ = real("derived/gen31_vga_from_bag1.raw")
    known = json.loads((DATA / "ground_truth.json").read_text())["files"]["ros/event_camera_py_test_events_1.bag"]
    edges = joined(run(played("silkyevcam", path))).triggers
    assert (len(edges), int((edges.t // 1000).sum())) == (known["n_triggers"], known["sum_t_triggers"])


def test_davis_frames_and_samples():
    """Frames (8 bits in the file, 10 on the wire) and inertial samples of a DAVIS recording, times included."""
    path, _ = real("aedat4/aestream_davis.aedat4")
    with open_recording(path) as recording:
        sent = recording.read()
    driver = played("davis346", path)
    got = joined(run(driver))
    assert len(sent.frames) == len(got.frames) == 3
    for a, b in zip(sent.frames, got.frames):
        assert (a.t_ns, a.end_ns, a.exposure_ns) == (b.t_ns, b.end_ns, b.exposure_ns)
        assert (b.pixels >> 8 == a.pixels).all()
    assert (got.imu.t == sent.imu.t).all()
    np.testing.assert_allclose(got.imu.acceleration, sent.imu.acceleration, atol=2 * 9.81 / 2**15)
    np.testing.assert_allclose(got.imu.angular_velocity, sent.imu.angular_velocity, atol=np.deg2rad(250 / 2**15))
    # all edges of this file are the marks of a frame's readout (2) and exposure (3), no edges of the input
    assert set(sent.triggers.id.tolist()) == {2, 3} and len(got.triggers) == 0
    assert driver.counters() == {"frame_marks_left_out": len(sent.triggers)}


@pytest.mark.parametrize("name", ["davis346", "dvxplorer"])
@pytest.mark.parametrize(("orientation", "signs"), [(0, (1, 1, 1)), (4, (-1, 1, 1)), (2, (1, -1, 1)), (5, (-1, 1, -1))])
def test_inertial_axes_follow_the_cameras_register(name, orientation, signs):
    """Bits 2, 1, 0 of register 3,1 turn x, y, z around, of both sensors."""
    rng = np.random.default_rng(3)
    t = np.arange(1, 40) * MS
    acceleration, angular = rng.uniform(-15, 15, (39, 3)), rng.uniform(-2, 2, (39, 3))
    sent = Events.empty()
    sent.imu = Imu(t, acceleration, angular, np.full(39, 30.0))
    driver = silent(name)
    driver.emulated.fixed[3, 1] = orientation
    driver.emulated.feed.put(encoder_for(name).encode(sent))
    driver.emulated.feed.end()
    got = joined(run(driver)).imu
    assert got.t.tolist() == t.tolist()
    np.testing.assert_allclose(got.acceleration, acceleration * signs, atol=4 * 9.81 / 2**15)
    np.testing.assert_allclose(got.angular_velocity, angular * signs, atol=np.deg2rad(250 / 2**15))


def test_mini_keeps_every_event():
    """Groups of rows share a word on this wire, so events of one time and column may change places; none is lost."""
    path, _ = real("derived/gen31_vga_from_bag1.raw")
    with open_recording(path) as recording:
        sent = recording.read()
    got = joined(run(played("dvxplorer_mini", path)))
    assert (got.t == sent.t).all()
    key = lambda e: np.sort(e.t << 22 | e.x.astype(np.int64) << 12 | e.y.astype(np.int64) << 1 | e.p)
    assert (key(got) == key(sent)).all()


@pytest.mark.parametrize("name", MODELS)
def test_identity(name):
    """Serial, firmware and place on the bus; the model is recognised from what the device says, not from the name."""
    with silent(name) as driver:
        about = driver.info()
        assert (about.name, about.serial, about.clock) == (name, "0000e915", "device:0000e915")
        assert about.details["firmware"] and about.details["usb"].endswith("bus 1 address 1")
        assert (about.width, about.height) == (MODELS[name].width, MODELS[name].height)
        if MODELS[name].sensor == "IMX636":
            assert abs(about.details["temperature_c"] - 41.0) < 0.2  # 0.19 deg C per step


def test_real_pace_takes_the_recordings_time(tmp_path):
    """At speed 20, 0.4 s of device time are not over in less than 0.02 s, and all events are there."""
    sent = random_recording(tmp_path / "a.raw", 640, 480)
    began = time.monotonic()
    assert same(joined(run(played("silkyevcam", tmp_path / "a.raw", speed=20.0))), sent)
    assert time.monotonic() - began > 0.0195


class HeldUpClock:
    """A clock of a busy machine: 0.4 ms pass between any two looks at it."""

    def __init__(self) -> None:
        self.ns = 0

    def now(self) -> int:
        self.ns += 400_000
        return self.ns

    def sleep(self, seconds: float) -> None:
        time.sleep(min(seconds, 0.0))  # which refuses less than 0
        self.ns += round(seconds * 1e9)


def test_a_wait_that_is_over_before_it_begins(tmp_path):
    """The process is held up between two looks at the clock, as on a busy machine: the stream goes on."""
    sent = random_recording(tmp_path / "a.raw", 640, 480)
    assert same(joined(run(played("silkyevcam", tmp_path / "a.raw", speed=1.0, clock=HeldUpClock()))), sent)


def test_a_recording_larger_than_the_camera_is_refused(tmp_path):
    """One line with both sizes."""
    random_recording(tmp_path / "a.raw", 640, 480, 10)
    with pytest.raises(ValueError, match=r"640x480 px do not fit on the iniVation DVS128 \(128x128\)"):
        played("dvs128", tmp_path / "a.raw")


def test_duration_ends_the_recording(tmp_path):
    """Device time after the first event."""
    sent = random_recording(tmp_path / "a.raw", 346, 260)
    got = joined(run(played("davis346", tmp_path / "a.raw", duration_s=0.1)))
    assert same(got, sent[: int((sent.t < sent.t[0] + 100 * MS).sum())])


def test_times_of_today_are_kept(tmp_path):
    """A recording with Unix times is sent from near 0, as a camera counts, and comes out with its own times."""
    from evis.events import open_writer

    t = 1_700_000_000_123_456_000 + np.arange(50) * 7_000_000
    sent = Events(t, np.arange(50, dtype=np.uint16), np.zeros(50, np.uint16), np.ones(50, np.uint8))
    with open_writer(tmp_path / "a.npz", 64, 48) as writer:
        writer.write(sent)
    for name in ("evk4", "davis346", "dvs128", "dvxplorer_mini"):
        assert same(joined(run(played(name, tmp_path / "a.npz"))), sent), name
