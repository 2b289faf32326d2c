"""Bodies that sleep: the course is that of MuJoCo's own steps, and each environment moves as alone."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from engine_arguments import grouped
from environments_rig import told

from evis.scene import load_scene
from nodes.physics.engines.mujoco_engine import MujocoEngine
from nodes.physics.environments.environments import Environments

WORLD = """<mujoco><option timestep="0.001" integrator="{integrator}" sleep_tolerance="1e-4"><flag sleep="enable"/>
</option><worldbody><geom type="plane" size="3 3 .1"/>
<body name="box" pos="0 0 .11"><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body>
<body name="far" pos="0 1 .3"><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body>
<body name="cart" pos="-1 0 .1"><joint name="rail" type="slide" axis="1 0 0" damping="5"/>
<geom size=".09" mass="1"/></body>
</worldbody><actuator><motor joint="rail"/></actuator></mujoco>"""
"""A cart that can be driven into a box at rest, and another that falls and comes to rest by itself."""


def engine_of(folder: Path, envs: int, threads: int = 1, seed: int = 3, **options: object) -> MujocoEngine:
    (folder / "m.xml").write_text(WORLD.format(integrator=options.pop("integrator", "implicitfast")))
    scene = load_scene(str(folder / "m.xml"), visuals=False)
    return MujocoEngine(scene, seed, envs, threads=threads, **grouped(joints=True, contacts=True, **options))


def push(k: int, envs: int) -> np.ndarray:
    return (20.0 + np.arange(envs))[:, None] * (1 + k % 2)


@pytest.mark.parametrize("envs", [1, 3])
def test_a_course_is_that_of_mujoco(tmp_path: Path, envs: int) -> None:
    """Positions are those of mj_step on the model, to the bit, while bodies fall asleep, which then stay there."""
    engine = engine_of(tmp_path, envs)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "m.xml"))
    data, asleep = mujoco.MjData(model), []
    for n in range(1, 41):
        interval = engine.advance(n * 50_000_000)
        for _ in range(50):
            mujoco.mj_step(model, data)
        assert all(np.array_equal(interval.qpos[k, -1], data.qpos) for k in range(envs))
        asleep.append((data.tree_asleep >= 0).tolist())
    assert not any(asleep[0]) and all(asleep[-1][:2])
    assert not interval.qvel[:, -1, :12].any() and not interval.twist[:, -1, :2].any()
    assert len(interval.contacts.env) >= 8 * envs


def test_a_touch_wakes(tmp_path: Path) -> None:
    """A box that sleeps is pushed on by a cart as one that cannot sleep is, within what 100 um/s may change."""
    sleeping, awake = engine_of(tmp_path, 2), engine_of(tmp_path, 2)
    awake.model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    ends = []
    for engine in (sleeping, awake):
        engine.advance(1_000_000_000)
        interval = engine.advance(2_500_000_000, np.full((2, 1), 25.0))
        ends.append(interval.end_pose[:, 0])
    assert ends[1][0, 0] > 0.2
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-3)


@pytest.mark.parametrize("integrator", ["implicitfast", "discrete", "RK4"])
def test_each_moves_as_alone(tmp_path: Path, integrator: str) -> None:
    """Actions of some, taken back or not, and resets of single environments: the bytes of each run by itself."""
    make = lambda envs, threads, seed: engine_of(tmp_path, envs, threads, seed, integrator=integrator)
    shared = [(Environments(make(4, threads, 3), 4, 30.0), ahead) for threads, ahead in ((1, False), (2, True))]
    alone = [Environments(make(1, 1, 3 + k), 1, 30.0) for k in range(4)]
    for worlds in (*alone, *(each for each, _ahead in shared)):
        worlds.advance(0)
    slept = False
    for n in range(1, 46):
        controls = None
        if n in (12, 25, 26, 31):
            controls = push(n, 4)
            controls[: n % 3] = 0.0
        restarted = {20: 1, 21: 2, 38: 3}.get(n)
        if restarted is not None:
            alone[restarted].restart([0], [-1], [1], n - 1)
            alone[restarted].present()
        expected = [
            told(each.advance(n, None if controls is None else controls[k : k + 1]), 0)
            for k, each in enumerate(alone)
        ]  # fmt: skip
        for worlds, ahead in shared:
            if restarted is not None:
                worlds.restart([restarted], [-1], [1], n - 1)
                worlds.present()
            interval = worlds.advance(n, controls, ahead)
            assert [told(interval, k) for k in range(4)] == expected
            slept |= bool((interval.qvel[0, -1] == 0).any())
    assert slept


def test_a_reset_wakes(tmp_path: Path) -> None:
    """What lies where it starts is awake after a reset, whatever it was before, in one environment as in two."""
    engines = [engine_of(tmp_path, 1), engine_of(tmp_path, 2)]
    courses = []
    for engine in engines:
        worlds = Environments(engine, engine.envs, 20.0)
        worlds.advance(0)
        for k in range(1, 30):
            worlds.advance(k)
        worlds.restart([0], [-1], [1], 29)
        worlds.present()
        courses.append([worlds.advance(k).end_pose[0] for k in range(30, 50)])
    assert np.array_equal(courses[0], courses[1])
    assert not np.array_equal(courses[0][0], courses[0][-1])


def test_accelerations_of_what_sleeps(tmp_path: Path) -> None:
    """A body that sleeps is at rest: no acceleration but what contacts leave in bodies that are awake."""
    engine = engine_of(tmp_path, 1, accelerations=True)
    interval = engine.advance(2_000_000_000)
    assert not interval.qvel[0, -1, :12].any()
    np.testing.assert_allclose(interval.acceleration[0, :2], 0.0, atol=0.02)


def test_a_tolerance_keeps_bodies_awake(tmp_path: Path) -> None:
    """physics_tolerance takes steps twice from the same state, of which sleep is no part."""
    from nodes.physics.precision.tolerance import Tolerance

    engine = engine_of(tmp_path, 1, tolerance=Tolerance(1e-4, 1e-4))
    interval = engine.advance(2_000_000_000)
    assert interval.qvel[0, -1].any()


def test_that_a_body_does_not_sleep_from_the_start_is_said(tmp_path: Path) -> None:
    """MuJoCo lets a box with sleep="init" hang in the air; here it falls, and that is said."""
    text = WORLD.format(integrator="implicitfast").replace('name="far"', 'name="far" sleep="init"')
    for name, said in (("init", True), ("off", False)):
        (tmp_path / f"{name}.xml").write_text(text if said else text.replace("enable", "disable"))
        notes = load_scene(str(tmp_path / f"{name}.xml"), visuals=False).notes
        assert [note for note in notes if "sleep" in note] == ['sleep="init" counts as sleep="allowed", so at the '
                                                              "start body 'far' may move"] * said  # fmt: skip


@pytest.mark.parametrize("envs", [1, 2])
def test_steps_with_checks_tell_the_same_velocities(tmp_path: Path, envs: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """That of the last steps before a body falls asleep is told to be none, whoever takes the steps."""
    plain, checked = engine_of(tmp_path, envs), engine_of(tmp_path, envs)
    for n in range(1, 41):
        truth = plain.advance(n * 50_000_000)
        falls = any((data.tree_asleep >= 0).any() for data in plain.data)
        with monkeypatch.context() as patch:
            if falls:
                patch.setattr(checked._watch, "quiet", lambda envs, *_: np.zeros(len(envs), bool))
            found = checked.advance(n * 50_000_000)
        assert told(found, 0) == told(truth, 0)
        if falls:
            break
    assert falls and checked.checked == envs
