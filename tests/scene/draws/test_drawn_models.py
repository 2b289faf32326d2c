"""What a scene changes and draws of its MuJoCo model: dynamics against closed forms, and what is seen."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from evis.geometry import se3
from evis.scene import SceneError, load_scene
from evis.scene.mjcf.dynamics import compile_model
from nodes.physics.engines.mujoco_engine import MujocoEngine
from nodes.physics.interval import Extras

MODEL = """
<mujoco model="rig">
  <option timestep="0.001" gravity="0 0 -9.81"/>
  <asset><material name="paint" rgba="0.8 0.1 0.1 1"/></asset>
  <worldbody>
    <light name="lamp" pos="0 0 3" dir="0 0 -1"/>
    <body name="bob" pos="0 0 2">
      <joint name="hinge" axis="0 1 0"/>
      <geom name="rod" type="capsule" fromto="0 0 0 0 0 -0.5" size="0.02" material="paint" contype="0" conaffinity="0"/>
    </body>
    <body name="ball_0" pos="1 0 1"><freejoint/><geom size="0.1" friction="0.5 0.01 0.001"/></body>
    <body name="ball_1" pos="2 0 1"><freejoint/><geom size="0.1"/></body>
  </worldbody>
  <actuator><position name="servo" joint="hinge" kp="3" kv="0.5"/></actuator>
</mujoco>
"""


def written(folder: Path, model: str, spare: str = "") -> str:
    (folder / "rig.xml").write_text(MODEL)
    (folder / "rig.yaml").write_text(
        f"mjcf: rig.xml\ncameras: {{cam0: {{position: [0, -5, 1], fov: 40 deg}}}}\n{spare}model:\n{model}"
    )
    return str(folder / "rig.yaml")


def test_numbers_by_name_and_by_pattern(tmp_path: Path) -> None:
    """Mass with inertia, friction, damping, gain with its feedback; a pattern's elements draw each for themselves."""
    scene = load_scene(
        written(
            tmp_path,
            "  gravity: [0, 0, -1.62]\n"
            "  bodies: {'ball_*': {mass_scale: {from: 2, to: 3}}, ball_0: {friction: 0.9}}\n"
            "  geoms: {rod: {friction: [1, 2, 3]}}\n"
            "  joints: {hinge: {damping: 0.4, stiffness: 2, armature: 0.01, friction: 0.05}}\n"
            "  actuators: {'*': {gain_scale: 2}}\n",
        ),
        seed=5,
    )
    plain = mujoco.MjModel.from_xml_path(str(tmp_path / "rig.xml"))
    model = compile_model(scene)
    ratio = model.body_mass[2:] / plain.body_mass[2:]
    drawn = {one.place: one.value for one in scene.drawn}
    assert ratio == pytest.approx([drawn[f"model.bodies.ball_{k}.mass_scale"] for k in range(2)])
    assert ratio[0] != ratio[1] and 2 <= ratio.min() and ratio.max() <= 3
    assert model.body_inertia[2:] == pytest.approx(plain.body_inertia[2:] * ratio[:, None])
    assert model.body_invweight0[2, 0] == pytest.approx(1 / model.body_mass[2])
    assert model.geom_friction[1] == pytest.approx([0.9, 0.01, 0.001]) and model.geom_friction[0] == pytest.approx(
        [1, 2, 3]
    )
    assert (model.dof_damping[0], model.jnt_stiffness[0], model.dof_armature[0]) == (0.4, 2.0, 0.01)
    assert model.dof_frictionloss[0] == 0.05 and model.opt.gravity[2] == -1.62
    assert model.actuator_gainprm[0, 0] == 6 and model.actuator_biasprm[0, :3] == pytest.approx([0, -6, -0.5])


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ('position kp="3" kv="3"', 'position kp="6" kv="3"'),
        ('position kp="3" kv="0.5"', 'position kp="6" kv="0.5"'),
        ('velocity kv="3"', 'velocity kv="6"'),
        ('damper kv="3"', 'damper kv="6"'),
        ('cylinder area="3" bias="1 2 3"', 'cylinder area="6" bias="1 2 3"'),
        ('muscle lengthrange="0 1" force="3"', 'muscle lengthrange="0 1" force="6"'),
        ('muscle lengthrange="0 1" scale="3"', 'muscle lengthrange="0 1" scale="6"'),
        ('general gainprm="-3"', 'general gainprm="-6"'),
    ],
)
def test_a_gain_goes_with_its_own_feedback_alone(before: str, after: str, tmp_path: Path) -> None:
    """As MuJoCo compiles the actuator that has the gain: a servo keeps its damping, also where that is equal."""
    text = """<mujoco><worldbody><body><joint name="j" type="hinge"/><geom size="1"/></body></worldbody>
    <actuator><{} name="servo" joint="j" ctrlrange="0 1"/></actuator></mujoco>"""
    (tmp_path / "m.xml").write_text(text.format(before))
    (tmp_path / "s.yaml").write_text(
        "mjcf: m.xml\nmodel: {actuators: {servo: {gain_scale: 2}}}\ncameras: {cam0: {fov: 1}}\n"
    )
    model = compile_model(load_scene(str(tmp_path / "s.yaml")))
    own = mujoco.MjModel.from_xml_string(text.format(after))
    for found, expected in (
        (model.actuator_gainprm, own.actuator_gainprm),
        (model.actuator_biasprm, own.actuator_biasprm),
    ):
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize(
    "actuator", ['dcmotor motorconst="0.05" resistance="1"', 'general gaintype="affine" gainprm="1 2 3"']
)
def test_a_gain_of_several_numbers_is_refused(actuator: str, tmp_path: Path) -> None:
    (tmp_path / "m.xml").write_text(
        f"""<mujoco><worldbody><body><joint name="j" type="hinge"/><geom size="1"/></body></worldbody>
        <actuator><{actuator} name="servo" joint="j"/></actuator></mujoco>"""
    )
    (tmp_path / "s.yaml").write_text("mjcf: m.xml\nmodel: {actuators: {servo: {gain: 2}}}\ncameras: {c: {fov: 1}}\n")
    with pytest.raises(SceneError, match=r"s\.yaml:2: .*gain is for actuators whose force"):
        load_scene(str(tmp_path / "s.yaml"))


def test_the_start_is_drawn(tmp_path: Path) -> None:
    """A hinge's angle and rate, and place and rotation of a free body, at the first state."""
    name = written(
        tmp_path,
        "  joints: {hinge: {position: {from: -90 deg, to: 90 deg}, velocity: 0.5}}\n"
        "  bodies:\n    ball_1:\n      shift: {from: [0, 0, 0], to: [1, 0, 1]}\n"
        "      turn: {axis: [0, 0, 1], angle: {from: 0, to: 3}}\n",
    )
    seen = []
    for seed in range(3):
        scene = load_scene(name, seed=seed, visuals=False)
        drawn = {one.place: one.value for one in scene.drawn}
        state = MujocoEngine(scene, extras=Extras(joints=True)).start()
        assert state.qpos is not None and state.qvel is not None
        assert state.qpos[0, 0, 0] == pytest.approx(np.radians(drawn["model.joints.hinge.position"]))
        assert state.qvel[0, 0, 0] == 0.5
        shift = [drawn.get(f"model.bodies.ball_1.shift[{k}]", 0.0) for k in range(3)]
        turn = [0.0, 0.0, drawn["model.bodies.ball_1.turn.angle"]]
        expected = se3.make_pose(np.array([2.0, 0, 1]) + shift, se3.exp(np.array(turn)))
        assert state.end_pose[0, scene.body_index("ball_1")] == pytest.approx(expected)
        seen.append(state.qpos[0, 0, 0])
    assert len(set(seen)) == 3


def test_a_pendulum_swings_by_its_drawn_gravity(tmp_path: Path) -> None:
    """Small swings of a stiffness without gravity: omega^2 = k / I about the hinge, of the model that was changed."""
    name = written(
        tmp_path,
        "  gravity: [0, 0, 0]\n  actuators: {servo: {gain: 0}}\n"
        "  joints: {hinge: {position: 0.02, stiffness: {from: 1, to: 2}}}\n"
        "  bodies: {bob: {mass: {from: 0.3, to: 0.6}}}\n",
    )
    scene = load_scene(name, seed=9, visuals=False)
    model = compile_model(scene)
    model.actuator_biasprm[:] = 0
    engine = MujocoEngine(scene, extras=Extras(joints=True))
    engine.model.actuator_biasprm[:] = 0
    engine.start()
    state = engine.advance(1_000_000_000)
    assert state.qpos is not None
    arm = model.body_inertia[1].max() + model.body_mass[1] * model.body_ipos[1, 2] ** 2
    omega = np.sqrt(model.jnt_stiffness[0] / arm)
    angle = state.qpos[0, :, 0]
    assert angle == pytest.approx(0.02 * np.cos(omega * state.t * 1e-9), abs=4e-4)
    assert angle.min() < -0.019


def test_materials_and_lights_of_the_model(tmp_path: Path) -> None:
    name = written(
        tmp_path,
        "  materials: {paint: {albedo: {from: [0, 0, 0], to: [1, 1, 1]}, roughness: 0.2}}\n"
        "  lights: {lamp: {strength: 3}}\n",
    )
    plain = load_scene(str(tmp_path / "rig.xml"))
    scene = load_scene(name, seed=1)
    paint = next(m for m in scene.materials if m.name == "paint")
    assert paint.albedo == pytest.approx([one.value for one in scene.drawn]) and paint.roughness == pytest.approx(0.2)
    assert scene.lights[0].colour == pytest.approx(3 * plain.lights[0].colour)


@pytest.mark.parametrize(
    ("model", "said"),
    [
        ("  bodies: {bal: {mass: 1}}\n", "fits none of the model's bodies"),
        ("  bodies: {bob: {mass: 1, mass_scale: 2}}\n", "are given; leave one out"),
        ("  bodies: {bob: {shift: [0, 0, 1]}}\n", "is for bodies with a free joint"),
        ("  bodies: {world: {mass: 1}}\n", "no inertia"),
        ("  bodies: {bob: {mass: 0}}\n", "it must be more than 0"),
        ("  joints: {joint1: {position: 1}}\n", "is for hinge and slide joints"),
        ("  joints: {hinge: {spring: 1}}\n", "spring is not known here"),
        ("  material: {paint: {albedo: 1}}\n", "material is not known here; did you mean 'materials'"),
    ],
)
def test_a_wrong_change_is_told_with_its_line(model: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"rig\.yaml:4: ") as caught:
        load_scene(written(tmp_path, model))
    assert said in str(caught.value)


def test_changes_are_for_models(tmp_path: Path) -> None:
    (tmp_path / "plain.yaml").write_text("cameras: {cam0: {fov: 40 deg}}\nmodel: {gravity: [0, 0, 1]}\n")
    with pytest.raises(SceneError, match="is for scenes with an mjcf"):
        load_scene(str(tmp_path / "plain.yaml"))
