"""Makes the observations of an agent: events as images or as they are, frames, joints, poses, its own last action.

Each says what the simulation must make for it, what its space is, and makes the values of all environments at once.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box

from evis.env.observation import Moment, Observation, Setting
from evis.events import representations
from evis.events.representations.columns import POLARITIES, check_choice, check_flag
from evis.gpu.host_copies import host_array
from evis.media.colour import luminance_of, srgb_from_linear

Block = int | tuple[int, int]
"""Pixels that are put together: a square's side, or rows and columns."""


def pooled(images: np.ndarray, block: Block) -> np.ndarray:
    """Adds up blocks of pixels: [..., H, W] to [..., H / rows, W / columns]."""
    rows, columns = _sides(block)
    *front, height, width = images.shape
    # An array of its own also where nothing is added up.
    return images.reshape(*front, height // rows, rows, width // columns, columns).sum(axis=(-3, -1))


def _sides(block: Block) -> tuple[int, int]:
    sides = np.array(block)
    if sides.dtype.kind not in "iu" or sides.shape not in ((), (2,)):
        raise ValueError(f"pool={block} is neither a side nor rows and columns, in whole pixels")
    rows, columns = np.broadcast_to(sides, 2).tolist()
    return rows, columns


def _pooled_size(block: Block, setting: Setting) -> tuple[int, int]:
    """Computes height and width of what is left when blocks are pooled. Raises ValueError for blocks that do not fill
    the image."""
    rows, columns = _sides(block)
    if min(rows, columns) < 1 or setting.height % rows or setting.width % columns:
        raise ValueError(f"pool={block} does not divide an image of {setting.width} x {setting.height}")
    return setting.height // rows, setting.width // columns


def is_number(value: Any) -> bool:
    """Says whether a value is one real number, of Python or numpy."""
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)


def _check_seen(setting: Setting) -> None:
    """Raises ValueError for a camera that has something only in some of the steps."""
    if setting.apart > 1:
        raise ValueError(
            f"the camera gives something in every {setting.apart}. step alone, at {setting.rate / setting.apart:g} Hz; "
            f"an observation needs it in each, {setting.rate:g} a second: leave its rate (camera_rate) out"
        )


def _check_count(name: str, value: Any) -> None:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
        raise ValueError(f"{name} is {value!r:.60}; it must be a whole number, 1 or more")


@dataclass
class VoxelGrid(Observation):
    """Shows the events of the step in time-interpolated voxels, float32 [bins, H, W], twice the bins with split.

    bins: slices of time. polarity, normalise: as in `evis.events.representations.voxel_grid`. pool: block of pixels
    that are added up.
    """

    bins: int = 5
    polarity: str = "signed"
    normalise: bool = False
    pool: Block = 1
    camera: str = ""

    def begin(self, setting: Setting) -> Box:
        """Implements Observation.begin."""
        _check_seen(setting)
        _check_count("bins", self.bins)
        check_choice("polarity", self.polarity, POLARITIES)
        check_flag("normalise", self.normalise)
        channels = self.bins * (2 if self.polarity == "split" else 1)
        low = -np.inf if self.polarity == "signed" or self.normalise else 0.0
        return Box(low, np.inf, (channels, *_pooled_size(self.pool, setting)), np.float32)

    def values(self, moment: Moment) -> np.ndarray:
        """Implements Observation.values."""
        made = representations.voxel_grid(
            moment.camera(self.camera).events, self.bins, window=(moment.start_ns, moment.stamp_ns),
            polarity=self.polarity, normalise=self.normalise,
        )  # fmt: skip
        return pooled(host_array(made.values), self.pool)


@dataclass
class CountImage(Observation):
    """Shows how many events each pixel had in the step, float32 [2, H, W] (OFF, ON), or [1, H, W] signed or merged.

    pool: block of pixels that are added up.
    """

    polarity: str = "split"
    pool: Block = 1
    camera: str = ""

    def begin(self, setting: Setting) -> Box:
        """Implements Observation.begin."""
        _check_seen(setting)
        check_choice("polarity", self.polarity, POLARITIES)
        low = -np.inf if self.polarity == "signed" else 0.0
        self._shape = (2 if self.polarity == "split" else 1, *_pooled_size(self.pool, setting))
        return Box(low, np.inf, self._shape, np.float32)

    def values(self, moment: Moment) -> np.ndarray:
        """Implements Observation.values."""
        made = representations.count_image(moment.camera(self.camera).events, polarity=self.polarity)
        return pooled(host_array(made.values).astype(np.float32), self.pool).reshape(-1, *self._shape)


@dataclass
class TimeSurface(Observation):
    """Shows how long ago each pixel saw its last event, 1 = now, 0 = never: float32 [2, H, W] (OFF, ON).

    It outlasts the step: what stands still fades with `tau` seconds. pool: block of pixels that are averaged.
    """

    tau: float = 0.1
    pool: Block = 1
    camera: str = ""

    def begin(self, setting: Setting) -> Box:
        """Implements Observation.begin."""
        _check_seen(setting)
        if not is_number(self.tau) or not 0 < self.tau < np.inf:
            raise ValueError(f"tau is {self.tau!r:.60}; it must be a number of seconds above 0")
        self._surface = representations.TimeSurface(max(1, round(self.tau * 1e9)))
        return Box(0.0, 1.0, (2, *_pooled_size(self.pool, setting)), np.float32)

    def forget(self, envs: np.ndarray) -> None:
        """Implements Observation.forget."""
        self._surface.reset(envs)

    def values(self, moment: Moment) -> np.ndarray:
        """Implements Observation.values."""
        made = self._surface.update(moment.camera(self.camera).events, at=moment.stamp_ns)
        return pooled(host_array(made.values), self.pool) / np.float32(np.prod(_sides(self.pool)))


@dataclass
class RawEvents(Observation):
    """Gives the events of the step, int64 [most, 4]: ns before its end, x, y, p; rows of -1 where there are no more.

    most: rows; of more events the latest are given.
    """

    most: int = 4096
    camera: str = ""

    def begin(self, setting: Setting) -> Box:
        """Implements Observation.begin."""
        _check_seen(setting)
        _check_count("most", self.most)
        high = [round(1e9 / setting.rate), setting.width - 1, setting.height - 1, 1]
        return Box(
            np.full((self.most, 4), -1, np.int64), np.tile(np.array(high, np.int64), (self.most, 1)), dtype=np.int64
        )

    def values(self, moment: Moment) -> np.ndarray:
        """Implements Observation.values."""
        events = moment.camera(self.camera).events
        t, x, y, p, offsets = (host_array(a) for a in (events.t, events.x, events.y, events.p, events.env_offsets))
        result = np.full((len(offsets) - 1, self.most, 4), -1, np.int64)
        for env, end in enumerate(offsets[1:]):
            first = max(offsets[env], end - self.most)
            chosen = slice(first, end)
            result[env, : end - first] = np.stack(
                (moment.stamp_ns[env] - t[chosen], x[chosen], y[chosen], p[chosen]), 1
            )
        return result


@dataclass
class Frames(Observation):
    """Shows the picture at the end of the step, uint8 [H, W, 3] sRGB, or [H, W, 1] grey.

    exposure: display white over radiance.
    """

    grey: bool = True
    exposure: float = 0.5
    camera: str = ""
    OUTPUT: ClassVar[str] = "keyframe"

    def begin(self, setting: Setting) -> Box:
        """Implements Observation.begin."""
        _check_seen(setting)
        check_flag("grey", self.grey)
        if not is_number(self.exposure) or not 0 < self.exposure < np.inf:
            raise ValueError(f"exposure is {self.exposure!r:.60}; it must be a number above 0")
        return Box(0, 255, (setting.height, setting.width, 1 if self.grey else 3), np.uint8)

    def values(self, moment: Moment) -> np.ndarray:
        """Implements Observation.values."""
        light = host_array(moment.camera(self.camera).keyframe)
        if self.grey:
            light = (light if light.ndim == 3 else luminance_of(light))[..., None]
        return display(light, self.exposure)


def display(light: np.ndarray, exposure: float) -> np.ndarray:
    """Converts linear light to display values, uint8 of the same shape; exposure: display white over radiance."""
    return np.round(255 * srgb_from_linear(np.clip(light.astype(np.float32) * exposure, 0, 1))).astype(np.uint8)


@dataclass
class Joints(Observation):
    """Gives positions and velocities of all joints in a row, float32 [nq + nv]: rad or m, rad/s or m/s."""

    OUTPUT: ClassVar[str] = "state"
    ARGUMENTS: ClassVar[Mapping[str, Any]] = {"joints": True}

    def begin(self, setting: Setting) -> Box:
        """Implements Observation.begin."""
        return Box(-np.inf, np.inf, (sum(setting.joints),), np.float32)

    def values(self, moment: Moment) -> np.ndarray:
        """Implements Observation.values."""
        state = moment.step.state
        return np.concatenate((state.qpos[:, -1], state.qvel[:, -1]), axis=1).astype(np.float32)


@dataclass
class Poses(Observation):
    """Gives position [m] and quaternion x y z w of bodies in the world, float32 [bodies, 7]; without names, of all."""

    bodies: tuple[str, ...] = ()
    OUTPUT: ClassVar[str] = "state"

    def begin(self, setting: Setting) -> Box:
        """Implements Observation.begin."""
        if isinstance(self.bodies, str):
            raise ValueError(f"bodies is {self.bodies!r:.60}; names come several, as ({self.bodies!r:.60},)")
        chosen = self.bodies or setting.names
        if missing := [name for name in chosen if name not in setting.names]:
            raise ValueError(f"there is no body '{missing[0]}'; there are {', '.join(setting.names)}")
        self._chosen = [setting.names.index(name) for name in chosen]
        return Box(-np.inf, np.inf, (len(chosen), 7), np.float32)

    def values(self, moment: Moment) -> np.ndarray:
        """Implements Observation.values."""
        return moment.step.state.end_pose[:, self._chosen].astype(np.float32)


@dataclass
class LastAction(Observation):
    """Gives the action of the step as the agent gave it, float32 [nu]; after a reset the one nearest to zero.

    An agent whose camera moves needs it to tell its own motion from that of what it sees.
    """

    OUTPUT: ClassVar[str] = "state"

    def begin(self, setting: Setting) -> Box:
        """Implements Observation.begin."""
        return setting.action

    def values(self, moment: Moment) -> np.ndarray:
        """Implements Observation.values."""
        return moment.actions.copy()
