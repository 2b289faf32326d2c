"""Computes reference courses by closed form or by an integration of our own in float64, independent of the engine's."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np


def runge_kutta(rate: Callable[[np.ndarray], np.ndarray], start: np.ndarray, t: np.ndarray, step: float) -> np.ndarray:
    """Integrates y' = rate(y) by the classical method of fourth order.

    Args:
        start: float64 [n] at t = 0.
        t: float64 [S] s, rising, at which y is wanted.
        step: longest step [s].

    Returns:
        float64 [S, n].
    """
    y, now, found = np.array(start, float), 0.0, np.empty((len(t), len(start)))
    for i, then in enumerate(t):
        count = int(np.ceil((then - now) / step - 1e-9))
        h = (then - now) / max(count, 1)
        for _ in range(count):
            a = rate(y)
            b = rate(y + 0.5 * h * a)
            c = rate(y + 0.5 * h * b)
            y = y + h / 6 * (a + 2 * b + 2 * c + rate(y + h * c))
        now = then
        found[i] = y
    return found


def free_body(inertia: np.ndarray, omega: np.ndarray, t: np.ndarray, step: float) -> np.ndarray:
    """Computes the attitude of a body without forces, by Euler's equations.

    Args:
        inertia: float64 [3] about its principal axes. omega: float64 [3] rad/s about them, at t = 0.
        t: float64 [S] s. step: of the integration [s].

    Returns:
        Quaternions x y z w from the body to the world, float64 [S, 4]; the identity at t = 0.
    """
    i, j, k = (float(value) for value in inertia)

    def rate(y: np.ndarray) -> np.ndarray:
        p, q, r, x, y_, z, w = y.tolist()
        turn = (w * p + y_ * r - z * q, w * q + z * p - x * r, w * r + x * q - y_ * p, -x * p - y_ * q - z * r)
        return np.array([(j - k) / i * q * r, (k - i) / j * r * p, (i - j) / k * p * q, *(0.5 * v for v in turn)])

    found = runge_kutta(rate, np.array([*omega, 0, 0, 0, 1.0]), t, step)[:, 3:]
    return np.asarray(found / np.linalg.norm(found, axis=-1, keepdims=True))


def pendulum(amplitude: float, omega: float, t: np.ndarray) -> np.ndarray:
    """Computes the angle [rad] of a pendulum that is let go at `amplitude` [rad], by Jacobi's functions.

    sin(angle / 2) = k sn(K - omega t, k) with k = sin(amplitude / 2) (Landau and Lifshitz, Mechanics, 11.1); omega
    [rad/s] is that of small swings. sn is by the descending Landen transformation (Abramowitz and Stegun 16.4).
    """
    modulus = float(np.sin(amplitude / 2))
    a, b, c = [1.0], [float(np.sqrt(1 - modulus**2))], [modulus]
    while c[-1] > 1e-16:
        mean, root, half = (a[-1] + b[-1]) / 2, float(np.sqrt(a[-1] * b[-1])), (a[-1] - b[-1]) / 2
        a, b, c = [*a, mean], [*b, root], [*c, half]
    quarter = np.pi / (2 * a[-1])
    phase = 2 ** (len(a) - 1) * a[-1] * (quarter - np.mod(omega * t, 4 * quarter))
    for n in range(len(a) - 1, 0, -1):
        phase = (phase + np.arcsin(np.clip(c[n] / a[n] * np.sin(phase), -1, 1))) / 2
    return np.asarray(2 * np.arcsin(modulus * np.sin(phase)))


def oscillator(omega: float, zeta: float, t: np.ndarray) -> np.ndarray:
    """Computes x(t) of x'' = -omega^2 x - 2 zeta omega x' let go at x = 1; zeta at most 1."""
    if zeta == 1:
        return (1 + omega * t) * np.exp(-omega * t)
    damped = omega * np.sqrt(1 - zeta**2)
    return np.asarray(np.exp(-zeta * omega * t) * (np.cos(damped * t) + zeta * omega / damped * np.sin(damped * t)))


def chain(links: int, length: float, gravity: float, t: np.ndarray, step: float) -> np.ndarray:
    """Computes the course of a chain of thin rods, let go while it lies level along x, its first end held.

    Lagrange's equations in the angle of each rod to the x axis; the mass of a rod is 1, as it does not matter.

    Args:
        length: of a rod [m]. gravity: along -z [m/s^2]. t: float64 [S] s. step: of the integration [s].

    Returns:
        float64 [S, links + 1, 2]: x and z [m] of the beginning of each rod, and of the end of the last.
    """
    number = np.arange(links)
    beyond = links - 1 - np.maximum.outer(number, number) + 0.5
    coupling = length**2 * beyond
    own = length**2 * (links - 1 - number + 1 / 3)
    weight = gravity * length * (links - 1 - number + 0.5)

    def rate(y: np.ndarray) -> np.ndarray:
        angle, speed = y[:links], y[links:]
        cosine, sine = np.cos(angle), np.sin(angle)
        mass = coupling * (np.outer(cosine, cosine) + np.outer(sine, sine))
        mass[number, number] = own
        across = coupling * (np.outer(sine, cosine) - np.outer(cosine, sine))
        return np.concatenate((speed, np.linalg.solve(mass, -across @ speed**2 - weight * cosine)))

    angle = runge_kutta(rate, np.zeros(2 * links), t, step)[:, :links]
    ends = length * np.cumsum(np.stack((np.cos(angle), np.sin(angle)), -1), axis=1)
    return np.concatenate((np.zeros((len(t), 1, 2)), ends), axis=1)


def damping_of(restitution: float) -> float:
    """Finds the damping ratio of a contact's spring and damper that gives back this share of the speed.

    The contact ends where its force would pull: e = exp(-b / w (pi - atan(2 b w / (w^2 - b^2)))) with b = zeta and
    w = sqrt(1 - zeta^2) (Schwager and Poeschel, Granular Matter 9, 2007, eq. 21), for zeta below 1 / sqrt(2).
    """
    low, high = 0.0, 0.7
    for _ in range(60):
        zeta = 0.5 * (low + high)
        w = np.sqrt(1 - zeta**2)
        given = np.exp(-zeta / w * (np.pi - np.arctan(2 * zeta * w / (w**2 - zeta**2))))
        low, high = (zeta, high) if given > restitution else (low, zeta)
    return low
