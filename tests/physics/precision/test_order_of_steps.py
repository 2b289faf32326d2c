"""What a run tells of its physics where RK4 is of order 1: actuators whose force is no smooth equation within a step.

Against the closed forms of a mass of 1 kg on a slide that an actuator pushes with up to 1 N from t = 0 on."""

from collections.abc import Callable

import mujoco
import numpy as np
import pytest
from engine_arguments import grouped

from evis.scene import load_scene
from nodes.physics.engines.mujoco_engine import MujocoEngine
from nodes.physics.precision.errors import Errors
from nodes.physics.precision.order import order_of
from nodes.physics.precision.tolerance import Tolerance

TAU = 0.1
"""Time constant of an activation [s], and of a DC motor's current."""


def filtered(t: np.ndarray) -> np.ndarray:
    """The way [m] under a force 1 - exp(-t / TAU)."""
    return 0.5 * t**2 - TAU * t + TAU**2 * (1 - np.exp(-t / TAU))


def late(t: np.ndarray) -> np.ndarray:
    """The way [m] under a force that is 1 from 50 ms on."""
    return 0.5 * np.maximum(t - 0.05, 0.0) ** 2


Way = Callable[[np.ndarray], np.ndarray]
ACTUATORS: dict[str, tuple[str, Way]] = {
    "filterexact": (f"<general joint='s' dyntype='filterexact' dynprm='{TAU}' gainprm='1'/>", filtered),
    "early": (f"<general joint='s' dyntype='filter' dynprm='{TAU}' gainprm='1' actearly='true'/>", filtered),
    "delay": ("<motor joint='s' delay='.05' nsample='50'/>", late),
}
SMOOTH = f"<general joint='s' dyntype='filter' dynprm='{TAU}' gainprm='1'/>"


def engine_of(folder, actuator: str, **given) -> MujocoEngine:
    (folder / "m.xml").write_text(
        "<mujoco><option timestep='.001' integrator='RK4' gravity='0 0 0'/><worldbody><body name='mass'>"
        "<joint name='s' type='slide' axis='1 0 0'/><geom size='.1' mass='1'/></body></worldbody>"
        f"<actuator>{actuator}</actuator></mujoco>"
    )
    return MujocoEngine(load_scene(str(folder / "m.xml"), visuals=False), **grouped(**given))


def largest_error(engine: MujocoEngine, way: Way, seconds: int = 2) -> float:
    """How far the mass was off at keyframes of 30 Hz, under a control of 1."""
    t = np.array([round(k * 1e9 / 30) for k in range(1, 30 * seconds + 1)])
    x = np.array([engine.advance(int(stamp), np.ones((1, 1))).end_pose[0, 0, 0] for stamp in t])
    return float(np.abs(x - way(t * 1e-9)).max())


@pytest.mark.parametrize("name", ACTUATORS)
def test_the_error_that_an_actuator_makes_of_rk4_is_told(tmp_path, name):
    """Counted as of order 4 it was told as an 80th of what it is."""
    actuator, way = ACTUATORS[name]
    errors = Errors()
    true = largest_error(engine_of(tmp_path, actuator, errors=errors), way)
    worst = errors.worst()
    assert true > 1e-4 and worst is not None
    assert worst.position == pytest.approx(true, rel=0.1)


@pytest.mark.parametrize("name", ["filterexact", "early"])
def test_with_a_tolerance_actuators_leave_rk4_its_order(tmp_path, name):
    """At order 1 the error was 0.45 mm with a tolerance of 0.1 mm a second, for activations are not compared."""
    actuator, way = ACTUATORS[name]
    engine = engine_of(tmp_path, actuator, tolerance=Tolerance(1e-4, 1e-4))
    assert largest_error(engine, way) < 1e-9
    assert engine.missed() == 0


@pytest.mark.parametrize("tau", [3e-4, 1e-4])
def test_a_tolerance_takes_steps_in_which_no_activation_grows(tmp_path, tau):
    """Once the activation had come to its rest, nothing in the poses told that a whole step makes it grow: the run
    diverged, or was told 0.36 m of error that it did not have."""
    errors = Errors()
    actuator = f"<general joint='s' dyntype='filter' dynprm='{tau}' gainprm='1'/>"
    engine = engine_of(tmp_path, actuator, errors=errors, tolerance=Tolerance(1e-4, 1e-4))
    assert largest_error(engine, lambda t: 0.5 * t**2 - tau * t + tau**2 * (1 - np.exp(-t / tau)), 1) < 1e-9
    worst = errors.worst()
    assert worst is not None and worst.position < 1e-9


def test_other_actuators_leave_rk4_its_order(tmp_path):
    """The position servo without time constant is a spring and a damper; a filter's equation is smooth."""
    servo = "<position joint='s' kp='50' kv='2'/>"
    of = {text: order_of(engine_of(tmp_path, text).model) for text in (SMOOTH, servo)}
    assert of == {SMOOTH: 4, servo: 4}
    assert largest_error(engine_of(tmp_path, SMOOTH), filtered) < 1e-9


@pytest.mark.parametrize(
    "actuator",
    [
        f"<position joint='s' kp='50' kv='2' timeconst='{TAU}'/>",
        f"<dcmotor joint='s' motorconst='.05 .05' resistance='1' inductance='{TAU}'/>",
    ],
)
def test_the_order_is_that_at_which_halved_steps_agree(tmp_path, actuator):
    """Of each step half as long the error is half as large, and not a sixteenth."""
    ends = []
    for timestep in (1e-3, 5e-4, 2.5e-4):
        engine = engine_of(tmp_path, actuator, timestep=timestep)
        ends.append(engine.advance(500_000_000, np.full((1, 1), 0.7)).end_pose[0, 0, 0])
    measured = np.log2(abs(ends[0] - ends[1]) / abs(ends[1] - ends[2]))
    assert measured == pytest.approx(order_of(engine.model), abs=0.3)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4", "discrete"])
@pytest.mark.parametrize("dynamics", ["filter", "filterexact"])
@pytest.mark.parametrize("times", [0.97, 1.03])
def test_an_activation_that_grows_is_told_before_the_start(tmp_path, integrator, dynamics, times):
    """Euler's factor in a step h is 1 - h / tau, that of RK4 the exponential's first five terms: |factor| = 1 at 2 and
    2.785. A `filterexact` grows with RK4 alone."""
    limit = 2.785 if integrator == "RK4" else 2.0
    (tmp_path / "m.xml").write_text(
        f"<mujoco><option timestep='.001' integrator='{integrator}' gravity='0 0 0'/><worldbody><body name='mass'>"
        "<joint name='s' type='slide' axis='1 0 0'/><geom size='.1' mass='1'/></body></worldbody><actuator>"
        f"<general name='push' joint='s' dyntype='{dynamics}' dynprm='{1e-3 / limit / times}'/></actuator></mujoco>"
    )
    engine = MujocoEngine(load_scene(str(tmp_path / "m.xml"), visuals=False))
    told = engine.start().warnings
    model, data = engine.model, mujoco.MjData(engine.model)
    data.ctrl[:] = 1
    mujoco.mj_step(model, data, 400)
    grows = bool(abs(data.act[0] - 1) > 1)
    assert grows == (times > 1 and (dynamics == "filter" or integrator == "RK4"))
    assert any("the activation of actuator 'push'" in text for _, text in told) == grows
    for _, text in told:
        assert "physics_tolerance" in text and "filterexact" in text
