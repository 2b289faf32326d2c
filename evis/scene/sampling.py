"""Finds what in a scene is too fast for the frames that it is seen in: such things look slower than they are, or
still."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from evis.scene.model import Scene, Waveform
from evis.scene.motion import Prescribed, Sinusoid, Swing

LOOKED_AT_S = np.linspace(0.0, 1.0, 257)
"""Times at which rotations are looked at [s]."""

ENOUGH = 8
"""Frames per period from which on a sinusoid keeps nine tenths of its change, at any phase, up to a depth of 0.5."""


SLOW = 0.125
"""Part of a half turn per frame: a body that turns by less at the end of an interval is taken to be slow within it."""

FOLLOWED = 64
"""Periods of a light between two keyframes up to which single pixels are looked at whenever it changes."""

FINEST = 1024
"""Most parts into which the time between two frames is divided by the instants at which single pixels are looked at."""


@dataclass(frozen=True)
class _Fast:
    """Something that is too fast. what: it does; wanted: frames per second that would do; false: its frequency looks
    another one."""

    name: str
    what: str
    frame_rate: float
    wanted: float
    false: bool

    def line(self, where: str = "") -> str:
        loss = "show something slower or nothing" if self.false else "miss a part of its events"
        frames = f"frames come at {self.frame_rate:g} Hz, which {loss}"
        return f"{self.what}{where} and {frames}; {self.wanted:.4g} Hz would do (keyframe_rate x upsampling)"


def undersampled(
    scenes: Scene | Sequence[Scene], frame_rate: float, pixel_rate: float = 0.0, keyframe_rate: float = 0.0
) -> list[str]:
    """Returns a line for each light and each body of prescribed motion that frames at `frame_rate` [Hz] show falsely.

    scenes: one, or those of environments side by side, of which the line tells that in which it is fastest.
    pixel_rate: at which single pixels are seen between frames [Hz], 0 = frames alone. keyframe_rate: of keyframes
    then [Hz]; lights that are slow enough, FOLLOWED, and no shorter than two of the FINEST parts, are seen as they are.

    Lights need ENOUGH frames per period, and two in the shorter part of a square wave; from two frames per period down
    (Nyquist) the frequency is wrong too. So is a rotation's from a frame per half turn down. What a physics engine
    moves is not known beforehand: `Turns` looks at it.
    """
    worlds = [scenes] if isinstance(scenes, Scene) else scenes
    fastest: dict[str, tuple[_Fast, int]] = {}
    seen: set[int] = set()
    for env, scene in enumerate(worlds):
        if id(scene) not in seen:
            seen.add(id(scene))
            for one in _too_fast(scene, frame_rate, pixel_rate, keyframe_rate):
                if one.name not in fastest or one.wanted > fastest[one.name][0].wanted:
                    fastest[one.name] = one, env
    return [one.line(f" in environment {env}" if len(seen) > 1 else "") for one, env in fastest.values()]


def _too_fast(scene: Scene, frame_rate: float, pixel_rate: float, keyframe_rate: float) -> Iterator[_Fast]:
    """What `undersampled` tells of one scene."""
    for light in scene.lights:
        if light.waveform is not None and light.waveform.depth:
            frequency, wanted = light.waveform.frequency, _wanted(light.waveform)
            followed = pixel_rate > frame_rate and frequency <= FOLLOWED * keyframe_rate
            followed = followed and wanted <= FINEST * frame_rate
            if frame_rate < wanted and not followed:
                name = f"light '{light.name}'"
                what = f"{name} flickers at {frequency:g} Hz"
                yield _Fast(name, what, frame_rate, wanted, 2 * frequency >= frame_rate)
    rate = max(frame_rate, pixel_rate)
    for body in scene.bodies:
        if isinstance(body.trajectory, Prescribed):
            fastest = max(_half_turns(body.trajectory), default=0.0)
            if fastest >= rate:
                name = f"body '{body.name}'"
                what = f"{name} makes {fastest / 2:.4g} turns or swings per second"
                yield _Fast(name, what, rate, ENOUGH * fastest / 2, True)


class Turns:
    """Notices bodies that a physics engine turns too fast for frames at `frame_rate` [Hz]; 0 = any is fast enough."""

    def __init__(self, scene: Scene, frame_rate: float) -> None:
        self._names = [body.name for body in scene.bodies]
        self._rate = frame_rate
        self._watched = np.array([not isinstance(body.trajectory, Prescribed) for body in scene.bodies], bool)

    def too_fast(self, moving: np.ndarray, twist: np.ndarray) -> list[str]:
        """Returns a line for each body that turns half about within a frame, once for each.

        moving: int [B], bodies, and twist float64 [E, S, B, 6], theirs, as of WorldState. Where all are slower than
        SLOW at the end of the interval the states within it are not looked at.
        """
        if not self._rate or not self._watched[moving].any():
            return []
        # What turns so fast does so for longer than an interval, so that most are told by its end alone.
        end = twist[:, -1, :, 3:]
        if np.abs(end).max(initial=0.0) * np.sqrt(3.0) < SLOW * np.pi * self._rate:
            return []
        omega = twist[..., 3:]
        half_turns = np.sqrt(np.einsum("...i,...i", omega, omega).max(axis=(0, 1))) / np.pi
        lines = []
        for body, fastest in zip(moving.tolist(), half_turns.tolist()):
            if fastest >= self._rate and self._watched[body]:
                self._watched[body] = False
                name = f"body '{self._names[body]}'"
                what = f"{name} makes {fastest / 2:.4g} turns per second"
                lines.append(_Fast(name, what, self._rate, ENOUGH * fastest / 2, True).line())
        return lines


def _wanted(wave: Waveform) -> float:
    """Frames per second."""
    shorter = min(wave.duty, 1 - wave.duty) if wave.kind == "square" else 0.5
    return wave.frequency * max(ENOUGH, 2 / shorter)


def _half_turns(path: Prescribed) -> Iterator[float]:
    """Per second, or half periods of what swings, for each of the body's own motions."""
    for motion in (*path.shifts, *path.turns):
        if isinstance(motion, (Sinusoid, Swing)):
            yield 2 * abs(motion.frequency) if np.any(motion.amplitude) else 0.0
    for turn in path.turns:
        yield float(np.abs(turn.turn(LOOKED_AT_S)[1]).max()) / np.pi
