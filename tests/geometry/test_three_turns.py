"""Three turns against SciPy's products of rotations, for each of the nine choices of axes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from evis.geometry.three_turns import three_turns

CALM = np.radians([[0, -25, 10], [70, 20, -30], [150, -10, 100], [230, 30, 190], [330, 5, 260], [400, -20, 370]])
"""Angles whose middle one stays small while the others go round."""


@pytest.mark.parametrize("first", range(3))
@pytest.mark.parametrize("third", range(3))
def test_the_calm_choice_is_found_and_gives_the_rotations(first: int, third: int) -> None:
    """Made of turns about e_i, e_j and e_k whose middle one keeps e_i and e_k apart: these are found, without jumps."""
    middle = next(n for n in range(3) if n not in (first, third))
    apart = np.pi / 2 if first == third else 0.0
    steps = np.linspace(0, 1, 60)
    angles = np.stack([np.interp(steps, np.linspace(0, 1, 6), column) for column in CALM.T], axis=-1)
    angles[:, 1] += apart
    turns = [Rotation.from_rotvec(angles[:, [n]] * np.eye(3)[[axis]]) for n, axis in enumerate((first, middle, third))]
    truth = turns[0] * turns[1] * turns[2]
    axes, found = three_turns(truth.as_quat())
    product = Rotation.identity(60)
    for axis, angle in zip(axes, found.T):
        product = product * Rotation.from_rotvec(angle[:, None] * axis)
    assert (product.inv() * truth).magnitude().max() < 1e-12
    assert np.argmax(axes[0]) == first and np.argmax(axes[2]) == third
    assert np.abs(np.diff(found, axis=0)).max() < 0.5  # 100 degrees in 12 steps


def test_what_turns_over_in_all_directions_is_refused() -> None:
    """Turns by 90 degrees about all axes bring every axis onto every other."""
    about = Rotation.create_group("O").as_quat()
    with pytest.raises(ValueError, match="no three axes can follow it"):
        three_turns(about)
