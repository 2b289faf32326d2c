"""Worlds that are hard to step, their courses at any step, and how far courses are apart."""

from pathlib import Path

import numpy as np
from engine_arguments import grouped

from evis.geometry import se3
from evis.scene import load_scene
from nodes.physics.engines.mujoco_engine import MujocoEngine
from nodes.physics.precision.errors import Errors

FREE = "contype='0' conaffinity='0'"
RACKET = f"""<body name='racket'><freejoint/><inertial pos='0 0 0' mass='.3' diaginertia='.001 .002 .003'/>
<geom type='box' size='.1 .15 .01' {FREE}/></body>"""
ROCK = "<body name='rock' pos='0 0 50'><freejoint/><geom size='.1' mass='1'/></body>"
PENDULUM = (
    f"<body name='bob'><joint axis='0 1 0'/><geom type='capsule' fromto='0 0 0 .5 0 0' size='.02' {FREE}/></body>"
)
SPRING = (
    "<body name='mass'><joint type='slide' axis='1 0 0' stiffness='{}' springref='.01'/>"
    "<geom size='.1' mass='1'/></body>"
)


def chain(links: int) -> str:
    """A metre of links, held at one end, at first level."""
    long = 1 / links
    parts = [
        f"<body name='link{k}' pos='{long * (k > 0)} 0 0'><joint axis='0 1 0'/>"
        f"<geom type='capsule' fromto='0 0 0 {long} 0 0' size='.004' mass='.01' {FREE}/>"
        for k in range(links)
    ]
    return "".join(parts) + "</body>" * links


def course(folder: Path, world: str, seconds: float, integrator: str = "Euler", spin: str = "", **given):
    """The engine and the poses [keyframes, bodies, 7] of a run at 30 keyframes a second."""
    start = f"<keyframe><key name='home' qvel='0 0 0 {spin}'/></keyframe>" if spin else ""
    gravity = "0 0 0" if spin else "0 0 -9.81"
    option = f"<option timestep='.001' integrator='{integrator}' gravity='{gravity}'/>"
    (folder / "m.xml").write_text(f"<mujoco>{option}<worldbody>{world}</worldbody>{start}</mujoco>")
    engine = MujocoEngine(load_scene(str(folder / "m.xml"), visuals=False), **grouped(**given))
    stamps = [round(k * 1e9 / 30) for k in range(1, round(30 * seconds) + 1)]
    return engine, np.array([engine.advance(t).end_pose[0, : engine.model.nbody - 1] for t in stamps])


def apart(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances [m] and angles [rad] between poses."""
    turn = se3.multiply(se3.conjugate(a[..., 3:]), b[..., 3:])
    angle = 2 * np.arctan2(np.linalg.norm(turn[..., :3], axis=-1), np.abs(turn[..., 3]))
    return np.linalg.norm(a[..., :3] - b[..., :3], axis=-1), angle


def told(errors: Errors):
    worst = errors.worst()
    assert worst is not None
    return worst
