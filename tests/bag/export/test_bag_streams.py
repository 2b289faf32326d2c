"""Frames and events of a bag in the forms that other commands take."""

import json

import numpy as np
import pytest
from bag_messages import scene

from evis.bag import BagError
from evis.bag.export.topics import export
from evis.bag.writer import BagWriter
from evis.cli import main
from evis.events import RecordingError, open_recording
from msgs.camera import Frames
from msgs.header import Header

NS = 1_000_000


def bag_of_frames(path, envs=1):
    """A first message of one frame and two of three, as an interpolator sends them; returns what they hold."""
    rng = np.random.default_rng(5)
    light = np.exp(rng.normal(size=(envs, 7, 4, 6))).astype(np.float32)
    t = np.arange(7, dtype=np.int64) * NS
    with BagWriter(path, {"evis": {"seed": "7"}}) as writer:
        for part in (slice(0, 1), slice(1, 4), slice(4, 7)):
            stamp = Header(int(t[part][-1]), clock="sim")
            frames = Frames(stamp, t[part], np.zeros(envs, np.int32), light[:, part])
            writer.write("/cam0/frames", frames)
    return t, light


def test_frames_are_one_sequence(tmp_path):
    """t and luminance: bit by bit, in any number of messages."""
    t, light = bag_of_frames(tmp_path / "a.mcap")
    result = export(tmp_path / "a.mcap", "/cam0/frames", tmp_path / "f.npz")
    assert result["frames"] == 7
    with np.load(tmp_path / "f.npz") as found:
        assert set(found) == {"t", "luminance"}
        assert found["t"].dtype == np.int64 and np.array_equal(found["t"], t)
        assert found["luminance"].dtype == np.float32 and np.array_equal(found["luminance"], light[0])


def test_frames_of_one_environment(tmp_path):
    """Of several, one has to be named."""
    _, light = bag_of_frames(tmp_path / "a.mcap", envs=2)
    with pytest.raises(BagError, match="name one of them: /env0/cam0/frames"):
        export(tmp_path / "a.mcap", "/cam0/frames", tmp_path / "f.npz")
    export(tmp_path / "a.mcap", "/env1/cam0/frames", tmp_path / "f.npz")
    assert np.array_equal(np.load(tmp_path / "f.npz")["luminance"], light[1])


@pytest.mark.parametrize("crossing", ["linear", "cubic"])
def test_exported_frames_are_what_simulate_takes(tmp_path, capsys, crossing):
    """The sensor is given the same numbers as by hand."""
    from nodes.event_sensor.simulate import simulate_frames

    t, light = bag_of_frames(tmp_path / "a.mcap")
    export(tmp_path / "a.mcap", "/cam0/frames", tmp_path / "f.npz")
    words = [str(tmp_path / "f.npz"), str(tmp_path / "e.npz"), "--crossing", crossing, "--json"]
    assert main(["events", "simulate", *words]) == 0
    expected = simulate_frames(light[0], t, crossing=crossing)
    found = np.load(tmp_path / "e.npz")
    assert json.loads(capsys.readouterr().out)["events"] == len(found["t"]) > 50
    assert all(np.array_equal(found[name], expected[name]) for name in "txyp")


def test_the_events_of_each_environment_are_a_stream(tmp_path):
    """Named as `evis bag info` names them; the first when none is named, and that is said."""
    path, messages = tmp_path / "a.mcap", [scene(k, 3)["/cam0/events"] for k in range(4)]
    with BagWriter(path) as writer:
        for message in messages:
            writer.write("/cam0/events", message)
    for env in range(3):
        expected = np.concatenate([m.t[m.env_offsets[env] : m.env_offsets[env + 1]] for m in messages])
        with open_recording(path, topic=f"/env{env}/cam0/events") as recording:
            assert np.array_equal(recording.read().t, expected) and not recording.info.warnings
    with open_recording(path) as recording:
        assert "these are of /env0/cam0/events" in recording.info.warnings[0]
    with pytest.raises(RecordingError, match="they are on /env0/cam0/events, /env1"):
        open_recording(path, topic="/cam0/events")


def test_times_that_a_format_rounds_are_counted(tmp_path):
    """By `.raw`, which holds whole us."""
    message = scene(3)["/cam0/events"]
    message.c = None
    with BagWriter(tmp_path / "a.mcap") as writer:
        writer.write("/cam0/events", message)
    odd = int(np.count_nonzero(message.t % 1000))
    assert odd > 0
    assert export(tmp_path / "a.mcap", "/cam0/events", tmp_path / "e.raw")["times_rounded_to_us"] == odd
    assert "times_rounded_to_us" not in export(tmp_path / "a.mcap", "/cam0/events", tmp_path / "e.npz")


def test_colour_that_a_format_lacks_is_counted(tmp_path):
    """By all but `.npz`, as many as there are events."""
    message = scene(3)["/cam0/events"]
    message.c = np.arange(len(message.t), dtype=np.uint8) % 3
    with BagWriter(tmp_path / "a.mcap") as writer:
        writer.write("/cam0/events", message)
    assert export(tmp_path / "a.mcap", "/cam0/events", tmp_path / "e.csv")["colour_left_out"] == len(message.t) > 0
    assert "colour_left_out" not in export(tmp_path / "a.mcap", "/cam0/events", tmp_path / "e.npz")
    assert np.array_equal(np.load(tmp_path / "e.npz")["c"], message.c)
