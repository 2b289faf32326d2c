"""Makes cases of bodies that stand on each other: stacks, mass ratios, sizes far apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bench.physics.case import EARTH, STEPS, Case, Course, displaced

HARD = "solref='-1e6 -2e3' solimp='.99 .99 .001'"
"""Contacts of 1e6/s^2 with critical damping."""
CONTACTS = (("default", ""), ("hard", HARD))


FINER = f"{EARTH} tolerance='1e-25' iterations='200'"
"""The solver stops when the cost falls by less than this, in units of the mean inertia: that of the heaviest body."""


def cases(quick: bool) -> list[Case]:
    """Lists a stack of 10 boxes, a heap of 216 balls, light boxes below heavy ones, and 1 mm beside and on 100 m."""
    found = []
    seconds = 0.3 if quick else 1.0
    steps = STEPS[:2] if quick else STEPS[:3]
    kinds = [(f"{kind} contacts", contact) for kind, contact in CONTACTS]

    def stands(name: str, limit: float, world: str, option: str = EARTH) -> Case:
        return Case(name, "piles", "stands", "m", limit, seconds, displaced, world, option=option, steps=steps)

    found += [stands(f"stack of 10 boxes, {kind}", 1e-3, _tower([1.0] * 10, contact)) for kind, contact in kinds]
    found += [
        Case(
            f"heap of 216 balls, {kind}", "piles", "none overlap", "m", 1e-3, 0.06 if quick else 0.4, _overlap,
            _heap(contact), option=EARTH, steps=STEPS[:1] if quick else STEPS[:2], tolerances=(),
        )
        for kind, contact in kinds
    ]  # fmt: skip
    for mass in (10, 100, 1000, 10000):
        name = f"1 kg below {mass:,} kg"
        found += [stands(f"{name}, {kind}", 1e-3, _tower([1.0, mass], contact)) for kind, contact in kinds]
    found += [stands(f"1 mm beside 100 m, {kind}", 1e-4, _beside(contact)) for kind, contact in kinds]
    small_on_large = _tower([1e9, 1e-6], HARD, (50.0, 5e-4))
    found.append(stands("1 mm on 100 m, hard contacts", 1e-4, small_on_large))
    found.append(stands("1 mm on 100 m, hard contacts, solver to 1e-25", 1e-4, small_on_large, FINER))
    return found


def _tower(masses: Sequence[float], contact: str, halves: Sequence[float] = ()) -> str:
    """Boxes on each other, from the ground up: masses [kg] and half their widths [m], 0.1 if none are given."""
    world, z = f"<geom type='plane' size='99 99 1' {contact}/>", 0.0
    for n, (mass, half) in enumerate(zip(masses, halves or [0.1] * len(masses), strict=True)):
        box = f"<geom type='box' size='{half} {half} {half}' mass='{mass}' {contact}/>"
        world += f"<body name='box{n}' pos='0 0 {z + half}'><freejoint/>{box}</body>"
        z += 2 * half
    return world


def _beside(contact: str) -> str:
    """A cube of 1 mm and 1 mg on the ground, 1 cm beside a cube of 100 m and a million tons."""
    world = f"<geom type='plane' size='99 99 1' {contact}/>"
    for name, x, half, mass in (("large", 0.0, 50.0, 1e9), ("small", 50.01, 5e-4, 1e-6)):
        box = f"<geom type='box' size='{half} {half} {half}' mass='{mass}' {contact}/>"
        world += f"<body name='{name}' pos='{x} 0 {half}'><freejoint/>{box}</body>"
    return world


def _heap(contact: str) -> str:
    """Balls 1 cm apart on a lattice that is a little disturbed."""
    places = 0.21 * np.stack(np.meshgrid(*[np.arange(6.0)] * 3, indexing="ij"), -1).reshape(-1, 3)
    places[:, :2] += 1e-3 * np.random.default_rng(0).uniform(-1, 1, (216, 2))
    places[:, 2] += 0.1
    ball = f"<freejoint/><geom size='.1' mass='10' {contact}/>"
    balls = "".join(f"<body pos='{x} {y} {z}'>{ball}</body>" for x, y, z in places.tolist())
    return f"<geom type='plane' size='9 9 1' {contact}/>{balls}"


def _overlap(course: Course) -> float:
    """Deepest overlap of balls of radius 0.1, and of a ball with the ground."""
    deepest = 0.0
    for place in course.pose[..., :3]:
        apart = np.linalg.norm(place[:, None] - place, axis=-1) + np.eye(len(place))
        deepest = max(deepest, 0.2 - float(apart.min()), 0.1 - float(place[:, 2].min()))
    return deepest
