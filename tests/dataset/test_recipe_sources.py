"""The user's own files of a recipe count in its digest, and what would differ from machine to machine is refused."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh
from in_this_process import InThisProcess
from PIL import Image
from small_recipe import checksums

from evis.config.document import LaunchError
from evis.dataset.making.make import make
from evis.dataset.making.store import INDEX
from evis.dataset.recipe_file import read_recipe

RECIPE = """\
sequences: 3
duration: 0.05
arguments: {width: 32, height: 24}
scenes:
  own.yaml:
    arguments: {pictures: mine}
"""
SCENE = """\
args: {pictures: {type: folder, default: "", help: of the ball}}
include: part.yaml
cameras: {cam0: {position: [0, -1, 0], look_at: [0, 0, 0], fov: 40 deg}}
bodies:
  ball:
    motion: {kind: sinusoid, amplitude: [0.3, 0, 0], frequency: 2}
    shapes: [{shape: sphere, radius: 0.2, material: paint}, {shape: mesh, file: cube.stl, material: paint}]
materials:
  paint: {texture: {kind: noise, folder: "${pictures}"}}
  other: {texture: {kind: image, file: {choose: [a.png, b.png]}}}
"""


@pytest.fixture
def recipe(tmp_path: Path) -> Path:
    """A recipe, its scene, and what that is made of, in one folder."""
    home = tmp_path / "home"
    (home / "mine" / "deep").mkdir(parents=True)
    (home / "r.yaml").write_text(RECIPE)
    (home / "own.yaml").write_text(SCENE)
    (home / "part.yaml").write_text("environment: 1\n")
    rng = np.random.default_rng(1)
    for place in ("a.png", "b.png", "mine/one.png", "mine/two.png"):
        Image.fromarray(rng.integers(0, 256, (8, 8, 3), np.uint8)).save(home / place)
    (home / "mine" / "deep" / "leaf.mtl").write_text("newmtl x\n")
    trimesh.creation.box([0.2, 0.2, 0.2]).export(home / "cube.stl")
    return home / "r.yaml"


def test_every_file_counts_and_each_alone(recipe: Path) -> None:
    """The scene, what it includes, its meshes and pictures, those of other seeds too; not the recipe's neighbours."""
    before = read_recipe(recipe)
    assert set(before.files) == {"own.yaml", "part.yaml", "cube.stl", "a.png", "b.png", "mine"}
    (recipe.parent / "stranger.png").write_bytes(b"x")
    assert read_recipe(recipe).digest == before.digest
    for place in ("own.yaml", "part.yaml", "a.png", "b.png", "mine/two.png", "mine/deep/leaf.mtl", "cube.stl"):
        path = recipe.parent / place
        data = path.read_bytes()
        if place == "cube.stl":
            trimesh.creation.box([0.2, 0.2, 0.3]).export(path)
        elif place.endswith(".png"):
            Image.new("RGB", (8, 8), (9, 9, 9)).save(path)
        else:
            path.write_bytes(data + b"\n# a word more\n")
        after = read_recipe(recipe)
        changed = {name for name in before.files if before.files[name] != after.files[name]}
        assert changed == {place.partition("/")[0]} and after.digest != before.digest
        path.write_bytes(data)
    assert read_recipe(recipe).digest == before.digest
    (recipe.parent / "mine" / "two.png").rename(recipe.parent / "mine" / "zwei.png")
    assert read_recipe(recipe).digest != before.digest  # the order of files is by their names


def test_a_scene_that_comes_with_evis_has_no_files_of_the_users() -> None:
    assert read_recipe("rotation").files == {}


def test_resume_does_not_mix(recipe: Path, tmp_path: Path) -> None:
    """A picture that changes between two runs makes another data set, and the line names it."""
    out = str(tmp_path / "d")
    make(read_recipe(recipe), out, InThisProcess, count=2)
    index = json.loads((tmp_path / "d" / INDEX).read_text())
    assert set(index["recipe_files"]) == {"own.yaml", "part.yaml", "cube.stl", "a.png", "b.png", "mine"}
    assert all(str(tmp_path) not in path.read_text() for path in (tmp_path / "d").rglob("*.json"))
    assert make(read_recipe(recipe), out, InThisProcess, resume=True).made == 1
    Image.new("RGB", (8, 8), (9, 9, 9)).save(recipe.parent / "mine" / "one.png")
    with pytest.raises(ValueError, match="another recipe, this one as it was before mine changed"):
        make(read_recipe(recipe), out, InThisProcess, resume=True)


def test_bytes_do_not_depend_on_where_the_recipe_lies(
    recipe: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder's name is taken from the recipe's folder, whatever the working directory is."""
    make(read_recipe(recipe), str(tmp_path / "d"), InThisProcess)
    shutil.copytree(recipe.parent, tmp_path / "elsewhere")
    monkeypatch.chdir(tmp_path)
    make(read_recipe(Path("elsewhere") / "r.yaml"), str(tmp_path / "e"), InThisProcess)
    first = checksums(tmp_path / "d")
    assert first == checksums(tmp_path / "e") and len(first) > 9
    entries = json.loads((tmp_path / "d" / INDEX).read_text())["sequences"]
    assert [entry["arguments"]["pictures"] for entry in entries] == ["mine"] * 3


def test_what_cannot_be_used_is_told_before_anything_is_made(recipe: Path) -> None:
    """With the line of the scene in the recipe, the file and the remedy; also what no draw has come upon yet."""
    mine = recipe.parent / "mine"
    (mine / "bad.png").write_bytes(b"GIF?")
    with pytest.raises(LaunchError, match=r"r.yaml:5: the folder mine: bad.png is no picture.*take it away"):
        read_recipe(recipe)
    (mine / "bad.png").rename(mine / "bad.stl")
    with pytest.raises(LaunchError, match=r"the folder mine: bad.stl .*take it away"):
        read_recipe(recipe)
    recipe.write_text(RECIPE.replace("mine", "theirs"))
    with pytest.raises(LaunchError, match=r"r.yaml:5: the folder theirs is not there; name one of pictures or meshes"):
        read_recipe(recipe)


@pytest.mark.parametrize(
    ("given", "remedy"),
    [
        ("interpolator: auto", "none, splat or rigid"),
        ("interpolator: {choices: [rigid, auto]}", "none, splat or rigid"),
        ("upsampling: auto", "a number"),
    ],
)
def test_auto_is_refused_for_it_measures_the_machine(recipe: Path, given: str, remedy: str) -> None:
    recipe.write_text(RECIPE.replace("{pictures: mine}", f"{{{given}}}"))
    key = given.split(":")[0]
    with pytest.raises(LaunchError, match=rf"r.yaml:6: {key}: auto .* write what .* chooses: {remedy}"):
        read_recipe(recipe)
