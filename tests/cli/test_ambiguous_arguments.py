"""What stands after `evis launch`, `graph` and `events simulate`: scenes by path, arguments twice, wrong values."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from evis.config import paths

Evis = Callable[..., Any]
SCENE = """
args: {side: {default: 1, min: 0.5, unit: m, help: edge of the box}}
cameras: {cam0: {fov: 40 deg}}
world: [{shape: box, size: ["${side}", 1, 1], position: [0, 0, 3], material: grey}]
materials: {grey: {albedo: 0.5}}
"""


def test_a_scene_of_ones_own_is_launched_by_its_path(tmp_path: Path, evis_here: Evis) -> None:
    """With arguments of its own, as those that come with evis."""
    (tmp_path / "mine.yaml").write_text(SCENE)
    made = json.loads(evis_here("launch", "mine.yaml", "side:=2", "--explain", "--json").out)
    params = made["nodes"]["renderer"]["params"]
    assert (params["scene"], params["scene_args"]) == ("mine.yaml", "side=2")
    assert evis_here("graph", "mine.yaml", "side:=2").code == 0
    by_hand = json.loads(evis_here("launch", "simulator", "scene:=mine.yaml", "side:=2", "--explain", "--json").out)
    assert by_hand["nodes"]["renderer"]["params"]["scene_args"] == "side=2"
    copy = tmp_path / "copy.yaml"
    copy.write_text((paths.data_folder("scenes") / "drone.yaml").read_text())
    assert paths.find_launch(str(copy)) == (paths.data_folder("launch") / "simulator.yaml", {"scene": str(copy)})


@pytest.mark.parametrize(
    ("name", "part"),
    [
        ("own one/mine", "own one/mine: no such file; did you mean 'own one/mine.yaml'?"),
        ("own one/mnie.yaml", "own one/mnie.yaml: no such file; did you mean 'own one/mine.yaml'?"),
        ("own one", "own one: is a folder; name a file in it"),
        ("own one/other.yaml", "own one/other.yaml: no such file"),
    ],
)
def test_a_file_beside_what_was_named_is_suggested(tmp_path: Path, evis_here: Evis, name: str, part: str) -> None:
    (tmp_path / "own one").mkdir()
    (tmp_path / "own one" / "mine.yaml").write_text(SCENE)
    result = evis_here("launch", name)
    assert result.code == 2 and result.line == f"evis launch: {part}"


@pytest.mark.parametrize(("name", "said"), [("a" * 300, "no launch file or scene 'aaa"), ("a/" * 3000, "no such file")])
def test_a_name_longer_than_any_is_one_that_is_not_there(evis_here: Evis, name: str, said: str) -> None:
    result = evis_here("launch", name)
    assert result.code == 2 and said in result.line and str(paths.data_folder("launch")) not in result.line


def test_a_file_in_the_home_folder(tmp_path: Path, evis_here: Evis, monkeypatch: pytest.MonkeyPatch) -> None:
    """No shell replaces ~ behind `:=`."""
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "mine.yaml").write_text(SCENE)
    made = json.loads(evis_here("launch", "simulator", "scene:=~/mine.yaml", "--explain", "--json").out)
    assert made["nodes"]["renderer"]["params"]["scene"] == str(tmp_path / "home" / "mine.yaml")


@pytest.mark.parametrize("command", ["launch", "graph"])
def test_an_argument_that_neither_scene_nor_launch_file_has(tmp_path: Path, evis_here: Evis, command: str) -> None:
    """The nearest of both is named."""
    (tmp_path / "mine.yaml").write_text(SCENE)
    for wrong, right in (("sidee", "side"), ("widht", "width")):
        result = evis_here(command, "mine.yaml", f"{wrong}:=2")
        assert result.code == 2 and f"did you mean '{right}'?" in result.line


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (["launch", "spinning_disk", "seed:=1", "--seed", "2"], "the seed is given twice"),
        (["launch", "spinning_disk", "omega:=20", "omega:=30"], "omega is given twice, as 20 and 30"),
        (["launch", "drone", "scene:=falling_objects"], "the scene is given twice"),
        (["launch", "spinning_disk", "--duration", "1e9"], "less than 1e9"),
        (["launch", "spinning_disk", "preset:=davis"], "did you mean 'davis346'?"),
        (["launch"], "warehouse"),
    ],
)
def test_what_cannot_be_meant_is_wrong_usage(evis_here: Evis, words: list[str], part: str) -> None:
    """Exit status 2 and one line."""
    result = evis_here(*words)
    assert result.code == 2 and part in result.line


def test_a_recording_is_no_launch_file(tmp_path: Path, evis_here: Evis) -> None:
    """The line says how it is played."""
    for name, how in (("a.mcap", "replay bag:=a.mcap"), ("a.raw", "camera file:=a.raw")):
        (tmp_path / name).write_bytes(b"x")
        result = evis_here("launch", name)
        assert result.code == 2 and how in result.line


def frames(folder: Path, count: int = 2) -> str:
    """An archive of frames whose light goes up and down by 5 thresholds."""
    light = np.where(np.arange(count)[:, None, None] % 2, np.e, 1.0) * np.ones((count, 64, 64))
    np.savez(folder / "frames.npz", luminance=light.astype(np.float32), t=np.arange(count) * 1_000_000)
    return "frames.npz"


@pytest.mark.parametrize(
    ("out", "words", "part"),
    [
        ("a.npz", ["--seed", "-1"], "--seed is -1"),
        ("a.npz", ["--seed", "99999999999999999999"], "--seed is 99999999999999999999"),
        ("a.npz", ["--fps", "0"], "--fps is 0"),
        ("a.npz", ["--white", "0"], "--white is 0"),
        ("a.npz", ["--tone", "log"], "--tone is 'log'"),
        ("a.npz", ["--encoding", "evt3"], "leave out --encoding"),
        ("a.raw", ["--encoding", "zstd"], "there are evt3"),
        ("a.xyz", [], "cannot write '.xyz'"),
        ("frames.npz", [], "would be lost"),
    ],
)
def test_simulate_refuses_before_it_works(
    tmp_path: Path, evis_here: Evis, out: str, words: list[str], part: str
) -> None:
    """Exit status 2, one line that names the option, and no file."""
    name = frames(tmp_path)
    result = evis_here("events", "simulate", name, out, *words)
    assert result.code == 2 and part in result.line
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_black_in_coded_images_is_told_of(tmp_path: Path, evis_here: Evis) -> None:
    """Code 0 has no logarithm; with a dark current of a code of `--white` it has one."""
    (tmp_path / "png").mkdir()
    for k, code in enumerate((100, 0, 100)):
        Image.fromarray(np.full((2, 2), code, np.uint8)).save(tmp_path / "png" / f"{k}.png")
    words = ["events", "simulate", "png", "a.npz", "--fps", "1000", "--white", "50", "--json"]
    skipped = json.loads(evis_here(*words).out)
    assert (skipped["events"], skipped["nonfinite"]) == (0, 4)
    assert any("--dark-level 0.5" in text for text in skipped["warnings"])
    seen = json.loads(evis_here(*words, "--dark-level", "0.5").out)
    linear = 50 * ((100 / 255 + 0.055) / 1.055) ** 2.4
    assert seen["events"] == 4 * 2 * int(np.log((linear + 0.5) / 0.5) / 0.2)
    assert not any("--dark-level" in text for text in seen.get("warnings", []))


@pytest.mark.parametrize("suffix", ["raw", "npz", "csv", "aedat4", "h5"])
def test_a_full_disk_is_named_and_leaves_nothing(tmp_path: Path, suffix: str) -> None:
    """The system refuses to let a file grow beyond 64 kB, as a full disk does."""
    name = frames(tmp_path, 40)

    def small_files() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (65536, 65536))

    done = subprocess.run(
        [sys.executable, "-m", "evis", "events", "simulate", name, f"out.{suffix}"],
        cwd=tmp_path, capture_output=True, text=True, preexec_fn=small_files, timeout=600,
    )  # fmt: skip
    assert done.returncode == 1
    limit = "a file may have 65536 bytes (ulimit -f): allow more, as by `ulimit -f unlimited`"
    assert done.stderr.splitlines() == [f"evis events: out.{suffix}: writing failed: File too large; {limit}"]
    assert [p.name for p in tmp_path.iterdir()] == [name]
