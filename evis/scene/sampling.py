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

NAMED = 3
"""Other lights or bodies that a line names beside the fastest; it counts the rest."""

FINEST = 1024
"""Most parts into which the time between two frames is divided by the instants at which single pixels are looked at."""

LONGEST_GAP_NS = 1 << 31
"""Time between two keyframes [ns] from which on no pixel is looked at between frames: samples count it in int32."""


def too_far_apart(keyframe_rate: float) -> bool:
    """Tells whether keyframes at a rate [Hz], 0 = unknown, are too far apart to look at single pixels between them."""
    return keyframe_rate > 0 and 1e9 / keyframe_rate >= LONGEST_GAP_NS


@dataclass(frozen=True)
class _Fast:
    """Something that is too fast. kind: light or body; what: it does; wanted: frames per second that would do; false:
    its frequency looks another one."""

    kind: str
    name: str
    what: str
    frame_rate: float
    wanted: float
    false: bool

    def line(self, where: str = "") -> str:
        """Words the warning about it; where: it is, behind what it does."""
        loss = "show something slower or nothing" if self.false else "miss a part of its events"
        frames = f"frames come at {self.frame_rate:g} Hz, which {loss}"
        does = f"{self.kind} '{self.name}' {self.what}{where}"
        return f"{does} and {frames}; {self.wanted:.4g} Hz would do (keyframe_rate x upsampling)"


def _lines(found: Sequence[tuple[_Fast, str]]) -> list[str]:
    """Makes one line of all lights, or all bodies, that lose the same, each with words for where it is: a hall has
    hundreds of lamps on one mains. It tells of the fastest, whose remedy does for the others, and names them."""
    alike: dict[tuple[str, bool], list[tuple[_Fast, str]]] = {}
    for one, where in found:
        alike.setdefault((one.kind, one.false), []).append((one, where))
    lines = []
    for (kind, _), some in alike.items():
        fastest, where = max(some, key=lambda each: each[0].wanted)
        others = [f"'{one.name}'" for one, _ in some if one is not fastest]
        kinds = kind if len(others) == 1 else {"light": "lights", "body": "bodies"}[kind]
        names = ", ".join(others[:NAMED]) + (", ..." if len(others) > NAMED else "")
        more = f", for {len(others)} other {kinds} too: {names}" if others else ""
        lines.append(fastest.line(where) + more)
    return lines


def undersampled(
    scenes: Scene | Sequence[Scene], frame_rate: float, pixel_rate: float = 0.0, keyframe_rate: float = 0.0
) -> list[str]:
    """Returns lines on the lights and the bodies of prescribed motion that frames at `frame_rate` [Hz] show falsely.

    scenes: one, or those of environments side by side, of which a line tells that in which a thing is fastest.
    pixel_rate: at which single pixels are seen between frames [Hz], 0 = frames alone. keyframe_rate: of keyframes
    then [Hz]; lights that are slow enough, FOLLOWED, and no shorter than two of the FINEST parts, are seen as they are.

    Lights need ENOUGH frames per period, and two in the shorter part of a square wave; from two frames per period down
    (Nyquist) the frequency is wrong too. So is a rotation's from a frame per half turn down. What a physics engine
    moves is not known beforehand: `Turns` looks at it.
    """
    worlds = [scenes] if isinstance(scenes, Scene) else scenes
    fastest: dict[tuple[str, str], tuple[_Fast, int]] = {}
    seen: set[int] = set()
    for env, scene in enumerate(worlds):
        if id(scene) not in seen:
            seen.add(id(scene))
            for one in _too_fast(scene, frame_rate, pixel_rate, keyframe_rate):
                thing = one.kind, one.name
                if thing not in fastest or one.wanted > fastest[thing][0].wanted:
                    fastest[thing] = one, env
    return _lines([(one, f" in environment {env}" if len(seen) > 1 else "") for one, env in fastest.values()])


def _too_fast(scene: Scene, frame_rate: float, pixel_rate: float, keyframe_rate: float) -> Iterator[_Fast]:
    """What `undersampled` tells of one scene."""
    if too_far_apart(keyframe_rate):
        pixel_rate = 0.0
    for light in scene.lights:
        if light.waveform is not None and light.waveform.depth:
            frequency, wanted = light.waveform.frequency, _wanted(light.waveform)
            followed = pixel_rate > frame_rate and frequency <= FOLLOWED * keyframe_rate
            followed = followed and wanted <= FINEST * frame_rate
            if frame_rate < wanted and not followed:
                what = f"flickers at {frequency:g} Hz"
                yield _Fast("light", light.name, what, frame_rate, wanted, 2 * frequency >= frame_rate)
    rate = max(frame_rate, pixel_rate)
    for body in scene.bodies:
        if isinstance(body.trajectory, Prescribed):
            fastest = max(_half_turns(body.trajectory), default=0.0)
            if fastest >= rate:
                what = f"makes {fastest / 2:.4g} turns or swings per second"
                yield _Fast("body", body.name, what, rate, ENOUGH * fastest / 2, True)


class Turns:
    """Notices bodies that a physics engine turns too fast for frames at `frame_rate` [Hz]; 0 = any is fast enough."""

    def __init__(self, scene: Scene, frame_rate: float) -> None:
        self._names = [body.name for body in scene.bodies]
        self._rate = frame_rate
        self._watched = np.array([not isinstance(body.trajectory, Prescribed) for body in scene.bodies], bool)

    def too_fast(self, moving: np.ndarray, twist: np.ndarray) -> list[str]:
        """Returns a line on the bodies that turn half about within a frame; each body is in one once.

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
        found = []
        for body, fastest in zip(moving.tolist(), half_turns.tolist()):
            if fastest >= self._rate and self._watched[body]:
                self._watched[body] = False
                what = f"makes {fastest / 2:.4g} turns per second"
                found.append((_Fast("body", self._names[body], what, self._rate, ENOUGH * fastest / 2, True), ""))
        return _lines(found)


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
