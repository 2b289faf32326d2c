"""interpolator="auto" of a Simulation: chosen once, the same as what was chosen given by hand, or one line why not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import evis
from evis.bag.reader import BagReader
from nodes.interpolator.auto import launch as auto
from nodes.interpolator.auto.choice import Candidate
from nodes.interpolator.auto.trial import Measured, Trial

SIZE = {"width": 48, "height": 36}


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The seeds for which the scene is measured; the measurement finds splat at 60 Hz x 4."""
    seeds: list[int] = []

    def measured(setting: Any, say: Any) -> tuple[Measured, bool]:
        seeds.append(setting.seed)
        say("a round of splat")
        way = ("splat", 60.0, 4)
        return Measured([Candidate(*way, 0.1, 0.01)], trials=[Trial(*way, 0.01)]), True

    monkeypatch.setattr(auto, "measured", measured)
    return seeds


def test_auto_is_what_it_has_chosen(asked: list[int], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The same events as with the choice given by hand; another seed keeps it, and the bag tells of it."""
    bag = tmp_path / "auto.mcap"
    given: dict[str, Any] = {"shot_rate": 20.0, **SIZE}
    with evis.Simulation("spinning_disk", interpolator="auto", seed=3, **given) as sim:
        chosen = sim.chosen
        assert (chosen["interpolator"], chosen["keyframe_rate"], chosen["upsampling"]) == ("splat", 60, 4)
        assert sim.keyframe_rate == 60
        own = [step.events.t.tobytes() for step in sim.run(0.05)]
        sim.save(bag)
        other = [step.events.t.tobytes() for step in [sim.reset(seed=4), *sim.run(0.05)]]
        assert sim.chosen == chosen and other != own
    with evis.Simulation("spinning_disk", interpolator="splat", keyframe_rate=60, upsampling=4, seed=3, **given) as sim:
        assert [step.events.t.tobytes() for step in sim.run(0.05)] == own and not sim.chosen
    with BagReader(bag) as reader:
        assert "splat" in reader.metadata["evis"]["chosen.summary"]
    assert asked == [3] and capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("target", "arguments", "says"),
    [
        ("spinning_disk", {"wanted_error": 0.1}, "wanted_error is for interpolator:=auto"),
        ("spinning_disk", {"interpolator": "auto", "wanted_rtf": -1}, "wanted_rtf is -1"),
        ("spinning_disk", {"interpolator": "auto", "device": "cuda:77"}, "no device 'cuda:77'"),
    ],
)
def test_what_auto_cannot_choose_is_said_in_a_line(target: str, arguments: dict[str, Any], says: str) -> None:
    with pytest.raises(evis.SimulationError, match=says) as caught:
        evis.Simulation(target, **arguments, **SIZE)
    assert "\n" not in str(caught.value)
