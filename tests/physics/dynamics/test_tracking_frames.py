"""Frames of cameras and lights that track or target a body: against MuJoCo's own pictures and against differences."""

import mujoco
import numpy as np
import pytest
from engine_arguments import grouped

from evis.geometry import interpolate, se3
from evis.scene import load_scene
from nodes.physics.engines.mujoco_engine import MujocoEngine

MS = 1_000_000
MODEL = """
<mujoco><option integrator="RK4" gravity="0 0 -2"/><worldbody>
  <light name="plain" pos="0 0 5"/>
  <camera name="from_world" mode="targetbodycom" target="torso" pos="0.5 -4 2"/>
  <camera name="all" mode="trackcom" pos="0 -6 1" euler="80 0 0"/>
  <light name="above" mode="targetbodycom" target="torso" pos="0.1 0.2 6"/>
  <body name="torso" pos="0 0 1" euler="5 10 15"><freejoint/><geom type="box" size=".3 .1 .1"/>
    <camera name="com" mode="trackcom" pos="0 -3 0.3" xyaxes="1 0 0 0 0 1"/>
    <camera name="origin" mode="track" pos="0 -3 0.3" euler="90 0 0"/>
    <camera name="eye" pos=".3 0 0" euler="90 0 -90"/>
    <light name="lamp" mode="trackcom" pos="0 0 3" dir="0.2 0 -1"/>
    <body name="leg" pos=".3 0 0"><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .2 0 -.6" size=".04"/>
      <camera name="at_foot" mode="targetbody" target="free" pos="0 0.1 -.5"/>
      <light name="torch" mode="targetbody" target="free" pos="0 0 -.6"/></body></body>
  <body name="free" pos="2 1 0.5"><freejoint/><geom type="box" size=".1 .2 .3"/></body>
</worldbody></mujoco>
"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("follow") / "m.xml"
    path.write_text(MODEL)
    return load_scene(str(path))


def moving_engine(scene, **options):
    engine = MujocoEngine(scene, **grouped(**options))
    for k, data in enumerate(engine.data):
        data.qvel[:] = 0.7 * np.random.default_rng(k).normal(size=engine.model.nv)
        mujoco.mj_forward(engine.model, data)
    engine._begin_course()
    return engine


def number(engine, kind, name):
    return mujoco.mj_name2id(engine.model, kind, name)


def test_cameras_are_where_mujoco_s_renderer_has_them(scene):
    """Position, forward and up of the camera that mjv_updateScene sets up for drawing, in single precision."""
    engine = moving_engine(scene)
    interval = engine.advance(100 * MS)
    model, data = engine.model, engine.data[0]
    fresh = mujoco.MjData(model)
    fresh.qpos[:] = data.qpos
    mujoco.mj_forward(model, fresh)
    view, chosen, option = mujoco.MjvScene(model, 100), mujoco.MjvCamera(), mujoco.MjvOption()
    chosen.type = mujoco.mjtCamera.mjCAMERA_FIXED
    names = ["from_world", "all", "com", "origin", "eye", "at_foot"]
    assert [scene.cameras[0].name, *names[1:]] == ["cam0", *(c.name for c in scene.cameras[1:])]
    for i, camera in enumerate(scene.cameras):
        chosen.fixedcamid = number(engine, mujoco.mjtObj.mjOBJ_CAMERA, names[i])
        mujoco.mjv_updateScene(model, fresh, option, None, chosen, mujoco.mjtCatBit.mjCAT_ALL, view)
        left, right = view.camera
        pose = interval.pose[0, -1, scene.body_index(camera.name)]
        down, forward = (se3.rotate(pose[3:], axis) for axis in np.eye(3)[1:])
        assert np.abs(pose[:3] - 0.5 * (left.pos + right.pos)).max() < 1e-5, names[i]
        assert np.abs(forward - left.forward).max() < 1e-6 and np.abs(down + left.up).max() < 1e-6, names[i]


def test_lights_are_where_mujoco_has_them(scene):
    """light_xpos and light_xdir, from the frame and what the scene says of the light in it."""
    engine = moving_engine(scene)
    interval = engine.advance(100 * MS)
    fresh = mujoco.MjData(engine.model)
    fresh.qpos[:] = engine.data[0].qpos
    mujoco.mj_forward(engine.model, fresh)
    assert [light.name for light in scene.lights] == ["plain", "above", "lamp", "torch"]
    for light in scene.lights[1:]:
        i = number(engine, mujoco.mjtObj.mjOBJ_LIGHT, light.name)
        pose = interval.pose[0, -1, light.body]
        assert np.abs(se3.transform(pose, light.vector) - fresh.light_xpos[i]).max() < 1e-12
        assert np.abs(se3.rotate(pose[3:], light.direction) - fresh.light_xdir[i]).max() < 1e-12


def test_velocities_are_the_derivatives_of_the_poses(scene):
    """Central differences of second order over steps of 0.1 ms, of every frame and both parts of its twist."""
    interval = moving_engine(scene, timestep=1e-4).advance(60 * MS)
    frames = [n for n, body in enumerate(scene.bodies) if body.follows]
    assert len(frames) == 8
    p, v = interval.pose[0, :, frames, :3], interval.twist[0, :, frames, :3]
    moves = np.abs(v).max(axis=(1, 2)) > 0.05
    assert [scene.bodies[n].name for n, move in zip(frames, moves) if not move] == ["cam0", "above"]  # on the world
    assert np.abs((p[:, 2:] - p[:, :-2]) / 2e-4 - v[:, 1:-1]).max() < 1e-6
    q, omega = interval.pose[0, :, frames, 3:], interval.twist[0, :, frames, 3:]
    turn = se3.log(se3.multiply(q[:, 2:], se3.conjugate(q[:, :-2]))) / 2e-4
    assert np.abs(turn - omega[:, 1:-1]).max() < 1e-5
    turning = np.abs(omega).max(axis=(1, 2)) > 0.01
    follows = [scene.bodies[n].name for n in frames]
    assert {name for name, turns in zip(follows, turning) if turns} == {"cam0", "at_foot", "above", "torch"}


def test_between_steps_a_frame_is_on_its_curve(scene):
    """Sub-frame poses from steps of 1 ms against a run with steps of 0.1 ms."""
    coarse, fine = (moving_engine(scene, timestep=dt).advance(40 * MS) for dt in (1e-3, 1e-4))
    frames = [n for n, body in enumerate(scene.bodies) if body.follows]
    found = interpolate.pose_at(fine.t, coarse.t, coarse.pose[0], coarse.twist[0])[:, frames]
    wanted = fine.pose[0][:, frames]
    assert np.abs(found[..., :3] - wanted[..., :3]).max() < 1e-8
    angle = np.linalg.norm(se3.log(se3.multiply(found[..., 3:], se3.conjugate(wanted[..., 3:]))), axis=-1)
    assert angle.max() < 1e-8


def test_frames_at_rest_do_not_move(tmp_path):
    """No gravity, no velocity: nothing is listed as moving, to the bit."""
    path = tmp_path / "m.xml"
    path.write_text(MODEL.replace('gravity="0 0 -2"', 'gravity="0 0 0"'))
    assert MujocoEngine(load_scene(str(path))).advance(20 * MS).moving.tolist() == []


def test_straight_above_its_target_a_camera_stays_finite(tmp_path):
    """There MuJoCo's rule has no side: the pose is MuJoCo's, the velocity finite."""
    path = tmp_path / "m.xml"
    path.write_text(
        """<mujoco><worldbody><camera name="c" mode="targetbody" target="ball" pos="0 0 3"/>
        <light name="l" mode="targetbody" target="ball" pos="0 0 3"/>
        <body name="ball"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""
    )
    interval = MujocoEngine(load_scene(str(path))).advance(50 * MS)
    assert np.isfinite(interval.pose).all() and np.abs(interval.twist[0, :, 1:]).max() == 0
    assert np.allclose(se3.rotate(interval.pose[0, -1, 1, 3:], np.array([0, 0, 1.0])), [0, 0, -1])


def test_environments_have_frames_of_their_own(scene):
    """Each as if alone, byte for byte."""
    both = moving_engine(scene, envs=2)
    alone = moving_engine(scene)
    first, single = both.advance(30 * MS), alone.advance(30 * MS)
    assert first.pose[0].tobytes() == single.pose[0].tobytes() and first.twist[0].tobytes() == single.twist[0].tobytes()
    assert np.abs(first.pose[0] - first.pose[1])[:, [b.follows is not None for b in scene.bodies]].max() > 1e-3
