"""The truths of the physics benchmark are right, and what is wrong stays in its tables."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from bench.physics import contacts, free, piles, plot, references, springs, tables
from bench.physics.case import INTEGRATORS, MS, Case
from bench.physics.trial import Method, Trial, run
from bench.report import SUBJECTS

ACCURATE = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
ALL = [case for room in (free, springs, contacts, piles) for case in room.cases(True)]


def case_of(start: str) -> Case:
    (found,) = [case for case in ALL if case.name.startswith(start)]
    return found


def test_the_integration_is_of_fourth_order():
    """Half the step, a sixteenth of the error."""
    t = np.array([1.0, 2.0])
    wrong = [
        np.abs(references.runge_kutta(lambda y: np.array([y[1], -y[0]]), np.array([1.0, 0.0]), t, h)[:, 0] - np.cos(t))
        for h in (0.1, 0.05)
    ]
    np.testing.assert_allclose(wrong[0] / wrong[1], 16, rtol=0.1)


def test_a_free_body_is_that_of_another_integrator():
    """Euler's equations for the angular velocity in the body, and scipy's rotations for the attitude."""
    inertia, omega, t = np.array([1.0, 2.0, 3.0]), np.array([0.5, 3.0, 0.2]), np.linspace(0.5, 4, 8)

    def rate(_, y):
        w, turn = y[:3], y[3:].reshape(3, 3)
        return np.concatenate((np.cross(inertia * w, w) / inertia, (turn @ np.cross(np.eye(3), w)).ravel()))

    y = solve_ivp(rate, (0, 4), [*omega, *np.eye(3).ravel()], t_eval=t, **ACCURATE).y.T
    found = Rotation.from_quat(references.free_body(inertia, omega, t, 1e-3)).as_matrix()
    assert np.abs(found - y[:, 3:].reshape(-1, 3, 3)).max() < 1e-9


@pytest.mark.parametrize("amplitude", [0.1, 2.6])
def test_a_pendulum_is_that_of_another_integrator(amplitude):
    t = np.linspace(0.1, 20, 50)
    y = solve_ivp(lambda _, y: [y[1], -9 * np.sin(y[0])], (0, 20), [amplitude, 0.0], t_eval=t, **ACCURATE).y
    assert np.abs(references.pendulum(amplitude, 3.0, t) - y[0]).max() < 1e-9


@pytest.mark.parametrize("zeta", [0.0, 0.3, 1.0])
def test_an_oscillator_is_that_of_another_integrator(zeta):
    t = np.linspace(0.1, 5, 20)
    y = solve_ivp(lambda _, y: [y[1], -4 * y[0] - 4 * zeta * y[1]], (0, 5), [1.0, 0.0], t_eval=t, **ACCURATE).y
    assert np.abs(references.oscillator(2.0, zeta, t) - y[0]).max() < 1e-9


def test_a_chain_of_one_rod_is_a_pendulum():
    """Of 3 g / (2 l), let go at 90 degrees."""
    t = np.linspace(0.1, 2, 20)
    end = references.chain(1, 0.5, 9.81, t, 1e-3)[:, 1]
    angle = references.pendulum(np.pi / 2, np.sqrt(1.5 * 9.81 / 0.5), t)
    assert np.abs(end - 0.5 * np.stack((np.sin(angle), -np.cos(angle)), -1)).max() < 1e-8


def test_a_chain_of_three_rods_keeps_its_energy():
    """By the speed of the rods' ends, in differences."""
    t = np.arange(0, 1, 1e-3)
    x = references.chain(3, 0.3, 9.81, t, 1e-4)
    v = np.gradient(x, t, axis=0)
    start, end, over = v[:, :-1], v[:, 1:], x[..., 1]
    # Of a thin rod of mass 1: (u.u + u.v + v.v) / 6, with the velocities u and v of its ends.
    kinetic = (start**2 + start * end + end**2).sum((1, 2)) / 6
    energy = kinetic + 9.81 * (over[:, :-1] + over[:, 1:]).sum(1) / 2
    assert np.abs(energy[1:-1]).max() < 1e-3 * kinetic.max()


def test_a_contact_gives_back_what_is_asked_for():
    """Until its force would pull."""
    zeta = references.damping_of(0.8)

    def pulls(_, y):
        return y[0] + 2 * zeta * y[1]

    pulls.terminal, pulls.direction = True, 1
    end = solve_ivp(lambda _, y: [y[1], -y[0] - 2 * zeta * y[1]], (0.0, 9.0), [-1e-9, -1.0], events=pulls, **ACCURATE)
    assert end.t_events[0].size == 1 and end.y[1, -1] == pytest.approx(0.8, abs=1e-6)


@pytest.mark.parametrize("step", [MS, MS // 4])
def test_a_projectile_is_off_by_what_it_must_be(step, tmp_path):
    """Semi-implicit Euler by g dt t / 2, RK4 by nothing."""
    case = dataclasses.replace(case_of("projectile"), seconds=0.2)
    euler, accurate = (run(case, Method(name, step), tmp_path) for name in ("Euler", "RK4"))
    assert euler.error == pytest.approx(9.81 * step * 1e-9 * 0.2 / 2, rel=1e-9) and accurate.error < 1e-12
    assert euler.ended_s == 0.2 and euler.cpu > 0 and accurate.right


@pytest.mark.parametrize("name", ["spring of 1e8 N/m and 1 kg, undamped", "bullet of 100 m/s at a wall of 1 cm, hard"])
def test_what_diverges_stays_in_the_tables_and_the_plot(name, tmp_path):
    """Also where nothing else is left of a case."""
    pytest.importorskip("matplotlib")
    case = case_of(name)
    trial = run(case, Method("Euler", MS), tmp_path)
    assert trial.verdict == "diverged, foretold" and math.isnan(trial.error) and trial.ended_s <= case.seconds
    found = tables.sections([trial])
    (row,) = found["cases"]["rows"]
    assert row["Euler, 1 ms"] == "diverged, foretold" and row["cheapest that is right"] == "none of these"
    assert found["outcomes"]["rows"][0]["diverged, foretold"] == 1
    (path,) = [path for path in plot.plot(found, tmp_path) if case.group in path.name]
    assert path.stat().st_size > 1000


def test_an_estimate_is_compared_in_the_unit_of_the_error(tmp_path):
    """Of free fall, and of a pendulum's angle; not of what stands, whose error is that of the contact's model."""
    fall = run(dataclasses.replace(case_of("projectile"), seconds=0.5), Method("Euler", MS), tmp_path)
    swing = run(dataclasses.replace(case_of("pendulum at 149 degrees for"), seconds=1.0), Method("Euler", MS), tmp_path)
    assert fall.ratio == pytest.approx(1, abs=0.01) and swing.ratio == pytest.approx(1, abs=0.2)
    stack = run(dataclasses.replace(case_of("stack of 10 boxes, d"), seconds=0.02), Method("Euler", MS), tmp_path)
    assert stack.estimate is not None and stack.ratio is None
    found = tables.sections([fall, stack])
    assert found["estimates"]["rows"][0]["Euler"] == "1" and found["outcomes"]["rows"][0]["estimated"] == "1 of 1"


def test_a_tolerance_is_a_curve_of_its_own(tmp_path):
    """Its error is within what was asked for, and stands under it; the steps of integrators stand elsewhere."""
    case = dataclasses.replace(case_of("spring of 1e4 N/m and 1 kg, undamped"), seconds=0.2)
    whole, bounded = (run(case, Method("Euler", MS, tolerance), tmp_path) for tolerance in (None, 1e-3))
    assert bounded.method.name == "tolerance" and bounded.error < 1e-3 * case.seconds < whole.error
    found = tables.sections([whole, bounded])
    (row,) = found["tolerances"]["rows"]
    assert float(row["0.001"]) == pytest.approx(bounded.error, rel=0.1) and row["0.01"] == ""
    assert found["cases"]["rows"][0]["cheapest that is right"] == "tolerance, 0.001"
    assert len(found["errors_springs"]["rows"]) == len(found["estimates"]["rows"]) == 1


def made(integrator, step, error, cpu=1.0, **said):
    return Trial(case_of("projectile"), Method(integrator, step), error, cpu, 1.0, **said)


def test_a_verdict_says_whether_the_user_was_told():
    """Of what is right too."""
    told = {"said": ("x",)}
    assert made("RK4", MS, 1e-3).verdict == "right" and made("RK4", MS, 0.0, **told).verdict == "right, but warned of"
    assert made("RK4", MS, 1.1e-3).verdict == "off, unsaid" and made("RK4", MS, 1.0, **told).verdict == "off, said"
    assert made("RK4", MS, 1.0, foretold=("x",), **told).verdict == "off, foretold"
    assert made("RK4", MS, math.nan, fault="x").verdict == "diverged, said"


def test_the_cheapest_is_not_a_lucky_one():
    """One whose shorter step is off is passed over, and what was foretold to diverge; of those that cost the same the
    first integrator is named."""
    lucky, worse = made("Euler", MS, 0.0, 1.0), made("Euler", MS // 4, 1.0, 4.0)
    slow, others = made("discrete", MS, 1e-4, 9.0), [made(name, MS // 4, 0.0, cpu) for name, cpu in
                                                     (("RK4", 2.1), ("implicit", 2.2), ("discrete", 8.0))]  # fmt: skip
    assert tables.cheapest([lucky, worse, slow, *others]) is others[1]
    assert tables.cheapest([worse, made("RK4", MS, 0.0, foretold=("x",))]) is None
    assert tables.cheapest([made("RK4", MS, 0.0, said=("x",))]).verdict == "right, but warned of"


def test_every_case_has_a_truth_and_steps_that_divide_its_samples():
    """And names of its own, and a plot."""
    assert len({case.name for case in ALL}) == len(ALL) > 40 and {case.group for case in ALL} == set(tables.GROUPS)
    for case in ALL:
        assert case.truth and case.limit > 0 and set(case.integrators) <= set(INTEGRATORS)
        assert MS in case.steps and all(MS % step == 0 for step in case.steps)
    assert SUBJECTS["physics"][0] == "bench.physics.work_precision"
