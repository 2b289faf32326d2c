"""Draws the picture that `render` returns: the camera's picture with the events of the step in it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from evis.env.observations import display
from evis.gpu.host_copies import host_array
from evis.media.pictures.event_pictures import ON_BLACK

LEAST_PX = 256
"""Small images are enlarged by a whole number to at least this many rows."""
EXPOSURE = 0.5
RENDER_MODE = "rgb_array"
"""The one of Gymnasium's modes that there is."""


def is_drawn(render_mode: str | None) -> bool:
    """Tells whether an environment of this render_mode paints pictures. Raises ValueError for one that is not there."""
    if render_mode not in (None, RENDER_MODE):
        raise ValueError(f"render_mode is {render_mode!r}; it must be {RENDER_MODE} or None")
    return render_mode is not None


class Painter:
    """Paints the last step of any environment."""

    def __init__(self) -> None:
        self._steps: dict[int, Any] = {}
        """Environment -> the last step that has something of it."""

    def take(self, step: Any, fresh: np.ndarray) -> None:
        """Keeps a step of the environments bool [E] `fresh`, which is painted only when somebody looks."""
        self._steps.update(dict.fromkeys(np.flatnonzero(fresh).tolist(), step))

    def steps(self) -> dict[int, Any]:
        """Gives the steps that pictures are made of, by environment."""
        return dict(self._steps)

    def restore(self, steps: Mapping[int, Any]) -> None:
        """Paints these steps from now on."""
        self._steps = dict(steps)

    def picture(self, env: int) -> np.ndarray:
        """Returns the picture uint8 [H, W, 3]. Raises ValueError before the first reset."""
        if env not in self._steps:
            raise ValueError("there is nothing to render before reset")
        step = self._steps[env]
        light = host_array(step.keyframe)[env]
        image = display(light if light.ndim == 3 else np.repeat(light[..., None], 3, axis=-1), EXPOSURE)
        events = step.events
        if events is not None:
            x, y, p, offsets = (host_array(a) for a in (events.x, events.y, events.p, events.env_offsets))
            own = slice(int(offsets[env]), int(offsets[env + 1]))
            image[y[own], x[own]] = np.where(p[own, None] > 0, ON_BLACK.on, ON_BLACK.off)
        scale = -(-LEAST_PX // image.shape[0])
        return image.repeat(scale, axis=0).repeat(scale, axis=1)
