"""Actuators that take several controls, as MuJoCo's `orientation`: a control is one thing, an actuator another."""

import mujoco
import numpy as np
import pytest

import evis
from evis.scene import load_scene
from nodes.physics.stiffness import modes

MODEL = """<mujoco><option timestep="0.001" gravity="0 0 0"/><worldbody>
<body name="box"><joint name="ball" type="ball"/><geom type="box" size=".07 .09 .05"/></body>
<body name="wheel" pos="1 0 0"><joint name="hinge"/><geom size=".1"/></body></worldbody>
<actuator><orientation name="turn" joint="ball" input="quat" kp="1" dampratio="1"/>
<position name="servo" joint="hinge" gear="3" kp="2" {delay}/></actuator></mujoco>"""


@pytest.fixture
def path(tmp_path):
    def written(delay: str = "") -> str:
        (tmp_path / "m.xml").write_text(MODEL.format(delay=delay))
        return str(tmp_path / "m.xml")

    return written


def test_each_control_has_a_name_and_the_course_is_mujoco_s(path):
    """The box follows its setpoint as by mj_step; before an action it stays, as MuJoCo's start has it."""
    with evis.Simulation(path(), width=16, height=12, keyframe_rate=50, outputs=["state"]) as sim:
        assert [a.name for a in sim.actuators] == [*(f"turn[{k}]" for k in range(4)), "servo"]
        sim.reset()
        still = sim.step().state.end_pose[0, 0, 3:]
        controls = np.array([0.9, 0.3, 0.1, 0.3, 0.4])
        moved = sim.step(controls).state.end_pose[0, :2, 3:]
    model = mujoco.MjModel.from_xml_path(path())
    data = mujoco.MjData(model)
    data.ctrl[:] = controls
    mujoco.mj_step(model, data, 20)
    mujoco.mj_kinematics(model, data)
    np.testing.assert_array_equal(still, [0, 0, 0, 1])
    np.testing.assert_allclose(moved, data.xquat[1:][:, [1, 2, 3, 0]], atol=1e-12)
    assert abs(moved[0, 0]) > 1e-3


def test_actions_at_multiples_of_the_model_s_own_step_act_at_once(path):
    """Of 2.5 ms, too: three parts of 833,333 ns would fall short of the keyframe, and the action came a step later."""
    file = path().replace("m.xml", "coarse.xml")
    with open(file, "w") as f:
        f.write(MODEL.format(delay="").replace('timestep="0.001"', 'timestep="0.0025"'))
    model = mujoco.MjModel.from_xml_path(file)
    model.opt.timestep /= 4
    data = mujoco.MjData(model)
    with evis.Simulation(file, width=16, height=12, keyframe_rate=40, outputs=["state"]) as sim:
        sim.reset()
        for k in range(4):
            data.ctrl[:] = [0.9, 0.3, 0.1, 0.3, 0.4 * (-1) ** k]
            mujoco.mj_step(model, data, 40)
            mujoco.mj_kinematics(model, data)
            moved = sim.step(data.ctrl).state.end_pose[0, :2, 3:]
            np.testing.assert_allclose(moved, data.xquat[1:][:, [1, 2, 3, 0]], atol=1e-12)


def test_what_belongs_to_an_actuator_is_found_by_its_number(path):
    """A servo behind one with four controls: its delay, its gear and its gain in a scene."""
    file = path('delay="0.01" nsample="10"')
    (model := mujoco.MjModel.from_xml_path(file)).actuator_gear[0, 0] = 7  # of another actuator
    stiffness = next(mode.stiffness for mode in modes(model) if "hinge" in mode.source)
    assert stiffness == pytest.approx(2 * 3**2 / model.dof_M0[3])
    scene = file.replace("m.xml", "s.yaml")
    with open(scene, "w") as f:
        f.write('mjcf: m.xml\nmodel: {actuators: {"*o": {gain: 5}}}\n')
    assert [(c.number, c.values) for c in load_scene(scene).changes] == [(1, (5.0,))]
    with evis.Simulation(file, width=16, height=12, timestep=0.0005, outputs=["state"]) as sim:
        sim.reset()
        assert sim.step(np.array([1, 0, 0, 0, 0.4])).state.end_pose[0, 1, 5] > 0
