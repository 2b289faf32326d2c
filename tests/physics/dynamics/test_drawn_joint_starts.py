"""Hinges and slides that start between bounds: even, from the seed, each joint with a stream of its own."""

from pathlib import Path

import numpy as np
import pytest

from evis.scene import load_scene
from evis.scene.load import starts_at_random
from nodes.physics.engines.mujoco_engine import MujocoEngine
from nodes.physics.interval import Extras

MODEL = """<mujoco><option gravity="0 0 0"/><worldbody>
<body name="a"><joint name="slide" type="slide"/><geom size=".1"/>
<body name="b"><joint name="hinge"/><geom size=".1" pos=".3 0 0"/></body></body>
<body name="c"><freejoint name="free"/><geom size=".1"/></body></worldbody></mujoco>"""


def scene(folder: Path, starts: str):
    (folder / "m.xml").write_text(MODEL)
    path = folder / "s.yaml"
    path.write_text(f"mjcf: m.xml\ncameras: {{cam0: {{fov: 1, position: [0, 0, 9]}}}}\ninitial_joints: {starts}\n")
    return str(path)


def start(folder: Path, starts: str, seed: int = 0, envs: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities of the slide and the hinge at the start, each [E, 2]."""
    interval = MujocoEngine(load_scene(scene(folder, starts)), seed, envs, extras=Extras(joints=True)).start()
    return interval.qpos[:, 0, :2], interval.qvel[:, 0, :2]


def test_starts_are_even_between_their_bounds(tmp_path: Path) -> None:
    stats = pytest.importorskip("scipy.stats")
    qpos, qvel = start(
        tmp_path, "{slide: {position: [-1, 3]}, hinge: {position: 0.5, velocity: [0, 90 deg]}}", envs=400
    )
    assert stats.kstest(qpos[:, 0], stats.uniform(-1, 4).cdf).pvalue > 0.01
    assert stats.kstest(qvel[:, 1], stats.uniform(0, np.pi / 2).cdf).pvalue > 0.01
    assert (qpos[:, 1] == 0.5).all() and (qvel[:, 0] == 0).all()
    assert abs(np.corrcoef(qpos[:, 0], qvel[:, 1])[0, 1]) < 0.15


def test_environment_k_starts_as_a_single_run_with_seed_plus_k(tmp_path: Path) -> None:
    starts = "{slide: {position: [-1, 1], velocity: [-1, 1]}}"
    many, fast = start(tmp_path, starts, seed=5, envs=3)
    for k in range(3):
        one, one_fast = start(tmp_path, starts, seed=5 + k)
        assert (one == many[k]).all() and (one_fast == fast[k]).all()
    assert len(np.unique(many[:, 0])) == 3


def test_a_joint_more_does_not_move_the_others(tmp_path: Path) -> None:
    alone, _ = start(tmp_path, "{hinge: {position: [-1, 1]}}")
    beside, _ = start(tmp_path, "{slide: {position: [-1, 1]}, hinge: {position: [-1, 1]}}")
    assert alone[0, 1] == beside[0, 1] != 0


def test_an_episode_that_begins_anew_begins_elsewhere(tmp_path: Path) -> None:
    engine = MujocoEngine(load_scene(scene(tmp_path, "{slide: {position: [-1, 1]}}")), 3, extras=Extras(joints=True))
    first = engine.start().qpos[0, 0, 0]
    engine.data[0].qvel[:] = 1e9
    assert engine.advance(10_000_000).faults
    assert engine.data[0].qpos[0] != first and abs(engine.data[0].qpos[0]) <= 1


def test_the_seed_is_said_to_matter(tmp_path: Path) -> None:
    assert starts_at_random(scene(tmp_path, "{hinge: {position: [0, 1]}}"))
    assert not starts_at_random(scene(tmp_path, "{hinge: {position: 1}}"))


@pytest.mark.parametrize(
    ("starts", "message"),
    [
        ("{hing: {position: 1}}", "'hing' is no hinge or slide of the model; did you mean 'hinge'"),
        ("{free: {position: 1}}", "'free' is no hinge or slide of the model"),
        ("{hinge: {position: [2, 1]}}", "the least comes first"),
        ("{hinge: {position: [1, 2, 3]}}", "a number or \\[least, most\\]"),
        ("{hinge: {place: 1}}", "place"),
    ],
)
def test_what_is_no_start_is_named(tmp_path: Path, starts: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        load_scene(scene(tmp_path, starts))
