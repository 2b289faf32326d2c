"""Holds the last frame back until the next one, for crossing methods whose curve needs the frame after a step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from evis.gpu.saved_arrays import saved


@dataclass
class Held:
    """Holds a frame back until the next one is there.

    begins: bool [E], environments whose episode it begins. episodes: int32 [E].
    """

    images: wp.array
    stamp: int
    begins: np.ndarray
    episodes: np.ndarray


class LookAhead:
    """Holds back the last frame of `envs` sensors with `size` samples each; `held` is None before the first frame."""

    def __init__(self, envs: int, size: int, device: Any) -> None:
        self._envs, self._size, self._device = envs, size, device
        self.held: Held | None = None

    def state(self) -> dict[str, Any]:
        """Gives the frame that is held back, as plain values; empty without one."""
        if self.held is None:
            return {}
        held = self.held
        kept = {"stamp": held.stamp, "begins": np.array(held.begins), "episodes": np.array(held.episodes)}
        return {**kept, **saved({"images": held.images})}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Holds back the frame of a state."""
        self.held = None
        if state:
            images: wp.array = wp.array(state["images"], dtype=wp.float32, device=self._device)
            begins, episodes = np.array(state["begins"], bool), np.array(state["episodes"], np.int32)
            self.held = Held(images, int(state["stamp"]), begins, episodes)

    def release(self) -> Held | None:
        """Gives the frame that was held back, and holds none any more."""
        held, self.held = self.held, None
        return held

    def join(
        self, images: wp.array, t: np.ndarray, fresh: np.ndarray, episodes: np.ndarray
    ) -> tuple[wp.array, np.ndarray, list[np.ndarray], list[np.ndarray]]:
        """Joins the frame that was held back with new ones, and holds the last of these back.

        images: float32, E x K x size samples. t: int64 [K] ns. fresh: bool [E], where the first new frame begins an
        episode; episodes: int32 [E]. Returns images, stamps, and for each of the first frames fresh and episodes.
        """
        old, begins, of = self.held, [fresh], [episodes]
        if old is not None:
            begins, of = [old.begins, fresh], [old.episodes, episodes]
            t = np.concatenate(([old.stamp], t))
        new = images.reshape((self._envs, -1, self._size))
        rest = begins[len(t) - 1] if len(t) <= len(begins) else np.zeros(self._envs, bool)
        last: wp.array = wp.empty((self._envs, self._size), dtype=wp.float32, device=self._device)
        _copy(last, new[:, -1])
        self.held = Held(last, int(t[-1]), rest, of[-1])
        if old is not None:
            joined: wp.array = wp.empty((self._envs, len(t), self._size), dtype=wp.float32, device=self._device)
            _copy(joined[:, 0], old.images)
            _copy(joined[:, 1:], new)
            images = joined
        return images, t, begins, of


def _copy(to: wp.array, source: wp.array) -> None:
    """Copies between arrays of one device, which may be slices; numpy moves whole rows where it can."""
    if wp.get_device(to.device).is_cuda:
        wp.copy(to, source)
    else:
        to.numpy()[...] = source.numpy()
