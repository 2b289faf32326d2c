"""Every real recording, against what independent readers found in it."""

from __future__ import annotations

import hashlib
import json

import numpy as np
import pytest

from evis.cli import events as command
from evis.events import Events, open_recording

WHEEL = [
    f"wheel/wheel_2024_11_26_11_{t}_crop100.aedat4" for t in ("34_19", "34_58", "35_33", "35_50", "36_31", "36_46")
]
FORMATS = {
    "prophesee/faery_evt2.raw": ("raw", "evt2"),
    "prophesee/iebcs_MNIST_ev_0_1_td.dat": ("dat", "2d"),
    "es/faery_dvs.es": ("es", "dvs"),
    "aedat4/aestream_davis.aedat4": ("aedat4", "lz4"),
    "aedat2/DVS128-2017-03-21-short.aedat": ("aedat2", "dvs128"),
    "aedat2/synth_RotatingBar.aedat": ("aedat2", "davis"),
    "nmnist/tonic_sample_nmnist.bin": ("nmnist", ""),
    "txt/slider_depth_events_chunk.txt": ("text", "txyp, t in s"),
    "ros/event_camera_py_test_events_1.bag": ("rosbag1", "evt3"),
    "ros/codecs_mono_cd_0.db3": ("rosbag2-db3", "mono"),
    "derived/gen31_vga_from_bag1.raw": ("raw", "evt3"),
    "derived/hd_from_evt3_sample_ecf.hdf5": ("hdf5", "ecf"),
    "derived/hd_from_evt3_sample_evt21_little.raw": ("raw", "evt21"),
} | {name: ("aedat4", "lz4") for name in WHEEL}


def sha256(events: Events, unit_ns: int) -> str:
    """The ground truth's hash, times in the file's own unit (text files have more digits: to the nearest)."""
    t = np.rint(events.t / unit_ns).astype(np.int64) if (events.t % unit_ns).any() else events.t // unit_ns
    digest = hashlib.sha256()
    for array in (t, events.x, events.y, events.p):
        digest.update(array.astype(array.dtype.newbyteorder("<")).tobytes())
    return digest.hexdigest()


def test_every_file_of_the_ground_truth_is_here(truth):
    """A new recording with checksums gets its test."""
    assert set(FORMATS) == set(truth)


@pytest.mark.parametrize("name", FORMATS)
def test_decoded_arrays(name, truth, recording_path):
    """Format, size and the hash of all events; nothing dropped, nothing cut; triggers where they were counted."""
    known = truth[name]
    with open_recording(recording_path(name)) as recording:
        assert (recording.info.format, recording.info.encoding) == FORMATS[name]
        assert (recording.info.width, recording.info.height) == (known["width"], known["height"])
        events = recording.read()
        assert not recording.info.truncated and not recording.counters()
        assert recording.position == 1.0 or recording.position > 0.9
    assert len(events) == known["n"]
    assert sha256(events, {"us": 1000, "ns": 1}[known["unit"]]) == known["sha256"]
    if "n_triggers" in known:
        edges = events.triggers
        assert len(edges) == known["n_triggers"] and int(edges.t.sum()) // 1000 == known["sum_t_triggers"]
        first = list(zip((edges.t // 1000).tolist(), edges.id.tolist(), edges.value.tolist()))[:2]
        assert first == [tuple(edge) for edge in known["first_triggers"]]


@pytest.mark.parametrize("name", FORMATS)
def test_windows_and_seeking(name, truth, recording_path):
    """Windows of a tenth of the recording hold all events; seeking to the middle goes on where the reading would."""
    with open_recording(recording_path(name)) as recording:
        events = recording.read()
        span = int(events.t[-1] - events.t[0])
        recording.seek(int(events.t[0]))
        parts = []
        for stop in range(int(events.t[0]), int(events.t[-1]) + span // 10 + 1, max(span // 10, 1)):
            parts.append(recording.read_until(stop))
            assert not len(parts[-1]) or int(parts[-1].t.max()) <= stop
        assert len(Events.concatenate(parts)) == len(events)
        middle = int(events.t[0]) + span // 2
        recording.seek(middle)
        rest, at = recording.read(), int(np.argmax(events.t >= middle))
        np.testing.assert_array_equal(rest.t, events.t[at:])
        np.testing.assert_array_equal(rest.x, events.x[at:])
        recording.seek(int(events.t.max()) + 1_000_000_000)
        assert recording.next_t_ns is None and len(recording.read()) == 0


@pytest.mark.parametrize("name", ["es/faery_dvs.es", "derived/hd_from_evt3_sample_ecf.hdf5"])
@pytest.mark.parametrize("backend", ["numpy", "warp"])
def test_both_backends(name, backend, truth, recording_path):
    """The plain loop and the kernel give the same, right, bits."""
    with open_recording(recording_path(name), backend) as recording:
        assert sha256(recording.read(), 1000) == truth[name]["sha256"]


@pytest.mark.parametrize("name", FORMATS)
def test_info(name, truth, recording_path, capsys):
    """`evis events info --json`: the contract's keys, as other readers found them, in ns, not shifted."""
    import argparse

    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    assert command.run(parser.parse_args(["info", str(recording_path(name)), "--json"])) == 0
    info, known = json.loads(capsys.readouterr().out), truth[name]
    unit = {"us": 1000, "ns": 1}[known["unit"]]
    assert (info["width"], info["height"], info["events"]) == (known["width"], known["height"], known["n"])
    assert (info["on"], info["off"]) == (known["n_on"], known["n"] - known["n_on"])
    assert round(info["t_first_ns"] / unit) == known["first"][0] and round(info["t_last_ns"] / unit) == known["last"][0]
    assert (info["format"], info["encoding"]) == FORMATS[name]


def test_size_and_topic_of_the_user(recording_path, capsys):
    """A size given by hand is taken, and events outside of it are dropped and counted."""
    with open_recording(recording_path("nmnist/tonic_sample_nmnist.bin"), size=(20, 34)) as recording:
        events = recording.read()
        assert (recording.info.width, recording.info.geometry_from) == (20, "option")
        assert recording.counters()["events_outside"] == 4325 - len(events) > 0
        assert events.x.max() < 20
