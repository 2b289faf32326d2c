"""Any worker makes the same bytes; what is killed goes on; what fails is said, and the rest is there."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from in_this_process import InThisProcess
from small_recipe import checksums, evis, write

import evis as public
from evis.dataset.errors import DatasetError
from evis.dataset.layouts import LAYOUTS, reader_of
from evis.dataset.making.make import make
from evis.dataset.making.store import INDEX, LocalStore
from evis.dataset.making.tasks import Answer
from evis.dataset.making.worker import Maker
from evis.dataset.recipe import Plan
from evis.dataset.recipe_file import read_recipe
from evis.dataset.report.sheet import write_sheet
from evis.dataset.report.summary import summary
from evis.dataset.report.verify import verify


@pytest.fixture(scope="module")
def serial(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    """The recipe, and the checksums of its data set when one worker makes it from the first to the last."""
    folder = tmp_path_factory.mktemp("serial")
    recipe = write(folder)
    made = make(read_recipe(recipe), str(folder / "d"), InThisProcess)
    assert made.there == made.made == 5 and not made.failed and made.events > 0
    return recipe, checksums(folder / "d")


def test_two_processes_make_the_same_bytes(serial: tuple[Path, dict[str, str]], tmp_path: Path) -> None:
    """And `verify` finds every event again; --count makes the first ones only."""
    recipe, expected = serial
    told = json.loads(evis("dataset", "make", recipe, "--out", tmp_path / "d", "--workers", 2, "--json").stdout)
    assert told["made"] == 5 and checksums(tmp_path / "d") == expected
    found = json.loads(evis("dataset", "verify", tmp_path / "d", "--json").stdout)
    assert found["wrong"] == [] and found["events"] == told["events"]
    make(read_recipe(recipe), str(tmp_path / "two"), InThisProcess, count=2)
    first = {name: digest for name, digest in checksums(tmp_path / "two").items() if name != INDEX}
    assert first.items() <= expected.items() and len(list((tmp_path / "two").glob("*/*"))) == 2


def test_a_data_set_in_a_folder_named_as_one_that_is_being_written(
    serial: tuple[Path, dict[str, str]], tmp_path: Path
) -> None:
    """What lies in it is finished: a second call makes only what is missing, and `verify` finds it whole."""
    recipe, expected = serial
    out = tmp_path / "copy.part" / "set.part"
    assert make(read_recipe(recipe), str(out), InThisProcess, count=2).there == 2
    made = make(read_recipe(recipe), str(out), InThisProcess, resume=True)
    assert (made.there, made.made) == (5, 3) and checksums(out) == expected
    assert verify(str(out))["wrong"] == []


def test_what_the_layout_cannot_hold_is_said_once(tmp_path: Path) -> None:
    """While it is made: labels that were asked for are else found missing when it is read."""
    path = write(tmp_path, ("layout: npz", "layout: mvsec\nlabels: [boxes, depth]"))
    said: list[str] = []
    made = make(read_recipe(path), str(tmp_path / "d"), InThisProcess, count=2, say=said.append)
    assert made.made == 2 and made.notes == ["MVSEC has no boxes: it is left out"]
    assert said == ["note: MVSEC has no boxes: it is left out"]


def test_a_sequence_is_what_a_simulation_gives(tmp_path: Path) -> None:
    """With the arguments and the seed that dataset.json tells, on a worker that has made others before."""
    plan = read_recipe(write(tmp_path)).sequence(3)
    maker = Maker(str(tmp_path / "d"))
    (tmp_path / "d").mkdir()
    for index in (1, 3):
        maker.make(read_recipe(tmp_path / "small.yaml").sequence(index))
    maker.close()
    events = reader_of("npz")(tmp_path / "d" / plan.path).events(0, 10**9)
    with public.Simulation(plan.scene, seed=plan.seed, **plan.arguments) as sim:
        steps = [sim.reset(), *sim.run(0.1)]
    for name in "txyp":
        assert np.array_equal(getattr(events, name), np.concatenate([getattr(s.events, name) for s in steps]))


def test_a_reset_simulation_makes_the_bytes_of_a_new_one(tmp_path: Path) -> None:
    """Where only the seed is another the worker resets its simulation."""
    recipe = write(tmp_path, ("from: 15, to: 70", "choices: [20]"), ("choices: [0, 1]", "choices: [1]"))
    for folder, new in (("warm", False), ("new", True)):
        (tmp_path / folder).mkdir()
        maker = Maker(str(tmp_path / folder))
        for plan in read_recipe(recipe).sequences(3):
            maker = Maker(str(tmp_path / folder)) if new else maker
            maker.make(plan)
    assert checksums(tmp_path / "warm") == checksums(tmp_path / "new")
    assert len(set(checksums(tmp_path / "warm").values())) >= 6  # other seeds, other events


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_is_the_same_to_the_byte_and_holds_every_event(layout: str, tmp_path: Path) -> None:
    """Whatever the worker has made before."""
    if layout == "zarr":
        pytest.importorskip("zarr")
    recipe = read_recipe(write(tmp_path, ("layout: npz", f"layout: {layout}\nlabels: [boxes, forward_flow]")))
    make(recipe, str(tmp_path / "d"), InThisProcess, count=2)
    maker = Maker(str(tmp_path / "again"))
    for index in (1, 0):
        maker.make(recipe.sequence(index))
    maker.close()
    again = checksums(tmp_path / "again")
    assert again and {name: d for name, d in checksums(tmp_path / "d").items() if name != INDEX} == again
    assert verify(str(tmp_path / "d"))["wrong"] == []


def test_a_killed_run_goes_on_to_the_same_checksums(serial: tuple[Path, dict[str, str]], tmp_path: Path) -> None:
    """kill -9 of everything in the middle: workers go with their parent, and nothing is half-written."""
    recipe, expected = serial
    out = tmp_path / "d"
    command = [sys.executable, "-m", "evis", "dataset", "make", str(recipe), "--out", str(out), "--workers", "2"]
    run = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 120
    while not list(out.glob("*/*/sequence.json")) and time.monotonic() < deadline:
        time.sleep(0.01)
    run.kill()
    run.wait()
    for file in out.glob("*/*/*"):  # beside the parts that are cleared at the next start
        if not file.parent.name.endswith(".part"):
            assert (
                checksums(file.parent).items()
                <= {
                    name.removeprefix(f"{file.parent.relative_to(out)}/"): digest for name, digest in expected.items()
                }.items()
            )
    evis("dataset", "make", recipe, "--out", out, "--workers", 2, "--resume")
    assert checksums(out) == expected


def test_a_killed_worker_is_replaced(serial: tuple[Path, dict[str, str]], tmp_path: Path) -> None:
    """As the kernel kills one where memory runs out."""
    from evis.dataset.making.processes import Processes

    recipe, expected = serial
    victims = []

    class Killed(Processes):
        def assign(self, worker: int, plans: Sequence[Plan]) -> None:
            super().assign(worker, plans)
            if plans[0].index == 1 and not victims:
                victims.append(self._all[worker].process.pid)
                os.kill(victims[0], signal.SIGKILL)

    made = make(read_recipe(recipe), str(tmp_path / "d"), lambda out: Killed(1, out))
    assert victims and made.retried == {1: 1} and made.made == 5
    assert checksums(tmp_path / "d") == expected


def test_what_fails_is_listed_with_its_cause_and_the_rest_is_made(tmp_path: Path) -> None:
    """A sequence whose worker is killed each time; --resume tries it again."""

    class Fails(InThisProcess):
        def assign(self, worker: int, plans: Sequence[Plan]) -> None:
            if plans[0].index == 2:
                self.told.append(Answer(worker, 2, cause="the worker was killed", died=True))
            else:
                super().assign(worker, plans)

    said: list[str] = []
    recipe = read_recipe(write(tmp_path))
    made = make(recipe, str(tmp_path / "d"), Fails, say=said.append)
    assert made.made == 4 and made.failed == {2: "the worker was killed"} and made.retried == {2: 2}
    assert said == ["spinning_disk_00002 failed 3 times: the worker was killed"]
    index = json.loads((tmp_path / "d" / INDEX).read_text())
    assert index["failed"] == [{"index": 2, "cause": "the worker was killed"}]
    assert [entry["index"] for entry in index["sequences"]] == [0, 1, 3, 4]
    again = make(recipe, str(tmp_path / "d"), InThisProcess, resume=True)
    assert again.made == 1 and again.there == 5 and not again.failed


def test_a_full_disk_ends_the_run_and_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is left of the sequence that did not fit; what was there is whole."""
    published = []
    publish = LocalStore.publish

    def full(self: LocalStore, folder: Path, entry: object) -> None:
        if len(published) == 2:
            raise OSError(28, "No space left on device", str(folder))
        published.append(entry)
        publish(self, folder, entry)  # type: ignore[arg-type]

    monkeypatch.setattr(LocalStore, "publish", full)
    recipe = read_recipe(write(tmp_path))
    made = make(recipe, str(tmp_path / "d"), InThisProcess)
    assert made.made == 2 and "No space left" in made.stopped
    assert len(list((tmp_path / "d").glob("*/*"))) == 2 and not list((tmp_path / "d").glob("*/.*"))
    monkeypatch.setattr(LocalStore, "publish", publish)
    assert make(recipe, str(tmp_path / "d"), InThisProcess, resume=True).there == 5


def test_places_that_are_not_free(serial: tuple[Path, dict[str, str]], tmp_path: Path) -> None:
    """Another recipe's data set, other files, a file, a folder that another run writes into."""
    recipe, expected = serial
    out = recipe.parent / "d"
    other = read_recipe(write(tmp_path, ("to: 70", "to: 60")))
    with pytest.raises(ValueError, match="another recipe"):
        make(other, str(out), InThisProcess, resume=True)
    with pytest.raises(ValueError, match="is not empty, and holds no data set"):
        make(read_recipe(recipe), str(recipe.parent), InThisProcess)
    for place in (tmp_path / "file", tmp_path / "link"):  # that leads nowhere
        place.write_text("mine") if place.name == "file" else place.symlink_to(tmp_path / "nowhere")
        with pytest.raises(DatasetError, match="holds no data set; name a new folder"):
            make(read_recipe(recipe), str(place), InThisProcess)
    assert (tmp_path / "file").read_text() == "mine" and not (tmp_path / "nowhere").exists()
    with pytest.raises(ValueError, match="--resume goes on"):
        make(read_recipe(recipe), str(out), InThisProcess)
    with LocalStore(str(out)).alone():
        line = evis("dataset", "make", recipe, "--out", out, "--resume", status=1).stderr
    assert "another `evis dataset make`" in line and line.count("\n") == 1
    assert checksums(out) == expected


def test_an_argument_that_only_the_graph_refuses_is_told_with_its_scene(tmp_path: Path) -> None:
    """Before anything is made, at both ends of every range."""
    recipe = read_recipe(write(tmp_path, ("layout: npz", "layout: npz\nlabels: [flw]")))
    with pytest.raises(ValueError, match=r"small.yaml:9: .*no label 'flw'; did you mean 'flow'"):
        make(recipe, str(tmp_path / "d"), InThisProcess)
    assert not (tmp_path / "d").exists()


def test_events_that_the_readout_delays_past_the_end_are_found(tmp_path: Path) -> None:
    """By `verify`, and by a sequence that is read to its end, in a layout that is read by time alone."""
    changes = ("layout: npz", "layout: mcap"), ("shot_rate: 3.0", "timestamp_jitter_us: 200")
    made = make(read_recipe(write(tmp_path, *changes)), str(tmp_path / "d"), InThisProcess, count=2)
    found = verify(str(tmp_path / "d"))
    assert found["wrong"] == [] and found["events"] == made.events > 0
    for sequence in public.dataset.open(tmp_path / "d"):
        events = sequence.events()
        assert len(events.t) == sequence.count() and events.t[-1] > sequence.duration_ns
        with pytest.raises(TypeError, match=r"times are whole ns, not 0.0: .* is from 0.1 s to 0.2 s"):
            sequence.events(0.0, 0.1)  # type: ignore[arg-type]
        with pytest.raises(TypeError, match=r"times are whole ns, not 0.1"):
            sequence.labels("flow", 0, 0.1)  # type: ignore[arg-type]


def test_damage_is_found(serial: tuple[Path, dict[str, str]], tmp_path: Path) -> None:
    """One bit of one file, a file that lacks, and one that nobody wrote."""
    out = tmp_path / "d"
    shutil.copytree(serial[0].parent / "d", out)
    first, second, third = (Path(out, e["path"]) for e in json.loads((out / INDEX).read_text())["sequences"][:3])
    data = bytearray((first / "frame.png").read_bytes())
    data[100] ^= 1
    (first / "frame.png").write_bytes(data)
    (second / "about.json").unlink()
    (third / "more.txt").write_text("x")
    wrong = verify(str(out))["wrong"]
    assert [line.partition("/frame.png")[1] or line.partition("/about.json")[1] or line for line in wrong] == [
        "/frame.png",
        "/about.json",
        f"{third.relative_to(out)}/more.txt was not written by evis",
    ]


def test_info_and_show(serial: tuple[Path, dict[str, str]], tmp_path: Path) -> None:
    """What the data set holds, and a sheet with a picture of each sequence."""
    from PIL import Image

    recipe, _ = serial
    told = summary(str(recipe.parent / "d"))
    assert told["sequences"] == 5 and told["duration_s"] == pytest.approx(0.5) and told["splits"]["train"] == 3
    assert told["scenes"] == {"spinning_disk": 5} and told["events"] > 0
    write_sheet(str(recipe.parent / "d"), str(tmp_path / "sheet"), 48)
    sheet = np.asarray(Image.open(tmp_path / "sheet.png"))
    assert sheet.shape[0] > 100 and sheet.shape[1] > 400 and len(np.unique(sheet.reshape(-1, 3), axis=0)) > 100
    page = (tmp_path / "sheet.html").read_text()
    assert page.count("<img ") == 5 and "spinning_disk_00004" in page and "omega" in page
