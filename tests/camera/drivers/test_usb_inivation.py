"""What iniVation cameras do beyond events: binning, crops of flipped sensors, a Mini's samples beside the stream."""

from __future__ import annotations

import numpy as np
import pytest
from usb_rig import MS, joined, played, random_recording, run, silent

from evis.events import Events, open_writer
from evis.events.arrays import Imu
from evis.events.codecs.encoder import encoder_for
from nodes.camera.interface.settings import describe
from nodes.camera.usb.settings import UsbSettings

CHIP = 5


def with_samples(path, n=200):
    """Events and inertial samples of 5 ms each, in a file that holds both."""
    rng = np.random.default_rng(5)
    t = np.arange(1, 50_001) * 20_000
    x, y = rng.integers(0, 640, len(t), np.uint16), rng.integers(0, 480, len(t), np.uint16)
    events = Events(t, x, y, rng.integers(0, 2, len(t), np.uint8))
    samples = rng.uniform(-15, 15, (n, 3)), rng.uniform(-2, 2, (n, 3)), np.full(n, 30.0)
    events.imu = Imu(np.arange(1, n + 1) * 5 * MS, *samples)
    with open_writer(path, 640, 480) as writer:
        for part in np.split(np.arange(len(t)), 50):  # 20 ms each, as a camera's recorder writes them
            piece = Events(t[part], x[part], y[part], events.p[part])
            i = (events.imu.t > t[part[0]] - 20_000) & (events.imu.t <= t[part[-1]])
            piece.imu = Imu(events.imu.t[i], *(column[i] for column in samples))
            writer.write(piece)
    return events


@pytest.mark.parametrize("name", ["dvxplorer_mini", "dvxplorer_micro"])
def test_mini_samples_arrive_beside_the_events(name, tmp_path):
    """Every sample comes out, in order, with its values, near the events of its time, in the packet of its time."""
    sent = with_samples(tmp_path / "a.aedat4")
    driver = played(name, tmp_path / "a.aedat4")
    readings = run(driver)
    got = joined(readings).imu
    assert len(got) == len(sent.imu)
    np.testing.assert_allclose(got.acceleration, sent.imu.acceleration, atol=2 * 9.81 / 2**15)
    np.testing.assert_allclose(got.angular_velocity, sent.imu.angular_velocity, atol=np.deg2rad(125 / 2**15))
    assert (got.temperature == 30).all()
    # the device hands over 1 ms at a time; a sample is between the events before and behind it
    assert np.abs(got.t - sent.imu.t).max() <= 2 * MS
    assert (np.diff(got.t) >= 0).all()
    for reading in readings[:-1]:
        t = reading.events.imu.t
        assert (t <= reading.stamp_ns).all()
    assert driver.counters() == {}


def test_mini_without_samples(tmp_path):
    """imu=false: nobody reads the endpoint, nothing is counted, the events are the same."""
    sent = with_samples(tmp_path / "a.aedat4", 20)
    driver = played("dvxplorer_mini", tmp_path / "a.aedat4")
    got = joined(run(driver, imu=False))
    assert len(got) == len(sent) and len(got.imu) == 0
    assert driver.emulated.registers[3, 2] == driver.emulated.registers[3, 3] == 0


def test_mini_messages_and_damage_are_told(tmp_path):
    """What the firmware says is in the camera's info; packets that make no sense are counted."""
    random_recording(tmp_path / "a.npz", 640, 480, 2000)
    driver = played("dvxplorer_mini", tmp_path / "a.npz")
    driver.emulated.feed.imu_queue.put([b"\x00\x03\0\0\0\0sensor is hot", b"\x01\xe0", b"\x09" * 16])
    with driver:
        driver.configure(driver.settings_type()())
        driver.start()
        while not driver.ended:
            driver.read(0.2)
        assert driver.info().details["device_message"] == "sensor is hot (code 3)"
        assert driver.counters() == {"device_messages": 1, "imu_damaged": 2}


@pytest.mark.parametrize("name", ["dvxplorer", "dvxplorer_mini"])
@pytest.mark.parametrize("orientation", [0, 1, 2, 3])
def test_binning(name, orientation, tmp_path):
    """320x240 in the info; whichever edge the sensor counts from, an event of (x, y) comes as (x // 2, y // 2)."""
    sent = random_recording(tmp_path / "a.npz", 640, 480, 3000)
    driver = played(name, tmp_path / "a.npz")
    driver.emulated.fixed[1, 2] = orientation
    with driver:
        driver.configure(driver.settings_type().of({"binning": True, "decoder": "numpy"}))
        assert (driver.info().width, driver.info().height) == (320, 240)
        driver.start()
        readings = []
        while not driver.ended:
            if (reading := driver.read(0.2)) is not None:
                readings.append(reading)
        assert driver.emulated.registers[CHIP, 0x3202] == 1
    got = joined(readings)
    assert (got.t == sent.t).all() and (got.x == sent.x // 2).all() and (got.y == sent.y // 2).all()
    assert driver.counters() == {}


def test_binning_excludes_a_region():
    """The chip's cropper counts pixels before they are put together: it is not offered."""
    kind = silent("dvxplorer").SETTINGS
    with pytest.raises(ValueError, match="binning and a region of interest"):
        kind.of({"binning": True, "roi_x": 8})


@pytest.mark.parametrize(
    ("orientation", "crop"),
    [
        (0, (0, 1, 0xF8, 4, 0x0F, 0, 100, 0, 109)),  # columns 100-109, rows 11-35
        (1, (0, 55, 0xF0, 58, 0x1F, 0, 100, 0, 109)),  # rows counted from below: 444-468
        (2, (0, 1, 0xF8, 4, 0x0F, 2, 530 - 512, 2, 539 - 512)),  # columns from the right: 530-539
        (4, (0, 12, 0xF0, 13, 0x3F, 0, 11, 0, 35)),  # columns are read as rows
    ],
)
def test_crop_counts_as_the_chip_does(orientation, crop):
    """Registers 0x3300-0x3308 for the region x 100-109, y 11-35."""
    assert cropped(orientation, roi_x=100, roi_width=10, roi_y=11, roi_height=25) == crop


def test_crop_within_one_group():
    """First and last row in one group of eight: the last mask alone counts, so it holds both ends."""
    assert cropped(0, roi_y=18, roi_height=3)[1:5] == (2, 0xFF, 2, 0b0001_1100)


def cropped(orientation, **roi):
    driver = silent("dvxplorer")
    driver.emulated.fixed[1, 2] = orientation
    with driver:
        driver.configure(driver.settings_type().of(roi))
        return tuple(driver.emulated.registers[CHIP, 0x3300 + i] for i in range(9))


@pytest.mark.parametrize(("name", "size"), [("davis346", (346, 260)), ("dvxplorer", (640, 480))])
def test_transposed_sensors(name, size):
    """Orientation bit 2: what comes as x is y. Positions come out as in the image."""
    width, height = size
    sent = Events.of([1000, 2000, 3000], [0, height - 1, 5], [9, 8, 7], [1, 0, 1])
    driver = silent(name)
    driver.emulated.fixed[1, 2], driver.emulated.fixed[1, 0], driver.emulated.fixed[1, 1] = 4, height, width
    driver.emulated.feed.put(encoder_for(name).encode(sent))
    driver.emulated.feed.end()
    got = joined(run(driver))
    assert got.x.tolist() == [9, 8, 7] and got.y.tolist() == [0, height - 1, 5]


def test_region_of_a_transposed_davis():
    """Its registers count columns and rows of the readout."""
    driver = silent("davis346")
    driver.emulated.fixed[1, 2] = 4
    with driver:
        driver.configure(driver.settings_type().of({"roi_x": 10, "roi_width": 20, "roi_y": 30, "roi_height": 40}))
        driver.start()
        assert [driver.emulated.registers[1, i] for i in (41, 42, 43, 44)] == [30, 10, 69, 29]


def test_micro_is_told_by_its_firmware():
    """CX3 with firmware 10: registers of eight bytes, thresholds and flips as numbers, nothing written to the chip."""
    driver = silent("dvxplorer_micro")
    driver.emulated.fixed[1, 2] = ord("X") << 8 | ord("-")
    with driver:
        assert driver.info().name == "dvxplorer_micro"
        driver.configure(driver.settings_type().of({"sensitivity": "high"}))
        driver.start()
        r = driver.emulated.registers
        assert (r[1, 14], r[1, 15], r[1, 24], r[1, 25], r[1, 21], r[1, 22]) == (5, 5, 1, 0, 640, 480)
        assert (r[3, 5], r[3, 8], r[1, 3], r[3, 2]) == (11, 11, 1, 1)
        assert all(module != CHIP for module, _, _ in driver.emulated.writes)
    assert r[1, 3] == r[3, 2] == 0


NOT_DRIVEN = {
    "dvxplorer_micro": {"binning", "roi_x", "roi_y", "roi_width", "roi_height", "trigger_in"},
    "dvxplorer_mini": {"trigger_in"},
    "dvxplorer_lite": {"binning"},
    "dvxplorer": set(),
}
"""What docs/cameras.md says that a model has no setting for: of all that the largest has."""


@pytest.mark.parametrize("name", NOT_DRIVEN)
def test_a_model_takes_what_it_drives(name):
    """Nothing that would be refused or, as the trigger input of a camera without one, do nothing."""
    every = {"sensitivity", "roi_x", "roi_y", "roi_width", "roi_height", "binning", "imu", "trigger_in"}
    with silent(name) as driver:
        kind = driver.settings_type()
        assert set(describe(kind)) - set(describe(UsbSettings)) == every - NOT_DRIVEN[name]
        for setting in NOT_DRIVEN[name]:
            with pytest.raises(ValueError, match=f"no setting '{setting}'"):
                kind.of({setting: 1})
        if name != "dvxplorer_micro":
            facts = describe(kind)
            limits = [facts[key]["maximum"] for key in ("roi_x", "roi_y", "roi_width", "roi_height")]
            w, h = driver.info().width, driver.info().height
            assert limits == [w - 1, h - 1, w, h]


def test_lite_is_told_by_its_chip():
    """320x240, no subsampling (its registers count from 1), no binning, regions inside its own size."""
    driver = silent("dvxplorer_lite")
    with driver:
        about = driver.info()
        assert (about.name, about.width, about.height) == ("dvxplorer_lite", 320, 240)
        driver.configure(driver.settings_type().of({"roi_x": 100, "roi_y": 8}))
        r = driver.emulated.registers
        assert r[CHIP, 0x3204] == 9
        assert [r[CHIP, 0x3300 + i] for i in range(9)] == [0, 1, 0xFF, 29, 0xFF, 0, 100, 1, 319 - 256]
        with pytest.raises(ValueError, match="does not lie inside 320x240"):
            driver.settings_type().of({"roi_x": 300, "roi_width": 40})
