"""A jump of the stamps by hours, or of the light by more thresholds than memory holds: refused in one line that names
the cause, before the memory is taken."""

import re

import numpy as np
import pytest

from evis.cli import main
from evis.events import open_recording
from nodes.event_sensor.peers import make_model
from nodes.event_sensor.readout.readout import Readout
from nodes.event_sensor.sensor import EventSensor
from nodes.event_sensor.simulate import simulate_frames

ONE = np.zeros(1, np.int32)
S = 10**9
HOURS = 36_000 * S
NAMED = rf"from {S} ns to the frame at {S + HOURS} ns"
REMEDY = "put frames between the two, cut the sequence there"


def jump(height, width, before=3):
    """Frames of constant light, one a second after the other, and one ten hours later."""
    t = np.concatenate([np.arange(before) * S // (before - 1), [S + HOURS]])
    return np.full((1, len(t), height, width), 0.5, np.float32), t


@pytest.mark.parametrize(
    "faults",
    [
        {"leak_rate": 0.1, "shot_rate": 5.0},
        {"leak_rate": 0.5},
        {"shot_rate": 5.0},
        {"hot_pixel_fraction": 0.01, "hot_pixel_rate": 100.0},
        {"leak_rate": 0.1, "shot_rate": 5.0, "crossing": "monotone"},
        {"model": "v2e", "leak_rate": 0.5},
    ],
)
def test_noise_over_hours_is_refused(faults):
    """128 x 128 pixels at 0.5 Hz and more would be 290 million events in one message, 9 GB."""
    images, t = jump(128, 128)
    faults = dict(faults)
    model = faults.pop("model", "evis")
    sensor = EventSensor(128, 128, **faults) if model == "evis" else make_model(model, 128, 128, **faults)
    with pytest.raises(ValueError, match=rf"leak and noise make .* in 1 x 16384 pixels, too many .*{NAMED}") as told:
        sensor.process(images, t, ONE)
    assert REMEDY in str(told.value) and "lower their rates" in str(told.value) and "\n" not in str(told.value)


def test_the_remedies_help():
    """An episode that begins after the gap, or frames in it, make the same sensor go on."""
    images, t = jump(20, 20)
    sensor = EventSensor(20, 20, leak_rate=0.1, shot_rate=5.0)
    sensor.process(images[:, :3], t[:3], ONE)
    sensor.process(images[:, 3:], t[3:], ONE + 1)
    assert len(sensor.process(images[:, 3:], t[3:] + 2 * S, ONE + 1).t)
    few = EventSensor(20, 20, leak_rate=0.1)
    assert len(few.process(images, t, ONE).t) == pytest.approx(400 * 0.1 * 36_001, rel=1e-3)  # a gap that fits is kept


def test_a_span_that_no_time_code_holds_names_the_stamps_too():
    images, t = jump(260, 346)
    with pytest.raises(ValueError, match=rf"too long for the event sensor.*{NAMED}.*{REMEDY}"):
        EventSensor(260, 346).process(images, t, ONE)
    envs = 2**20
    with pytest.raises(ValueError, match=rf"too long for event model esim.*{NAMED}.*{REMEDY}"):
        make_model("esim", 1, 1, envs).process(np.ones((envs, 4, 1, 1), np.float32), jump(1, 1)[1], np.zeros(envs))
    with pytest.raises(ValueError, match="from 7 to 1099511627783 ns is too long for the readout"):
        Readout(4, 4, readout_rate=1e12).apply(
            {n: np.zeros(0, d) for n, d in zip("txyp", (np.int64, np.uint16, np.uint16, np.uint8))},
            np.array([0, 0]), 7, 2**40 + 7,
        )  # fmt: skip


def test_a_model_that_makes_too_many_says_where(monkeypatch):
    """How many a diffusion makes is known only when they are counted."""
    from nodes.event_sensor.peers import model

    monkeypatch.setattr(model, "MOST_BACKGROUND", 3000)
    images, t = jump(20, 20)
    with pytest.raises(ValueError, match=rf"dvs_voltmeter makes \d+ events, too many for a message, {NAMED}.*{REMEDY}"):
        make_model("dvs_voltmeter", 20, 20).process(images, t, ONE)


def test_simulate_keeps_what_it_has_and_says_why(tmp_path, capsys):
    """The command on such frames: exit 1, one line, and the events of the frames before in the file."""
    images, t = jump(128, 128, before=40)
    images[0, ::2] *= 2
    np.savez(tmp_path / "gap.npz", luminance=images[0], t=t)
    words = ["events", "simulate", str(tmp_path / "gap.npz"), str(tmp_path / "out.npz"), "--leak-rate", "0.1"]
    assert main([*words, "--shot-rate", "5"]) == 1
    out, err = capsys.readouterr()
    assert not out and err.count("\n") == 1 and "Traceback" not in err
    assert re.search(rf"leak and noise make .* from \d+ ns to the frame at {S + HOURS} ns: {REMEDY}", err)
    with open_recording(tmp_path / "out.npz") as recording:
        made = recording.read_until(2**62)
    taken = int(re.search(r"holds the events of (\d+) of 41 frames", err)[1])
    whole = simulate_frames(images[0, :taken], t[:taken], leak_rate=0.1, shot_rate=5.0)
    assert taken >= 20 and len(made) > 1000 and made.t.tobytes() == whole["t"].tobytes()


def test_more_events_than_the_memory_holds(tmp_path, monkeypatch):
    """ln of a step of a million is 13.8: 1,381 thresholds of 0.01 at each of 128 x 128 pixels."""
    meminfo = tmp_path / "meminfo"
    meminfo.write_text("MemAvailable: 400000 kB\n")
    monkeypatch.setattr("evis.gpu.room.MEMINFO", meminfo)
    monkeypatch.setattr("evis.gpu.room.CGROUP", tmp_path)
    images = np.full((1, 2, 128, 128), 1e-3, np.float32)
    images[0, 1] = 1e3
    sensor = EventSensor(128, 128, threshold=0.01)
    with pytest.raises(ValueError, match=r"^[0-9]+ events in one message take [0-9.]+ GB .*, of which 0.41 are free; "):
        sensor.process(images, np.array([0, S // 1000]), ONE)
    meminfo.write_text("MemAvailable: 4000000 kB\n")
    events = EventSensor(128, 128, threshold=0.01).process(images, np.array([0, S // 1000]), ONE)
    assert len(events.t) == 128 * 128 * 1381
