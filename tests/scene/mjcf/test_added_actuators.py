"""Actuators that a scene file gives to joints of its model, against statics and dynamics in closed form."""

import mujoco
import numpy as np
import pytest

from evis.scene import SceneError, load_scene
from evis.scene.load import may_be_driven
from evis.scene.mjcf.dynamics import compile_model

LINK = """<inertial><origin xyz="0 0 {z}"/><mass value="1"/>
  <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>"""
URDF = f"""<robot name="two"><link name="base"/>
  <link name="arm">{LINK.format(z=0.25)}</link><link name="tip">{LINK.format(z=0)}</link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1.2" effort="30" velocity="2"/></joint>
  <joint name="wrist" type="continuous"><parent link="arm"/><child link="tip"/><origin xyz="0 0 0.5"/>
    <axis xyz="0 0 1"/></joint></robot>"""
GRAVITY = 9.81


def model_of(folder, actuators, source=URDF, name="robot.urdf"):
    (folder / name).write_text(source)
    (folder / "s.yaml").write_text(f"mjcf: {name}\ncameras: {{cam0: {{fov: 1}}}}\nactuators: {actuators}\n")
    return compile_model(load_scene(str(folder / "s.yaml"), visuals=False))


def moved(model, controls, seconds):
    data = mujoco.MjData(model)
    data.ctrl[:] = controls
    while data.time < seconds:
        mujoco.mj_step(model, data)
    return data


def test_servos_hold_and_turn_a_urdf(tmp_path):
    """The arm stands where the servo's torque is that of gravity: gain (c - q) = -(0.25 + 0.5) m g sin q. A velocity
    servo without load comes to its speed. Ranges: the joint's limits, and what is given; names are the joints'."""
    wrist, shoulder = "{kind: velocity, gain: 5, range: [-2, 2]}", "{kind: position, gain: 200, damping: 20}"
    model = model_of(tmp_path, f"{{wrist: {wrist}, shoulder: {shoulder}}}")
    assert [model.actuator(i).name for i in range(model.nu)] == ["shoulder", "wrist"]
    np.testing.assert_allclose(model.actuator_ctrlrange, [[-1, 1.2], [-2, 2]])
    data = moved(model, [0.4, 1.5], 3.0)
    assert abs(200 * (0.4 - data.qpos[0]) + 0.75 * GRAVITY * np.sin(data.qpos[0])) < 1e-3
    assert data.qvel[1] == pytest.approx(1.5, abs=1e-6)


def test_motors_give_their_force_up_to_the_joints_effort(tmp_path):
    """The wrist turns freely about its own axis: after t its speed is gain u t / I. The shoulder's range is 30 N m by
    the gain, and 30 N m is all that comes of more."""
    model = model_of(tmp_path, '{"*": {kind: motor, gain: 0.5}}')
    np.testing.assert_allclose(model.actuator_ctrlrange[0], [-60, 60])
    assert model.actuator_ctrllimited.tolist() == [1, 0]
    data = moved(model, [0.0, 0.1], 0.1)
    assert data.qvel[1] == pytest.approx(0.5 * 0.1 * data.time / 0.01, rel=1e-6)
    model = model_of(tmp_path, "{shoulder: {kind: position, gain: 1e4}}")
    data = mujoco.MjData(model)
    data.ctrl[:] = 1.0
    mujoco.mj_forward(model, data)
    assert data.qfrc_actuator[0] == pytest.approx(30)


def test_an_mjcf_keeps_its_own_and_its_keyframes(tmp_path):
    xml = """<mujoco><worldbody><body><joint name="a"/><geom size="0.1"/><body><joint name="b" type="slide"/>
      <geom size="0.1"/></body></body></worldbody><actuator><motor name="b" joint="a"/></actuator>
      <keyframe><key name="home" qpos="0.1 0.2" ctrl="0.7"/></keyframe></mujoco>"""
    model = model_of(tmp_path, "{b: {kind: position, gain: 3, range: [1, 2]}}", xml, "m.xml")
    assert model.nu == 2 and model.key_ctrl.tolist() == [[0.7, 1.0]] and model.key_qpos.tolist() == [[0.1, 0.2]]
    assert model.actuator(0).name == "b" and model.actuator_trnid[1, 0] == 1


def test_it_may_be_driven_then_and_mistakes_are_told(tmp_path):
    model_of(tmp_path, "{wrist: {kind: motor}}")
    assert may_be_driven(str(tmp_path / "s.yaml")) and not may_be_driven(str(tmp_path / "robot.urdf"))
    for actuators, words in (
        ("{rist: {kind: motor}}", "actuators 'rist' fits none of the model's hinges and slides; did you mean 'wrist'?"),
        ("{wrist: {kind: position}}", "needs 'gain'"),
        ("{wrist: {kind: servo}}", "kind is 'servo'; there are position, velocity, motor"),
        ('{"*": {kind: motor}, wrist: {kind: motor}}', "gives joint 'wrist' a second actuator"),
        ("{wrist: {kind: motor, range: [2, 1]}}", "range is [2, 1]; the least comes first"),
        ("{wrist: {kind: motor, damping: 1}}", "damping"),
    ):
        with pytest.raises(SceneError) as caught:
            model_of(tmp_path, actuators)
        assert words in str(caught.value)
    (tmp_path / "s.yaml").write_text("cameras: {cam0: {fov: 1}}\nactuators: {a: {kind: motor}}\n")
    with pytest.raises(SceneError, match="actuators is for scenes with an mjcf"):
        load_scene(str(tmp_path / "s.yaml"))
