"""Sequences that are made at once, as environments of one simulation, are to the byte what they are by themselves."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from in_this_process import InThisProcess
from small_recipe import checksums, evis, write

from evis.dataset.making import worker
from evis.dataset.making.batches import BYTES_PER_PIXEL, batch_size, batches
from evis.dataset.making.finished import Entry
from evis.dataset.making.make import make
from evis.dataset.making.tasks import Answerer
from evis.dataset.making.worker import Maker
from evis.dataset.making.workforce import usual_workers
from evis.dataset.recipe import Plan, Recipe
from evis.dataset.recipe_file import read_recipe

LABELLED = ("layout: npz", "layout: dsec\nlabels: [forward_flow, boxes]")
SENSED = (
    "      texture:",
    "      threshold: {from: 0.15, to: 0.3}\n      defocus: {choices: [0, 0.4]}\n      texture:",
)
SPRING = """<mujoco><option timestep="0.001" integrator="Euler" gravity="0 0 0"/><worldbody>
<body name="mass" pos="0 1 0"><joint name="spring" type="slide" axis="1 0 0" stiffness="1e8"/>
<geom size=".1" mass="1"/></body></worldbody></mujoco>"""
SCENE = """
args: {kick: {default: 0.0, help: start}, balls: {type: int, default: 1, help: how many}}
mjcf: spring.xml
initial_joints: {spring: {position: "${kick}"}}
cameras: {cam0: {position: [0, -1, 0], look_at: [0, 1, 0], fov: 60 deg}}
materials: {grey: {albedo: 0.5}}
world:
  - name: ball
    shape: sphere
    radius: 0.05
    position: ["${0.2 * k}", 0.5, 0.2]
    material: grey
    copies: {over: {k: "${balls}"}}
lights: {key: {kind: directional, direction: [0, 1, -0.5], irradiance: [5, 5, 5]}}
"""


def spring(folder: Path, arguments: str) -> Recipe:
    """A recipe of a mass on a spring that is too stiff for its step, and of balls beside it."""
    (folder / "spring.xml").write_text(SPRING)
    (folder / "spring.yaml").write_text(SCENE)
    (folder / "recipe.yaml").write_text(
        f"layout: npz\nsequences: 4\nduration: 0.1\nsampling: grid\narguments: {{width: 24, height: 18}}\n"
        f"scenes:\n  spring.yaml:\n    arguments: {arguments}\n"
    )
    return read_recipe(folder / "recipe.yaml")


@pytest.fixture
def by_itself(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Numbers of the sequences that were made by themselves."""
    made, found = Maker.make, []

    def noted(self: Maker, plan: Plan) -> Entry:
        found.append(plan.index)
        return made(self, plan)

    monkeypatch.setattr(Maker, "make", noted)
    return found


def test_any_batch_makes_the_same_bytes(tmp_path: Path, by_itself: list[int]) -> None:
    """Of five sequences that differ in arguments of scene and sensor, whole batches and what is left over."""
    recipe = write(tmp_path, LABELLED, SENSED)
    make(read_recipe(recipe), str(tmp_path / "one"), InThisProcess)
    expected = checksums(tmp_path / "one")
    by_itself.clear()
    assert make(read_recipe(recipe), str(tmp_path / "four"), InThisProcess, batch=4).retried == {}
    assert by_itself == [4]
    assert checksums(tmp_path / "four") == expected
    told = evis("dataset", "make", recipe, "--out", tmp_path / "two", "--workers", 1, "--batch", 2, "--json").stdout
    assert json.loads(told)["made"] == 5 and json.loads(told)["retried"] == {}
    assert checksums(tmp_path / "two") == expected


def test_batches_are_full_and_of_what_goes_together(tmp_path: Path) -> None:
    """Other scenes, sizes and lengths are apart; the first sequences come first."""
    text = (
        "layout: npz\nsequences: 12\nduration: 0.1\nscenes:\n"
        "  spinning_disk: {weight: 2, arguments: {omega: {from: 15, to: 70}, keyframe_rate: {choices: [30, 60]}}}\n"
        "  fidget_spinner: {arguments: {threshold: {from: 0.1, to: 0.4}}}\n"
    )
    (tmp_path / "two.yaml").write_text(text)
    plans = read_recipe(tmp_path / "two.yaml").sequences()
    made = batches(plans, 3)
    assert sorted(plan.index for batch in made for plan in batch) == list(range(12))
    assert [batch[0].index for batch in made] == sorted(batch[0].index for batch in made)
    for batch in made:
        assert len({(plan.scene, plan.arguments.get("keyframe_rate")) for plan in batch}) == 1
    spinners = [len(batch) for batch in made if batch[0].scene_name == "fidget_spinner"]
    assert spinners == [3, 1] and batches(plans, 1) == [[plan] for plan in plans]


def test_a_gpu_makes_as_many_at_once_as_its_memory_holds(tmp_path: Path) -> None:
    """And no more than each worker has to make."""
    recipe = read_recipe(write(tmp_path, ("width: 32, height: 24", "width: 640, height: 480")))
    each = BYTES_PER_PIXEL * 640 * 480
    assert [batch_size(recipe, 100, 2, room * each + 1) for room in (0, 1, 5, 1000)] == [1, 1, 5, 16]
    assert batch_size(recipe, 5, 2, 1000 * each) == 3


def test_workers_share_gpus_where_there_are_cores_for_them(monkeypatch: pytest.MonkeyPatch) -> None:
    for cores, gpus, expected in ((2, 0, 2), (32, 2, 28), (2, 2, 2), (6, 4, 4), (16, 1, 14), (8, 1, 8)):
        monkeypatch.setattr("os.sched_getaffinity", lambda pid, n=cores: set(range(n)))
        assert usual_workers(gpus) == expected


def test_what_cannot_be_simulated_side_by_side_is_made_one_by_one(tmp_path: Path, by_itself: list[int]) -> None:
    """An argument that decides how many things there are."""
    recipe = spring(tmp_path, "{balls: {choices: [1, 2]}, threshold: {choices: [0.2, 0.3]}}")
    made = make(recipe, str(tmp_path / "d"), InThisProcess, batch=4)
    assert made.made == 4 and not made.retried and sorted(by_itself) == [0, 1, 2, 3]
    make(recipe, str(tmp_path / "one"), InThisProcess)
    assert checksums(tmp_path / "d") == checksums(tmp_path / "one")


def test_an_environment_that_diverges_fails_alone(tmp_path: Path, by_itself: list[int]) -> None:
    """The others of its batch are what they are by themselves, and none of them is made twice."""
    recipe = spring(tmp_path, "{kick: {choices: [0.0, 0.01]}, threshold: {choices: [0.2, 0.3]}}")
    (tmp_path / "d").mkdir()
    (tmp_path / "one").mkdir()
    plans = [recipe.sequence(index) for index in range(4)]
    told = Answerer(str(tmp_path / "d")).answers([plan.as_dict() for plan in plans])
    failed = [answer["index"] for answer in told if "entry" not in answer]
    assert failed == [plan.index for plan in plans if plan.arguments["kick"]] and len(failed) == 2
    assert all("body 'mass' diverged" in answer["cause"] for answer in told if "entry" not in answer)
    assert not by_itself
    maker = Maker(str(tmp_path / "one"))
    for plan in plans:
        if not plan.arguments["kick"]:
            maker.make(plan)
    assert checksums(tmp_path / "d") == checksums(tmp_path / "one")


def test_a_sequence_that_cannot_be_written_fails_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In mid-run, and then again by itself; the others are there."""
    add = worker.Written.add

    def refused(self: worker.Written, step: Any, picture: bool) -> None:
        if self.plan.index == 2 and picture:
            raise ValueError("what it is cannot be written")
        add(self, step, picture)

    monkeypatch.setattr(worker.Written, "add", refused)
    made = make(read_recipe(write(tmp_path)), str(tmp_path / "d"), InThisProcess, batch=5)
    assert made.made == 4 and made.failed == {2: "what it is cannot be written"} and made.retried == {2: 2}
    assert len(list((tmp_path / "d").glob("*/*/sequence.json"))) == 4 and not list((tmp_path / "d").glob("*/.*"))


@pytest.mark.slow
def test_a_worker_killed_with_a_batch_loses_none_of_it(tmp_path: Path) -> None:
    """As where memory runs out: its sequences are made one by one, by another worker."""
    import os
    import signal
    from collections.abc import Sequence

    from evis.dataset.making.processes import Processes

    victims: list[int] = []

    class Killed(Processes):
        def assign(self, worker: int, plans: Sequence[Plan]) -> None:
            super().assign(worker, plans)
            if not victims:
                victims.append(self._all[worker].process.pid)
                os.kill(victims[0], signal.SIGKILL)
            else:
                assert len(plans) == 1

    recipe = read_recipe(write(tmp_path))
    made = make(recipe, str(tmp_path / "d"), lambda out: Killed(1, out), batch=5)
    assert victims and made.made == 5 and made.retried == dict.fromkeys(range(5), 1)
    make(recipe, str(tmp_path / "one"), InThisProcess)
    assert checksums(tmp_path / "d") == checksums(tmp_path / "one")


@pytest.mark.slow
def test_a_run_of_batches_killed_in_the_middle_goes_on_to_the_same_checksums(tmp_path: Path) -> None:
    """kill -9 of everything while the second batch is made."""
    recipe, out = write(tmp_path), tmp_path / "d"
    words = ["dataset", "make", str(recipe), "--out", str(out), "--workers", "1", "--batch", "2"]
    run = subprocess.Popen([sys.executable, "-m", "evis", *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 120
    while not list(out.glob("*/*/sequence.json")) and time.monotonic() < deadline:
        time.sleep(0.01)
    run.kill()
    run.wait()
    assert 1 <= len(list(out.glob("*/*/sequence.json"))) < 5
    evis(*words, "--resume")
    make(read_recipe(recipe), str(tmp_path / "one"), InThisProcess)
    assert checksums(out) == checksums(tmp_path / "one")
