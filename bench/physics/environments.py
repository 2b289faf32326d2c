"""Measures the milliseconds per keyframe of many environments of a MuJoCo scene, by threads and by engine.

    python -m bench.physics.environments [falling_objects robot_arm] [--envs 64] [--threads 1,2] [--device cuda]

The runs of one scene take turns, keyframe by keyframe, so that what else the machine does meets all of them.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from evis.scene import load_scene
from nodes.physics.mujoco_engine import MujocoEngine

KEYFRAMES, COUNTED = 40, 20
"""Keyframes of 1/30 s, of which the last COUNTED count: things lie on each other by then."""
HEAD = """| scene | environments | engine | ms a keyframe: min | median | max | environment-s/s |
|---|---|---|---|---|---|---|"""


def rows(scene: str, envs: int, threads: list[int], device: str | None, keyframes: int) -> list[str]:
    """Times a scene; returns the rows of a table."""
    loaded = load_scene(scene, visuals=False)
    engines = {f"MuJoCo, {count} threads": MujocoEngine(loaded, 0, envs, threads=count) for count in threads}
    if device is not None:
        engines[f"MuJoCo Warp, {device}"] = MujocoEngine(loaded, 0, envs, warp=device)
    spent: dict[str, list[float]] = {name: [] for name in engines}
    for k in range(1, keyframes + 1):
        for name, engine in engines.items():
            began = time.perf_counter()
            engine.advance(round(k * 1e9 / 30))
            spent[name].append(1e3 * (time.perf_counter() - began))
    found = []
    for name, values in spent.items():
        counted = values[-COUNTED:]
        times = " | ".join(f"{value:.1f}" for value in (min(counted), float(np.median(counted)), max(counted)))
        found.append(f"| {scene} | {envs} | {name} | {times} | {envs / 30 / np.median(counted) * 1e3:.0f} |")
    return found


if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("scenes", nargs="*", default=["falling_objects", "robot_arm"])
    arguments.add_argument("--envs", default="64", help="how many, as 64,256")
    arguments.add_argument("--threads", default="1,2", help="of MuJoCo, as 1,2; empty = without it")
    arguments.add_argument("--device", help="of MuJoCo Warp; not given = without it")
    arguments.add_argument("--keyframes", type=int, default=KEYFRAMES)
    given = arguments.parse_args()
    print(HEAD)
    counts = [int(count) for count in given.threads.split(",") if count]
    for scene in given.scenes:
        for envs in given.envs.split(","):
            print("\n".join(rows(scene, int(envs), counts, given.device, given.keyframes)), flush=True)
