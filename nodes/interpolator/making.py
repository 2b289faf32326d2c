"""Makes the interpolator that a node's parameters ask for, for all of its environments or for each look of the world.

It is sized, and warmed up, for keyframes of the size that is expected; where worlds change, those that look different
get one of their own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from evis.scene.digest import appearance
from evis.scene.model import Camera, Scene
from evis.scene.parameters import camera_of
from evis.scene.parts import Parts
from evis.scene.worlds import Group, Worlds
from nodes.interpolator.interpolator import Interpolator
from nodes.interpolator.refine.instants import wanted_slots
from nodes.interpolator.separate import SeparateInterpolators
from nodes.renderer import parameters
from nodes.renderer.at_once import (
    LEAST_OF_PIXEL,
    LEAST_OF_REFINED,
    LEAST_OF_RIGID,
    at_once,
    check_room,
    keyframes_of,
    refined_at_once,
)
from nodes.renderer.cores import threads_for

USUAL_RATE = 30.0
"""Keyframes per second where it is not known how many there are."""

Made = Interpolator | SeparateInterpolators


@dataclass(frozen=True)
class KeyframeSize:
    """Holds the size of the keyframes that are expected.

    height, width: margin included [px], 0 = not known. margin: pixels beyond the image on every side. samples: per
    pixel and axis, which come apart, as pixels of a larger image; height, width and margin are of these.
    """

    height: int
    width: int
    margin: int
    samples: int

    @classmethod
    def expected(cls, params: Mapping[str, Any], camera: Camera | None) -> KeyframeSize:
        """Finds the size from a node's parameters, and from its camera where the scene is known."""
        size = (camera.height, camera.width) if camera else (params["height"], params["width"])
        samples = params["supersampling"] or camera.supersampling if camera else 1
        margin = samples * params["margin"]
        height, width = (samples * length + 2 * margin for length in size) if all(size) else (0, 0)
        return cls(height, width, margin, samples)

    @property
    def pixels(self) -> int:
        """Counts the pixels of a keyframe, 0 where its size is not known."""
        return self.height * self.width


def check_memory(name: str, params: Mapping[str, Any], method: str, size: KeyframeSize, sampled: bool) -> None:
    """Raises ValueError, in the name of a node, where the device's memory cannot hold what a run takes at least.

    sampled: whether single pixels are looked at between the frames.
    """
    if not size.pixels:
        return
    refined = size.samples > 1 and sampled and not parameters.by_paths(params)
    least = LEAST_OF_REFINED if refined else LEAST_OF_RIGID if method == "rigid" else LEAST_OF_PIXEL
    # Who takes several samples of a pixel may not know what looking at each of them between frames takes.
    fineness = size.samples if refined else 1
    check_room(name, params["device"], params["envs"], size.width, size.height, params["upsampling"], least, fineness)


def gaps_at_once(
    name: str,
    params: Mapping[str, Any],
    pixels: int,
    scenes: Sequence[Scene],
    sampled: bool,
    run_s: float | None,
    recorded: bool,
) -> int:
    """Computes how many gaps `rigid` makes at once where nobody waits for a single one.

    Args:
        name: the node's, for errors.
        params: its parameters.
        pixels: of a keyframe.
        scenes: of the environments.
        sampled: whether single pixels are looked at between the frames.
        run_s: length of the run [s], None = not known.
        recorded: whether a recorder takes what comes of the frames.

    Raises:
        ValueError: where those that were asked for do not fit the device's memory.
    """
    batch, device, upsampling = params["batch"], params["device"], params["upsampling"]
    paths, rate = parameters.by_paths(params), params["keyframe_rate"] or USUAL_RATE
    run = upsampling, paths, keyframes_of(run_s, rate), recorded
    gaps = at_once(name, batch, device, params["envs"], pixels, *run)
    if not sampled:
        return gaps
    from nodes.interpolator.refine.light.highlights import tolerance_for

    tolerance = 1e9 * params["time_tolerance"]
    tolerance = min((tolerance_for(scene, tolerance) for scene in scenes), default=tolerance)
    slots = wanted_slots(round(1e9 / rate), upsampling, tolerance)
    return refined_at_once(gaps, batch, device, pixels * max(slots, 1))


class InterpolatorMaker:
    """Makes, warms up and replaces the interpolators of a node."""

    def __init__(
        self, params: Mapping[str, Any], method: str, size: KeyframeSize, sampled: bool, gaps: int, late: bool
    ) -> None:
        """Takes what an interpolator is made for.

        params: the node's. method: what makes the frames, a key of METHODS. size: of the keyframes. sampled: whether
        somebody reads samples of single pixels between the frames. gaps: how many are made at once. late: whether the
        report of one gap may come with the next.
        """
        self._params, self._method, self._size = params, method, size
        self._sampled, self._gaps, self._late = sampled, gaps, late

    def make(self, worlds: Worlds | None) -> Made:
        """Makes an interpolator for all environments, or one for each look of their worlds, not warmed up yet; None:
        the method needs no scene."""
        if worlds is None:
            return self._interpolator(None, ())
        groups = worlds.groups(self._look)
        if len(groups) == 1:
            return self._interpolator(groups[0][0], worlds.apart())
        return self._separate(Parts(groups, self._each(worlds, groups)))

    def replace(self, made: Made, worlds: Worlds, changed: np.ndarray) -> Made:
        """Gives environments whose worlds have changed, int [n], an interpolator of their own, warmed up; those of the
        others go on."""
        if len(changed) == len(worlds.scenes):
            anew = self.make(worlds)
            self.warm_up(anew, len(changed))
            return anew
        if not isinstance(made, SeparateInterpolators):
            made = self._separate(Parts.of_all(made, len(worlds.scenes)))
        groups = worlds.groups(self._look, changed)
        for one, (_, envs) in zip(made.change(groups, self._each(worlds, groups)), groups):
            self.warm_up(one, len(envs))
        return made

    def begin(self, made: Made) -> None:
        """Begins to build what gaps need, where their size is known: kernels compile while the caller does something
        else, until `warm_up`."""
        if self._size.pixels and isinstance(made, Interpolator):
            made.begin(self._params["envs"], self._size.height, self._size.width, self._size.margin)

    def warm_up(self, made: Made, envs: int) -> None:
        """Compiles what gaps of so many environments need, before their first keyframe."""
        size, rate = self._size, self._params["keyframe_rate"]
        if size.pixels:
            made.warm_up_for(envs, size.height, size.width, size.margin, round(1e9 / rate) if rate else 0)
        else:
            made.warm_up()

    def _look(self, scene: Scene) -> tuple[bytes, float]:
        """Gives what environments that one interpolator works on have in common: what is made of their scenes, and how
        closely single pixels are looked at in time, which depends on how glossy things may move."""
        tolerance = self._params["time_tolerance"]
        if tolerance == 0:
            return appearance(scene), 0.0
        from nodes.interpolator.refine.light.highlights import tolerance_for

        return appearance(scene), tolerance_for(scene, 1e9 * tolerance)

    def _each(self, worlds: Worlds, groups: Sequence[Group]) -> list[Callable[[], Interpolator]]:
        return [partial(self._interpolator, scene, worlds.apart(envs)) for scene, envs in groups]

    def _interpolator(self, scene: Scene | None, worlds: Sequence[Scene]) -> Interpolator:
        p = self._params
        how: dict[str, Any] = {key: p[key] for key in ("colour", "device", "tolerance", "time_tolerance")}
        how |= parameters.light_options(p if scene else {})
        how["threads"] = threads_for(p["threads"], p["envs"] * self._size.pixels)
        how |= {"scene": scene, "camera": camera_of(scene, p["camera"]) if scene else None, "worlds": worlds}
        how["sampled"] = self._sampled
        if self._gaps > 1:
            from nodes.interpolator.many_gaps import ManyGaps

            return ManyGaps(self._method, p["upsampling"], self._gaps, **how)
        made = Interpolator(self._method, p["upsampling"], **how)
        made.late = self._late
        return made

    def _separate(self, parts: Parts[Interpolator]) -> SeparateInterpolators:
        return SeparateInterpolators(parts, self._params["upsampling"], self._params["device"])
