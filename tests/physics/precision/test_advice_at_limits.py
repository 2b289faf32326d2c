"""Joints at hard limits, welds and speeds beyond the limit: what is said of them names them, and helps."""

import re
from pathlib import Path

import numpy as np
import pytest
from engine_arguments import grouped

from evis import Diverged, Simulation
from evis.scene import load_scene
from nodes.physics.engines.mujoco_engine import MujocoEngine
from nodes.physics.precision.stepping import Stepping
from nodes.physics.precision.tolerance import Tolerance

G = 9.81
RAIL = "<body name='mass'><joint name='rail' type='slide' axis='0 0 1' {}/><geom size='.1' mass='1'/></body>"
CORD = "<tendon><fixed name='cord' limited='true' range='-1 1' solreflimit='-1e7 -10'><joint joint='rail' coef='1'/>"
HARD = {
    "the limit of joint 'rail'": (RAIL.format("limited='true' range='-1 1' solreflimit='-1e7 -10'"), ""),
    "the limit of tendon 'cord'": (RAIL.format(""), f"{CORD}</fixed></tendon>"),
    "equality 'glue'": (
        "<body name='mass'><freejoint/><geom size='.1' mass='1'/></body>",
        "<equality><weld name='glue' body1='mass' solref='-1e7 -7e3'/></equality>",
    ),
}


def model(folder: Path, world: str, rest: str = "", integrator: str = "Euler", dt: float = 1e-3, g: float = G) -> str:
    option = f"<option timestep='{dt}' integrator='{integrator}' gravity='0 0 {-g}'/>"
    (folder / "m.xml").write_text(f"<mujoco>{option}<worldbody>{world}</worldbody>{rest}</mujoco>")
    return str(folder / "m.xml")


@pytest.mark.parametrize("source", HARD)
def test_a_hard_limit_is_foretold_and_the_tolerance_follows_it(tmp_path, source):
    """omega dt = 3.16. A fall of 1 m onto a limit that gives back e^(-pi c / 2 omega) of the speed comes up again to
    the square of that; a weld stays where it is."""
    scene = load_scene(model(tmp_path, *HARD[source]), visuals=False)
    (foretold,) = (text for _, text in MujocoEngine(scene)._warnings)
    assert f"the direct solref of {source} has omega*dt" in foretold and "physics_tolerance" in foretold

    exact = MujocoEngine(scene, stepping=Stepping(tolerance=Tolerance(1e-3, 1e-3)))
    assert exact._warnings == []
    fall, contact = np.sqrt(2 / G), np.pi / np.sqrt(1e7)
    kept = np.exp(-10 * contact / 2)
    top = fall * (1 + kept) + contact
    found = exact.advance(round(top * 1e9))
    assert found.faults == []
    height = found.end_pose[0, 0, 2]
    assert height == pytest.approx(0.0 if "glue" in source else kept**2 - 1, abs=2e-3)


def test_what_falls_for_long_may_be_faster_than_the_limit(tmp_path):
    """After 102 s of free fall 1000 m/s are passed; what is said is done, and the fall is g t^2 / 2, which is off by
    g dt t / 2 with Euler."""
    world = "<body name='stone'><freejoint/><geom size='.1' mass='1'/></body>"
    fall = model(tmp_path, world, g=100.0)
    with Simulation(fall, outputs=["state"], keyframe_rate=1) as sim, pytest.raises(Diverged) as caught:
        sim.run(12)
    assert "speed_limit:=N" in str(caught.value) and "a long fall" in str(caught.value)
    with Simulation(fall, outputs=["state"], keyframe_rate=1, speed_limit=1e5) as sim:
        step = sim.run(12)[-1]
    assert step.state.end_pose[0, 0, 2] == pytest.approx(-50 * 12 * 12.001, rel=1e-9)


def test_a_tolerance_is_not_advised_to_who_has_one(tmp_path):
    """A spring of 31.6 rad a step, which the tolerance follows, swings at 3162 m/s: that is what is said, and not
    that RK4 cannot follow it."""
    scene = load_scene(model(tmp_path, RAIL.format("stiffness='1e9' springref='.1'"), g=0.0), visuals=False)
    ((_, text),) = MujocoEngine(scene, stepping=Stepping(tolerance=Tolerance(1e-3, 1e-3))).advance(10_000_000).faults
    assert "physics_tolerance" not in text and "omega*dt" not in text and "speed_limit:=N" in text


def test_the_step_that_is_said_is_never_that_which_is_too_long(tmp_path):
    """k a hair beyond 4 / dt^2: rounded to nearest it was stable "below 2" at 2, below 1 ms at 1 ms."""
    scene = load_scene(model(tmp_path, RAIL.format("stiffness='4.01e6'"), g=0.0), visuals=False)
    ((_, text),) = MujocoEngine(scene)._warnings
    assert "omega*dt = 2.0025 and Euler is stable below 2;" in text and "timestep below 0.00099 s" in text


@pytest.mark.parametrize("omega, warned", [(900.0, False), (2000.0, True), (31623.0, True)])
def test_what_swings_within_a_step_is_told_and_shorter_steps_show_it(tmp_path, omega, warned):
    """A tolerance is kept at the steps; a keyframe between two of them is off by more the faster a spring swings."""
    scene = load_scene(model(tmp_path, RAIL.format(f"stiffness='{omega**2}' springref='.01'"), g=0.0), visuals=False)

    def off(**given) -> tuple[float, list[str]]:
        engine = MujocoEngine(scene, **grouped(tolerance=Tolerance(1e-4, 1e-4), **given))
        said = [text for _, text in engine._warnings]
        t = np.array([round(k * 333_333.3) for k in range(1, 31)])
        z = np.array([engine.advance(stamp).end_pose[0, 0, 2] for stamp in t])
        return np.abs(z - 0.01 * (1 - np.cos(omega * t * 1e-9))).max(), said

    worst, said = off()
    assert len(said) == warned and (worst > 1e-4) == warned
    if warned:
        assert "the spring of joint 'rail' swings by" in said[0]
        share, step = (float(re.search(pattern, said[0])[1]) for pattern in (r"up to (\S+) of", r"timestep:=(\S+) "))
        assert 0.2 * share < worst / 0.01 < 1.05 * share
        worst, said = off(timestep=step)
        assert said == [] and worst < 1e-4
