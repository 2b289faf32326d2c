"""Makes cases of contacts with a known outcome: bounces, slopes, blows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bench.physics.case import EARTH, MS, STEPS, Case, Course, G
from bench.physics.references import damping_of

HEIGHT, RESTITUTION = 1.0, 0.8
STIFF = 7e5
"""Stiffness of a bouncing contact by mass [1/s^2]: it lasts for 3.8 ms."""
BLOW = "solref='-1e9 -6e4' solimp='.99 .99 .001'"
"""A contact that stops 500 m/s within a centimetre."""
FACE, RADIUS = 0.2, 0.01
"""Where the bullet's wall begins, and how thick the bullet is [m]."""
REACH = np.pi / 2 - np.arcsin(0.04 / 0.5)
"""Angle at which the bat's side touches the post [rad]: both are 2 cm round, and the post is 50 cm away."""
HITS = (MS, MS // 4, MS // 16, MS // 64, MS // 500)


def cases(quick: bool) -> list[Case]:
    """Lists bounces, slopes, slide to roll, bullet, bat and cradles."""
    bullet = """<geom name='wall' type='box' pos='.205 0 0' size='.005 1 1' {0}/>
    <body name='bullet'><freejoint/><geom size='.01' mass='.01' {0}/></body>"""
    bat = f"""<geom name='post' type='capsule' fromto='0 .5 -.2 0 .5 .2' size='.02' {BLOW}/><body name='bat'>
    <joint axis='0 0 1'/><geom type='capsule' fromto='.1 0 0 .8 0 0' size='.02' mass='1' {BLOW}/></body>"""
    rolling = """<geom type='plane' size='99 99 1' friction='.2 0 0'/><body name='ball' pos='0 0 .1'><freejoint/>
    <geom size='.1' mass='1' friction='.2 0 0'/></body>"""
    found = [
        Case(
            "ball that bounces without loss", "contacts", "flies as high as it was let go", "m", 0.01,
            1.5 if quick else 4.0, _height, _bouncer(0.0), option=EARTH, steps=STEPS[:3],
        ),
        Case(
            "ball that keeps 4/5 of its speed: first apex", "contacts", "e^2 h", "m", 0.01, 1.2, _apex,
            _bouncer(damping_of(RESTITUTION)), option=EARTH,
        ),
        Case(
            "ball that keeps 4/5 of its speed: end of its bounces", "contacts", "series of instant blows", "s", 0.05,
            5.0, _rest, _bouncer(damping_of(RESTITUTION)), option=EARTH, steps=STEPS[:3],
        ),
        *_slopes(quick),
        Case(
            "ball that slides, then rolls", "contacts", "rolls from 2 v / (7 mu g) on", "m", 1e-3, 1.0, _rolled,
            rolling, "qpos='0 0 .1 1 0 0 0' qvel='2 0 0 0 0 0'", EARTH, estimated=True,
        ),
        *(
            Case(
                f"bullet of 100 m/s at a wall of 1 cm, {kind} contacts", "contacts", "stays before the wall", "m", 2e-3,
                0.01, _beyond, bullet.format(hard), "qvel='100 0 0 0 0 0'", steps=HITS, sample_ns=0,
            )
            for kind, hard in (("default", ""), ("hard", BLOW))
        ),
        Case(
            "bat at 1000 rad/s at a post of 4 cm, hard contacts", "contacts", "stays before the post", "deg", 1.0,
            0.01, _past, bat, "qvel='1000'", steps=HITS, sample_ns=0,
        ),
    ]  # fmt: skip
    for balls in (5, 49):
        found.append(
            Case(
                f"cradle of {balls} balls 2 cm apart", "contacts", "the last one goes on, the rest stands", "m/s", 0.01,
                0.03 * balls + 0.1, _handed_on, _cradle(balls), f"qvel='1 {'0 ' * (balls - 1)}'",
                steps=STEPS[:2] if quick else STEPS[:3] if balls > 5 else STEPS,
            )
        )  # fmt: skip
    return found


def _bouncer(zeta: float) -> str:
    contact = f"solref='-{STIFF} -{2 * zeta * np.sqrt(STIFF)}' solimp='.95 .95 .001' condim='1'"
    return f"""<geom type='plane' size='9 9 1' {contact}/><body name='ball' pos='0 0 {HEIGHT + 0.1}'><freejoint/>
    <geom size='.1' mass='10' {contact}/></body>"""


def _height(course: Course) -> float:
    """By its energy while it flies: how far off it would fly."""
    z = course.pose[:, 0, 2] - 0.1
    return float(np.abs(z + course.twist[:, 0, 2] ** 2 / (2 * G) - HEIGHT)[z > 0].max())


def _apex(course: Course) -> float:
    t, z = course.t, course.pose[:, 0, 2] - 0.1
    apex = z[t > 1.1 * np.sqrt(2 * HEIGHT / G)].max()
    return float(abs(apex - RESTITUTION**2 * HEIGHT))


def _rest(course: Course) -> float:
    """When its speed is last above what it has between the 16th and the 17th bounce."""
    fall, speed = np.sqrt(2 * HEIGHT / G), np.sqrt(2 * G * HEIGHT)
    expected = fall * (1 + 2 * np.sum(RESTITUTION ** np.arange(1, 17)))
    fast = np.abs(course.twist[:, 0, 2]) > speed * RESTITUTION**16.5
    return float(abs(course.t[fast][-1] - expected))


def _slopes(quick: bool) -> list[Case]:
    found = []
    plane = """<geom type='plane' size='99 99 1' friction='.5 0 0'/><body name='block' pos='0 0 .1'>
    <joint type='slide' axis='1 0 0'/><joint type='slide' axis='0 0 1'/>
    <geom type='box' size='.1 .1 .1' mass='1' friction='.5 0 0'/></body>"""
    for degrees, truth, kind, option in (
        (20, "stays", "", ""),
        (20, "stays", ", elliptic, impratio 100", "cone='elliptic' impratio='100'"),
        (30, "a = g (sin - mu cos)", "", ""),
    ):
        slope = np.radians(degrees)
        pull = max(0.0, float(np.sin(slope) - 0.5 * np.cos(slope))) * G
        gravity = f"gravity='{G * np.sin(slope)} 0 {-G * np.cos(slope)}' {option}"
        found.append(
            Case(
                f"block on a slope of {degrees} degrees, mu 0.5{kind}", "contacts", truth, "m", 1e-3,
                0.5 if quick else 2.0, _slid(pull), plane, option=gravity, steps=STEPS[:3], estimated=degrees == 30,
            )
        )  # fmt: skip
    return found


def _slid(pull: float) -> Callable[[Course], float]:
    def error(course: Course) -> float:
        return float(np.abs(course.pose[:, 0, 0] - pull * course.t**2 / 2).max())

    return error


def _rolled(course: Course) -> float:
    t, drag = course.t, 0.2 * G
    change = 2 * 2.0 / (7 * drag)
    slides = np.minimum(t, change)
    expected = 2 * slides - drag * slides**2 / 2 + 10 / 7 * np.maximum(t - change, 0)
    return float(np.abs(course.pose[:, 0, 0] - expected).max())


def _beyond(course: Course) -> float:
    return max(0.0, float(course.pose[:, 0, 0].max()) - (FACE - RADIUS))


def _past(course: Course) -> float:
    return max(0.0, float(np.degrees(course.qpos[:, 0].max() - REACH)))


def _cradle(balls: int) -> str:
    contact = f"solref='-{STIFF} 0' solimp='.95 .95 .001' condim='1'"
    ball = f"<joint type='slide' axis='1 0 0'/><geom size='.1' mass='1' {contact}/>"
    return "".join(f"<body pos='{0.22 * n} 0 0'>{ball}</body>" for n in range(balls))


def _handed_on(course: Course) -> float:
    found = course.twist[-1, :, 0]
    return float(np.abs(found - np.eye(len(found))[-1]).max())
