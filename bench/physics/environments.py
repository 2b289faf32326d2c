"""Measures the milliseconds per keyframe of many environments of a MuJoCo scene, by threads and by engine.

    python -m bench.physics.environments [falling_objects robot_arm] [--envs 64] [--threads 1,2] [--device cuda]

The runs of one scene take turns, keyframe by keyframe, so that what else the machine does meets all of them.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from itertools import product

import numpy as np

from bench import command
from evis.scene import load_scene
from nodes.physics.dynamics.batch.unsupported import Unsupported
from nodes.physics.engines.mujoco_engine import MujocoEngine

KEYFRAMES, COUNTED = 40, 20
"""Keyframes of 1/30 s, of which the last COUNTED count: things lie on each other by then."""
HEAD = """| scene | environments | engine | ms a keyframe: min | median | max | environment-s/s |
|---|---|---|---|---|---|---|"""


def rows(scene: str, envs: int, threads: list[int], device: str | None, keyframes: int) -> list[str]:
    """Times a scene; returns the rows of a table.

    threads: numbers of them with which MuJoCo runs. device: that of MuJoCo Warp, None = without it. Raises ValueError
    for a scene without a MuJoCo model, Unsupported where MuJoCo Warp is not installed or cannot take the model.
    """
    loaded = load_scene(scene, visuals=False)
    if not loaded.dynamic:
        raise ValueError(f"scene {scene} has no MuJoCo model: its bodies move in closed form; name one that has")
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


def main(argv: Sequence[str] | None = None) -> None:
    """Runs the command line."""
    parser = command.parser_of("bench.physics.environments", __doc__ or "")
    parser.add_argument("scenes", nargs="*", default=["falling_objects", "robot_arm"], help="with a MuJoCo model")
    parser.add_argument("--envs", type=_counts, default=[64], metavar="E,...", help="how many, as 64,256; 64")
    threads = "of MuJoCo, as 1,2 (when not given); empty = without it"
    parser.add_argument("--threads", type=_counts, default=[1, 2], metavar="N,...", help=threads)
    parser.add_argument("--device", help="of MuJoCo Warp: cpu, cuda or cuda:N; not given = without it")
    most = f"simulated, {KEYFRAMES} when not given, of which the last {COUNTED} count"
    parser.add_argument("--keyframes", type=command.count, default=KEYFRAMES, metavar="N", help=most)
    given = parser.parse_args(argv)
    if given.device is not None:
        command.check_device(parser, given.device)
    elif not given.threads:
        parser.error("without --threads and without --device there is no engine to measure")
    if not given.envs:
        parser.error("--envs names no number of environments")
    try:
        for i, (scene, envs) in enumerate(product(given.scenes, given.envs)):
            measured = rows(scene, envs, given.threads, given.device, given.keyframes)
            print("\n".join(measured if i else [HEAD, *measured]), flush=True)
    except Unsupported as why:
        parser.exit(1, f"{parser.prog}: MuJoCo Warp cannot take scene {scene}: {why}\n")
    except (ValueError, OSError) as error:
        parser.exit(1, f"{parser.prog}: {error}\n")


def _counts(text: str) -> list[int]:
    return [command.count(word) for word in text.split(",") if word]


if __name__ == "__main__":
    main()
