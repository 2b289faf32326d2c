"""Describes what a caller may ask of `rigid`, and how the sub-frames of a gap are shared out because of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from evis.scene.model import Camera, Scene, Waveform

if TYPE_CHECKING:
    from nodes.renderer.paths.paths import PathOptions

TOLERANCE = 0.1
"""Difference of log radiance between the keyframes up to which light is taken to change evenly: half the contrast
threshold of common sensors."""

STEP_PX = 1.0
"""Path [px] between two samples of a pixel, where lists are of the host; on a GPU they cost more than they save."""

MANY_FRAMES = 16
"""Frames of a gap from which on details finer than pixels count: of fewer, events are further off because of the time
between frames, and what details cost for each keyframe is shared by fewer frames."""

EVER = 1.0e9
"""Path [px] that is longer than any."""

MOST_WAVEFORMS = {False: 4, True: 8}
"""Waveforms of lights that flicker up to which keyframes are shaded once for each, by whether single pixels are looked
at between the frames: with more, keyframes take longer than shading anew what is seen between them."""

CPU_PIXELS, GPU_PIXELS = 1 << 21, 1 << 25
"""Pixels of the sub-frames that are worked on at once: what caches hold, and memory."""

LEAST_ON_LINES = 8
"""Fewest sub-frames of a portion where there are lines between samples, which end with it."""


@dataclass(frozen=True)
class RigidOptions:
    """Holds the options of `rigid` besides sizes."""

    light_samples: int = 16
    """The renderer's shadow rays for an area light, with its `paths`."""
    paths: PathOptions | None = None
    tolerance: float = TOLERANCE
    """Error of log radiance that is looked for and shaded away."""
    single: bool = False
    """Whether single pixels are looked at between the frames: then all frames are there at once, and none of their
    pixels is on a line between two others."""
    on_device: bool | None = None
    """Whether all is decided on the device, and every pixel of every sub-frame looked up, None: for a GPU; otherwise
    by lists that the host divides, and where little moves some sub-frames are lines between two others."""


@dataclass(frozen=True)
class Layout:
    """Says in which portions the sub-frames of a gap are made, and how their pixels are.

    envs: E. upsampling: K. channels: 1 or 3. portions: sub-frames, counted from 1, in the slots of each portion; the
    first begins with keyframe B itself, so that its z-buffer is there for all the others. step: path [px] between two
    samples of a pixel, 0 = all are looked up. tolerance: of log radiance. on_device: see RigidOptions. flicker: whether
    lights do. waveforms: of those that flicker, none where they are more than MOST_WAVEFORMS. single: see RigidOptions.
    """

    envs: int
    upsampling: int
    channels: int
    portions: list[list[int]]
    step: float
    tolerance: float
    on_device: bool
    flicker: bool
    waveforms: tuple[Waveform, ...]
    single: bool = False

    @property
    def detailed(self) -> bool:
        """Tells whether frames are so close together that what is finer than a keyframe's pixels counts."""
        return self.single or self.upsampling >= MANY_FRAMES

    @property
    def pace(self) -> float:
        """Gives the path [px] per frame from which on details finer than pixels do not matter: events between frames
        that are further apart than these are off for that reason."""
        return EVER if self.single else 1.0

    @property
    def slots(self) -> int:
        """Gives what is drawn at once: sub-frames of a portion, at most."""
        return len(self.shown[0])

    @property
    def shown(self) -> list[list[int]]:
        """Gives the sub-frame, counted from 0, of each slot of each portion; those left over repeat the last one."""
        longest = len(self.portions[0])
        return [[part[min(s, len(part) - 1)] - 1 for s in range(longest)] for part in self.portions]

    @property
    def ratio(self) -> float:
        """Gives the ratio of the radiance of two samples up to which a line is drawn between them."""
        return float(np.exp(self.tolerance / 2))

    @property
    def waveform_count(self) -> int:
        """Counts the waveforms of lights that flicker whose light is added up; see `log_type`."""
        return len(self.waveforms)

    @property
    def relight(self) -> bool:
        """Tells whether flicker has all but the sky shaded anew."""
        return self.flicker and not self.waveforms


def layout_of(
    scene: Scene, camera: Camera, envs: int, upsampling: int, margin: int, channels: int, cpu: bool, asked: RigidOptions
) -> Layout:
    """Works out the layout of gaps between keyframes of E environments.

    margin: pixels beyond the image on every side. channels: 1 or 3. cpu: whether the device is one.
    """
    pixels = (camera.height + 2 * margin) * (camera.width + 2 * margin)
    waveforms = tuple(dict.fromkeys(light.waveform for light in scene.lights if light.waveform is not None))
    flicker = bool(waveforms)
    if len(waveforms) > MOST_WAVEFORMS[asked.single]:
        waveforms = ()
    on_device = not cpu if asked.on_device is None else asked.on_device
    # Light that flickers is on no line.
    step = 0.0 if flicker or asked.single or on_device else STEP_PX
    # Lines end with a portion, which must not depend on the device or on other environments.
    if asked.single:
        at_once = upsampling
    elif step > 0:
        at_once = max(LEAST_ON_LINES, CPU_PIXELS // pixels)
    else:
        at_once = max(1, (CPU_PIXELS if cpu else GPU_PIXELS) // (envs * pixels))
    slots = -(-upsampling // -(-upsampling // at_once))
    order = [upsampling, *range(1, upsampling)]
    portions = [order[k : k + slots] for k in range(0, upsampling, slots)]
    return Layout(
        envs, upsampling, channels, portions, step, asked.tolerance, on_device, flicker, waveforms, asked.single
    )
