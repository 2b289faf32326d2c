"""What the seed of a run decides is said in its plan and in its summary, and that it decides nothing too."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from evis.config import paths
from evis.launch.explain import as_text
from evis.launch.planner import Options, plan_file
from evis.runtime.plan import Plan
from evis.scene import load_scene
from evis.supervisor.report import as_table, summarise
from nodes.imu.node import ImuNode
from nodes.physics.engines.mujoco_engine import MujocoEngine


def plan(scene: str, **given: object) -> Plan:
    path, preset = paths.find_launch(scene)
    return plan_file(path, {**preset, **given}, Options(view=False))


def table(made: Plan) -> str:
    return as_table(summarise(made, [], startup_s=0, wall_s=0, failure=None, interrupted=False))


def test_nothing_random_is_said() -> None:
    """The ideal sensor on prescribed motion; the IMU that nobody has opened does not count."""
    made = plan("spinning_disk", seed=5)
    assert made.random == {"physics": [], "event_sensor": [], "audit": ["which pixels are audited"]}
    assert "but the choice of audited pixels: seed 5 changes no event" in table(made)
    made = plan("spinning_disk", seed=5, audit=0)
    assert made.random == {"physics": [], "event_sensor": []}
    assert "random, by seed 5\n  nothing: every seed gives the same run\n" in as_text(made)
    assert "nothing in this run is random: seed 5 changes nothing" in table(made)
    assert "random" not in table(plan("spinning_disk")), "nobody gave a seed"


def test_what_is_random_is_named() -> None:
    made = plan("falling_objects", seed=5, preset="davis346")
    assert "  physics: start of free bodies\n" in as_text(made)
    assert "  event_sensor: threshold mismatch, leak, shot noise, hot pixels, timestamp jitter\n" in as_text(made)
    assert "nothing" not in table(made)
    assert "  physics: start of joint along, start of joint across\n" in as_text(plan("pong", seed=5))


def test_the_start_of_a_scene_depends_on_the_seed_where_that_is_said() -> None:
    """Of the two scenes that MuJoCo moves one is random."""
    for name, random in (("falling_objects", True), ("robot_arm", False)):
        scene = load_scene(name, visuals=False)
        starts = [MujocoEngine(scene, seed, 1).start().pose for seed in (1, 2)]
        assert np.array_equal(*starts) != random
        assert bool(plan(name).random["physics"]) == random, name


def test_the_noise_of_an_imu_is_named() -> None:
    given = {name: param.default for name, param in ImuNode.PARAMS.items()}
    assert ImuNode.random(given) == ()
    assert ImuNode.random({**given, "gyro_noise": 1e-4}) == ("noise of the gyroscope",)


def test_a_spread_of_nothing_is_not_random(tmp_path: Path) -> None:
    (tmp_path / "ball.xml").write_text(
        "<mujoco><worldbody><camera name='cam0'/>"
        "<body name='b'><freejoint/><geom size='0.1'/></body></worldbody></mujoco>"
    )
    scene = tmp_path / "ball.yaml"
    for spread, random in (("{position: 0, rotation: 0 deg}", False), ("{position: 0, rotation: 2 deg}", True)):
        scene.write_text(f"mjcf: ball.xml\ninitial_spread: {spread}\n")
        assert bool(plan(str(scene)).random["physics"]) == random
        starts = [MujocoEngine(load_scene(str(scene), visuals=False), seed, 1).start().pose for seed in (1, 2)]
        assert np.array_equal(*starts) != random
