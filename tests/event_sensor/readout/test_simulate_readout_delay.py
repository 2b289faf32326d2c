"""What `evis events simulate` says of a readout that was slower than the events: mean and longest wait."""

import json

import numpy as np
import pytest

from evis.cli import main
from nodes.event_sensor.simulate import Simulation


def frames(path):
    """All 64 pixels rise at once: a burst of equal times for a readout of 1 Mev/s."""
    np.savez(path, luminance=np.stack([np.ones((8, 8)), np.full((8, 8), 1.3)]).astype(np.float32), t=[0, 10**6])
    return str(path)


def test_mean_and_longest_wait(tmp_path, capsys):
    """64 events at one instant, one per us: the k-th waits k us, 1 to 63; the sum says nothing to a reader."""
    words = ["events", "simulate", frames(tmp_path / "f.npz"), str(tmp_path / "e.npz"), "--crossing", "frame"]
    words += ["--readout-rate", "1e6"]
    assert main([*words, "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["events"] == 64 and said["readout_delayed"] == 63
    assert said["readout_delay_mean_us"] == pytest.approx(32.0)
    assert said["readout_delay_max_us"] == pytest.approx(63.0)
    assert "readout_delay_ns" not in said
    assert main(words) == 0
    assert "readout_delay_max_us" in capsys.readouterr().out


def test_without_a_readout_nothing_is_said(tmp_path, capsys):
    assert main(["events", "simulate", frames(tmp_path / "f.npz"), str(tmp_path / "e.npz"), "--json"]) == 0
    assert not [name for name in json.loads(capsys.readouterr().out) if name.startswith("readout")]
    assert Simulation().longest_delay_ns == 0
