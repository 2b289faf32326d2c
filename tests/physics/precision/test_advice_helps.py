"""What a user is told to do is done, on the case that it was told of: it must help, and simulate the same."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from engine_arguments import grouped

from evis.scene import load_scene
from nodes.physics.engines.mujoco_engine import MujocoEngine
from nodes.physics.precision.tolerance import Tolerance

MS = 1_000_000
A = 0.01
MASS = "<body name='mass'><joint name='rail' type='slide' axis='1 0 0' {}/><geom size='.1' mass='1'/></body>"
STRONG = 1e7
CASES = {
    "spring": (MASS.format(f"stiffness='{STRONG}'"), ""),
    "damper": (MASS.format("damping='1e4'"), ""),
    "tendon spring": (
        MASS.format(""),
        f"<tendon><fixed name='cord' stiffness='{STRONG}' springlength='0'><joint joint='rail' coef='1'/></fixed>"
        "</tendon>",
    ),
    "tendon servo": (
        MASS.format(""),
        "<tendon><fixed name='cord'><joint joint='rail' coef='1'/></fixed></tendon>"
        f"<actuator><position tendon='cord' kp='{STRONG}'/></actuator>",
    ),
}


def engine_of(folder: Path, world: str, rest: str = "", integrator: str = "Euler", dt: float = 1e-3, **given):
    option = f"<option timestep='{dt}' integrator='{integrator}' gravity='0 0 0'/>"
    (folder / "m.xml").write_text(f"<mujoco>{option}<worldbody>{world}</worldbody>{rest}</mujoco>")
    return MujocoEngine(load_scene(str(folder / "m.xml"), visuals=False), **grouped(**given))


def run(engine: MujocoEngine, seconds: float, qpos: float = 0.0, qvel: float = 0.0, parts: int = 100):
    """Times [s], positions of the first joint, and everything that was said."""
    (data,) = engine.data
    data.qpos[0] += qpos
    data.qvel[0] += qvel
    mujoco.mj_forward(engine.model, data)
    engine._begin_course()
    said, found = [text for _, text in engine._warnings], []
    for k in range(1, parts + 1):
        interval = engine.advance(round(seconds * 1e9 * k / parts))
        said += [text for _, text in (*interval.warnings, *interval.faults)]
        found.append(data.qpos[0])
        if interval.faults:
            break
    return np.arange(1, len(found) + 1) * seconds / parts, np.array(found), list(dict.fromkeys(said))


def told(text: str, pattern: str) -> float:
    match = re.search(pattern, text)
    assert match is not None, text
    return float(match[1])


@pytest.mark.parametrize(
    "case, integrator",
    [(c, i) for c in CASES for i in ("Euler", "implicit", "RK4") if c != "damper" or i == "RK4"],
)
def test_a_stiff_thing_is_foretold_and_every_remedy_helps(tmp_path, case, integrator):
    """The tolerance follows x(t) in closed form; a shorter step and `discrete` stay below the start."""
    world, rest = CASES[case]
    _, _, said = run(engine_of(tmp_path, world, rest, integrator), 0.3, A, 1.0 if case == "damper" else 0.0)
    what = "damping of joint 'rail'" if case == "damper" else {"spring": "spring of joint 'rail'"}.get(case, case[7:])
    assert what in said[0] and ("cord" in said[0]) == ("tendon" in case)
    assert len(said) == 2 and "diverged" in said[1] and what in said[1]
    for text in said:
        assert "physics_tolerance:=0.001,0.001, which follows it" in text
        assert ("erases its oscillation" in text) == (case != "damper")
        dt = told(text, r"timestep below ([\d.e+-]+) s")
        for engine in (engine_of(tmp_path, world, rest, integrator, 0.95 * dt),
                       engine_of(tmp_path, world, rest, "discrete")):  # fmt: skip
            _, x, after = run(engine, 0.3, A)
            assert after == [] and np.abs(x).max() < 10 * A
    exact = engine_of(tmp_path, world, rest, integrator, tolerance=Tolerance(1e-3, 1e-3))
    t, x, after = run(exact, 0.05, A, parts=50)
    closed = A * np.cos(np.sqrt(STRONG) * t) if case != "damper" else np.full(len(t), A)
    # At the steps, which these keyframes are at; that there are 3.16 rad between them is told.
    assert len(after) == (case != "damper") and all("between steps" in text for text in after)
    assert np.abs(x - closed).max() < 1e-3


def test_a_tendon_of_another_gear_is_foretold_at_its_limit(tmp_path):
    """Twice the joint's way: four times the stiffness, so that omega dt = 2 at 2.5e5 N/m."""
    for share in (0.98, 1.02):
        rest = (
            f"<tendon><fixed name='cord' stiffness='{share * 2.5e5 * 4}' springlength='0'>"
            "<joint joint='rail' coef='2'/></fixed></tendon>"
        )
        _, x, said = run(engine_of(tmp_path, MASS.format(""), rest), 1.0, A)
        assert np.abs(x).max() < 1 and ["diverged" in text for text in said] == ([False, True] if share > 1 else [])


SPINNER = """<body name='top'><freejoint/><inertial pos='0 0 0' mass='.3' diaginertia='.001 .002 .003'/>
<geom type='box' size='.1 .15 .01'/></body>"""


def spun(folder: Path, **given):
    """Everything that is said of 0.2 s at 900 rad/s about the intermediate axis, and the energy at the end over that
    at the start."""
    engine = engine_of(folder, SPINNER, **given)
    (data,), inertia = engine.data, np.array([1.0, 2.0, 3.0])
    data.qvel[3:] = (3.0, 900.0, 1.0)
    first = inertia @ data.qvel[3:] ** 2
    _, _, said = run(engine, 0.2)
    return said, (inertia @ data.qvel[3:] ** 2) / first


def test_what_an_environment_is_told_after_a_reset_is_of_itself(tmp_path):
    """The second of three begins anew and is spun up: how fast it turned is its own speed, in no others' place."""
    engine = engine_of(tmp_path, SPINNER, envs=3)
    engine.advance(10_000_000)
    engine.leave(1)
    anew = engine.anew([1], [None], [1])
    anew.data[0].qvel[3:] = (3.0, 700.0, 1.0)
    anew.advance(1_000_000)
    anew.data[0].qvel[3:] = (1e12, 700.0, 1.0)
    (fault,) = anew.advance(3_000_000).faults
    assert "it turned 0.7 rad in one step" in fault[1]


def test_a_top_that_is_too_fast_is_told_what_helps(tmp_path):
    """0.9 rad a step diverges; the tolerance keeps its energy to 1e-4, the step that is said keeps it bounded."""
    said, _ = spun(tmp_path)
    assert "diverged" in said[-1] and "it turned 0.9 rad in one step" in said[-1]
    said, energy = spun(tmp_path, dt=0.99 * told(said[-1], r"timestep below ([\d.e+-]+) s"))
    assert said == [] and 0.5 < energy < 2
    said, energy = spun(tmp_path, tolerance=Tolerance(1e-3, 1e-3))
    assert said == [] and energy == pytest.approx(1, abs=1e-4)


def firm(text: str) -> str:
    """The attributes of a geom that are advised."""
    match = re.search(r'solref="[^"]+" solimp="[^"]+"', text)
    assert match is not None, text
    return match[0].replace('"', "'")


def test_a_contact_that_is_too_hard_is_told_what_helps(tmp_path):
    """omega dt = 3.16: a ball let fall by 0.1 m flies up 3.8. With damping c it comes back to e^(-pi c / omega) of
    that, which the tolerance gives, and nearly the step that is said; `discrete` erases the bounce."""
    hard = "solref='-1e7 -10'"
    world = f"""<geom name='ground' type='plane' size='5 5 1' {hard}/>
    <body name='ball' pos='0 0 .2'><freejoint/><geom name='ball' size='.1' mass='1' {hard}/></body>"""

    def highest(**given) -> tuple[float, list[str]]:
        engine = engine_of(tmp_path, world, **given)
        engine.model.opt.gravity[2] = -9.81
        said = [text for _, text in engine._warnings]
        course = [engine.advance(10 * k * MS).end_pose[0, 0, 2] for k in range(1, 46)]
        return max(course[20:]) - 0.1, said

    # The first 0.2 s are fall and contact, the next 0.25 s hold the top of the first bounce.
    high, said = highest()
    assert high > 0.5 and len(said) == 1 and said[0].startswith("the direct solref of geom 'ground' ")
    assert "(and 1 more like it: the direct solref of geom 'ball')" in said[0]
    assert "physics_tolerance:=0.001,0.001, which follows it" in said[0] and "erases its bounce" in said[0]
    high, said = highest(tolerance=Tolerance(1e-3, 1e-3))
    assert said == [] and high == pytest.approx(0.1 * np.exp(-np.pi * 10 / np.sqrt(1e7)), abs=1e-3)
    high, said = highest(dt=0.95 * told(highest()[1][0], r"timestep below ([\d.e+-]+) s"))
    assert said == [] and high == pytest.approx(0.1, abs=2e-3)
    high, said = highest(integrator="discrete")
    assert said == [] and high < 0.1


WALL = "<geom name='wall' type='box' pos='1 0 0' size='.005 1 1' {0}/>"
BULLET = "<body name='bullet'><freejoint/><geom name='ball' size='.01' mass='.01' {0}/></body>"


@pytest.mark.parametrize("dt", [1e-3, 5e-5])
def test_a_bullet_stops_at_the_wall_if_one_does_what_is_said(tmp_path, dt):
    """It leaps over the wall, or sinks through a soft one; with what is said it comes back."""
    _, x, said = run(engine_of(tmp_path, WALL.format("") + BULLET.format(""), dt=dt), 0.02, qvel=100.0)
    assert x[-1] > 1.1 and len(said) == 1
    solref = firm(said[0])
    world = WALL.format(solref) + BULLET.format(solref)
    dt = 0.99 * told(said[0], r"timestep below ([\d.e+-]+) s")
    _, x, said = run(engine_of(tmp_path, world, dt=dt), 0.02, qvel=100.0)
    assert x.max() < 1 and x[-1] < 0.99 and said == []


POST = "<geom name='post' type='cylinder' pos='.4 0 0' size='.01 .5' {0}/>"
BAT = """<body name='bat'><joint axis='0 0 1'/><inertial pos='.25 0 0' mass='1' diaginertia='.01 .02 .02'/>
<geom type='capsule' fromto='.05 0 0 .5 0 0' size='.02' {0}/></body>"""


def test_a_bat_that_turns_through_a_post_is_said_to(tmp_path):
    """1000 rad/s: its origin stands still, its tip goes half a metre a step. Slow enough nothing is said."""
    engine = engine_of(tmp_path, POST.format("") + BAT.format(""))
    _, _, said = run(engine, 0.02, -0.5, 1000.0)
    assert len(said) == 1 and said[0].startswith("the farthest point of body 'bat' goes 0.5 m in one step")
    assert "geom 'post'" in said[0]
    solref = firm(said[0])
    dt = 0.99 * told(said[0], r"timestep below ([\d.e+-]+) s")
    _, angle, said = run(engine_of(tmp_path, POST.format(solref) + BAT.format(solref), dt=dt), 0.004, -0.5, 1000.0)
    assert angle.max() < 0 and said == []
    assert run(engine_of(tmp_path, BAT.format("")), 0.02, -0.5, 10.0)[2] == []


@pytest.mark.parametrize("shape", ["sphere' size='.2", "cylinder' size='.2 .02", "capsule' size='.02 .2"])
def test_what_turns_about_its_own_axis_passes_through_nothing(tmp_path, shape):
    """A ball, a wheel, a shaft at 300 rad/s; a wheel that tumbles does."""
    post = "<geom type='box' pos='5 0 0' size='.01 .5 .5'/>"
    for axis, passes in (("0 0 1", False), ("1 0 0", "sphere" not in shape)):
        world = f"{post}<body><joint axis='{axis}'/><geom type='{shape}' mass='1'/></body>"
        assert bool(run(engine_of(tmp_path, world), 0.01, qvel=300.0)[2]) == passes


def test_a_light_box_is_not_pressed_into_the_ground_if_one_does_what_is_said(tmp_path):
    """11 tons on a kilogram: MuJoCo's own contacts give way by half of its height, those that are said do not."""

    def world(solref: str) -> str:
        boxes = "".join(
            f"<body pos='0 0 {0.1 + 0.2 * n}'><freejoint/>"
            f"<geom name='b{n}' type='box' size='.1 .1 .1' mass='{m}' {solref}/></body>"
            for n, m in enumerate((1, 1e3, 1e4))
        )
        return f"<geom name='ground' type='plane' size='9 9 1' {solref}/>{boxes}"

    def fallen(solref: str, dt: float) -> tuple[float, list[str]]:
        engine = engine_of(tmp_path, world(solref), dt=dt)
        engine.model.opt.gravity[2] = -9.81
        _, _, said = run(engine, 1.0, parts=20)
        return float(engine.data[0].qpos[2]), said

    low, said = fallen("", 1e-3)
    assert low < 0.05 and len(said) == 1
    assert "timestep" not in said[0]  # the step is short enough for that
    low, said = fallen(firm(said[0]), 1e-3)
    assert low > 0.05 and said == []


@pytest.mark.parametrize("tolerant", [False, True])
def test_what_is_alike_is_one_line_with_the_remedy_for_all(tmp_path, tolerant):
    """A comb of 40 teeth printed 40 lines. The stiffest tooth, number 7, has omega = sqrt(2.25e6 / 1) = 1500 / s, and
    Euler is stable up to 2 / omega = 1.33 ms; with a tolerance, poses once in 2 ms are to show swings of 3 rad."""
    tooth = (
        "<body pos='0 {0} 0'><joint name='tooth{0}' type='slide' axis='1 0 0' {1}/><geom size='.1' mass='1'/></body>"
    )
    strengths = [2.25e6 if i == 7 else 2e6 for i in range(40)]
    comb = "".join(tooth.format(i, f"stiffness='{k}'") for i, k in enumerate(strengths))
    fan = tooth.format(50, "damping='1e4'")
    given = {"tolerance": Tolerance(0.001, 0.001)} if tolerant else {}
    engine = engine_of(tmp_path, comb + fan, integrator="implicitfast", dt=0.002, timestep=0.002, **given)
    (line,) = (text for _, text in engine._warnings)
    assert line.startswith("the spring of joint 'tooth7' ")
    names = ", ".join(f"the spring of joint 'tooth{i}'" for i in range(3))
    assert f" (and 39 more like it: {names}, ...); " in line
    if tolerant:
        assert "swings by 3 rad in a step of 0.002 s" in line and told(line, r"timestep:=(\S+) shows") * 1500 <= 0.5
    else:
        assert 1e-3 < told(line, r"timestep below (\S+) s") <= 2 / 1500
