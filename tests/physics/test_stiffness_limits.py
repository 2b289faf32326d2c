"""Springs, servos and spins, easy to impossible: closed forms, and the limit of every integrator, found and said."""

import mujoco
import numpy as np
import pytest
from engine_arguments import grouped

from evis.geometry import se3
from evis.scene import load_scene
from nodes.physics.engines.mujoco_engine import MujocoEngine
from nodes.physics.stiffness import Mode, modes

MS = 1_000_000
DT = 1e-3
EXPLICIT_IN_POSITION = ["Euler", "implicit", "implicitfast"]


@pytest.fixture
def engine_of(tmp_path):
    def make(world, integrator, rest="", gravity="0 0 0", **given):
        option = f"<option gravity='{gravity}' integrator='{integrator}' timestep='{DT}'/>"
        (tmp_path / "m.xml").write_text(f"<mujoco>{option}<worldbody>{world}</worldbody>{rest}</mujoco>")
        (tmp_path / "s.yaml").write_text("mjcf: m.xml\ncameras: {cam0: {fov: 1, position: [0, 0, 9]}}\n")
        return MujocoEngine(load_scene(str(tmp_path / "s.yaml")), **grouped(**given))

    return make


def run(engine, seconds, controls=None, parts=10):
    """Published times [s], poses and twists of the bodies, and the first fault or None."""
    found = []
    for k in range(1, parts + 1):
        interval = engine.advance(round(seconds * k / parts * 1000) * MS, controls)
        found.append((interval.t * 1e-9, interval.pose[0], interval.twist[0]))
        if interval.faults:
            break
    fault = interval.faults[0][1] if interval.faults else None
    return *(np.concatenate(values) for values in zip(*found, strict=True)), fault


def start(engine, qpos=None, qvel=None):
    (data,) = engine.data
    if qpos is not None:
        data.qpos[:] = qpos
    if qvel is not None:
        data.qvel[:] = qvel
    mujoco.mj_forward(engine.model, data)
    engine._begin_course()


def spring(stiffness, damping):
    """1 kg on a spring along x."""
    joint = f"<joint name='spring' type='slide' axis='1 0 0' stiffness='{stiffness}' damping='{damping}'/>"
    return f"<body name='mass'>{joint}<geom size='.1' mass='1'/></body>"


def limit(integrator, zeta):
    """omega dt up to which an oscillator does not grow, by hand.

    Velocity first, damping at the end of the step: s^2 < 4 + 4 zeta s. RK4: where |R(i s)| = 1, s = 2 sqrt 2, without
    damping, and with critical damping where |R(-s)| = 1, s = 2.785.
    """
    if integrator == "RK4":
        return {0: 2 * np.sqrt(2), 1: 2.785}[zeta]
    return 2 * zeta + 2 * np.sqrt(zeta**2 + 1)


@pytest.mark.parametrize("integrator, zeta", [*((i, z) for i in EXPLICIT_IN_POSITION for z in (0, 0.1, 1)),
                                              ("RK4", 0), ("RK4", 1)])  # fmt: skip
def test_the_limit_of_an_oscillator_is_found_where_it_is(engine_of, integrator, zeta):
    """P4: a hundredth below nothing is said and nothing happens; a hundredth above it is foretold, with the limit, and
    it diverges."""
    bound = limit(integrator, zeta)
    for share in (0.99, 1.01):
        omega = share * bound / DT
        engine = engine_of(spring(omega**2, 2 * zeta * omega), integrator)
        start(engine, qpos=[1e-3])
        foretold = [text for _, text in engine._warnings]
        _, pose, _, fault = run(engine, 2.0)
        if share < 1:
            assert foretold == [] and fault is None and np.abs(pose[:, 0, 0]).max() < 0.1
            continue
        assert len(foretold) == 1 and "joint 'spring'" in foretold[0] and integrator in foretold[0]
        assert fault is not None and "joint 'spring'" in fault and "timestep below" in fault
        said = float(foretold[0].split("timestep below ")[1].split()[0])
        assert said == pytest.approx(bound / omega, rel=0.05)


def test_heavy_damping_under_rk4_is_foretold(engine_of):
    """A damper of 1e4 /s is nothing to Euler, which takes it at the end of a step; RK4 ends at 2.785/s of it."""
    for integrator in ("Euler", "implicitfast", "discrete", "RK4"):
        engine = engine_of(spring(1.0, 1e4), integrator)
        start(engine, qpos=[0.01])
        foretold = [text for _, text in engine._warnings]
        _, _, _, fault = run(engine, 0.5)
        if integrator != "RK4":
            assert foretold == [] and fault is None
            continue
        assert len(foretold) == 1 and "the damping of joint 'spring' has omega*dt = 10" in foretold[0]
        assert "RK4 is stable below 2.79" in foretold[0]
        assert fault is not None and "likely cause: the damping of joint 'spring'" in fault


@pytest.mark.parametrize("integrator", ["Euler", "implicit", "implicitfast", "RK4", "discrete"])
@pytest.mark.parametrize("kp", [1e3, 1e4, 1e5, 1e6])
def test_a_servo_with_critical_damping(engine_of, integrator, kp):
    """P5: 1 rad is 1 rad after a second. Euler takes an actuator's damping at the start of a step, so that
    4 - 2 c dt - k dt^2 > 0 ends it at omega dt = 0.83: foretold, and blamed, for kp = 1e6."""
    world = """<body name='arm'><joint name='hinge' type='hinge' axis='0 0 1'/>
    <inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/><geom size='.1'/></body>"""
    rest = f"<actuator><position joint='hinge' kp='{kp}' kv='{2 * np.sqrt(kp)}'/></actuator>"
    engine = engine_of(world, integrator, rest)
    foretold = [text for _, text in engine._warnings]
    _, _, _, fault = run(engine, 1.0, np.array([[1.0]]))
    if integrator == "Euler" and kp == 1e6:
        assert len(foretold) == 1 and "the servo of joint 'hinge'" in foretold[0]
        assert fault is not None and "likely cause: the servo of joint 'hinge'" in fault
    else:
        assert foretold == [] and fault is None
        assert engine.data[0].qpos[0] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("zeta", [0, 0.1, 1])
@pytest.mark.parametrize("integrator, off", [("RK4", 2e-9), ("Euler", 8e-3), ("discrete", 6e-2)])
def test_a_spring_is_its_closed_form(engine_of, integrator, off, zeta):
    """P4, 10 rad/s for a second: RK4 to nine digits; `discrete` damps what nothing else does."""
    omega, a = 10.0, 0.01
    engine = engine_of(spring(omega**2, 2 * zeta * omega), integrator)
    start(engine, qpos=[a])
    t, pose, _, fault = run(engine, 1.0)
    if zeta == 1:
        expected = a * (1 + omega * t) * np.exp(-omega * t)
    else:
        damped = omega * np.sqrt(1 - zeta**2)
        expected = a * np.exp(-zeta * omega * t) * (np.cos(damped * t) + zeta * omega / damped * np.sin(damped * t))
    assert fault is None
    assert np.abs(pose[:, 0, 0] - expected).max() < off * a


@pytest.mark.parametrize("stiffness", [1e8, 1e12])
def test_discrete_takes_any_spring(engine_of, stiffness):
    """omega dt = 10 and 1000: it comes to rest where the spring is, and nothing is foretold."""
    engine = engine_of(spring(stiffness, 0), "discrete")
    start(engine, qpos=[0.01])
    _, pose, _, fault = run(engine, 0.2)
    assert engine._warnings == [] and fault is None
    assert np.abs(pose[:, 0, 0]).max() <= 0.01 * (1 + 1e-9)
    assert abs(pose[-1, 0, 0]) < 1e-9


@pytest.mark.parametrize("omega", [(1e-3, 10, 1e-3), (1.0, 2.0, 3.0)])
def test_a_needle_that_tumbles_keeps_energy_and_momentum(engine_of, omega):
    """P3 at 1 : 1000 : 1000, free of forces: RK4 at 1 ms to twelve digits, from the published twists."""
    inertia = np.array([1e-6, 1e-3, 1e-3])
    needle = "<inertial pos='0 0 0' mass='1' diaginertia='1e-6 1e-3 1e-3'/>"
    engine = engine_of(f"<body><freejoint/>{needle}<geom size='.01'/></body>", "RK4")
    start(engine, qvel=[0, 0, 0, *omega])
    _, pose, twist, fault = run(engine, 2.0)
    q = pose[:, 0, 3:]
    local = se3.rotate(se3.conjugate(q), twist[:, 0, 3:])
    energy, momentum = np.sum(inertia * local**2, -1), se3.rotate(q, inertia * local)
    assert fault is None
    np.testing.assert_allclose(energy, energy[0], rtol=1e-12)
    assert np.abs(momentum - momentum[0]).max() < 1e-11 * np.linalg.norm(momentum[0])


def test_a_free_top_turns_as_jacobis_functions_say(engine_of):
    """P3, I = (1, 2, 3)e-3 about the intermediate axis: omega(t) by sn, cn and dn, flips and their period included."""
    from scipy.special import ellipj

    i1, i2, i3 = inertia = np.array([1e-3, 2e-3, 3e-3])
    engine = engine_of(
        "<body><freejoint/><inertial pos='0 0 0' mass='1' diaginertia='.001 .002 .003'/><geom size='.01'/></body>",
        "RK4",
    )
    # At t = 0 omega_2 = 0, so that omega = (a cn, b sn, c dn) of s t, or with cn and dn exchanged; energy decides.
    first = np.array([3.0, 0.0, 2.0])
    start(engine, qvel=[0, 0, 0, *first])
    t, pose, twist, _ = run(engine, 2.0)
    local = se3.rotate(se3.conjugate(pose[:, 0, 3:]), twist[:, 0, 3:])
    double_energy, square = np.sum(inertia * first**2), np.sum((inertia * first) ** 2)
    # Landau and Lifshitz, Mechanics, 37.10, for I1 < I2 < I3 and square > 2 E I2 (else with 1 and 3 exchanged).
    assert square > double_energy * i2
    s = np.sqrt((i3 - i2) * (square - double_energy * i1) / (i1 * i2 * i3))
    m = (i2 - i1) * (double_energy * i3 - square) / ((i3 - i2) * (square - double_energy * i1))
    sn, cn, dn, _ = ellipj(s * t, m)
    amplitude = np.sqrt((double_energy * i3 - square) / (i2 * (i3 - i2)))
    expected = np.stack([first[0] * cn, amplitude * sn, first[2] * dn], -1)
    assert np.abs(local[:, [0, 2]] - expected[:, [0, 2]]).max() < 1e-7
    assert np.abs(np.abs(local[:, 1]) - np.abs(expected[:, 1])).max() < 1e-7


@pytest.mark.parametrize("timestep, said", [(1e-3, "goes 0.1 m in one step"), (5e-5, "overlap by")])
def test_a_bullet_through_a_wall_is_said_to_pass(engine_of, timestep, said):
    """P12, 100 m/s at 1 cm: by leaps, or, in steps short enough, by a contact too soft to stop it."""
    world = """<geom name='wall' type='box' pos='1 0 0' size='.005 1 1'/>
    <body name='bullet'><freejoint/><geom name='ball' size='.01' mass='.01'/></body>"""
    engine = engine_of(world, "Euler", timestep=timestep)
    start(engine, qvel=[100, 0, 0, 0, 0, 0])
    texts = [text for k in range(1, 11) for _, text in engine.advance(2 * k * MS).warnings]
    assert engine.data[0].qpos[0] > 1.1
    assert len(texts) == 1 and said in texts[0] and "geom 'wall' (0.01 m)" in texts[0]


def test_a_bullet_stops_at_a_wall_that_is_hard_enough(engine_of):
    """P12: the same ball, 2 us, a contact of 1e9/s^2 with much damping: it comes back, and nothing is said."""
    hard = "solref='-1e9 -6e4' solimp='.99 .99 .001'"
    world = f"""<geom name='wall' type='box' pos='.05 0 0' size='.005 1 1' {hard}/>
    <body name='bullet'><freejoint/><geom name='ball' size='.01' mass='.01' {hard}/></body>"""
    engine = engine_of(world, "Euler", timestep=2e-6)
    start(engine, qvel=[100, 0, 0, 0, 0, 0])
    texts = [text for k in range(1, 3) for _, text in engine.advance(k * MS).warnings]
    assert engine.data[0].qpos[0] < 0.05 and engine.data[0].qvel[0] < 0 and texts == []


def test_a_light_box_pressed_into_the_ground_is_said(engine_of):
    """P11 with MuJoCo's own soft contacts: 11 tons sink into a box of a kilogram by half of its height."""
    world = "<geom name='ground' type='plane' size='9 9 1'/>" + "".join(
        f"<body pos='0 0 {0.1 + 0.2 * n}'><freejoint/><geom name='box{n}' type='box' size='.1 .1 .1' mass='{m}'/>"
        "</body>"
        for n, m in enumerate((1, 1e3, 1e4))
    )
    engine = engine_of(world, "Euler", gravity="0 0 -9.81")
    texts = [text for k in range(1, 11) for _, text in engine.advance(200 * k * MS).warnings]
    assert engine.data[0].qpos[2] < 1e-3
    assert len(texts) == 1 and "geom 'box0' and geom 'box1' overlap by 0.1" in texts[0]


def test_contacts_foretell_what_they_did_before():
    """Stiffness 1e6, damping 1e4 at 1 ms: 4 - 2 c dt - k dt^2 = 0 at 0.198 ms, by hand."""
    mode = Mode("contact", "Euler", 1e6, 0.0, 1e4)
    assert mode.grows(DT) and mode.rate * DT == pytest.approx(10)
    assert mode.longest_step(DT) == pytest.approx((np.sqrt(1e8 + 4e6) - 1e4) / 1e6, rel=1e-6)
    assert not Mode("contact", "discrete", 1e6, 0.0, 1e4).grows(DT)


def test_what_has_no_spring_has_no_mode():
    assert modes(mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")) == []
