"""The error that a run tells of its physics, against closed forms and against RK4 in steps a tenth as long."""

import numpy as np
import pytest
from known_courses import PENDULUM, RACKET, ROCK, SPRING, apart, chain, course, told
from physics_nodes import Wire

from evis.scene import load_scene
from nodes.physics.engines.mujoco_engine import MujocoEngine
from nodes.physics.node import PhysicsNode
from nodes.physics.precision.errors import Errors

ROUNDING = 1e-7
"""What the rounding of 50,000 steps has become in 5 s of tumbling."""


@pytest.mark.parametrize("rate", [20, 30, 250, 400, 1000])
def test_the_error_of_rk4_is_told_at_any_keyframe_rate(tmp_path, rate):
    """100 rad/s for a second against the closed form: few steps at a time are followed in shorter ones."""
    (tmp_path / "m.xml").write_text(
        "<mujoco><option timestep='.001' integrator='RK4' gravity='0 0 0'/>"
        f"<worldbody>{SPRING.format(1e4)}</worldbody></mujoco>"
    )
    errors = Errors()
    engine = MujocoEngine(load_scene(str(tmp_path / "m.xml"), visuals=False), errors=errors)
    t = np.array([round(k * 1e9 / rate) for k in range(1, rate + 1)])
    x = np.array([engine.advance(stamp).end_pose[0, 0, 0] for stamp in t])
    true = np.abs(x - 0.01 * (1 - np.cos(100 * t * 1e-9))).max()
    assert told(errors).position == pytest.approx(true, rel=0.2)


@pytest.mark.parametrize("integrator", ["Euler", "implicit", "implicitfast", "discrete"])
def test_free_fall_is_told_to_be_off_by_what_euler_makes_of_it(tmp_path, integrator):
    """g dt t / 2, by hand."""
    errors = Errors()
    course(tmp_path, ROCK, 2.0, integrator, errors=errors)
    assert told(errors).position == pytest.approx(9.81 * 1e-3 * 2.0 / 2, rel=1e-6) and told(errors).rotation == 0


CASES = {
    "racket": (RACKET, 5.0, ".01 10 .01"),
    "pendulum": (PENDULUM, 5.0, ""),
    "chain": (chain(50), 1.0, ""),
    "spring": (SPRING.format(400), 2.0, ""),
}


@pytest.mark.parametrize(
    "case, integrator",
    [(case, i) for case in CASES for i in ("Euler", "implicit", "RK4") if (case, i) != ("chain", "RK4")],
)
def test_the_error_is_told_within_a_factor_of_two(tmp_path, case, integrator):
    """Of the body that is furthest off, at the keyframe where it is."""
    world, seconds, spin = CASES[case]
    errors = Errors()
    _, made = course(tmp_path, world, seconds, integrator, spin, errors=errors)
    _, exact = course(tmp_path, world, seconds, "RK4", spin, timestep=1e-4)
    worst = told(errors)
    shift, turn = (off[:, worst.body].max() for off in apart(made, exact))
    for found, true in ((worst.position, shift), (worst.rotation, turn)):
        assert 0.5 * true - ROUNDING < found < 2 * true + ROUNDING


def test_steps_twice_as_long_that_diverge_are_not_told(tmp_path):
    """omega dt = 1.5, and 2 omega dt is beyond Euler's 2: what is told is no more than the swing."""
    errors = Errors()
    engine, _ = course(tmp_path, SPRING.format(1500.0**2), 1.0, errors=errors)
    assert engine._shadow._too_long and 0.005 < told(errors).position < 0.05


def test_nobody_is_moved_by_being_measured(tmp_path):
    _, measured = course(tmp_path, chain(10), 1.0, errors=Errors())
    _, alone = course(tmp_path, chain(10), 1.0)
    assert measured.tobytes() == alone.tobytes()


def test_an_action_at_an_odd_step_is_no_error(tmp_path):
    """33 steps a keyframe, a force that changes at each: what is told is Euler's own, |x'' dt t / 2| at most."""
    world = "<body name='cart'><joint name='rail' type='slide' axis='1 0 0'/><geom size='.1' mass='1'/></body>"
    rest = "<actuator><motor joint='rail'/></actuator>"
    (tmp_path / "m.xml").write_text(f"<mujoco><option timestep='.001'/><worldbody>{world}</worldbody>{rest}</mujoco>")
    errors = Errors()
    engine = MujocoEngine(load_scene(str(tmp_path / "m.xml"), visuals=False), errors=errors)
    for k in range(1, 31):
        engine.advance(k * 33_000_000, np.array([[(-1.0) ** k]]))
    assert told(errors).position < 1e-3 * 0.99 / 2


def test_the_first_environment_stands_for_all(tmp_path):
    """Other environments, and a reset of another one, change nothing of what is told."""
    found = []
    for envs in (1, 3):
        errors = Errors()
        (tmp_path / "m.xml").write_text(f"<mujoco><worldbody>{PENDULUM}</worldbody></mujoco>")
        engine = MujocoEngine(load_scene(str(tmp_path / "m.xml"), visuals=False), 0, envs, errors=errors)
        for k in range(1, 31):
            if envs > 1 and k == 10:
                engine.leave(2)
                engine.anew([2], [None], [1]).advance(10**9)
            engine.advance(round(k * 1e9 / 30))
        found.append(told(errors))
    assert found[0] == found[1]


def test_a_run_tells_it(tmp_path):
    """In its summary, on its topic, and with a warning, unless it cannot be seen."""
    (tmp_path / "m.xml").write_text(f"<mujoco><worldbody>{ROCK}</worldbody></mujoco>")
    for seconds, warned in ((1.0, True), (0.1, False)):
        node = PhysicsNode("physics", {"scene": str(tmp_path / "m.xml"), "duration": seconds, "keyframe_rate": 10.0})
        results = {}

        class Telling(Wire):
            def result(self, node, name, value, results=results):
                results[name] = value

        node.runtime = Telling()
        node.setup()
        while node.step({}):
            pass
        node.finish()
        error = results["physics_error"]
        assert error == {"body": "rock", "position_m": pytest.approx(9.81e-3 * seconds / 2), "rotation_rad": 0.0}
        assert node.runtime.messages[-1].scalars() == error
        assert bool(node.runtime.warnings) == warned and all("'rock'" in text for text in node.runtime.warnings)


def test_many_bodies_are_looked_at_from_time_to_time(tmp_path):
    """60 rocks in free fall: what a keyframe in twenty shows, added up, is g dt t / 2 to the length of a window."""
    rocks = "".join(ROCK.replace("rock", f"rock{n}").replace("0 0 50", f"{n} 0 50") for n in range(60))
    errors = Errors()
    engine, _ = course(tmp_path, rocks, 4.0, errors=errors)
    assert engine.model.nv == 360
    assert told(errors).position == pytest.approx(9.81e-3 * 4.0 / 2, rel=0.05)


def test_what_discrete_erases_is_named(tmp_path):
    """omega dt = 1.5 is erased, 0.1 is not, nor by Euler."""
    for integrator, omega, erased in (("discrete", 1500.0, 1), ("discrete", 100.0, 0), ("Euler", 1500.0, 0)):
        errors = Errors()
        course(tmp_path, SPRING.format(omega**2), 0.1, integrator, errors=errors)
        assert len(errors.erased) == erased and all("spring of joint" in what for what in errors.erased)


def test_what_is_prescribed_has_no_error():
    node = PhysicsNode("physics", {"scene": "spinning_disk", "duration": 0.1})
    node.runtime = Wire()
    node.setup()
    node.finish()
    assert not node.runtime.messages
