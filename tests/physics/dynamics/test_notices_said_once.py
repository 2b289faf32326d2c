"""Notices of a simulation that goes on: each is said once per environment, whatever happens afterwards."""

import mujoco
import numpy as np
import pytest

from evis.scene import load_scene
from nodes.physics.engines.mujoco_engine import MujocoEngine

MS = 1_000_000

ARM = """<mujoco><option timestep="0.001" gravity="0 0 0"/><worldbody>
<body name="arm"><joint name="hinge" type="hinge"/><geom size=".1" mass="1"/></body></worldbody>
<actuator><motor joint="hinge"/></actuator></mujoco>"""
TAKEN_AS_ZERO = (
    "a control is not finite, or beyond 1e+10, and all controls were taken as zero; give smaller ones, and the "
    "actuator more gear"
)


@pytest.fixture
def engine(tmp_path):
    (tmp_path / "arm.xml").write_text(ARM)
    return MujocoEngine(load_scene(str(tmp_path / "arm.xml")), envs=2)


def spoil(engine, env):
    """A control as a plugin could leave it; MuJoCo counts every step with it."""
    engine.data[env].ctrl[0] = np.nan


def test_a_notice_is_said_once_and_not_each_step(engine):
    """MuJoCo counts every step whose control it drops; the first alone is told, for the environment that it is in."""
    spoil(engine, 1)
    said = []
    for k in range(1, 6):
        spoil(engine, 1)
        said += engine.advance(k * 10 * MS).warnings
    assert engine.data[1].warning[mujoco.mjtWarning.mjWARN_BADCTRL].number >= 5
    assert said == [(1, TAKEN_AS_ZERO)]
    spoil(engine, 0)
    assert engine.advance(60 * MS).warnings == [(0, TAKEN_AS_ZERO)]
    assert engine.advance(70 * MS).warnings == []


@pytest.mark.parametrize(("control", "told"), [(1e10, False), (1.001e10, True)])
def test_a_control_that_is_too_large_takes_the_others_with_it(tmp_path, control, told):
    """What is told is what happens: beside a huge control on a weak gear a motor of 1 N m on 1 kg m^2 does nothing."""
    weak = (
        '<body name="far" pos="3 0 0"><joint name="slide" type="slide"/><geom size=".1" mass="1"/></body></worldbody>'
    )
    more = '<motor joint="slide" gear="1e-12"/></actuator>'
    (tmp_path / "arm.xml").write_text(ARM.replace("</worldbody>", weak).replace("</actuator>", more))
    engine = MujocoEngine(load_scene(str(tmp_path / "arm.xml")))
    said = engine.advance(10 * MS, np.array([[1.0, control]])).warnings
    assert said == ([(0, TAKEN_AS_ZERO)] if told else [])
    assert (engine.data[0].qvel == 0).all() == told


def test_a_notice_is_not_said_again_in_the_next_episode(engine):
    """A restart sets MuJoCo's counters to 0; what was said of the environment stays said."""
    spoil(engine, 0)
    assert engine.advance(10 * MS).warnings == [(0, TAKEN_AS_ZERO)]
    engine.data[0].qvel[0] = np.nan
    assert len(engine.advance(20 * MS).faults) == 1
    assert engine.data[0].warning[mujoco.mjtWarning.mjWARN_BADCTRL].number == 0
    spoil(engine, 0)
    interval = engine.advance(30 * MS)
    assert engine.data[0].warning[mujoco.mjtWarning.mjWARN_BADCTRL].number > 0
    assert interval.faults == [] and interval.warnings == []


def test_another_run_is_told_of_as_the_first(engine):
    """What a run says, and which of its steps are looked at one by one, does not hang on the runs before it."""
    spoil(engine, 0)
    first = engine.advance(10 * MS).warnings
    engine.rewind(0)
    assert first == [(0, TAKEN_AS_ZERO)]
    assert engine.advance(10 * MS).warnings == []
    spoil(engine, 0)
    assert engine.advance(20 * MS).warnings == first


def test_what_has_no_name_is_called_by_its_number():
    """Geoms and the bodies that they are on."""
    from nodes.physics.stiffness import geom_name

    body, named = (f"<body{name}><freejoint/><geom size='1'/></body>" for name in ("", " name='ball'"))
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{body}{named}</worldbody></mujoco>")
    assert [geom_name(model, g) for g in (0, 1)] == ["geom 0 of body 'body1'", "geom 1 of body 'ball'"]
