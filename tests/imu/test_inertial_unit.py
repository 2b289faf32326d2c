"""The inertial unit against mechanics: rest, free fall, spin, smooth motion; noise against its densities."""

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest

from evis.geometry import se3
from evis.runtime.clock import keyframe_stamp
from nodes.imu.inertial import ImuModel, InertialUnit, polynomial
from nodes.imu.noise import normals

MS = 1_000_000
G = 9.81
PERFECT = ImuModel()


def body(motion, t):
    """Pose [S, 7] and twist [S, 6] of motion(seconds) -> (position, quaternion, velocity, omega)."""
    parts = [np.array(p, float) for p in zip(*(map(np.asarray, motion(s)) for s in np.asarray(t) * 1e-9))]
    return np.concatenate(parts[:2], axis=1), np.concatenate(parts[2:], axis=1)


def read(motion, model=PERFECT, end_ns=100 * MS, message_ns=33_333_333, step_ns=MS, episode=0, unit=None):
    """All readings from 0 to end_ns, in messages whose sub-steps are those of physics."""
    unit = unit or InertialUnit(model)
    out = [unit.advance(np.zeros(1, np.int64), *body(motion, [0]), episode)]
    start = 0
    while start < end_ns:
        stop = min(start + message_ns, end_ns)
        inside = np.arange(start // step_ns + 1, -(-stop // step_ns)) * step_ns
        t = np.concatenate(([start], inside, [stop]))
        out.append(unit.advance(t, *body(motion, t), episode))
        start = stop
    return [np.concatenate([getattr(r, name) for r in out]) for name in ("t", "acceleration", "angular_velocity")]


def still(quaternion):
    return lambda s: ([1.0, 2, 3], quaternion, [0.0] * 3, [0.0] * 3)


def test_at_rest_it_feels_gravity_upwards():
    """A camera that looks along the world's x with its y axis down reads -g on y; one that looks up reads +g on z."""
    level = se3.look_at(np.zeros(3), np.array([1.0, 0, 0]))[3:]
    t, f, w = read(still(level))
    np.testing.assert_allclose(f, np.broadcast_to([0, -G, 0], f.shape), atol=1e-12)
    assert not w.any() and len(t) == 100
    up = se3.look_at(np.zeros(3), np.array([0.0, 0, 1]), np.array([1.0, 0, 0]))[3:]
    np.testing.assert_allclose(read(still(up))[1], np.broadcast_to([0, 0, G], f.shape), atol=1e-12)
    weightless = read(still(up), ImuModel(gravity=0.0))[1]
    assert np.abs(weightless).max() < 1e-12


def test_in_free_fall_it_feels_nothing():
    fall = lambda s: ([0.3 * s, 0, 5 - G / 2 * s * s], se3.IDENTITY[3:], [0.3, 0, -G * s], [0.0] * 3)
    _, f, _ = read(fall)
    assert np.abs(f).max() < 1e-10


def test_a_stamp_right_beside_a_sub_step_does_no_harm():
    """1 ns between two velocities: their difference over it is mostly rounding, 1e-7 of the speed per second."""
    swing = lambda s: ([0.0] * 3, se3.IDENTITY[3:], [300 * math.sin(s), 0, 0], [0.0] * 3)
    for message in (33_333_333, 20_000_001, 999_999):
        t, f, _ = read(swing, ImuModel(gravity=0.0), message_ns=message)
        assert len(t) == 100
        # The first samples of messages this short have fewer than five velocities to go by.
        np.testing.assert_allclose(f[5:, 0], 300 * np.cos(t[5:] * 1e-9), rtol=0, atol=1e-7)
    t, f, _ = read(swing, ImuModel(gravity=0.0), end_ns=3 * MS, message_ns=100_000, step_ns=100)
    assert len(t) == 3
    # Velocities every 100 ns, of which one per us is used: rounding of 300 m/s over 1 us is 6e-8.
    np.testing.assert_allclose(f[:, 0], 300 * np.cos(t * 1e-9), rtol=0, atol=1e-6)


def test_first_order_integration_gives_the_acceleration_that_was_integrated():
    """Semi-implicit Euler, as most engines: positions and velocities disagree by half a step; f must not."""
    step, a = 1e-3, -G
    unit = InertialUnit(ImuModel())
    n = np.arange(101)
    v, z = a * step * n, a * step**2 * n * (n + 1) / 2
    pose = np.tile(se3.IDENTITY, (101, 1))
    twist = np.zeros((101, 6))
    pose[:, 2], twist[:, 2] = z, v
    f = unit.advance(n * MS, pose, twist).acceleration
    assert len(f) == 100 and np.abs(f).max() < 1e-9


@pytest.mark.parametrize("omega, tolerance", [(5.0, 1e-7), (50.0, 2e-4)])
def test_a_spin_gives_omega_and_the_centripetal_acceleration_of_the_offset(omega, tolerance):
    """At radius r, looking outwards: f = -r omega^2 on z (inwards) and -g on y, at every angle."""
    r = 0.25

    def spin(s):
        a = omega * s
        out = np.array([math.cos(a), math.sin(a), 0])
        along = np.array([-math.sin(a), math.cos(a), 0])
        return r * out, se3.look_at(np.zeros(3), out)[3:], r * omega * along, [0, 0, omega]

    _, f, w = read(spin)
    size = r * omega**2
    np.testing.assert_allclose(f, np.broadcast_to([0, -G, -size], f.shape), atol=tolerance * size)
    np.testing.assert_allclose(w, np.broadcast_to([0, -omega, 0], w.shape), atol=1e-9 * omega + 1e-9)


def test_the_error_is_of_fourth_order_in_the_sub_step():
    rate = 2 * np.pi * 3

    def swing(s):
        p, v = math.sin(rate * s), rate * math.cos(rate * s)
        return [0.1 * p, 0, 0], se3.exp(np.array([0, 0, p])), [0.1 * v, 0, 0], [0, 0, v]

    errors = []
    for step in (8, 4, 2):
        t, f, w = read(swing, ImuModel(gravity=0), end_ns=400 * MS, message_ns=80 * MS, step_ns=step * MS)
        angle = np.sin(rate * t * 1e-9)
        a = -0.1 * rate**2 * angle
        want = np.stack((a * np.cos(angle), -a * np.sin(angle), 0 * a), axis=1)
        wanted = rate * np.cos(rate * t * 1e-9)
        errors.append((np.abs(f - want).max(), np.abs(w[:, 2] - wanted).max()))
    for coarse, fine in itertools.pairwise(errors):
        assert fine[0] < coarse[0] / 12 and fine[1] < coarse[1] / 12
    assert errors[-1][0] < 1e-5 * 0.1 * rate**2


@pytest.mark.parametrize(("rate", "exact"), [(66.6666667, Fraction(200, 3)), (29.97002997, Fraction(30_000, 1001))])
def test_a_rate_in_decimals_is_the_fraction_that_keyframes_take_it_for(rate, exact):
    """Samples and keyframes of one rate stay together: here after 100,000 of them, to the ns."""
    k = 100_000
    wanted = [round(n * 10**9 / exact) for n in range(k, k + 3)]
    t = np.array([wanted[0] - 1, wanted[-1]])
    assert InertialUnit(ImuModel(rate=rate)).advance(t, *body(still(se3.IDENTITY[3:]), t)).t.tolist() == wanted
    assert wanted == [keyframe_stamp(n, rate) for n in range(k, k + 3)]


def test_samples_lie_on_the_grid_of_the_rate_and_each_message_has_its_own():
    motion = still(se3.IDENTITY[3:])
    for rate in (1000.0, 200.0, 333.0, 59.94, 8000.0):
        want = [round(k * 1e9 / rate) for k in range(1, 10_000) if round(k * 1e9 / rate) <= 100 * MS]
        for message in (100 * MS, 33_333_333, 5 * MS, 777_777):
            assert read(motion, ImuModel(rate=rate), message_ns=message)[0].tolist() == want
    assert len(InertialUnit(ImuModel()).advance(np.array([7 * MS]), *body(motion, [7 * MS])).t) == 0
    late = 2**61
    unit = InertialUnit(ImuModel())
    t = np.array([late, late + 5 * MS])
    got = unit.advance(t, *body(motion, [0, 0])).t
    assert len(got) == 5 and (got % MS == 0).all()


def test_noise_and_bias_have_their_densities():
    """White: sigma sqrt(rate) per sample. Bias: a random walk of sigma_b sqrt(T) after T seconds."""
    model = ImuModel(rate=400.0, accel_noise=0.02, gyro_noise=0.003)
    _, f, w = read(still(se3.IDENTITY[3:]), model, end_ns=60_000 * MS, message_ns=1000 * MS, step_ns=100 * MS)
    n = len(f)
    assert n == 24_000
    for got, mean, sigma in ((f, [0, 0, G], 0.02 * 20), (w, [0, 0, 0], 0.003 * 20)):
        assert (np.abs(got.mean(axis=0) - mean) < 5 * sigma / math.sqrt(n)).all()
        np.testing.assert_allclose(got.std(axis=0), sigma, rtol=5 / math.sqrt(2 * n))
        assert (np.abs(np.corrcoef(got[1:].T, got[:-1].T) - np.eye(6)) < 5 / math.sqrt(n)).all()
    ends = []
    for seed in range(120):
        walk = ImuModel(rate=100.0, accel_bias=0.5, gyro_bias=0.1, seed=seed)
        unit = InertialUnit(walk)
        t = np.array([0, 4_000 * MS])
        r = unit.advance(t, *body(still(se3.IDENTITY[3:]), [0, 0]))
        ends.append([r.acceleration[[99, 399], 0] / 0.5, r.angular_velocity[[99, 399], 2] / 0.1])
    spread = np.std(ends, axis=0)
    np.testing.assert_allclose(spread, [[1, 2], [1, 2]], rtol=4 / math.sqrt(240))


def test_noise_does_not_depend_on_messages_and_differs_by_seed_and_episode():
    motion = still(se3.IDENTITY[3:])
    noisy = lambda seed: ImuModel(accel_noise=0.1, gyro_noise=0.1, accel_bias=0.1, gyro_bias=0.1, seed=seed)
    whole = read(motion, noisy(3), message_ns=100 * MS)
    for message in (33_333_333, MS, 1_500_000):
        again = read(motion, noisy(3), message_ns=message)
        # The noise-free part is the same polynomial from other knots: equal to rounding.
        np.testing.assert_allclose(again[1], whole[1], rtol=0, atol=1e-9)
        np.testing.assert_allclose(again[2], whole[2], rtol=0, atol=1e-9)
    assert read(motion, noisy(3))[1].tobytes() == read(motion, noisy(3))[1].tobytes()
    assert np.abs(read(motion, noisy(4))[1] - whole[1]).min() > 0
    unit = InertialUnit(noisy(3))
    first, second = (read(motion, unit=unit, episode=e)[1] for e in (0, 1))
    assert np.abs(first - second).min() > 0
    np.testing.assert_array_equal(second, read(motion, noisy(3), episode=1)[1])


def test_the_normal_numbers_are_normal():
    draws = normals(5, 0, np.arange(100_000), 4)
    quantiles = np.quantile(draws, [0.001, 0.0228, 0.1587, 0.5, 0.8413, 0.9772, 0.999], axis=0)
    want = np.array([-3.09, -2, -1, 0, 1, 2, 3.09])[:, None]
    np.testing.assert_allclose(quantiles, np.broadcast_to(want, quantiles.shape), atol=0.11)
    assert np.abs(np.corrcoef(draws.T) - np.eye(4)).max() < 0.016


def test_readings_beyond_the_range_are_clipped_and_counted():
    spin = lambda s: ([0.0] * 3, se3.exp(np.array([0, 0, 40 * s])), [0.0] * 3, [0, 0, 40])
    unit = InertialUnit(ImuModel(gyro_range=35.0, accel_range=9.0))
    _, f, w = read(spin, unit=unit)
    assert (w[:, 2] == 35).all() and (f[:, 2] == 9).all() and unit.clipped == 2 * len(w)


def test_a_state_that_is_not_finite_is_counted():
    unit = InertialUnit(ImuModel())
    pose, twist = body(still(se3.IDENTITY[3:]), np.zeros(11))
    twist[4] = np.nan
    unit.advance(np.arange(11) * MS, pose, twist)
    assert 0 < unit.nonfinite < 10


def test_a_polynomial_of_degree_four_is_exact():
    times = np.array([0, 3, 10, 11, 20, 33, 40], np.int64) * MS + 2**60
    x = (times - times[0]) * 1e-9
    coefficients = [7.0, -30, 4, 2, -1]
    at = times[0] + np.array([1, 15, 20, 39, 40], np.int64) * MS
    value, slope = polynomial(at, times, np.polyval(coefficients, x)[:, None])
    u = (at - times[0]) * 1e-9
    np.testing.assert_allclose(value[:, 0], np.polyval(coefficients, u), rtol=1e-12)
    np.testing.assert_allclose(slope[:, 0], np.polyval(np.polyder(coefficients), u), rtol=1e-10)


@pytest.mark.parametrize(
    "values, text", [({"rate": 0.0}, "IMU rate 0 Hz"), ({"gyro_noise": -1.0}, "IMU gyro_noise -1")]
)
def test_misuse_has_one_clear_line(values, text):
    with pytest.raises(ValueError, match=text):
        InertialUnit(ImuModel(**values))
