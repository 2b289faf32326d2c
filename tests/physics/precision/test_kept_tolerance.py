"""Sub-steps by step doubling: the tolerance is kept, whatever the model's integrator, and nobody else matters."""

import numpy as np
import pytest
from engine_arguments import grouped
from known_courses import PENDULUM, RACKET, ROCK, SPRING, apart, chain, course, told

from evis.scene import load_scene
from nodes.physics.engines.mujoco_engine import MujocoEngine
from nodes.physics.node import PhysicsNode
from nodes.physics.precision.errors import Errors
from nodes.physics.precision.stepping import Stepping
from nodes.physics.precision.tolerance import Tolerance

HARD = "solref='-1e4 -2'"
BALL = f"""<geom type='plane' size='5 5 1' {HARD}/>
<body name='ball' pos='0 0 .6'><freejoint/><geom size='.1' mass='1' {HARD}/></body>"""


@pytest.mark.parametrize("integrator", ["Euler", "discrete"])
@pytest.mark.parametrize(
    "world, seconds, spin",
    [
        (RACKET, 1.0, ".01 10 .01"),
        (PENDULUM, 2.0, ""),
        (chain(12), 1.0, ""),
        (SPRING.format(1500.0**2), 0.3, ""),
        (BALL, 1.0, ""),
    ],
    ids=["racket", "pendulum", "chain", "spring", "ball"],
)
def test_the_tolerance_is_kept(tmp_path, world, seconds, spin, integrator):
    """Against RK4 at 20 us: also of a spring that Euler hardly follows and `discrete` erases; what is told says so."""
    allowed, errors = (1e-3, 1e-3), Errors()
    _, made = course(tmp_path, world, seconds, integrator, spin, errors=errors, tolerance=Tolerance(*allowed))
    _, exact = course(tmp_path, world, seconds, "RK4", spin, timestep=2e-5)
    for off, most, said in zip(apart(made, exact), allowed, (told(errors).position, told(errors).rotation)):
        assert off.max() < most * seconds and said < most * seconds


def test_a_closer_tolerance_is_kept_too(tmp_path):
    """Free fall without any error of RK4's, the ball to 1e-6 m: more parts, and no other course."""
    errors = Errors()
    engine, made = course(tmp_path, ROCK, 2.0, tolerance=Tolerance(1e-9, 1e-9), errors=errors)
    t = np.arange(1, 61) / 30
    np.testing.assert_allclose(made[:, 0, 2], 50 - 9.81 * t**2 / 2, atol=1e-8)
    assert engine.missed() == 0
    parts = []
    for most in (1e-3, 1e-6):
        engine, _ = course(tmp_path, chain(6), 0.5, tolerance=Tolerance(most, most))
        parts.append(sum(engine._sub_steps[0].taken))
    assert parts[1] > parts[0]


@pytest.mark.parametrize("steps", [{"tolerance": Tolerance(0.01, 0.01)}, {"timestep": 5e-6}], ids=["parts", "short"])
def test_what_is_let_go_does_not_sleep_in_the_air(tmp_path, steps):
    """Of a model that may sleep, beside a box whose contact takes many parts: z = -g t^2 / 2."""
    sleep, ball = "<option><flag sleep='enable'/></option>", "<body><freejoint/><geom size='.1' mass='1'/></body>"
    box = "<body pos='2 0 -1.9'><freejoint/><geom type='box' size='.1 .1 .1' mass='1'/></body>"
    ground = "<geom type='plane' size='5 5 1' pos='0 0 -2'/>"
    (tmp_path / "m.xml").write_text(f"<mujoco>{sleep}<worldbody>{ball}{box}{ground}</worldbody></mujoco>")
    engine = MujocoEngine(load_scene(str(tmp_path / "m.xml"), visuals=False), **grouped(**steps))
    for t in (0.01, 0.02, 0.03):
        found = engine.advance(round(t * 1e9)).end_pose[0, 0, 2]
    assert found == pytest.approx(-0.5 * 9.81 * t**2, rel=3e-2)


def engine_of(envs: int) -> MujocoEngine:
    return MujocoEngine(
        load_scene("falling_objects", visuals=False), 3, envs, stepping=Stepping(tolerance=Tolerance(1e-2, 1e-1))
    )


def test_other_environments_change_nothing(monkeypatch):
    """Environment 1 of three is that of one run with seed + 1, also where every state is looked at."""
    stamps = [33_333_333 * (k + 1) for k in range(6)]
    three, one_by_one = engine_of(3), engine_of(3)
    one = MujocoEngine(
        load_scene("falling_objects", visuals=False), 4, 1, stepping=Stepping(tolerance=Tolerance(1e-2, 1e-1))
    )
    monkeypatch.setattr(one_by_one._steps, "_take_recorded", lambda course, watch, envs, *_: envs.tolist())
    for stamp in stamps:
        all_of, again, alone = three.advance(stamp), one_by_one.advance(stamp), one.advance(stamp)
        assert all_of.pose.tobytes() == again.pose.tobytes()
        assert all_of.pose[1].tobytes() == alone.pose[0].tobytes()


def test_wrong_tolerances_say_what_is_right():
    assert Tolerance.of([]) is None and Tolerance.of(["1e-3"]) == Tolerance(1e-3, 1e-3)
    for wrong in (["a"], ["0"], ["1e-3", "-1"], ["1", "2", "3"], ["nan"], ["inf", "1"]):
        with pytest.raises(ValueError, match="metres and radians above 0, as"):
            Tolerance.of(wrong)


def test_what_is_prescribed_needs_none():
    needless = PhysicsNode.without_effect({"scene": "spinning_disk"}).keys()
    assert needless == {"physics_tolerance", "timestep", "engine", "speed_limit"}
    assert PhysicsNode.without_effect({"scene": "cart_pole"}) == {}
