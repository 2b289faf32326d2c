"""Simulations that stay warm: a second sequence of a scene finds kernels, meshes and textures in memory."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from evis.dataset.about import About
from evis.dataset.recipe import Plan
from evis.runtime.clock import keyframe_count, keyframe_stamp
from evis.simulation.simulation import Simulation
from evis.simulation.step import Step
from msgs.camera import CameraInfo

MOST_WARM = 4
"""Most simulations that are kept, one for each scene and size."""
INFO = "info"
"""An output that is needed whatever a recipe asks for: what the cameras are."""


class Playing:
    """Gives the steps of one sequence, once. about: what is known of it. keyframes: number of the last one."""

    def __init__(self, plan: Plan, simulation: Simulation, cameras: dict[str, CameraInfo]) -> None:
        """cameras: those of earlier runs of the simulation, as they are told of once; what this one tells is added."""
        self._simulation = simulation
        self._first = simulation.reset(seed=plan.seed)
        cameras |= {name: outputs.info for name, outputs in self._first.cameras.items() if outputs.info is not None}
        rate = simulation.keyframe_rate
        self.keyframes = max(keyframe_count(round(plan.duration_s * 1e9), rate) - 1, 1)
        self.about = About(
            name=plan.name,
            scene=plan.scene_name,
            arguments=dict(plan.arguments),
            seed=plan.seed,
            duration_ns=keyframe_stamp(self.keyframes, rate),
            keyframe_rate=rate,
            cameras={name: _with_seed(info, plan.seed) for name, info in cameras.items()},
            labels=plan.labels,
        )

    def steps(self) -> Iterator[Step]:
        """Gives the step at each keyframe from 0 on, and at the end what the sensor had held back. Raises what the
        simulation raises."""
        yield self._first
        for _ in range(self.keyframes):
            yield self._simulation.step()
        yield self._simulation.finish()


class Warm:
    """Plays sequences one after another, on the simulations of the last scenes."""

    def __init__(self, besides: Sequence[str] = ()) -> None:
        """besides: outputs of `evis.Simulation` that steps are to have beside those of the recipe."""
        self._besides = tuple(besides)
        self._kept: dict[Any, tuple[Any, Simulation, dict[str, CameraInfo]]] = {}

    @contextmanager
    def play(self, plan: Plan) -> Iterator[Playing]:
        """Plays a sequence from its start, on the last simulation where only the seed is another.

        Raises SimulationError. Where anything is raised, the next sequence begins with a simulation of its own.
        """
        place = (plan.scene, plan.arguments.get("width"), plan.arguments.get("height"))
        wanted = (plan.arguments, plan.outputs, plan.labels)
        known = self._kept.pop(place, None)
        if known is not None and known[0] != wanted:
            known[1].close()
            known = None
        simulation, cameras = known[1:] if known is not None else (self._made(plan), {})
        try:
            yield Playing(plan, simulation, cameras)
        except BaseException:
            simulation.close()
            raise
        self._kept[place] = wanted, simulation, cameras
        while len(self._kept) > MOST_WARM:
            self._kept.pop(next(iter(self._kept)))[1].close()

    def _made(self, plan: Plan) -> Simulation:
        outputs = [*dict.fromkeys((*plan.outputs, INFO, *self._besides)), *(f"labels.{kind}" for kind in plan.labels)]
        return Simulation(plan.scene, outputs=outputs, seed=plan.seed, **plan.arguments)

    def close(self) -> None:
        """Ends all simulations."""
        for _, simulation, _ in self._kept.values():
            simulation.close()
        self._kept.clear()


def _with_seed(info: CameraInfo, seed: int) -> CameraInfo:
    """A camera's description, which is latched and comes once, with the seed of this run."""
    return replace(info, sensor={**info.sensor, "seed": seed}) if "seed" in info.sensor else info
