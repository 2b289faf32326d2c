"""Where a model starts: its keyframe `home`, another, or none; with the controls and mocap bodies of the keyframe."""

import numpy as np
import pytest

from evis.scene import SceneError, load_scene
from nodes.physics.engines.mujoco_engine import MujocoEngine

MS = 1_000_000
MODEL = """
<mujoco><option gravity="0 0 -9.81"/><worldbody>
  <body name="hand" mocap="true" pos="0 1 0"><geom size="0.1" contype="0" conaffinity="0"/></body>
  <body name="link"><joint name="j" axis="0 1 0" damping="2"/><geom type="capsule" fromto="0 0 0 0 0 -.4" size=".02"/>
  </body></worldbody>
  <actuator><position joint="j" kp="200"/></actuator>
  <keyframe><key name="down" qpos="0"/><key name="{home}" qpos="0.8" ctrl="0.8" mpos="1 2 3"/>
  <key qpos="0.3"/></keyframe>
</mujoco>
"""


@pytest.fixture
def model(tmp_path):
    def write(home="home"):
        (tmp_path / "arm.xml").write_text(MODEL.format(home=home))
        return str(tmp_path / "arm.xml")

    return write


def angle(interval):
    """Of the link about y, from its quaternion."""
    return 2 * np.arctan2(interval.pose[0, -1, 1, 4], interval.pose[0, -1, 1, 6])


def test_home_is_the_start_and_its_servo_holds_it(model):
    """qpos, ctrl and mocap pose of the keyframe; gravity bends a servo of 200 N m/rad by less than a degree."""
    engine = MujocoEngine(load_scene(model()))
    start = engine.start()
    assert np.isclose(angle(start), 0.8) and start.pose[0, 0, 0, :3].tolist() == [1, 2, 3]
    later = engine.advance(500 * MS)
    assert abs(angle(later) - 0.8) < np.radians(1) and engine.data[0].ctrl.tolist() == [0.8]


@pytest.mark.parametrize(("wanted", "expected"), [("down", 0.0), ("none", 0.0), ("1", 0.8), (2, 0.3), ("auto", 0.8)])
def test_an_argument_chooses_the_keyframe(model, wanted, expected):
    """By name or number; `none` is the reference pose, where the mocap body is where the model puts it."""
    interval = MujocoEngine(load_scene(model(), {"keyframe": wanted})).start()
    assert np.isclose(angle(interval), expected)
    if wanted == "none":
        assert interval.pose[0, 0, 0, :3].tolist() == [0, 1, 0]


def test_a_keyframe_whose_name_is_a_number_goes_by_its_name(model):
    assert np.isclose(angle(MujocoEngine(load_scene(model("0"), {"keyframe": "0"})).start()), 0.8)


@pytest.mark.parametrize("wanted", [3, "-1"])
def test_a_number_of_no_keyframe_is_told_with_those_there_are(model, wanted):
    with pytest.raises(SceneError, match=f"keyframe is '{wanted}'; its keyframes are numbered 0 to 2"):
        load_scene(model(), {"keyframe": wanted})


def test_other_keyframes_are_not_the_start(model):
    """Of a model without `home` it is the reference pose, as in MuJoCo."""
    assert angle(MujocoEngine(load_scene(model("bent"))).start()) == 0


def test_an_environment_that_diverged_starts_at_the_keyframe_again(model):
    """Not at the reference pose."""
    engine = MujocoEngine(load_scene(model()))
    engine.data[0].qvel[0] = np.nan
    interval = engine.advance(2 * MS)
    assert interval.faults and np.isclose(angle(interval), 0.8)


def test_a_wrong_keyframe_is_one_line_with_the_nearest(model, tmp_path):
    """By argument and in a scene file, where there is also none to choose from."""
    with pytest.raises(SceneError, match=r"keyframe is 'hom'; did you mean 'home'\?"):
        load_scene(model(), {"keyframe": "hom"})
    (tmp_path / "plain.xml").write_text("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    (tmp_path / "s.yaml").write_text("mjcf: plain.xml\nkeyframe: home\n")
    with pytest.raises(SceneError, match=r"s\.yaml:2: .*keyframe is 'home'; the model has no keyframe"):
        load_scene(str(tmp_path / "s.yaml"))
    (tmp_path / "s.yaml").write_text("cameras: {cam0: {fov: 1}}\nkeyframe: home\n")
    with pytest.raises(SceneError, match=r"s\.yaml:2: .*keyframe is for scenes with an mjcf"):
        load_scene(str(tmp_path / "s.yaml"))
