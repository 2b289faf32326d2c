"""What an emulated camera sends follows the registers that the driver wrote, as the device's would."""

from __future__ import annotations

import numpy as np
import pytest
from usb_rig import joined, played, random_recording, run, same

from evis.cli import main
from evis.events import Events, open_recording, open_writer
from nodes.camera.emulated.readout import RateLimit

REGION = {"roi_x": 37, "roi_y": 21, "roi_width": 150, "roi_height": 100}
LEFT, TOP, RIGHT, BOTTOM = 37, 21, 187, 121


def inside(events: Events) -> Events:
    """The events of the region, by the numbers that were asked for."""
    keep = (events.x >= LEFT) & (events.x < RIGHT) & (events.y >= TOP) & (events.y < BOTTOM)
    return events[keep]


@pytest.mark.parametrize(
    ("name", "width", "height"),
    [("evk4", 1280, 720), ("evk3_gen41", 1280, 720), ("silkyevcam", 640, 480), ("davis346", 346, 260),
     ("dvxplorer", 640, 480), ("dvxplorer_lite", 320, 240)],
)  # fmt: skip
def test_a_region_of_interest(name, width, height, tmp_path):
    """Events outside of it do not come, those inside come unchanged, at their own places."""
    sent = random_recording(tmp_path / "a.npz", width, height, 6000)
    wanted = inside(sent)
    assert 0 < len(wanted) < len(sent)
    got = joined(run(played(name, tmp_path / "a.npz"), **REGION))
    assert same(got, wanted)
    assert same(joined(run(played(name, tmp_path / "a.npz"))), sent)


@pytest.mark.parametrize("orientation", [1, 2, 3])
def test_a_region_of_a_sensor_that_counts_from_the_far_edge(orientation, tmp_path):
    """The chip's cropper counts before the image is flipped: what comes is the region of the image all the same."""
    sent = random_recording(tmp_path / "a.npz", 640, 480, 6000)
    driver = played("dvxplorer", tmp_path / "a.npz")
    driver.emulated.fixed[1, 2] = orientation
    assert same(joined(run(driver, **REGION)), inside(sent))


@pytest.mark.parametrize(("roi_y", "roi_height"), [(18, 3), (16, 8), (15, 2), (0, 1), (472, 8)])
def test_rows_of_a_dvxplorer_are_cropped_by_groups_of_eight(roi_y, roi_height, tmp_path):
    sent = random_recording(tmp_path / "a.npz", 640, 480, 9000)
    got = joined(run(played("dvxplorer", tmp_path / "a.npz"), roi_y=roi_y, roi_height=roi_height))
    assert same(got, sent[(sent.y >= roi_y) & (sent.y < roi_y + roi_height)]) and len(got)


def test_a_recording_of_the_cameras_own_words_is_cut_too(tmp_path):
    """Without settings its bytes are sent as they are; with a region they cannot be."""
    sent = random_recording(tmp_path / "a.raw", 1280, 720, 6000)
    readings = run(played("evk4", tmp_path / "a.raw"), raw=True)
    with open_recording(tmp_path / "a.raw") as recording:
        recording.read_until(2**62)
        assert b"".join(r.raw.tobytes() for r in readings) == recording.raw.tobytes()
    assert same(joined(run(played("evk4", tmp_path / "a.raw"), **REGION)), inside(sent))


@pytest.mark.parametrize("name", ["evk4", "evk3_gen41"])
@pytest.mark.parametrize("file", ["a.raw", "a.npz"])
def test_an_event_rate_limit(name, file, tmp_path):
    """A burst of 100 events in each us is cut to 1 Mev/s: 200 in each 200 us; the quiet before it comes whole."""
    t = np.concatenate([np.arange(1, 5001), np.repeat(np.arange(10_000, 14_000), 100)]) * 1000
    rng = np.random.default_rng(3)
    burst = Events(
        t, rng.integers(0, 1280, len(t), np.uint16), rng.integers(0, 720, len(t), np.uint16),
        rng.integers(0, 2, len(t), np.uint8),
    )  # fmt: skip
    with open_writer(tmp_path / file, 1280, 720) as writer:
        writer.write(burst)
    driver = played(name, tmp_path / file)
    got = joined(run(driver, event_rate_limit=1e6))
    assert same(got[got.t < 9e6], burst[burst.t < 9e6])
    counts = np.bincount(-(-got.t[got.t > 9e6] // 200_000))
    assert set(counts[counts > 0].tolist()) == {100, 200} and (counts == 100).sum() == 1  # the first us ends a period
    late = got[got.t > 9e6]
    assert set(zip(late.t.tolist(), late.x.tolist(), late.y.tolist())) <= set(
        zip(burst.t.tolist(), burst.x.tolist(), burst.y.tolist())
    )
    assert len(np.unique(late.t)) > 3900  # from all of the period, not only from its start
    assert driver.counters()["events_over_rate_limit"] == len(burst) - len(got)
    whole = played(name, tmp_path / file)
    assert same(joined(run(whole)), burst) and "events_over_rate_limit" not in whole.counters()


def test_a_period_that_comes_in_pieces_counts_once():
    """However a stretch of time is cut, no period lets more through."""
    t = np.sort(np.random.default_rng(5).integers(1, 2_000_000, 4000))
    limit, total = RateLimit(50, 200_000), np.zeros(12, int)
    for part in np.array_split(t, 37):
        total += np.bincount(-(-part[limit(part)] // 200_000), minlength=12)
    assert total.max() == 50 and (total[1:11] == 50).all()
    assert len(RateLimit(50, 200_000)(t[:0])) == 0 and not RateLimit(0, 200_000)(t).any()


def test_parts_that_are_switched_off(tmp_path):
    """Inertial samples of a camera whose chip is off are not sent."""
    from evis.events.arrays import Imu
    from nodes.camera.emulated.readout import Readout

    sent = random_recording(tmp_path / "a.npz", 346, 260, 500)
    readout = Readout(played("davis346", tmp_path / "a.npz").emulated.counts, frames=False, imu=False)
    given = Events(sent.t, sent.x, sent.y, sent.p, imu=Imu(sent.t[:1], np.ones((1, 3)), np.ones((1, 3)), np.ones(1)))
    assert len(readout(given).imu) == 0 and same(readout(given), sent) and not readout.passes_all
    driver = played("davis346", tmp_path / "a.npz")
    run(driver, frames=False, imu=False)
    driver.emulated.registers_changed = True
    assert not driver.emulated.readout().frames


@pytest.mark.parametrize(
    ("name", "given", "words"),
    [
        ("evk4", {"bias_fo": 10, "bias_refr": 5, "roi_width": 64}, "bias_fo, bias_refr change nothing"),
        ("davis346", {"background_filter_us": 500.0, "roi_width": 64}, "background_filter_us changes nothing"),
        ("dvxplorer", {"sensitivity": "high"}, "sensitivity changes nothing"),
        ("dvs128", {"bias_pr": 3}, "bias_pr changes nothing"),
        ("evk3_genx320", {"bias_fo": 20}, "bias_fo changes nothing"),
        ("evk4", {"roi_width": 64, "event_rate_limit": 1e6, "buffers": 8}, ""),
    ],
)
def test_what_cannot_be_honoured_is_said_once(name, given, words, tmp_path):
    sent = random_recording(tmp_path / "a.npz", 128, 128, 500)
    driver = played(name, tmp_path / "a.npz")
    with driver:
        driver.configure(driver.settings_type().of({"decoder": "numpy", **given}))
        warnings = driver.info().details.get("warnings", [])
    assert len(warnings) == bool(words) and all(words in w and "emulated" in w for w in warnings)
    assert len(sent)


def test_the_command_says_it(tmp_path, capsys):
    random_recording(tmp_path / "a.npz", 346, 260, 500)
    words = ["camera", "stream", "--emulate", "davis346", "--file", str(tmp_path / "a.npz"), "--pace", "fast"]
    assert main([*words, "--set", "bias_pr=5", "--json"]) == 0
    out, err = capsys.readouterr()
    assert err.count("bias_pr changes nothing") == 1 and "bias_pr" not in out
