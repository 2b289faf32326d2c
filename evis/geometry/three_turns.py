"""Takes rotations apart into three turns about axes of a frame, one after another."""

from __future__ import annotations

from itertools import product

import numpy as np

from evis.geometry import se3

STEEPEST = np.sin(np.radians(85.0))
"""Largest sine of how near the first axis may come to the third one: where they coincide the turns are not unique."""


def three_turns(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Computes q = exp(a e_i) exp(b e_j) exp(c e_k) of a sequence of rotations that follow one another smoothly.

    Of the nine ways to choose e_i and e_k among the axes x, y, z (Tait and Bryan's where they differ, Euler's where
    they do not) it takes that in which e_i, in the frame outside, stays furthest from e_k, in the frame that turns.
    Formulas: J. Diebel, Representing Attitude, 2006.

    q: unit quaternions float64 [K, 4]. Returns the axes [3, 3], a row each, and the angles [K, 3] in rad without jumps.
    Raises ValueError where the axes come within 5 degrees of each other in all nine.
    """
    m = se3.to_matrix(q)
    near, i, k = min((float(np.abs(m[:, i, k]).max()), i, k) for i, k in product(range(3), repeat=2))
    if near > STEEPEST:
        raise ValueError("it turns over so much that no three axes can follow it; cut it into shorter pieces")
    if i != k:
        j = 3 - i - k
        sign = 1.0 if (j - i) % 3 == 1 else -1.0
        a = np.arctan2(-sign * m[:, j, k], m[:, k, k])
        b = np.arcsin(sign * m[:, i, k])
        c = np.arctan2(-sign * m[:, i, j], m[:, i, i])
    else:
        j, other = (i + 1) % 3, (i + 2) % 3
        a = np.arctan2(m[:, j, i], -m[:, other, i])
        b = np.arccos(m[:, i, i])
        c = np.arctan2(m[:, i, j], m[:, i, other])
    return np.eye(3)[[i, j, k]], np.stack([np.unwrap(a), b, np.unwrap(c)], axis=-1)
