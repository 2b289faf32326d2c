"""A puck that falls and a cart that is pushed, in several environments, and what is told of one of them."""

from pathlib import Path

import numpy as np

from evis.scene import load_scene
from nodes.physics.engines.mujoco_engine import MujocoEngine
from nodes.physics.interval import Extras, Interval

SLIDE = """<mujoco><option timestep="0.001" {option}/><worldbody>
<geom type="plane" size="3 3 .1"/><body name="puck" pos="0 0 {height}"><freejoint/><geom size=".1" mass="1"/></body>
<body name="cart" pos="0 2 1"><joint name="rail" type="slide" axis="1 0 0"/><geom size=".1" mass="1"/></body>
</worldbody><actuator><motor joint="rail"/></actuator></mujoco>"""


def told(interval: Interval, env: int) -> tuple:
    """What is told of one environment, as bytes and texts."""
    arrays = (interval.end_pose[env], interval.pose[env], interval.twist[env], interval.qpos[env], interval.qvel[env])
    found = interval.contacts
    fields = {} if found is None else vars(found)
    touched = [values[found.env == env].tobytes() for name, values in fields.items() if name != "env"]
    texts = [[text for k, text in lines if k == env] for lines in (interval.faults, interval.warnings)]
    return tuple(a.tobytes() for a in arrays), touched, texts


def engine_of(
    folder: Path,
    envs: int,
    threads: int = 1,
    seed: int = 3,
    warp: str | None = None,
    contacts: bool = True,
    **world: object,
) -> MujocoEngine:
    text = SLIDE.format(**{"option": "integrator='Euler'", "height": 0.3} | world)
    (folder / "m.xml").write_text(text)
    scene = load_scene(str(folder / "m.xml"), visuals=False)
    return MujocoEngine(scene, seed, envs, threads=threads, warp=warp, extras=Extras(joints=True, contacts=contacts))


def controls(k: int, envs: int) -> np.ndarray:
    return np.sin(k + np.arange(envs))[:, None]
