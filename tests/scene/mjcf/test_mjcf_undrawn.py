"""What of a MuJoCo model is told not to be drawn, or otherwise, against what MuJoCo's own viewer would draw."""

import mujoco
import pytest

from evis.scene import load_scene

MODEL = """
<mujoco>
  <asset><material name="glass" rgba="0.5 0.6 1 0.3"/><material name="none" rgba="1 1 1 0"/></asset>
  <worldbody>
    <light pos="0 0 3"/>
    <body name="a" pos="0 0 1">
      <freejoint/>
      <geom name="window" type="box" size="0.1 0.1 0.1" material="glass"/>
      <geom name="painted" size="0.1" pos="1 0 0" material="glass" rgba="1 0 0 1"/>
      <geom name="tinted" size="0.1" pos="2 0 0" rgba="1 0 0 0.9"/>
      <geom type="capsule" size="0.1 0.1" pos="3 0 0" rgba="1 0 0 0.1"/>
      <geom name="hull" size="0.5" rgba="1 0 0 0.2" group="3"/>
      <geom name="gone" size="0.5" material="none"/>
      <site name="s"/>
    </body>
    <body name="b" pos="0 1 1"><joint name="h" axis="0 1 0"/><geom size="0.1" pos="0.1 0 0"/><site name="t"/></body>
    <body name="c" pos="0 2 1"><joint name="k" axis="0 1 0"/><geom size="0.1" pos="0.1 0 0"/><site name="u"/></body>
  </worldbody>
  <tendon>
    <fixed name="gear"><joint joint="h" coef="1"/><joint joint="k" coef="-1"/></fixed>
    <spatial name="rope"><site site="s"/><site site="t"/></spatial>
    <spatial name="thread" material="glass"><site site="s"/><site site="u"/></spatial>
    <spatial name="aid" group="4"><site site="t"/><site site="u"/></spatial>
    <spatial name="unseen" rgba="1 1 1 0"><site site="s"/><site site="u"/></spatial>
    <spatial name="clear" material="none"><site site="s"/><site site="u"/></spatial>
    <spatial name="red" material="none" rgba="1 0 0 1"><site site="s"/><site site="u"/></spatial>
  </tendon>
</mujoco>
"""


def viewed(model):
    """What MuJoCo's viewer draws by default: kind and number of each thing, with its alpha."""
    data, scene = mujoco.MjData(model), mujoco.MjvScene(model, 1000)
    mujoco.mj_forward(model, data)
    every = int(mujoco.mjtCatBit.mjCAT_ALL)
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, mujoco.MjvCamera(), every, scene)
    return [(g.objtype, g.objid, g.rgba[3]) for g in scene.geoms[: scene.ngeom]]


def test_tendons_and_transparent_geoms_are_named_as_mujoco_s_viewer_draws_them(tmp_path):
    """A line names three and counts the others."""
    path = tmp_path / "robot.xml"
    path.write_text(MODEL)
    model = mujoco.MjModel.from_xml_string(MODEL)
    seen = viewed(model)
    kind = mujoco.mjtObj
    tendons = list(dict.fromkeys(model.tendon(i).name for k, i, alpha in seen if k == kind.mjOBJ_TENDON and alpha > 0))
    clear = [model.geom(i).name or f"geom {i}" for k, i, alpha in seen if k == kind.mjOBJ_GEOM and 0 < alpha < 1]
    assert tendons == ["rope", "thread", "red"] and clear == ["window", "tinted", "geom 3"]
    scene = load_scene(str(path))
    (told,) = scene.notes
    assert told.startswith("spatial tendons are simulated but not drawn: 'rope', 'thread', 'red'; ")
    assert scene.left_out == [
        "what is transparent is drawn opaque: 'window', 'tinted', geom 3 of body 'a'; with alpha 0 it is left out"
    ]


def test_flexes_and_skins_are_named(tmp_path):
    """Of four flexes three, and that there is one more."""
    flex = '<flexcomp name="{}" type="grid" count="3 3 1" spacing="0.1 0.1 0.1" pos="0 0 1" radius="0.01"/>'
    cloths = "".join(flex.format(f"cloth{i}") for i in range(4))
    path = tmp_path / "robot.xml"
    path.write_text(f'<mujoco><worldbody><geom size="1"/>{cloths}</worldbody></mujoco>')
    (told,) = load_scene(str(path)).notes
    assert "flexes are simulated but not drawn: 'cloth0', 'cloth1', 'cloth2' and 1 more; " in told


@pytest.mark.parametrize(
    ("look", "why"), [('group="3"', "groups 3 to 5"), ('rgba="1 0 0 0"', "alpha 0"), ('rgba="1 0 0 1"', "")]
)
def test_a_model_of_which_nothing_is_drawn_is_told(tmp_path, look, why):
    """As a robot of collision shapes alone."""
    path = tmp_path / "robot.xml"
    path.write_text(f'<mujoco><worldbody><body><joint/><geom name="g" size="1" {look}/></body></worldbody></mujoco>')
    model = mujoco.MjModel.from_xml_path(str(path))
    drawn = [i for k, i, alpha in viewed(model) if k == mujoco.mjtObj.mjOBJ_GEOM and alpha > 0]
    scene = load_scene(str(path))
    assert len(drawn) == len(scene.instances) == (not why)
    assert len(scene.left_out) == bool(why) and all(why in line for line in scene.left_out)
    assert not load_scene(str(path), visuals=False).left_out
