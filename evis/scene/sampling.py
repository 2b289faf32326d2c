"""What in a scene is too fast for the frames that it is seen in: such things look slower than they are, or still."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from evis.scene.model import Scene
from evis.scene.motion import Prescribed, Sinusoid, Swing

LOOKED_AT_S = np.linspace(0.0, 1.0, 257)
"""Times at which rotations are looked at [s]."""

ENOUGH = 8
"""Frames per period that are enough for most purposes."""


def undersampled(scene: Scene, frame_rate: float) -> list[str]:
    """A line for each light and each body of prescribed motion that frames at `frame_rate` [Hz] show falsely.

    Two frames per period are too few (Nyquist), and so is a frame per half turn. What a physics engine moves is not
    known beforehand.
    """
    frames = f"frames come at {frame_rate:g} Hz"
    found: list[tuple[str, float]] = []
    for light in scene.lights:
        if light.waveform is not None and light.waveform.depth and 2 * light.waveform.frequency >= frame_rate:
            found.append(
                (f"light '{light.name}' flickers at {light.waveform.frequency:g} Hz", light.waveform.frequency)
            )
    for body in scene.bodies:
        if isinstance(body.trajectory, Prescribed):
            fastest = max(_half_turns(body.trajectory), default=0.0)
            if fastest >= frame_rate:
                what = f"body '{body.name}' makes {fastest / 2:.4g} turns or swings per second"
                found.append((what, fastest / 2))
    return [
        f"{what} and {frames}, which show something slower or nothing; {ENOUGH * frequency:.4g} Hz would do "
        "(keyframe_rate x upsampling)"
        for what, frequency in found
    ]


def _half_turns(path: Prescribed) -> Iterator[float]:
    """Per second, or half periods of what swings, for each of the body's own motions."""
    for motion in (*path.shifts, *path.turns):
        if isinstance(motion, (Sinusoid, Swing)):
            yield 2 * abs(motion.frequency) if np.any(motion.amplitude) else 0.0
    for turn in path.turns:
        yield float(np.abs(turn.turn(LOOKED_AT_S)[1]).max()) / np.pi
