"""A simulation that blows up is reported with body, time and cause, and begins its next episode."""

import warnings

import numpy as np
import pytest

from evis.scene import load_scene
from nodes.physics.engines.mujoco_engine import MujocoEngine
from nodes.physics.precision.stepping import Stepping

MS = 1_000_000

SPRING = """<mujoco><option timestep="0.001" integrator="{integrator}" gravity="0 0 0"/><worldbody>
<body name="mass"><joint name="spring" type="slide" stiffness="1e8" springref="{start}"/>
<geom size=".1" mass="1"/></body>
<body name="drifter" pos="3 0 0"><freejoint/><geom size=".1" mass="1"/></body>
</worldbody></mujoco>"""


@pytest.fixture
def spring_scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def make(integrator="Euler", start=0.01):
        (tmp_path / "spring.xml").write_text(SPRING.format(integrator=integrator, start=start))
        return load_scene("spring.xml")

    return make


@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicit", "implicitfast"])
def test_a_spring_too_stiff_for_the_step_is_a_fault(spring_scene, tmp_path, integrator):
    """k/m = 1e8 at 1 ms is omega*dt = 10: reported in the first interval, the state finite and back at the start."""
    engine = MujocoEngine(spring_scene(integrator))
    interval = engine.advance(50 * MS)
    assert [env for env, _ in interval.faults] == [0]
    text = interval.faults[0][1]
    assert "body 'mass' diverged at t = 0.0" in text and "joint 'spring'" in text
    assert "omega*dt = 10" in text and 'integrator="discrete"' in text and "\n" not in text
    assert np.isfinite(interval.pose).all() and np.isfinite(interval.twist).all()
    assert np.array_equal(interval.pose[0, -1], engine.start().pose[0, 0]) and not interval.twist.any()
    assert not list(tmp_path.glob("MUJOCO_LOG*"))


def test_numbers_too_large_for_squares_are_told_by_the_fault_alone(spring_scene):
    """A speed that grows a hundredfold a step for a hundred steps: a fault, and no warning of numpy's besides."""
    engine = MujocoEngine(spring_scene())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        interval = engine.advance(100 * MS)
    assert [env for env, _ in interval.faults] == [0] and "body 'mass' diverged" in interval.faults[0][1]


def test_only_the_diverged_environment_starts_again(spring_scene):
    """The others go on as if nothing had been."""
    engine = MujocoEngine(spring_scene(start=0.0), envs=2)
    for data in engine.data:
        data.qvel[1] = 2.0  # the drifter's vx
    engine.data[1].qpos[0] = 0.01
    interval = engine.advance(50 * MS)
    assert [env for env, _ in interval.faults] == [1]
    assert np.isclose(interval.pose[0, -1, 1, 0], 3.1) and interval.pose[1, -1, 1, 0] == 3.0
    again = engine.advance(100 * MS)
    assert again.faults == [] and np.isclose(again.pose[0, -1, 1, 0], 3.2)


def test_too_fast_is_a_fault_although_finite(spring_scene):
    """MuJoCo says nothing of 2 km/s."""
    engine = MujocoEngine(spring_scene("discrete", 0.0), stepping=Stepping(speed_limit=1000.0))
    engine.data[0].qvel[1] = 2000.0
    ((env, text),) = engine.advance(10 * MS).faults
    assert env == 0 and "body 'drifter' diverged" in text and "speed is 2000 m/s, the limit is 1000 m/s" in text


def test_not_a_number_is_a_fault(spring_scene):
    """As a user's plugin or a controller could make one."""
    engine = MujocoEngine(spring_scene("discrete", 0.0))
    engine.data[0].qvel[3] = np.nan
    interval = engine.advance(10 * MS)
    assert len(interval.faults) == 1 and "body 'drifter'" in interval.faults[0][1]
    assert np.isfinite(interval.pose).all()


def test_episodes_begin_differently_but_repeatably():
    """The next episode has its own random start, the same in every run, whatever the other environments do."""
    scene = load_scene("falling_objects", textures=False)

    def second_start(envs, k):
        engine = MujocoEngine(scene, seed=5 - k, envs=envs)
        engine.data[k].qvel[0] = np.nan
        return engine.advance(20 * MS).pose[k, -1]

    first = MujocoEngine(scene, seed=5).start().pose[0, 0]
    assert np.array_equal(second_start(1, 0), second_start(3, 2))
    assert np.abs(second_start(1, 0)[:6] - first[:6]).max() > 1e-4


STACK = """<mujoco><option timestep="0.001" integrator="{integrator}"/><worldbody>
<geom type="plane" size="9 9 1" {solref}/>
<body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="1" {solref}/></body>
<body pos="0 0 .3"><freejoint/><geom type="box" size=".1 .1 .1" mass="1000" {solref}/></body></worldbody></mujoco>"""


@pytest.mark.parametrize("integrator", ["Euler", "discrete"])
def test_a_ton_on_a_kilogram(tmp_path, integrator):
    """Direct solref: announced as unstable before the first step under Euler; `discrete` holds it within 1 mm."""
    (tmp_path / "stack.xml").write_text(STACK.format(integrator=integrator, solref='solref="-1e6 -1e4"'))
    engine = MujocoEngine(load_scene(str(tmp_path / "stack.xml")))
    texts = [text for _, text in engine.start().warnings]
    if integrator == "Euler":
        assert len(texts) == 1 and "direct solref" in texts[0] and "omega*dt = 10" in texts[0]
        assert "(and 2 more like it: " in texts[0]
    else:
        assert texts == []
        interval = engine.advance(2000 * MS)
        assert interval.faults == [] and np.allclose(interval.pose[0, -1, :2, 2], [0.1, 0.3], atol=1e-3)


@pytest.mark.parametrize("speed, warned", [(100.0, True), (10.5, True), (9.4, False)])
def test_a_bullet_at_a_thin_plate_is_said_to_pass(tmp_path, speed, warned):
    """More than 1 cm per step at a plate of 2 cm: MuJoCo lets it through without a word, here there is one warning."""
    (tmp_path / "plate.xml").write_text(
        "<mujoco><option timestep='0.001'/><worldbody><geom name='plate' type='box' size='1 1 .01'/>"
        "<body name='bullet' pos='0 0 1'><freejoint/><geom type='box' size='.1 .1 .1'/></body></worldbody></mujoco>"
    )
    engine = MujocoEngine(load_scene(str(tmp_path / "plate.xml")))
    engine.data[0].qvel[2] = -speed
    texts = [text for k in range(1, 5) for _, text in engine.advance(k * 10 * MS).warnings]
    if warned:
        assert len(texts) == 1 and f"body 'bullet' goes {speed / 1000:.3g} m" in texts[0] and "geom 'plate'" in texts[0]
        assert "timestep below 0.0001 s" in texts[0] or speed < 100
    else:
        assert texts == []
