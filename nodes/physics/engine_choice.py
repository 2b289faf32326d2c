"""Which engine moves a MuJoCo model: MuJoCo, or MuJoCo Warp on a GPU."""

from __future__ import annotations

from importlib.util import find_spec

FROM_ENVS = 64
"""Environments from which on a GPU takes their steps sooner than the threads of a CPU."""


def on_device(asked: str, device: str, envs: int) -> bool:
    """Tells whether MuJoCo Warp is to be tried. asked: `auto`, `mujoco` or `mujoco_warp`. device: Warp's name of it."""
    if asked == "auto":
        return device.startswith("cuda") and envs >= FROM_ENVS and find_spec("mujoco_warp") is not None
    return asked == "mujoco_warp"
