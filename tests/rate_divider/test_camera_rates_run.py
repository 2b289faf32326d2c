"""Whole graphs: a slower camera gives the very bytes of a graph at its rate, and the other camera those of its own.

A ball is dropped and hits the floor in the middle of one of the slower camera's gaps.
"""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from evis.bag.reader import BagReader
from msgs.header import Message

MODEL = """
<mujoco>
  <option timestep="0.001"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 0.1" rgba="0.5 0.5 0.5 1"/>
    <body name="ball" pos="0 0 0.28"><freejoint/><geom type="sphere" size="0.05" solref="0.004 0.2"/></body>
  </worldbody>
</mujoco>
"""
SCENE = """
args: {slow: {default: 25, help: rate of the second camera, unit: Hz}}
mjcf: drop.xml
cameras:
  cam0: {position: [0, -0.6, 0.2], look_at: [0, 0, 0.15], fov: 50 deg}
  side: {position: [0.6, 0, 0.2], look_at: [0, 0, 0.15], fov: 50 deg, rate: "${slow}"}
lights: {lamp: {kind: point, position: [0.5, -1, 1], intensity: 3}}
"""
SMALL = ("cameras:=cam0,side", "width:=48", "height:=40", "upsampling:=4", "labels:=poses,contacts", "imu:=true")
TOPICS = "/*/keyframe,/*/frames,/*/labels,/*/imu"
IMPACT_S = (2 * 0.23 / 9.81) ** 0.5


def evis(runtime: Path, *words: str) -> dict[str, object]:
    environment = {**os.environ, "XDG_RUNTIME_DIR": str(runtime), "EVIS_NO_VIEW": "1"}
    done = subprocess.run(
        [sys.executable, "-m", "evis", "launch", *words, "--json"],
        capture_output=True, text=True, env=environment, timeout=600,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def messages(bag: Path) -> dict[str, list[Message]]:
    found: dict[str, list[Message]] = {}
    with BagReader(bag) as reader:
        for topic, message in reader.messages():
            found.setdefault(topic, []).append(message)
    return found


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, dict[str, list[Message]]]]:
    """The same world with the second camera slower, with both as fast, with both as slow, and the first replayed."""
    folder = tmp_path_factory.mktemp("rates")
    (folder / "drop.xml").write_text(MODEL)
    scene = folder / "drop.yaml"
    scene.write_text(SCENE)
    runtime = Path(tempfile.mkdtemp(prefix="ev", dir="/tmp"))
    runs = {
        "mixed": ("keyframe_rate:=100",),
        "fast": ("keyframe_rate:=100", "slow:=100", "--compose"),
        "slow": ("keyframe_rate:=25", "--compose"),
    }
    try:
        for name, words in runs.items():
            bag = ("--record", str(folder / f"{name}.mcap"), "--record-topics", TOPICS)
            evis(runtime, str(scene), *SMALL, *words, "--duration", "0.24", *bag)
        words = (f"bag:={folder / 'mixed.mcap'}", "regenerate:=true", "--compose")
        evis(runtime, "replay", *words, "--record", str(folder / "replayed.mcap"))
        yield {name: messages(folder / f"{name}.mcap") for name in (*runs, "replayed")}
    finally:
        shutil.rmtree(runtime, ignore_errors=True)


def assert_same(some: list[Message], others: list[Message], what: str) -> None:
    assert len(some) == len(others) > 0, what
    for a, b in zip(some, others):
        for field in dataclasses.fields(a):
            x, y = getattr(a, field.name), getattr(b, field.name)
            if isinstance(x, np.ndarray):
                assert x.dtype == y.dtype and x.shape == y.shape and x.tobytes() == y.tobytes(), (what, field.name)
            else:
                assert x == y, (what, field.name)


@pytest.mark.parametrize("part", ["info", "keyframe", "frames", "events", "labels", "imu"])
def test_each_camera_gives_what_a_graph_at_its_rate_gives(bags: dict[str, dict[str, list[Message]]], part: str) -> None:
    assert_same(bags["mixed"][f"/side/{part}"], bags["slow"][f"/side/{part}"], "the slower camera")
    assert_same(bags["mixed"][f"/cam0/{part}"], bags["fast"][f"/cam0/{part}"], "the other camera")


def test_stamps_of_the_slower_camera_are_its_rates(bags: dict[str, dict[str, list[Message]]]) -> None:
    for part in ("state", "keyframe", "frames", "events", "labels", "imu"):
        stamps = [m.header.stamp_ns for m in bags["mixed"][f"/side/{part}"]]
        assert stamps == [k * 40_000_000 for k in range(7)], part
    assert len(bags["mixed"]["/cam0/events"]) == len(bags["mixed"]["/state"]) == 25
    assert_same(bags["mixed"]["/side/state"], bags["slow"]["/state"], "states")


def test_an_impact_within_a_gap_is_where_it_was(bags: dict[str, dict[str, list[Message]]]) -> None:
    """The merged states hold the sub-steps: the ball turns round at the time of its fall, not at a keyframe."""
    gap = bags["mixed"]["/side/state"][6]
    height = gap.rows([gap.names.index("ball")])[0][0, :, 0, 2]
    lowest = gap.t[np.argmin(height)] * 1e-9
    assert gap.t[0] * 1e-9 < IMPACT_S < lowest < gap.t[-1] * 1e-9
    # The floor gives way for some milliseconds (solref); no keyframe is as near.
    assert lowest - IMPACT_S < 0.008 and height.min() < 0.05
    assert min(height[0], height[-1]) > height.min() + 0.002
    assert len(bags["mixed"]["/side/events"][6].t) > 0


def test_a_bag_is_replayed_at_the_rates_of_its_cameras(bags: dict[str, dict[str, list[Message]]]) -> None:
    for camera in ("cam0", "side"):
        assert_same(bags["replayed"][f"/{camera}/events"], bags["mixed"][f"/{camera}/events"], camera)
