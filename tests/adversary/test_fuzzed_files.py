"""Damaged real files: read, or refused in one line that names them, in bounded memory and time.

Each input is drawn from its file and number; `python tests/adversary/mutations.py` writes it again.
"""

from __future__ import annotations

import json
import os
import select
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import tally

ROOT = Path(__file__).parents[2]
DATA = Path(os.environ.get("EVIS_TEST_DATA", ROOT.parent / "shared" / "data"))
INPUT_S = 60.0
"""For one input: what is read takes seconds at most, on a machine that others load too."""
pytestmark = [pytest.mark.slow, pytest.mark.timeout(7200)]


class Child:
    """A process that reads, and is replaced when an input has taken it."""

    def __init__(self) -> None:
        self.process: subprocess.Popen[str] | None = None

    def ask(self, **job: object) -> tuple[str, str]:
        """The kind of damage and what came of one input."""
        if self.process is None:
            self.process = subprocess.Popen(
                [sys.executable, str(Path(__file__).with_name("reader_child.py"))],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
                env={**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)},
            )  # fmt: skip
        assert self.process.stdin is not None and self.process.stdout is not None
        self.process.stdin.write(json.dumps(job) + "\n")
        self.process.stdin.flush()
        if not select.select([self.process.stdout], [], [], INPUT_S)[0]:
            self.stop()
            return "?", f"no answer within {INPUT_S:g} s"
        line = self.process.stdout.readline()
        if not line:
            status = self.process.wait()
            self.process = None
            return "?", f"the process died with {status}"
        kind, result = json.loads(line)
        return kind, result

    def stop(self) -> None:
        """Kill it."""
        if self.process is not None:
            self.process.kill()
            self.process.communicate()
        self.process = None


@pytest.fixture
def child() -> Iterator[Child]:
    child = Child()
    yield child
    child.stop()


def campaign(
    table: tally.Table, child: Child, subject: str, name: str, file: Path, place: Path, count: int, other: Path | None
) -> None:
    """`count` inputs made of one file, each put where the reader looks for it."""
    attack = f"{subject}: {name}"
    whole = child.ask(subject=subject, file=str(file), place=str(place), seed=[], other="")
    asks = name in ("replay.yaml", "simulator.yaml")  # one for a bag, the other for a scene
    assert whole == ("none", "refused" if asks else "read")
    for number in range(tally.number(count)):
        seed = [tally.SEED, *name.encode(), number]
        kind, result = child.ask(
            subject=subject, file=str(file), place=str(place), seed=seed, other=str(other) if other else ""
        )
        if result in ("read", "refused"):
            table.count("damaged files", attack, result)
        else:
            again = f"mutations.py {file} {','.join(map(str, seed))} OUT{f' {other}' if other else ''}"
            table.fail("damaged files", attack, f"{kind}: {result} [{again}]")
    mine = table.row("damaged files", attack).failures
    assert not mine, f"{len(mine)} of {tally.number(count)}: {mine[0]}"


def real_recordings() -> list[str]:
    """Names of the recordings below DATA, by what they are: no weights, tables or texts about them."""
    truth = DATA / "ground_truth.json"
    if not truth.exists():
        return []
    return sorted(
        str(p.relative_to(DATA)) for p in DATA.rglob("*")
        if p.suffix in (".aedat", ".aedat4", ".raw", ".hdf5", ".es", ".bin", ".dat", ".db3", ".bag", ".txt")
    )  # fmt: skip


@pytest.mark.parametrize("name", real_recordings() or ["none"])
def test_damaged_real_recordings(name: str, tmp_path: Path, child: Child, table: tally.Table) -> None:
    recordings = real_recordings()
    if name not in recordings:
        pytest.skip(f"no recordings at {DATA} (set EVIS_TEST_DATA)")
    other = DATA / recordings[recordings.index(name) - 1]
    place = tmp_path / f"damaged{Path(name).suffix}"
    campaign(table, child, "recording", name, DATA / name, place, 30, other)


@pytest.mark.parametrize("name", sorted(p.name for p in (ROOT / "launch").glob("*.yaml")))
def test_damaged_launch_files(name: str, tmp_path: Path, child: Child, table: tally.Table) -> None:
    folder = shutil.copytree(ROOT / "launch", tmp_path / "launch")
    campaign(table, child, "launch", name, ROOT / "launch" / name, folder / name, 30, ROOT / "scenes/drone.yaml")


@pytest.mark.parametrize("name", sorted(p.name for p in (ROOT / "scenes").glob("*.*ml")))
def test_damaged_scenes_and_mujoco_models(name: str, tmp_path: Path, child: Child, table: tally.Table) -> None:
    folder = shutil.copytree(ROOT / "scenes", tmp_path / "scenes")
    campaign(table, child, "scene", name, ROOT / "scenes" / name, folder / name, 30, ROOT / "scenes/robot_arm.xml")


@pytest.fixture(scope="module")
def assets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A textured box in each format of meshes."""
    import trimesh
    from PIL import Image

    folder = tmp_path_factory.mktemp("assets")
    texels = np.random.default_rng(0).integers(0, 255, (32, 32, 3), np.uint8)
    Image.fromarray(texels).save(folder / "texture.png")
    box = trimesh.creation.icosphere(2)
    uv = np.asarray(box.vertices[:, :2]) * 0.4 + 0.5
    box.visual = trimesh.visual.TextureVisuals(uv, image=Image.open(folder / "texture.png"))
    box.export(folder / "thing.glb")
    box.export(folder / "thing.obj", mtl_name="thing.mtl")
    (folder / "gltf").mkdir()
    box.export(folder / "gltf" / "thing.gltf")
    for path in (folder / "gltf").iterdir():
        path.rename(folder / path.name)
    return folder


ASSETS = ["thing.glb", "thing.gltf", "thing.obj", "thing.mtl", "texture.png"]


@pytest.mark.parametrize("name", ASSETS)
def test_damaged_meshes_materials_and_pictures(
    name: str, assets: Path, tmp_path: Path, child: Child, table: tally.Table
) -> None:
    folder = shutil.copytree(assets, tmp_path / "assets")
    mesh = name if name.startswith("thing") and name != "thing.mtl" else "thing.obj"
    head = "materials: {m: {texture: {kind: image, file: texture.png}}}\n" if name == "texture.png" else ""
    body = f"{{name: thing, shape: mesh, file: {mesh}{', material: m' if head else ''}}}"
    (folder / "scene.yaml").write_text(f"cameras: {{cam0: {{fov: 1}}}}\n{head}world:\n  - {body}\n")
    campaign(table, child, "scene", name, assets / name, folder / name, 100, None)


def test_damaged_bags(tmp_path: Path, child: Child, table: tally.Table, stage: object) -> None:
    from recorded_runs import Stage

    assert isinstance(stage, Stage)
    stage.undisturbed("as processes", "fast", "--record-topics", "/cam0/keyframe")
    campaign(table, child, "bag", "run.mcap", stage.bag, tmp_path / "damaged.mcap", 150, None)
