"""What has come to rest stays where it is and takes no steps, each environment for itself, until something changes."""

import mujoco
import numpy as np
import pytest
from engine_arguments import grouped

from evis.scene import load_scene
from nodes.physics.engines.mujoco_engine import MujocoEngine
from nodes.physics.engines.separate import SeparateEngines
from nodes.physics.environments.environments import Environments

BOX = "<body name='box' pos='0 0 {}'><freejoint/><geom type='box' size='.1 .1 .1' mass='1'/></body>"
GROUND = "<geom type='plane' size='5 5 1'/>"
CART = """<body name='cart' pos='0 0 .1'><joint name='rail' type='slide' axis='1 0 0' damping='5'/>
<geom size='.1' mass='1'/></body>"""
POLE = """<body name='pole' pos='0 0 1'><joint axis='0 1 0'/><geom type='capsule' fromto='0 0 0 0 0 1' size='.02'
mass='1' contype='0' conaffinity='0'/></body>"""


def engine_of(folder, world, rest="", integrator="implicitfast", **given):
    option = f"<option timestep='.001' integrator='{integrator}'/>"
    (folder / "m.xml").write_text(f"<mujoco>{option}<worldbody>{world}</worldbody>{rest}</mujoco>")
    return MujocoEngine(load_scene(str(folder / "m.xml"), visuals=False), **grouped(**given))


def steps_of(monkeypatch) -> list[int]:
    """Counts the steps that MuJoCo takes from now on."""
    count = [0]

    def step(model, data, grid, *rest):
        count[0] += len(grid)
        return take(model, data, grid, *rest)

    from nodes.physics.dynamics import traced_steps

    take = traced_steps.take_steps
    monkeypatch.setattr(traced_steps, "take_steps", step)
    return count


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "discrete", "RK4"])
def test_a_box_that_lies_still_takes_no_steps(tmp_path, monkeypatch, integrator):
    """And is where it would have crept to, to a nanometre."""
    engine, count = engine_of(tmp_path, GROUND + BOX.format(0.12), integrator=integrator), steps_of(monkeypatch)
    for k in range(1, 61):
        engine.advance(round(k * 1e9 / 30))
    before = count[0]
    for k in range(61, 91):
        interval = engine.advance(round(k * 1e9 / 30))
        assert len(interval.t) == 2 and not len(interval.moving)
    assert before > 0 and count[0] == before
    model, data = engine.model, mujoco.MjData(engine.model)
    mujoco.mj_step(model, data, 3000)
    np.testing.assert_allclose(interval.end_pose[0, 0, :3], data.xpos[1], atol=1e-9)


@pytest.mark.parametrize("rate", [0.1, 1.0, 1.9, 2.5])
def test_it_rests_however_far_keyframes_are_apart(tmp_path, monkeypatch, rate):
    """Two keyframes after it was still at the latest; what falls by a hair is not put to rest."""
    engine, count = engine_of(tmp_path, GROUND + BOX.format(0.1)), steps_of(monkeypatch)
    still = int(2 * rate) + 3
    for k in range(1, still + 1):
        engine.advance(round(k * 1e9 / rate))
    before = count[0]
    engine.advance(round((still + 1) * 1e9 / rate))
    assert before > 0 and count[0] == before
    pole = engine_of(tmp_path, POLE)
    pole.data[0].qpos[0] = 1e-13
    mujoco.mj_forward(pole.model, pole.data[0])
    poses = [pole.advance(round(k * 1e9 / rate)).pose[0, :, 0] for k in range(1, int(20 * rate) + 2)]
    assert max(np.abs(pose - poses[0][0]).max() for pose in poses) > 0.5


def test_a_change_of_the_controls_wakes_it(tmp_path):
    """Not the same controls once more. What follows is as if it had not rested: v = F / c (1 - e^(-c t / m))."""
    engine = engine_of(tmp_path, CART, "<actuator><motor joint='rail'/></actuator>")
    for k in range(1, 31):
        engine.advance(round(k * 1e9 / 30), np.zeros((1, 1)))
    assert engine._rests[0].now
    engine.advance(1_500_000_000, np.zeros((1, 1)))
    assert engine._rests[0].now
    interval = engine.advance(2_000_000_000, np.ones((1, 1)))
    assert len(interval.t) == 501
    assert interval.twist[0, -1, 0, 0] == pytest.approx(0.2 * (1 - np.exp(-2.5)), rel=1e-3)


@pytest.mark.parametrize("envs", [1, 2])
def test_a_control_that_is_still_under_way_finds_it_awake(tmp_path, envs):
    """Of a motor whose delay is longer than it takes to come to rest, and no whole steps: MuJoCo adds up its time."""
    motor = "<actuator><motor joint='rail' delay='.7995' nsample='801'/></actuator>"
    engine = engine_of(tmp_path, CART, motor, envs=envs)
    model, data = engine.model, mujoco.MjData(engine.model)
    for k in range(1, 61):
        interval = engine.advance(round(k * 1e9 / 30), np.full((envs, 1), float(k > 10)))
    data.ctrl[0] = 0.0
    mujoco.mj_step(model, data, 334)
    data.ctrl[0] = 1.0
    mujoco.mj_step(model, data, 2000 - 334)
    mujoco.mj_forward(model, data)
    assert data.qvel[0] > 0.1
    np.testing.assert_allclose(interval.twist[:, -1, 0, 0], data.qvel[0], rtol=1e-9)


def test_what_is_about_to_fall_does_not_rest(tmp_path):
    """A pole upright but for 1e-9 rad: slower than what rests for a second, but faster and faster."""
    engine = engine_of(tmp_path, POLE)
    (data,) = engine.data
    data.qpos[0] = 1e-9
    mujoco.mj_forward(engine.model, data)
    end = [engine.advance(round(k * 1e9 / 30)).end_pose[0, 0] for k in range(1, 241)]
    assert not np.allclose(end[-1], end[0], atol=0.1)


def test_what_falls_slowly_does_not_rest(tmp_path):
    """A mass 2 m above its hinge, upright but for 1e-8 of a degree: at first slow, it falls as cosh says."""
    mass = "<body><joint axis='0 1 0'/><geom size='.001' mass='1' pos='0 0 2'/></body>"
    engine, off, rate = engine_of(tmp_path, mass, integrator="RK4", joints=True), 1e-8 * np.pi / 180, np.sqrt(9.81 / 2)
    (data,) = engine.data
    data.qpos[0] = off
    mujoco.mj_forward(engine.model, data)
    for k in range(1, 271):
        found = engine.advance(round(k * 1e9 / 30)).qpos[0, -1, 0]
    assert found == pytest.approx(off * np.cosh(9 * rate), rel=1e-4)


def test_environments_rest_each_by_itself(tmp_path):
    """Two that are let go at other heights come to rest at other times, to the bit as alone; so do they anew."""
    world, stamps = GROUND + BOX.format(0.11), [round(k * 1e9 / 30) for k in range(1, 46)]

    def course(envs: int, lift: dict[int, float]) -> tuple[MujocoEngine, list]:
        engine = engine_of(tmp_path, world, envs=envs)
        for env, height in lift.items():
            engine.data[env].qpos[2] = height
            mujoco.mj_forward(engine.model, engine.data[env])
        engine._begin_course()
        found, resting = [], []
        for stamp in stamps:
            found.append(engine.advance(stamp).end_pose)
            resting.append([rest.now for rest in engine._rests])
        return engine, [np.array(found), np.array(resting)]

    engine, (both, resting) = course(2, {0: 0.1, 1: 0.6})
    assert (resting[:, 0] != resting[:, 1]).any() and resting[-1].all()
    for env, height in ((0, 0.1), (1, 0.6)):
        _, (alone, _) = course(1, {0: height})
        assert alone[:, 0].tobytes() == both[:, env].tobytes()
    again = engine.anew([1], [None], [1])
    assert not again._rests[0].now and len(again.advance(stamps[0]).moving)


def test_worlds_of_their_own_rest_side_by_side(tmp_path):
    """One rests and the other falls: the joints of both come with all sub-steps."""
    engines = [engine_of(tmp_path, GROUND + BOX.format(height), joints=True) for height in (0.1, 9.0)]
    both = SeparateEngines(engines)
    for k in range(1, 41):
        interval = both.advance(round(k * 1e9 / 40))
    assert engines[0]._rests[0].now and not engines[1]._rests[0].now
    assert interval.qpos.shape[:2] == interval.qvel.shape[:2] == (2, len(interval.t)) and len(interval.t) > 20
    assert not np.ptp(interval.qpos[0], axis=0).any() and np.ptp(interval.qpos[1, :, 2]) > 0.1
    both.leave(0)
    assert len(both.advance(1_050_000_000).t) > 20


def test_what_is_prescribed_beside_it_goes_on(tmp_path):
    (tmp_path / "m.xml").write_text(f"<mujoco><worldbody>{GROUND}{BOX.format(0.1)}</worldbody></mujoco>")
    (tmp_path / "s.yaml").write_text(
        "mjcf: m.xml\ncameras: {cam0: {fov: 1, position: [0, 0, 9]}}\n"
        "bodies: {rotor: {motion: [{kind: spin, axis: [0, 0, 1], rate: 3}]}}\n"
    )
    engine = MujocoEngine(load_scene(str(tmp_path / "s.yaml"), visuals=False))
    for k in range(1, 46):
        interval = engine.advance(round(k * 1e9 / 30))
    assert engine._rests[0].now and len(interval.t) == 35
    assert [engine.scene.bodies[n].name for n in interval.moving] == ["rotor"]


@pytest.mark.parametrize("contacts", [False, True])
def test_rest_while_steps_are_taken_ahead(tmp_path, contacts):
    """Environments come to rest when their next steps have begun; an action wakes one, a reset another.

    The bytes are those of a run without steps ahead, and of each environment by itself."""
    motor = "<actuator><motor joint='rail'/></actuator>"

    def worlds_of(envs, seed):
        world = GROUND + BOX.format(0.3) + CART.replace("0 0 .1'>", "-1 0 .1'>")
        made = engine_of(tmp_path, world, motor, seed=seed, envs=envs, joints=True, contacts=contacts, threads=2)
        return Environments(made, envs, 10.0)

    ahead, plain, alone = worlds_of(3, 5), worlds_of(3, 5), [worlds_of(1, 5 + k) for k in range(3)]
    for worlds in (ahead, plain, *alone):
        worlds.advance(0)
    rested = []
    for n in range(1, 101):
        controls = np.array([[0.0], [4.0], [0.0]]) if n in (50, 51) else np.zeros((3, 1)) if n == 52 else None
        if n == 70:
            for worlds in (ahead, plain):
                worlds.restart([2], [-1], [1], n - 1)
            alone[2].restart([0], [-1], [1], n - 1)
        found = [worlds.advance(n, controls, worlds is ahead) for worlds in (ahead, plain)]
        singly = [one.advance(n, None if controls is None else controls[k : k + 1]) for k, one in enumerate(alone)]
        for name in ("end_pose", "pose", "twist", "qpos", "qvel"):
            a, b = (getattr(interval, name) for interval in found)
            assert np.array_equal(a, b), (n, name)
            # One that rests by itself has no sub-steps, which others here may have.
            last = slice(None) if name == "end_pose" else -1
            for k, interval in enumerate(singly):
                assert np.array_equal(a[k][last], getattr(interval, name)[0][last]), (n, name, k)
        rested.append([not np.abs(found[0].twist[k]).any() for k in range(3)])
    assert all(rested[48]) and rested[50] == [True, False, True] and not rested[70][2]
