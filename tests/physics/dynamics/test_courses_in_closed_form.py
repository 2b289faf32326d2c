"""MuJoCo through the engine, against closed forms."""

import mujoco
import numpy as np
import pytest
from engine_arguments import grouped

from evis.geometry import interpolate, se3
from evis.scene import SceneError, load_scene
from nodes.physics.dynamics.stepped_model import step_length
from nodes.physics.engines.mujoco_engine import MujocoEngine
from nodes.physics.interval import Extras
from nodes.physics.precision.errors import Errors
from nodes.physics.precision.stepping import Stepping
from nodes.physics.precision.tolerance import Tolerance

MS = 1_000_000


@pytest.fixture
def scene_of(tmp_path):
    """A scene of one MJCF body text and options."""

    def make(worldbody, option="", rest="", spread=""):
        (tmp_path / "m.xml").write_text(f"<mujoco><option {option}/><worldbody>{worldbody}</worldbody>{rest}</mujoco>")
        (tmp_path / "s.yaml").write_text(f"mjcf: m.xml\ncameras: {{cam0: {{fov: 1, position: [0, 0, 9]}}}}\n{spread}")
        return load_scene(str(tmp_path / "s.yaml"))

    return make


BALL = "<body name='ball'><freejoint/><geom size='0.1' mass='1'/></body>"


def launch(engine, velocity, omega=(0, 0, 0)):
    """Give body 0 of every environment a velocity (a free joint's first six velocities)."""
    for data in engine.data:
        data.qvel[:6] = (*velocity, *omega)
        mujoco.mj_forward(engine.model, data)
    engine._begin_course()


@pytest.mark.parametrize("integrator, bias", [("RK4", 0.0), ("Euler", -0.5)])
@pytest.mark.parametrize("dt", [0.001, 0.00025])
def test_projectile(scene_of, integrator, bias, dt):
    """P1: RK4 is on the parabola; semi-implicit Euler lies below it by exactly g dt t / 2."""
    engine = MujocoEngine(
        scene_of(BALL, f"gravity='0 0 -9.81' integrator='{integrator}'"), stepping=Stepping(timestep=dt)
    )
    launch(engine, (3, 0, 5))
    for stamp in (250 * MS, 1000 * MS):
        interval = engine.advance(stamp)
        t = interval.t * 1e-9
        expected = np.stack((3 * t, 0 * t, 5 * t - 4.905 * t**2 + bias * 9.81 * dt * t), axis=-1)
        assert np.abs(interval.pose[0, :, 0, :3] - expected).max() < 1e-11
        assert np.abs(interval.twist[0, :, 0, 2] - (5 - 9.81 * t)).max() < 1e-11


def delayed_slider(scene_of, samples, option, **given):
    """An engine of a slider of 1 kg on which a motor acts 99.5 ms late."""
    slider = "<body><joint name='x' type='slide' axis='1 0 0'/><geom size='0.1' mass='1'/></body>"
    motor = f"<actuator><motor joint='x' delay='0.0995' nsample='{samples}'/></actuator>"
    return MujocoEngine(scene_of(slider, f"gravity='0 0 0' {option}", motor), **grouped(**given))


@pytest.mark.parametrize(("samples", "delay"), [(50, 0.0995), (25, 0.05)])
@pytest.mark.parametrize("envs", [1, 2])
@pytest.mark.parametrize("given", [{}, {"timestep": 0.0005}, {"timestep": 0.0003}, {"timestep": 0.001}])
def test_a_delay_of_an_actuator_is_kept_in_shorter_steps(scene_of, samples, delay, envs, given):
    """Up to one step: v = t - delay. It is as long as `nsample` of the model's own steps where those are shorter."""
    engine = delayed_slider(scene_of, samples, "timestep='0.002'", envs=envs, **given)
    found = 0.3 - engine.advance(300 * MS, np.ones((envs, 1))).twist[:, -1, 0, 0]
    assert (found > delay - 1e-9).all() and (found < delay + 1.01e-9 * engine.step_ns).all()


def test_a_delay_is_kept_in_the_half_steps_that_tell_the_error(scene_of):
    """Those of Euler are off by v dt / 2 at most, and by a step of the delay."""
    engine = delayed_slider(scene_of, 100, "timestep='0.001'", errors=(errors := Errors()))
    engine._shadow._halved = True
    for k in range(1, 10):
        engine.advance(k * 33 * MS, np.ones((1, 1)))
    assert 0 < errors.worst().position < 0.2 * 0.001


def test_what_a_delay_cannot_be_kept_in_is_refused(scene_of):
    """In one line with the file and the actuator."""
    with pytest.raises(SceneError, match=r"^m\.xml: actuator 'actuator0' has a delay, .*leave physics_tolerance out"):
        delayed_slider(scene_of, 50, "timestep='0.002'", tolerance=Tolerance(1e-3, 1e-3))
    with pytest.raises(SceneError, match=r"^m\.xml: actuator 'actuator0' has a delay of .* longer steps"):
        delayed_slider(scene_of, 9_000_000, "timestep='0.002'")


@pytest.mark.parametrize("omega", [50.0, 1000.0])
def test_spin_about_a_fixed_axis(scene_of, omega):
    """P2: theta = omega t for one second; Hermite in between as good as the knots."""
    disk = "<body name='d'><freejoint/><geom type='cylinder' size='0.1 0.001' mass='1'/></body>"
    engine = MujocoEngine(scene_of(disk, "gravity='0 0 0' integrator='RK4'"))
    launch(engine, (0, 0, 0), (0, 0, omega))
    interval = engine.advance(1000 * MS)
    wanted = np.array([0, 777_777, 500 * MS + 1, 999_500_000])
    found = interpolate.pose_at(wanted, interval.t, interval.pose[0], interval.twist[0])[:, 0]
    expected = se3.exp(np.outer(omega * wanted * 1e-9, [0, 0, 1]))
    angle = np.linalg.norm(se3.log(se3.multiply(found[:, 3:], se3.conjugate(expected))), axis=-1)
    assert angle.max() < 1e-9  # rounding of 1000 quaternion products


def test_free_rotation_keeps_energy_and_angular_momentum(scene_of):
    """P3: the intermediate axis flips; RK4 at 1 ms keeps both to 1e-7, measured from the published twists."""
    inertia = np.array([1e-3, 2e-3, 3e-3])
    body = (
        "<body name='b'><freejoint/><inertial pos='0 0 0' mass='1' diaginertia='0.001 0.002 0.003'/>"
        "<geom size='0.01'/></body>"
    )
    engine = MujocoEngine(scene_of(body, "gravity='0 0 0' integrator='RK4'"))
    launch(engine, (0, 0, 0), (1e-3, 10, 1e-3))
    pose, twist = [], []
    for k in range(1, 6):
        interval = engine.advance(k * 1000 * MS)
        pose.append(interval.pose[0, :, 0]), twist.append(interval.twist[0, :, 0])
    q, omega = np.concatenate(pose)[:, 3:], np.concatenate(twist)[:, 3:]
    local = se3.rotate(se3.conjugate(q), omega)
    assert local[:, 1].min() < -9.9  # it did flip
    energy = 0.5 * np.sum(inertia * local**2, axis=-1)
    momentum = se3.rotate(q, inertia * local)
    assert np.abs(energy / energy[0] - 1).max() < 1e-7
    assert np.abs(momentum - momentum[0]).max() < 1e-7 * np.linalg.norm(momentum[0])


ARM = """
<body name='a' pos='0 0 1' euler='10 20 30'><joint type='hinge' axis='0 1 0'/>
  <geom type='capsule' size='.02 .2' pos='0 0 .2'/>
  <body name='b' pos='0 0 .4'><joint type='hinge' axis='1 0 0'/><geom type='capsule' size='.02 .2' pos='.1 0 .2'/>
    <body name='c' pos='.2 0 .4'><joint type='ball'/><geom type='box' size='.1 .05 .02'/></body></body></body>
<body name='free' pos='2 0 0'><freejoint/><geom type='box' size='.1 .2 .3'/></body>
"""


def test_twists_are_mujoco_s_object_velocities(scene_of):
    """v of each body's origin and omega, world frame, on a moving chain; poses against xpos and xquat."""
    engine = MujocoEngine(scene_of(ARM))
    random = np.random.default_rng(0)
    data = engine.data[0]
    data.qvel[:] = random.normal(size=engine.model.nv)
    interval = engine.advance(50 * MS)
    mujoco.mj_forward(engine.model, data)
    velocity = np.zeros(6)
    for i in range(1, engine.model.nbody):
        mujoco.mj_objectVelocity(engine.model, data, mujoco.mjtObj.mjOBJ_XBODY, i, velocity, 0)
        assert np.abs(interval.twist[0, -1, i - 1] - np.roll(velocity, 3)).max() < 1e-12
        assert np.abs(interval.pose[0, -1, i - 1, :3] - data.xpos[i]).max() < 1e-12
        assert np.abs(se3.to_matrix(interval.pose[0, -1, i - 1, 3:]) - data.xmat[i].reshape(3, 3)).max() < 1e-12


def test_twists_are_derivatives_of_poses(scene_of):
    """Central differences over the published sub-steps."""
    engine = MujocoEngine(scene_of(ARM, "integrator='RK4'"), stepping=Stepping(timestep=1e-4))
    interval = engine.advance(50 * MS)
    p, v = interval.pose[0, :, :, :3], interval.twist[0, :, :, :3]
    assert np.abs((p[2:] - p[:-2]) / 2e-4 - v[1:-1]).max() < 1e-5 * max(1.0, np.abs(v).max())
    q, omega = interval.pose[0, :, :, 3:], interval.twist[0, :, :, 3:]
    turn = se3.log(se3.multiply(q[2:], se3.conjugate(q[:-2]))) / 2e-4
    assert np.abs(turn - omega[1:-1]).max() < 1e-4 * max(1.0, np.abs(omega).max())


def test_cameras_ride_on_bodies(tmp_path, scene_of):
    """A camera on a moving body: pose by composition, twist the derivative of it."""
    scene_of(ARM, "integrator='RK4'")
    path = tmp_path / "ride.yaml"
    path.write_text("mjcf: m.xml\ncameras: {cam0: {fov: 1, parent: c, position: [0.1, 0.2, 0.3]}}\n")
    interval = MujocoEngine(load_scene(str(path)), stepping=Stepping(timestep=1e-4)).advance(50 * MS)
    assert np.allclose(
        interval.pose[0, :, 4, :3], se3.transform(interval.pose[0, :, 2], np.array([0.1, 0.2, 0.3])), atol=1e-12
    )
    p, v = interval.pose[0, :, 4, :3], interval.twist[0, :, 4, :3]
    assert np.abs(v).max() > 0.1 and np.abs((p[2:] - p[:-2]) / 2e-4 - v[1:-1]).max() < 1e-4


def test_stamps_between_steps_lie_on_the_same_curve(scene_of):
    """30 Hz is no multiple of 1 ms: every pose is on the parabola, and each message begins where one ended."""
    engine = MujocoEngine(scene_of(BALL, "gravity='0 0 -9.81' integrator='RK4'"), extras=Extras(joints=True))
    launch(engine, (3, 0, 5), (1, 2, 3))
    last = None
    for k in range(1, 8):
        stamp = round(k * 1e9 / 30)
        interval = engine.advance(stamp)
        t = interval.t * 1e-9
        assert interval.t[-1] == stamp and np.all(np.diff(interval.t) > 0) and np.all(interval.t[1:-1] % MS == 0)
        assert np.abs(interval.pose[0, :, 0, 2] - (5 * t - 4.905 * t**2)).max() < 1e-12
        assert np.abs(interval.twist[0, :, 0, 2] - (5 - 9.81 * t)).max() < 1e-10
        assert np.abs(interval.qpos[0, :, :3] - interval.pose[0, :, 0, :3]).max() < 1e-5  # linear within a step of 1 ms
        if last is not None:
            assert np.array_equal(interval.pose[:, 0], last.pose[:, -1]) and interval.t[0] == last.t[-1]
            assert np.array_equal(interval.twist[:, 0], last.twist[:, -1])
        last = interval


def test_the_world_does_not_depend_on_the_keyframe_rate():
    """Bodies that bounce and collide: at 5, 125 and 1000 stamps a second the same bytes at the same time."""
    results = []
    for gap in (200, 8, 1):
        engine = MujocoEngine(load_scene("falling_objects", textures=False), seed=3)
        for stamp in range(gap, 601, gap):
            interval = engine.advance(stamp * MS)
        results.append(interval.pose[0, -1].tobytes())
    assert results[0] == results[1] == results[2]


@pytest.mark.parametrize(
    "model, asked, step", [(0.002, None, MS), (0.0005, None, MS // 2), (0.003, None, MS), (0.002, 1e-5, 10_000)]
)
def test_step_length(model, asked, step):
    """The model's own timestep cut into equal parts of at most a millisecond, or what was asked for."""
    assert step_length(model, asked) == step


def test_environments_are_single_runs_with_their_own_seed():
    """Environment k of E equals a run of one with seed + k, byte for byte; and a run equals itself."""
    scene = load_scene("falling_objects", textures=False)
    stamps = [round(k * 1e9 / 30) for k in range(1, 16)]

    def run(seed, envs):
        engine = MujocoEngine(scene, seed, envs)
        return np.concatenate([engine.start().pose, *(engine.advance(s).pose for s in stamps)], axis=1)

    together = run(7, 3)
    for k in range(3):
        assert run(7 + k, 1)[0].tobytes() == together[k].tobytes()
    assert np.abs(together[0] - together[1]).max() > 1e-3
    spread = together[:, 0, :, :3] - load_reference(scene)
    assert 1e-4 < np.abs(spread).max() < 0.06


def load_reference(scene):
    model = mujoco.MjModel.from_xml_path(str(scene.mjcf))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = scene.bodies[-1].trajectory.pose(np.zeros(1, np.int64))[:, :3]
    return np.concatenate((data.xpos[1:], camera))


def test_resting_contact_carries_the_weight(scene_of):
    """Sum of the forces on a resting box = m g upwards; asking for contacts changes nothing in the motion."""
    box = "<body name='box' pos='0 0 .1'><freejoint/><geom type='box' size='.1 .1 .1' mass='8'/></body>"
    world = f"<geom type='plane' size='1 1 1'/>{box}"
    poses = []
    for contacts in (True, False):
        engine = MujocoEngine(scene_of(world, "integrator='discrete'"), extras=Extras(contacts=contacts))
        for k in range(1, 21):
            interval = engine.advance(k * 50 * MS)
        poses.append(interval.pose.tobytes())
        if contacts:
            c = interval.contacts
            assert np.allclose(c.force.sum(axis=0), [0, 0, 8 * 9.81], atol=1e-3)
            assert c.body.tolist() == [[-1, 0]] * len(c.env) and np.allclose(c.normal, [0, 0, 1])
            assert np.allclose(np.abs(c.position[:, :2]), 0.1, atol=1e-3) and np.all(c.distance <= 0)
    assert poses[0] == poses[1]


def test_controls_act_from_their_stamp(scene_of):
    """1 N on 1 kg: at rest until the first action, then v = t, and after a zero action constant."""
    world = "<body name='cart'><joint name='x' type='slide' axis='1 0 0'/><geom size='0.1' mass='1'/></body>"
    rest = "<actuator><motor joint='x' ctrlrange='-5 5' ctrllimited='true'/></actuator>"
    engine = MujocoEngine(scene_of(world, "gravity='0 0 0'", rest), envs=2)
    assert engine.actuators.count == 1
    assert np.abs(engine.advance(100 * MS).twist).max() == 0
    push = engine.advance(200 * MS, np.array([[1.0], [2.0]])).twist[:, -1, 0, 0]
    assert np.allclose(push, [0.1, 0.2])
    assert np.allclose(engine.advance(300 * MS, np.zeros((2, 1))).twist[:, -1, 0, 0], push)
    with pytest.raises(ValueError, match=r"controls \[1, 1\], the model takes \[2, 1\]"):
        engine.advance(400 * MS, np.zeros((1, 1)))
    with pytest.raises(ValueError, match="nan for actuator 'x' of environment 1; it must be finite"):
        engine.advance(400 * MS, np.array([[0.0], [np.nan]]))
