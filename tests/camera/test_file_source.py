"""The file driver's pacing, against a wall clock that moves only when told; and the driver interface."""

from __future__ import annotations

import math

import numpy as np
import pytest
from camera_rig import WallClock, write

from nodes.camera.file_source import FileSettings, FileSource
from nodes.camera.interface.settings import Configuration, setting

MS = 1_000_000


def source(tmp_path, clock: WallClock, **settings) -> FileSource:
    path = write(tmp_path / "a.raw", np.arange(1, 100) * MS)
    driver = FileSource(path, now=clock.now, sleep=clock.sleep)
    driver.open()
    driver.configure(FileSettings(**settings))
    driver.start()
    return driver


@pytest.mark.parametrize("speed", [1.0, 2.0, 0.25])
def test_packets_come_when_they_are_due(speed, tmp_path):
    """A packet is handed over when its interval has passed on the wall clock, divided by the speed."""
    clock = WallClock()
    with source(tmp_path, clock, speed=speed) as driver:
        start, count = clock.ns, 0
        while not driver.ended:
            reading = driver.read(1.0)
            if reading is not None:
                count += 1
                assert abs(clock.ns - start - count * 10 * MS / speed) <= 1
                assert reading.late_ns == 0
    assert count == 10


def test_fast_never_sleeps(tmp_path):
    """As fast as possible means no waiting."""
    clock = WallClock()
    with source(tmp_path, clock, speed=0) as driver:
        n = 0
        while (reading := driver.read(1.0)) is not None:
            n += len(reading.events)
    assert (n, clock.slept) == (99, 0.0)


def test_a_wait_is_never_longer_than_the_timeout(tmp_path):
    """So that a graph can be stopped; the packet comes later, whole."""
    clock = WallClock()
    with source(tmp_path, clock) as driver:
        for k in range(1, 4):
            assert driver.read(0.003) is None
            assert clock.slept == pytest.approx(0.003 * k)
            assert not driver.ended
        reading = driver.read(0.003)
    assert reading is not None and len(reading.events) == 10


def test_lateness_is_told_and_nothing_is_dropped(tmp_path):
    """A consumer that is 35 ms late gets all packets, each with how late it is, and the schedule is caught up."""
    clock = WallClock()
    late, n = [], 0
    with source(tmp_path, clock) as driver:
        while not driver.ended:
            reading = driver.read(1.0)
            if reading is not None:
                late.append(reading.late_ns // MS)
                n += len(reading.events)
                if len(late) == 2:
                    clock.ns += 35 * MS
    assert late == [0, 0, 25, 15, 5, 0, 0, 0, 0, 0]
    assert n == 99


def test_life_of_a_driver(tmp_path):
    """What comes before its time is an error that says so; closing twice is fine."""
    driver = FileSource(write(tmp_path / "a.raw", [MS]))
    with pytest.raises(ValueError, match="not open"):
        driver.info()
    with driver:
        with pytest.raises(ValueError, match="before start"):
            driver.read(0)
        driver.start()
        with pytest.raises(ValueError, match="before start"):
            driver.configure(FileSettings())
    driver.stop()
    driver.close()


def test_settings_have_ranges_and_units():
    """A wrong name gets the nearest one, a wrong value its range and unit."""

    class Other(Configuration):
        pass

    with pytest.raises(ValueError, match="did you mean 'packet_ms'"):
        FileSettings.of({"packet_mss": 1})
    with pytest.raises(ValueError, match=r"packet_ms is 0 ms; it must be 0.01 to 10000 ms"):
        FileSettings.of({"packet_ms": 0.0})
    with pytest.raises(ValueError, match="must be finite"):
        FileSettings.of({"speed": math.nan})
    assert FileSettings.of({"speed": 3.0}).speed == 3.0
    assert setting(1, "x", "mV", 0, 5).metadata["unit"] == "mV"
    with pytest.raises(ValueError, match="takes FileSettings"):
        FileSource("a.raw").configure(Other())
