"""Renders the same scene with MuJoCo Warp's batch renderer: rays on the CPU or a GPU (`pip install 'evis[gpu]'`)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import warp as wp

from bench.renderer.mujoco import compiled
from evis.scene.model import Scene


def tracing(scene: Scene, poses: np.ndarray, image: str, device: str, worlds: int = 1) -> Callable[[], None] | None:
    """Makes a function that refits the tree and draws `image`, radiance or depth, of `worlds` copies of a scene.

    None where MuJoCo Warp is not installed. 8-bit colour with true shadows, without ambient light.
    """
    try:
        import mujoco
        import mujoco_warp as mjw
    except ImportError:
        return None
    model = compiled(scene, poses)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = scene.cameras[0]
    with wp.ScopedDevice(device):
        m, d = mjw.put_model(model), mjw.put_data(model, data, nworld=worlds)
        context = mjw.create_render_context(
            model, nworld=worlds, cam_res=(camera.width, camera.height), render_rgb=image == "radiance",
            render_depth=image == "depth", use_shadows=True, shadow_light_fraction=0.0, use_ambient_lighting=False,
        )  # fmt: skip

    def draw() -> None:
        with wp.ScopedDevice(device):
            mjw.refit_bvh(m, d, context)
            mjw.render(m, d, context)

    return draw
