"""The table of event hashes: a case is what the pure parts give, and a difference is found and sized."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bench import event_hashes
from bench.event_differences import file_of, sized
from bench.interpolation.pipeline import simulate
from evis.scene import load_scene
from nodes.interpolator.auto.world import World

DENSE = ("spinning_disk", "ideal", "none")


@pytest.fixture(scope="module")
def disk() -> dict[str, np.ndarray]:
    """Events of a case whose frames are all rendered."""
    return event_hashes.events_of(DENSE, "cpu")["cam0"]


def test_a_case_has_the_events_of_the_pure_parts(disk: dict[str, np.ndarray]) -> None:
    """The graph composed in this process adds and loses nothing: 30 x 8 keyframes a second, threshold 0.2."""
    world = World(load_scene("spinning_disk", {"width": 96, "height": 72}), 200_000_000)
    truth = simulate(world, "none", 240, 1, 200_000_000).streams["linear"]
    assert len(truth.t) > 10_000
    for name in "txyp":
        np.testing.assert_array_equal(disk[name], getattr(truth, name))


def write(path: Path, columns: dict[str, np.ndarray], **about: object) -> Path:
    """A file of one case, beside it its events."""
    name = "/".join((*DENSE, "cam0"))
    folder = path.with_suffix("")
    folder.mkdir()
    np.savez_compressed(folder / file_of(name), **columns)
    settings = {"size": [96, 72], "duration_s": 0.2, "seed": 1, **about}
    content = {"about": settings, "events": folder.name, "cases": {name: event_hashes.row_of(columns)}}
    path.write_text(json.dumps(content))
    return path


def test_equal_events_compare_equal(
    tmp_path: Path, disk: dict[str, np.ndarray], capsys: pytest.CaptureFixture[str]
) -> None:
    paths = [str(write(tmp_path / name, disk)) for name in ("a.json", "b.json")]
    assert event_hashes.main(["--compare", *paths]) == 0
    assert f"{len(disk['t']):,} events\n1 equal, 0 different, 0 missing" in capsys.readouterr().out


def test_a_difference_is_named_and_sized(
    tmp_path: Path, disk: dict[str, np.ndarray], capsys: pytest.CaptureFixture[str]
) -> None:
    """A late event, and a lost one."""
    late = {name: values.copy() for name, values in disk.items()}
    late["t"][-1] += 7
    lost = {name: values[:-1] for name, values in disk.items()}
    first, second, third = (str(write(tmp_path / f"{n}.json", c)) for n, c in enumerate((disk, late, lost)))
    assert event_hashes.main(["--compare", first, second]) == 1
    shown = capsys.readouterr().out
    assert shown.startswith("different  spinning_disk/ideal/none/cam0")
    assert "columns t differ; every pixel has the same events, 1 times differ, by up to 7 ns" in shown
    assert event_hashes.main(["--compare", first, third]) == 1
    count = len(disk["t"])
    assert f"{count:,} -> {count - 1:,} events" in capsys.readouterr().out


def test_another_order_is_told_from_other_times(disk: dict[str, np.ndarray]) -> None:
    """The pixels' own events are the same, and stand the other way round in the file."""
    one = {"t": np.array([5, 5]), "x": np.array([1, 2]), "y": np.array([0, 0]), "p": np.array([1, 1])}
    other = {name: values[::-1] for name, values in one.items()}
    assert (
        sized(one, other) == "every pixel has the same events, 0 times differ, by up to 0 ns, and so does their order"
    )
    fewer = {name: values[:1] for name, values in one.items()}
    assert sized(one, fewer).startswith("50.0000% of the events have no partner")


def test_what_is_in_one_file_alone_is_no_success(tmp_path: Path, disk: dict[str, np.ndarray]) -> None:
    first = write(tmp_path / "a.json", disk)
    empty = tmp_path / "b.json"
    empty.write_text(json.dumps({**json.loads(first.read_text()), "cases": {}}))
    assert event_hashes.main(["--compare", str(first), str(empty)]) == 1
    assert event_hashes.main(["--compare", str(empty), str(empty)]) == 1


def test_other_settings_are_not_compared(
    tmp_path: Path, disk: dict[str, np.ndarray], capsys: pytest.CaptureFixture[str]
) -> None:
    first, second = write(tmp_path / "a.json", disk), write(tmp_path / "b.json", disk, seed=2)
    assert event_hashes.main(["--compare", str(first), str(second)]) == 1
    assert "seed 1" in (told := capsys.readouterr().err) and "has 2" in told


def test_a_case_that_fails_costs_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is listed with its reason, and the exit status is 1."""

    def events_of(case: event_hashes.Case, device: str) -> dict[str, dict[str, np.ndarray]]:
        if case[1] == "imx636":
            raise ValueError("no such sensor")
        return {"cam0": {name: np.zeros(1, dtype) for name, dtype in event_hashes.COLUMNS.items()}}

    monkeypatch.setattr(event_hashes, "events_of", events_of)
    out = tmp_path / "a.json"
    assert event_hashes.main(["--out", str(out), "--scenes", "drone"]) == 1
    found = json.loads(out.read_text())
    assert len(found["cases"]) == 6 and len(found["failures"]) == 3
    assert found["failures"]["drone/imx636/rigid"] == "ValueError: no such sensor"
