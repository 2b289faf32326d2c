"""Describes frames as the kernels take them, and the number of their pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp


@dataclass(frozen=True)
class SampleLists:
    """Holds further samples between the frames, on the sensor's device, see further.Further; `first` counts lists.

    A list is that of `shared` neighbouring pixels and channels: entry i has the values value[i shared] and after.
    found, told: int64 [1], what further.checked has found, on the sensor's device and where the host can read it.
    """

    first: wp.array
    offset: wp.array
    value: wp.array
    shared: int
    found: wp.array | None = None
    told: wp.array | None = None


@dataclass
class Batch:
    """Holds the frames of a message. images, slopes: [E, frames, H, W, C]; the first `count` settle now.

    t: int64 [frames]. t_base, t_before: the stamp before t[0] and the one before that. begin: int32 [E], bit k set
    where frame k (0 or 1) begins an episode. episodes: int32 [2, E], of frame 0 and of the later ones. These three are
    of numpy (or rows of it); after `on` they are Warp arrays, and images and slopes are flat. further: samples between
    the frames, from t_base on.
    """

    images: wp.array
    slopes: wp.array
    t: Any
    frames: int
    count: int
    t_base: int
    t_before: int
    begin: Any
    episodes: Any
    further: SampleLists | None = None

    def on(self, device: Any) -> Batch:
        """Gives the same batch with all its arrays on the device."""

        def there(values: np.ndarray, dtype: Any) -> wp.array:
            return wp.array(np.ascontiguousarray(values), dtype=dtype, device=device, copy=False)

        return replace(
            self,
            images=self.images.flatten(),
            slopes=self.slopes.flatten(),
            t=there(self.t, wp.int64),
            begin=there(self.begin.astype(np.int32), wp.int32),
            episodes=there(np.stack(self.episodes), wp.int32),
        )


@dataclass(frozen=True)
class Size:
    """Describes the size of the images of all environments."""

    height: int
    width: int
    channels: int
    envs: int

    @property
    def pixels(self) -> int:
        """Counts the pixels of one environment, and their channels."""
        return self.height * self.width * self.channels

    def threads(self, cuda: bool) -> tuple[int, ...]:
        """Gives the launch size: a thread per row on a CPU, per pixel and channel on a GPU."""
        return (self.envs, self.height, self.width * self.channels) if cuda else (self.envs, self.height)
