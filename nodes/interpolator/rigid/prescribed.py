"""Computes poses of many bodies with prescribed motion at once: one pass over all of them instead of one for each."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from evis.geometry import se3
from evis.scene.motion import NS, Linear, Path, Prescribed, Sinusoid, Spin, Swing, Turn, with_parents
from evis.scene.spline import Spline


def _product_table() -> np.ndarray:
    """Tabulates what each product of two components, x y z w, adds to those of the quaternions' product: float64 [16,
    4]."""
    units = np.eye(4)
    return se3.multiply(units[:, None], units[None]).reshape(16, 4)


PRODUCT = _product_table()
CONJUGATE = np.array([-1.0, -1.0, -1.0, 1.0])


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Multiplies quaternions [M, K, 4] as se3.multiply gives them, with fewer and larger steps."""
    return (a[..., :, None] * b[..., None, :]).reshape(*a.shape[:-1], 16) @ PRODUCT


class PrescribedPoses:
    """Computes `Prescribed.pose` of several bodies at once, equal to it but for rounding."""

    def __init__(self, paths: Sequence[Prescribed]) -> None:
        nodes = with_parents(paths)
        row = {id(path): n for n, path in enumerate(nodes)}
        self._rows = np.array([row[id(path)] for path in paths], np.int64)
        start = np.array([path.start for path in nodes]).reshape(-1, 7)
        self._start = start[:, :3].copy(), start[:, 3:].copy()
        shifts = [(n, shift) for n, path in enumerate(nodes) for shift in path.shifts]
        self._linear = [(n, s.velocity) for n, s in shifts if isinstance(s, Linear)]
        waves = [(n, s) for n, s in shifts if isinstance(s, Sinusoid)]
        self._wave_rows = np.array([n for n, _ in waves], np.int64)
        self._wave = _columns([(2 * np.pi * s.frequency, s.phase) for _, s in waves], 2)
        self._wave_amplitude = np.array([s.amplitude for _, s in waves]).reshape(-1, 3)
        curves: list[tuple[bool, int, Spline]] = [(False, n, s.spline) for n, s in shifts if isinstance(s, Path)]
        # A turn's angle is rate t + amplitude sin(pace t + phase), or a spline's.
        turns = [(n, j, turn) for n, path in enumerate(nodes) for j, turn in enumerate(path.turns)]
        self._angle = _columns([_angle_of(turn) for _, _, turn in turns], 4)
        curves += [(True, k, turn.spline) for k, (_, _, turn) in enumerate(turns) if isinstance(turn, Turn)]
        self._curves = _joined(curves)
        self._axis = np.array([turn.axis for _, _, turn in turns], np.float64).reshape(-1, 3)
        deepest = max((j for _, j, _ in turns), default=-1)
        self._chain = [_pairs((n, k) for k, (n, i, _) in enumerate(turns) if i == j) for j in range(deepest + 1)]
        depth = [path.depth for path in nodes]
        self._levels = [
            _pairs((n, row[id(p.parent)]) for n, p in enumerate(nodes) if p.parent is not None and depth[n] == level)
            for level in range(1, max(depth, default=0) + 1)
        ]

    def at(self, t_ns: np.ndarray) -> np.ndarray:
        """Gives poses float64 [M, K, 7] in the world at times int64 [K] ns, in the order of the paths."""
        t = np.asarray(t_ns, np.int64) * NS
        place, turn = (np.repeat(values[:, None], len(t), axis=1) for values in self._start)
        for n, velocity in self._linear:
            place[n] += t[:, None] * velocity
        if len(self._wave_rows):
            pace, phase = self._wave
            np.add.at(place, self._wave_rows, np.sin(pace * t + phase)[..., None] * self._wave_amplitude[:, None])
        angles: list[tuple[int, np.ndarray]] = []
        for spline, targets in self._curves:
            values = spline(t)[0]
            for turns, n, first in targets:
                if turns:
                    angles.append((n, values[:, first]))
                else:
                    place[n] += values[:, first : first + 3]
        if len(self._axis):
            rate, amplitude, pace, phase = self._angle
            angle = rate * t + amplitude * np.sin(pace * t + phase)
            for k, values in angles:
                angle[k] = values
            each = se3.exp(angle[..., None] * self._axis[:, None])
            for nodes, which in self._chain:
                turn[nodes] = _product(turn[nodes], each[which])
        for nodes, parents in self._levels:
            carrier = turn[parents]
            there = np.concatenate((place[nodes], np.zeros((*place[nodes].shape[:2], 1))), axis=-1)
            there = _product(_product(carrier, there), carrier * CONJUGATE)
            place[nodes] = place[parents] + there[..., :3]
            turn[nodes] = _product(carrier, turn[nodes])
        return np.concatenate((place, turn), axis=-1)[self._rows]


def _joined(
    curves: Iterable[tuple[bool, int, Spline]],
) -> list[tuple[Spline, list[tuple[bool, int, int]]]]:
    """Joins splines with the same times; gives where each of them goes and its first column."""
    groups: dict[tuple[bool, bytes], list[tuple[bool, int, Spline]]] = {}
    for curve in curves:
        groups.setdefault((curve[2].loop, curve[2].times.tobytes()), []).append(curve)
    result = []
    for (loop, _), members in groups.items():
        splines = [spline for _, _, spline in members]
        joined = Spline(splines[0].times, np.hstack([spline.values for spline in splines]), loop)
        joined.rates = np.hstack([spline.rates for spline in splines])
        firsts = np.cumsum([0] + [spline.values.shape[1] for spline in splines])
        result.append((joined, [(turns, n, int(first)) for (turns, n, _), first in zip(members, firsts)]))
    return result


def _angle_of(turn: object) -> tuple[float, float, float, float]:
    """Gives (rate, amplitude, pace, phase) of a turn, all 0 for a spline."""
    if isinstance(turn, Spin):
        return turn.rate, 0.0, 0.0, 0.0
    if isinstance(turn, Swing):
        return 0.0, turn.amplitude, 2 * np.pi * turn.frequency, turn.phase
    return 0.0, 0.0, 0.0, 0.0


def _columns(rows: list[tuple[float, ...]], width: int) -> tuple[np.ndarray, ...]:
    """Makes columns [R, 1] of rows of numbers."""
    return tuple(np.array(rows, np.float64).reshape(-1, width).T[..., None])


def _pairs(pairs: Iterable[tuple[int, int]]) -> tuple[np.ndarray, np.ndarray]:
    """Splits pairs of numbers into two arrays."""
    both = np.array(list(pairs), np.int64).reshape(-1, 2)
    return both[:, 0], both[:, 1]
