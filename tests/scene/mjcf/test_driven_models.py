"""Whether a scene has actuators, told from its text."""

from pathlib import Path

import mujoco
import pytest

from evis.scene.load import find_scene, may_be_driven

BALL = "<worldbody><body><freejoint/><geom size='0.1'/></body></worldbody>"
HINGE = "<worldbody><body name='b'><joint name='j'/><geom size='0.1'/></body></worldbody>"
MOTOR = "<actuator><motor joint='j'/></actuator>"


@pytest.mark.parametrize("name", ["cart_pole", "falling_objects", "pan_tilt", "pong", "robot_arm"])
def test_of_shipped_models_it_is_what_mujoco_has(name: str) -> None:
    model = mujoco.MjModel.from_xml_path(str(find_scene(name).with_suffix(".xml")))
    assert may_be_driven(name) == (model.nu > 0)


def test_motion_in_closed_form_has_none() -> None:
    assert not may_be_driven("spinning_disk")


@pytest.mark.parametrize(
    "text, driven",
    [
        (f"<mujoco>{BALL}</mujoco>", False),
        (f"<mujoco><!-- {MOTOR} -->{BALL}</mujoco>", False),
        (f"<mujoco>{HINGE}{MOTOR}</mujoco>", True),
        (f"<mujoco>{HINGE}<include file='rest.xml'/></mujoco>", True),
        (f"<mujoco><asset><model name='m' file='rest.xml'/></asset>{BALL}</mujoco>", True),
        ("no model", True),
    ],
)
def test_what_stands_elsewhere_may_have_some(tmp_path: Path, text: str, driven: bool) -> None:
    (tmp_path / "m.xml").write_text(text)
    (tmp_path / "s.yaml").write_text("mjcf: m.xml\ncameras: {cam0: {fov: 1, position: [0, 0, 9]}}\n")
    assert may_be_driven(str(tmp_path / "s.yaml")) == may_be_driven(str(tmp_path / "m.xml")) == driven


def test_a_model_that_is_not_there_is_for_its_reader(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text("mjcf: m.xml\ncameras: {cam0: {fov: 1, position: [0, 0, 9]}}\n")
    assert may_be_driven(str(tmp_path / "s.yaml"))
