"""Puts environments of a model to their start: the scene's keyframe, perturbed by seed and number of the episode."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from evis.geometry import se3
from evis.scene.mjcf.changes import apply_start
from evis.scene.model import JointStart, Scene


def put_to_start(scene: Scene, model: Any, data: Any, seed: int, episode: int) -> None:
    """Writes the start of an environment's episode into `data`.

    Args:
        scene: says at which keyframe of the model, and how far free bodies and joints may be from there.
        model: MjModel of the scene.
        data: MjData of the environment.
        seed: of the environment.
        episode: number of the episode, since the environment got its seed.
    """
    if scene.keyframe >= 0:
        mujoco.mj_resetDataKeyframe(model, data, scene.keyframe)
    else:
        mujoco.mj_resetData(model, data)
    apply_start(model, data, scene.changes)
    spread, turn = scene.initial_spread
    random = np.random.Generator(np.random.Philox(key=[seed % 2**64, episode]))
    for joint in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE):
        shift, rotation = random.standard_normal((2, 3))
        at = model.jnt_qposadr[joint]
        data.qpos[at : at + 3] += spread * shift
        q = se3.from_mujoco(data.qpos[at + 3 : at + 7])
        data.qpos[at + 3 : at + 7] = se3.to_mujoco(se3.multiply(se3.exp(turn * rotation), q))
    start_joints(model, data, scene.initial_joints, seed % 2**64, episode)
    mujoco.mj_forward(model, data)


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
