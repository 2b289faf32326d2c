"""Where the hinges and slides of a model start: drawn by the seed of the environment and the number of its episode."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from evis.scene.model import JointStart


def start_joints(model: Any, data: Any, starts: Mapping[str, JointStart], seed: int, episode: int) -> None:
    """Draws positions and velocities of joints and writes them into `data`.

    Each joint has a stream of its own, keyed by its name, so that what is drawn of one does not hang on the others.

    Args:
        model: MjModel.
        data: MjData at the start of an episode.
        starts: bounds by joint.
        seed: of the environment.
        episode: number of the environment's episode.
    """
    for name, start in starts.items():
        # The upper half of the counter's last word is 1 here and 0 for free bodies, which start from counter 0.
        stream = np.random.Philox(key=[seed, episode], counter=[0, 0, 0, (1 << 32) | zlib.crc32(name.encode())])
        position, velocity = np.random.Generator(stream).random(2)
        joint = model.joint(name)
        if start.position is not None:
            data.qpos[joint.qposadr[0]] = start.position[0] + position * (start.position[1] - start.position[0])
        if start.velocity is not None:
            data.qvel[joint.dofadr[0]] = start.velocity[0] + velocity * (start.velocity[1] - start.velocity[0])
