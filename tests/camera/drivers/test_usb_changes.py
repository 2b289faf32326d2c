"""Settings that change while a camera streams: what is written on the wire, what is not, and what the stream loses."""

from __future__ import annotations

import time
from typing import Any

import pytest
from usb_rig import HandClock, joined, played, random_recording, same, silent

from evis.events import Events
from nodes.camera.interface.driver import Reading
from nodes.camera.usb.driver import UsbDriver
from nodes.camera.usb.models import MODELS

MS = 1_000_000
CHANGES: dict[str, dict[str, Any]] = {
    "evk4": {"bias_fo": -10, "bias_diff_on": 20, "roi_x": 100, "roi_width": 32, "event_rate_limit": 2e7,
             "trigger_in": True},
    "evk3_gen41": {"bias_fo": 0x50, "bias_pr": 0x60, "roi_y": 10, "event_rate_limit": 1e6},
    "evk3_genx320": {"bias_diff_on": 30, "bias_fo": 20},
    "silkyevcam": {"bias_fo": 1500, "bias_hpf": 1400, "bias_diff_on": 400, "roi_x": 64, "roi_width": 320,
                   "trigger_in": True},
    "davis346": {"bias_on": 300_000.0, "bias_refr": 2000.0, "roi_x": 10, "roi_width": 100, "exposure_us": 2000.0,
                 "background_filter_us": 5000.0, "frames": False, "imu": False, "trigger_in": True},
    "dvxplorer": {"sensitivity": "high", "roi_x": 8, "roi_height": 18, "imu": False, "trigger_in": True},
    "dvxplorer_lite": {"sensitivity": "low", "roi_y": 8, "roi_height": 16, "imu": False},
    "dvxplorer_mini": {"sensitivity": "very_high", "roi_x": 8, "roi_width": 10},
    "dvxplorer_micro": {"sensitivity": "very_low"},
    "dvs128": {"bias_diffon": 300_000, "bias_pr": 99},
}  # fmt: skip


def streaming(name: str, **settings: Any) -> UsbDriver:
    """A driver whose emulated device streams nothing."""
    driver = silent(name)
    driver.open()
    driver.configure(driver.settings_type().of({"decoder": "numpy", **settings}))
    driver.start()
    return driver


def held(driver: UsbDriver) -> Any:
    """What the device's registers hold, without those that were never written and read as 0."""
    if not hasattr(driver.emulated, "registers"):
        return driver.emulated.biases
    return {at: value for at, value in driver.emulated.registers.items() if value}


def end(*drivers: UsbDriver) -> None:
    for driver in drivers:
        driver.emulated.feed.end()
        driver.stop()
        driver.close()


@pytest.mark.parametrize("name", [n for n in MODELS if n not in ("evk3_imx636", "evk3_gen31", "silkyevcam_hd")])
def test_registers_are_those_of_a_start_with_these_settings(name):
    """Whichever way a setting came, the camera holds the same; the start's registers are checked in the tests of
    settings, against the makers' values. One that is as it was is not written again."""
    changes = CHANGES[name]
    live, fresh = streaming(name), streaming(name, **changes)
    assert (
        live.change(live.changed_settings(changes)) == [n for n in live.held_settings() if n in changes]
        and live.held_settings() == fresh.held_settings()
    )
    assert held(live) == held(fresh)
    if writes := getattr(live.emulated, "writes", None):
        count = len(writes)
        assert live.change(live.changed_settings(changes)) == [] and len(writes) == count
    end(live, fresh)


def test_the_writes_of_an_imx636_in_their_order():
    """Only what changes, biases first; offsets count from the factory's code and not from the last one."""
    driver = streaming("evk4", bias_fo=5)
    written = driver.emulated.writes
    for given, wanted in (
        ({"bias_fo": -10}, [(0x1004, 0x11A1_0000 | 0x53 - 10)]),
        ({"bias_fo": 0, "bias_hpf": 3}, [(0x1004, 0x11A1_0000 | 0x53), (0x100C, 0x11A1_0003)]),
        ({"trigger_in": True}, [(0x7004, 1 << 10)]),
        ({"event_rate_limit": 5000.0}, None),
        ({"event_rate_limit": 2e7}, [(0x600C, 4000)]),  # the controller is set up already
        (
            {"event_rate_limit": 0.0},
            [(0x6000, 0x155400), (0x6008, 0), (0x600C, 0), (0x6004, 0), (0x6028, 0), (0x6000, 0)],
        ),
    ):
        before = len(written)
        driver.change(driver.changed_settings(given))
        assert wanted is None or written[before:] == wanted, given
    driver.change(driver.changed_settings({"roi_x": 100, "roi_width": 32}))
    before = len(written)
    readout = driver.emulated.registers[4]
    assert readout >> 5 & 1 and readout >> 10 & 1  # masks in effect, and it goes on to send
    driver.change(driver.changed_settings({"roi_x": 0, "roi_width": 0}))
    assert written[before:] == [(4, readout & ~(1 << 5))]
    end(driver)


def test_a_gen31_goes_back_to_the_start_lists_code():
    """Of hpf it is 6, where the maker's table has 1 for the default of 1499 mV."""
    driver = streaming("silkyevcam")
    word = driver.emulated.registers[0x364]
    assert word >> 8 & 0x1FFF == 6
    for value in (1300, 1499):
        driver.change(driver.changed_settings({"bias_hpf": value}))
        assert (driver.emulated.registers[0x364] == word) is (value == 1499)
    driver.change(driver.changed_settings({"roi_width": 64}))
    assert driver.emulated.readout().columns.sum() == 64
    driver.change(driver.changed_settings({"roi_width": 0}))
    assert driver.emulated.readout().passes_all
    end(driver)


def test_a_davis_writes_its_biases_as_libcaer_does():
    """(5, 11) is the ON threshold, (2, 12) the exposure in cycles of 30 MHz; frames and samples go off and on again."""
    driver = streaming("davis346")
    written = driver.emulated.writes
    before = len(written)
    driver.change(driver.changed_settings({"bias_on": 387_500.0 * 128 / 255, "exposure_us": 2000.0, "frames": False}))
    assert written[before:] == [(5, 11, 0xF | 128 << 4 | 5 << 12), (2, 12, 60_000), (2, 4, 0)]
    before = len(written)
    driver.change(driver.changed_settings({"frames": True, "imu": False}))
    driver.change(driver.changed_settings({"imu": True, "trigger_in": True}))
    driver.change(driver.changed_settings({"trigger_in": False}))
    on, off = [(3, p, 1) for p in (2, 3, 4)], [(3, p, 0) for p in (2, 3, 4)]
    edges = [[(4, p, value) for p in (1, 2, 0)] for value in (1, 0)]
    assert written[before:] == [(2, 4, 1), *off, *on, *edges[0], *edges[1]]
    end(driver)


@pytest.mark.parametrize(
    ("name", "given", "told"),
    [
        ("evk4", {"bias_fo": 3, "bias_refr": -21}, "bias_refr is -21 .*must be -20 to 235"),
        ("evk4", {"bias_fo": 3, "bias_diff_off": 190}, "bias_diff_off is 190; .* it would be 263, not 0 to 255"),
        ("evk4", {"bias_fo": 3, "event_rate_limit": 4999.0}, "event_rate_limit is 4999 1/s; .* give 5000 or more"),
        ("evk4", {"bias_fo": 3, "roi_x": 1000, "roi_width": 500}, "does not lie inside 1280x720"),
        ("evk4", {"bias_fo": 3, "bias_foo": 4}, "no setting 'bias_foo'; did you mean 'bias_fo'"),
        ("evk4", {"bias_fo": 3, "packet_ms": 5.0}, "packet_ms is decided when the camera starts, .* bias_fo, bias_hpf"),
        ("evk3_gen41", {"bias_pr": 3, "bias_diff_off": 0x50}, "at least 15 codes"),
        ("silkyevcam", {"bias_pr": 1300, "bias_diff_on": 300}, "must lie 75 mV above"),
        ("silkyevcam", {"bias_pr": 1300, "roi_x": 600, "roi_width": 64}, "does not lie inside 640x480"),
        ("silkyevcam", {"bias_pr": 1300, "legacy_writes": True}, "legacy_writes is decided when the camera starts"),
        ("davis346", {"bias_pr": 9.0, "roi_y": 200, "roi_height": 61}, "does not lie inside 346x260"),
        ("dvxplorer", {"sensitivity": "high", "binning": True}, "binning is decided when the camera starts"),
        ("dvxplorer_mini", {"sensitivity": "high", "imu": False}, "imu is decided when the camera starts"),
        ("dvxplorer_micro", {"sensitivity": "loud"}, "sensitivity is 'loud', must be one of"),
    ],
)
def test_of_settings_with_one_that_is_wrong_nothing_is_written(name, given, told):
    driver = streaming(name)
    count, before = len(driver.emulated.writes), driver.held_settings()
    with pytest.raises(ValueError, match=told) as caught:
        driver.changed_settings(given)
    assert len(driver.emulated.writes) == count and driver.held_settings() == before
    assert "\n" not in str(caught.value)
    end(driver)


def test_the_same_checks_before_the_start():
    """What is wrong for a sensor is told before the first register is written, then too."""
    for name, given in (("silkyevcam", {"bias_fo": 1500, "roi_x": 600, "roi_width": 64}),
                        ("evk4", {"bias_fo": 3, "bias_diff_off": 190})):  # fmt: skip
        driver = silent(name)
        driver.open()
        count = len(driver.emulated.writes)
        with pytest.raises(ValueError, match=r"does not lie inside|it would be 263"):
            driver.configure(driver.settings_type().of(given))
        assert len(driver.emulated.writes) == count
        driver.close()


def test_configured_twice_offsets_do_not_add_up():
    driver = silent("evk4")
    driver.open()
    for offset in (-10, 7, 0):
        driver.configure(driver.settings_type().of({"bias_fo": offset}))
        assert driver.emulated.registers[0x1004] == 0x11A1_0000 | 0x53 + offset
    driver.close()


@pytest.mark.parametrize("name", ["evk4", "davis346"])
def test_what_failed_on_the_wire_is_not_known_and_written_again(name):
    """A setting that may or may not have been written is in no description until it is."""
    driver = streaming(name)
    given = {"bias_refr": 5}
    driver.emulated.faults.control_timeout = True
    with pytest.raises(ValueError, match=r"no answer in 1 s; unplug it") as caught:
        driver.change(driver.settings_type().of({"decoder": "numpy", **given}))
    assert "what the camera has of bias_refr is not known now: set it again" in str(caught.value)
    assert "bias_refr" not in driver.held_settings()
    driver.emulated.faults.control_timeout = False
    other = {"roi_width": 64}
    assert set(driver.change(driver.changed_settings(other))) == {"bias_refr", "roi_width"}
    standard = streaming(name, **other)
    assert held(driver) == held(standard) and driver.held_settings() == standard.held_settings()
    end(driver, standard)


def test_a_register_that_is_looked_at_while_it_is_written(tmp_path):
    """The thread that reads the data may come between: what it then sends follows the register all the same."""
    random_recording(tmp_path / "a.npz", 1280, 720, 500)
    device = played("evk4", tmp_path / "a.npz").emulated

    class Looked(dict):
        def __setitem__(self, at, value):
            device.streaming = lambda: True  # a read comes in just before the register has its value
            device._stream(512, 0.0)
            super().__setitem__(at, value)

    device.registers = Looked(device.registers, **{})
    for address in (0x2000, 4):
        device._store(address, 1 << 5)
    device._stream(512, 0.0)
    assert device.feed.register_filter is not None and device.feed.register_filter.columns.sum() == 1280 - 31


@pytest.mark.parametrize(
    ("name", "file", "size"),
    [("evk4", "a.raw", (1280, 720)), ("evk4", "a.npz", (1280, 720)), ("silkyevcam", "a.raw", (640, 480)),
     ("davis346", "a.npz", (346, 260)), ("dvxplorer", "a.npz", (640, 480))],
)  # fmt: skip
def test_a_region_that_changes_in_mid_stream(name, file, size, tmp_path):
    """All events before, and of those behind all that lie in the region; then all again. Nothing else is lost."""
    sent = random_recording(tmp_path / file, *size, n=12_000, span_us=900_000)
    clock = HandClock()
    driver = played(name, tmp_path / file, speed=1.0, clock=clock)
    readings: list[Reading] = []

    def read_until(stop_ns: int) -> None:
        clock.ns = stop_ns
        while not driver.ended and (not readings or readings[-1].stamp_ns < stop_ns - slack):
            if (reading := driver.read(0.2)) is not None:
                readings.append(reading)

    # the device makes a stretch of up to 20 ms beforehand; the host ends a packet of 1 ms with the event behind it
    cut, whole, slack = 300 * MS, 600 * MS, 25 * MS
    with driver:
        driver.configure(driver.settings_type().of({"decoder": "numpy"}))
        driver.start()
        assert clock.begun.wait(60.0)
        read_until(cut)
        driver.change(driver.changed_settings({"roi_x": 50, "roi_width": 100}))
        read_until(whole)
        driver.change(driver.changed_settings({"roi_x": 0, "roi_width": 0}))
        read_until(1000 * MS)
        assert driver.ended
        assert not {"bytes_lost", "words_unknown", "time_fell", "gaps", "events_stepped_back"} & set(driver.counters())
    inside = (sent.x >= 50) & (sent.x < 150)
    got = joined(readings)
    for begin, stop, wanted in (
        (0, cut - slack, sent),
        (cut + slack, whole - slack, sent[inside]),
        (whole + slack, 2**62, sent),
    ):
        assert same_between(got, wanted, begin, stop)


def same_between(got: Events, wanted: Events, begin_ns: int, stop_ns: int) -> bool:
    """Whether the events of a stretch of time are the same, and there are some."""
    a, b = (e[(e.t > begin_ns) & (e.t <= stop_ns)] for e in (got, wanted))
    return len(a) > 100 and same(a, b)


class NotedClock:
    """The machine's clock, and when the device took the time from which it counts."""

    def __init__(self) -> None:
        self.begun_ns = 0

    def now(self) -> int:
        now = time.monotonic_ns()
        self.begun_ns = self.begun_ns or now
        return now

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)


def test_the_time_of_a_change_is_the_devices(tmp_path):
    """Good to the least delay of what arrives, as far as this process can see it; never ahead of the device."""
    random_recording(tmp_path / "a.npz", 346, 260, n=4000, span_us=400_000)
    clock = NotedClock()
    driver = played("davis346", tmp_path / "a.npz", speed=1.0, clock=clock)
    assert driver.device_now_ns() is None
    delays: list[int] = []
    with driver:
        driver.configure(driver.settings_type().of({"decoder": "numpy"}))
        driver.start()
        while (reading := driver.read(1e-3)) is not None or len(delays) < 20:  # None: nothing waits to be decoded
            if reading is not None:
                delays.append(time.monotonic_ns() - int(reading.events.t[-1]))
        for _ in range(2):
            before, told, after = time.monotonic_ns(), driver.device_now_ns(), time.monotonic_ns()
            # its time begins with the end of the first window of 1 ms
            assert told is not None and before - min(delays) <= told <= after - clock.begun_ns + MS
            time.sleep(0.01)
