"""What goes wrong on USB, through the real drivers: one clear line, or counted, marked and survived."""

from __future__ import annotations

import numpy as np
import pytest
from usb_rig import MS, HandClock, joined, played, random_recording, run, same, silent

from nodes.camera.emulated.faults import Faults
from nodes.camera.find import list_devices
from nodes.camera.usb.models import MODELS

FAMILIES = ["evk4", "silkyevcam", "davis346", "dvxplorer", "dvxplorer_mini", "dvxplorer_micro", "dvs128"]


def one_line(error: pytest.ExceptionInfo[BaseException]) -> str:
    text = str(error.value)
    assert text and "\n" not in text
    return text


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize(
    ("fault", "text"),
    [
        ("busy", "busy: another program or node has it open; close that"),
        ("no_permission", "no permission to open it: run `evis camera udev"),
        ("control_timeout", "no answer in 1 s"),
    ],
)
def test_a_camera_that_cannot_be_opened(name, fault, text):
    """The camera, the reason and the remedy in one line."""
    if name == "dvs128" and fault == "control_timeout":
        driver = silent(name, fault)
        driver.open()  # it is asked nothing before it is configured
        with pytest.raises(OSError, match=text) as error:
            driver.configure(driver.settings_type()())
        driver.close()
    else:
        with pytest.raises(OSError, match=text) as error:
            silent(name, fault).open()
    if fault == "no_permission":
        assert "udevadm" in one_line(error) and "plug it in again" in one_line(error)
    maker = MODELS[name].title.split()[0]
    assert one_line(error).startswith(maker)


@pytest.mark.parametrize("name", FAMILIES)
def test_absent(name):
    """Not on the bus."""
    with pytest.raises(OSError, match=r"no .* found: plug it in"):
        silent(name, "absent")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("evk4", "unknown firmware 2.1.0; 3.8.0 or later"),
        ("evk3_genx320", "unknown firmware 2.1.0"),
        ("silkyevcam", r"unknown sensor \(acme,new_sensor, ti,tmp103\)"),
        ("davis346", "unknown firmware 1; 6 or later"),
        ("dvxplorer", "unknown firmware 1; 8 or later"),
        ("dvs128", "unknown firmware 5; 14 or later"),
    ],
)
def test_unknown_firmware(name, text):
    """Refused before anything is written to the sensor."""
    driver = silent(name, "unknown_firmware")
    with pytest.raises(OSError, match=text) as error:
        driver.open()
    one_line(error)
    assert not getattr(driver.emulated, "writes", [])


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("evk4", "unknown chip: register 0x14 of the IMX636 reads 0xdeadbeef"),
        ("silkyevcam", "unknown chip: register 0x800 of the Gen3.1 reads 0xef"),
        ("evk3_gen41", "unknown chip: register 0x14 of the Gen4.1"),
        ("dvxplorer_mini", "unknown sensor of 999x480"),
        ("davis346", "unknown sensor of 999x260"),
    ],
)
def test_unknown_chip(name, text):
    """The board is one of ours, the chip is not: the line says what can be done instead."""
    with pytest.raises(OSError, match=text) as error:
        silent(name, "unknown_chip").open()
    assert str(error.value).endswith("play that with file:=REC or --file REC")


def test_list_names_the_problem():
    """A camera that cannot be opened is listed with the reason; one that can, with its serial."""
    for name in ("davis346", "dvxplorer_mini", "evk4", "silkyevcam_hd", "dvs128"):
        driver = silent(name)
        (good,) = list_devices(driver.bus)
        assert (good.serial, good.name) == ("0000e915", name) and "problem" not in good.details
        assert not getattr(driver.emulated, "writes", [])  # looking changes nothing
    (bad,) = list_devices(silent("evk4", "no_permission").bus)
    assert bad.serial == "" and "evis camera udev" in bad.details["problem"]


@pytest.mark.parametrize("name", FAMILIES)
def test_short_reads_and_timeouts_lose_nothing(name, tmp_path):
    """Reads of 7 bytes (cut inside words) and timeouts in between: all events."""
    model = MODELS[name]
    sent = random_recording(tmp_path / "a.npz", model.width, model.height, 2000)
    driver = played(name, tmp_path / "a.npz", "short=7,timeout_every=3")
    assert same(joined(run(driver)), sent)
    assert not driver.counters()


@pytest.mark.parametrize("name", FAMILIES)
def test_stalls_are_cleared_counted_and_marked(name, tmp_path):
    """The endpoint is unhalted, the packets after a stall say that something is missing, the stream goes on."""
    model = MODELS[name]
    sent = random_recording(tmp_path / "a.npz", model.width, model.height)
    driver = played(name, tmp_path / "a.npz", "short=2048,stall_every=9")
    readings = run(driver)
    counters = driver.counters()
    assert counters["stalls"] >= 2 and counters["gaps"] >= 1
    assert sum(r.lost > 0 for r in readings) >= 1
    got = joined(readings)
    assert 0.5 * len(sent) < len(got) <= len(sent)
    assert abs(int(got.t[-1]) - int(sent.t[-1])) < 20_000_000


@pytest.mark.parametrize("name", FAMILIES)
@pytest.mark.parametrize("fault", ["lose_every=5", "garbage_every=5"])
def test_lost_packets_and_garbage_do_not_end_the_stream(name, fault, tmp_path):
    """What the driver cannot see it cannot count; it decodes on, and events stay on the sensor."""
    model = MODELS[name]
    sent = random_recording(tmp_path / "a.npz", model.width, model.height)
    got = joined(run(played(name, tmp_path / "a.npz", f"short=4096,{fault}"), steps=200_000))
    assert len(got) > 0.3 * len(sent)
    assert got.x.max() < model.width and got.y.max() < model.height


@pytest.mark.parametrize("name", ["evk4", "davis346"])
def test_a_lost_time_word_is_counted(name, tmp_path):
    """Enough packets are lost that a word of the time's upper part is among them: the time falls, and it is said."""
    model = MODELS[name]
    random_recording(tmp_path / "a.npz", model.width, model.height, 20_000)
    whole, lossy = (played(name, tmp_path / "a.npz", f"short=4096{fault}") for fault in ("", ",lose_every=5"))
    assert "time_fell" not in (run(whole, steps=200_000) and whole.counters())
    got = joined(run(lossy, steps=200_000))
    falls = int((np.diff(got.t) < -1_000_000).sum())
    assert len(got) < 20_000 and 1 <= lossy.counters()["time_fell"] <= falls


@pytest.mark.parametrize("name", FAMILIES)
def test_unplugged_in_mid_stream(name, tmp_path):
    """What had arrived is given, then one line with the remedy."""
    model = MODELS[name]
    sent = random_recording(tmp_path / "a.npz", model.width, model.height)
    driver = played(name, tmp_path / "a.npz", "short=1024,unplug_after=20000")
    readings = []
    with driver:
        driver.configure(driver.settings_type().of({"decoder": "numpy"}))
        driver.start()
        with pytest.raises(OSError, match=r"unplugged in mid-stream after .* bytes; with reconnect:=true") as error:
            while True:
                reading = driver.read(0.2)
                readings += [reading] if reading is not None else []
    one_line(error)
    got = joined(readings)
    assert same(got, sent[: len(got)]) and len(got) > 1000


@pytest.mark.parametrize("name", FAMILIES)
def test_reconnect(name, tmp_path):
    """With reconnect the same camera is found again by its serial, configured as before, and its stream goes on."""
    model = MODELS[name]
    sent = random_recording(tmp_path / "a.npz", model.width, model.height)
    driver = played(name, tmp_path / "a.npz", "short=1024,unplug_after=20000,replug")
    with driver:
        driver.configure(driver.settings_type().of({"decoder": "numpy", "reconnect": True}))
        driver.start()
        readings = []
        while not driver.ended:
            reading = driver.read(0.2)
            readings += [reading] if reading is not None else []
        counters = driver.counters()
    assert counters["unplugged"] == counters["reconnected"] == driver.episode == 1
    got = joined(readings)
    assert len(got) > 0.8 * len(sent)


def test_faults_of_a_text():
    """Names and counts; a wrong one is named."""
    assert Faults.of("busy, short=100") == Faults(busy=True, short=100)
    assert Faults.of("") == Faults()
    for text, message in (("bussy", "did you mean 'busy'"), ("short", "needs a count"), ("busy=3", "true or false")):
        with pytest.raises(ValueError, match=message):
            Faults.of(text)


@pytest.mark.parametrize("name", MODELS)
def test_a_driver_can_be_used_again(name, tmp_path):
    """Stop and start without closing: the sensor stops and sends again."""
    random_recording(tmp_path / "a.npz", MODELS[name].width, MODELS[name].height)
    clock = HandClock()
    driver = played(name, tmp_path / "a.npz", speed=1.0, clock=clock)
    with driver:
        driver.configure(driver.settings_type().of({"decoder": "numpy"}))
        parts = []
        for until_ns in (100 * MS, 300 * MS):
            driver.start()
            assert clock.begun.wait(60.0)
            clock.ns = until_ns
            reading = driver.read(60.0)
            assert reading is not None
            parts.append(reading)
            driver.stop()
            assert not driver.emulated.streaming()
    assert all(len(p.events) for p in parts)
    assert np.diff([int(p.events.t[0]) for p in parts])[0] > 0


def test_reconnect_takes_the_same_camera_only(tmp_path):
    """Another camera of the model on the bus is left alone, in whatever order they are found."""
    random_recording(tmp_path / "a.npz", 346, 260)
    driver = played("davis346", tmp_path / "a.npz", "short=1024,unplug_after=20000,replug")
    other = silent("davis346").emulated
    other.identity.serial, other.address = "00000777", 9
    driver.bus.backend.devices.insert(0, other)
    with driver:
        driver.configure(driver.settings_type().of({"decoder": "numpy", "reconnect": True}))
        driver.start()
        while not driver.ended:
            driver.read(0.2)
        assert driver.info().serial == "0000e915" and driver.counters()["reconnected"] == 1
    assert not other.writes and not other.claimed
