"""Keeps simulations warm: a second sequence of a scene finds kernels, meshes and textures in memory."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from evis.dataset.about import About
from evis.dataset.recipe import Plan
from evis.runtime.clock import keyframe_count, keyframe_stamp
from evis.simulation.errors import Diverged
from evis.simulation.simulation import Simulation
from evis.simulation.step import Step
from msgs.camera import CameraInfo

MOST_WARM = 4
"""Most simulations that are kept, one for each scene and size."""
INFO = "info"
"""An output that is needed whatever a recipe asks for: what the cameras are."""


class Playing:
    """Gives the steps of one sequence, once. about: what is known of it. keyframes: number of the last one."""

    def __init__(self, plan: Plan, simulation: Simulation) -> None:
        self._simulation = simulation
        self._first = simulation.reset(seed=plan.seed)
        self.keyframes = last_keyframe(plan, simulation)
        self.about = about_of(plan, simulation, self._first)

    def steps(self) -> Iterator[Step]:
        """Gives the step at each keyframe from 0 on, and at the end what the sensor had held back. Raises what the
        simulation raises."""
        yield self._first
        for _ in range(self.keyframes):
            yield self._simulation.step()
        yield self._simulation.finish()


class PlayingTogether:
    """Gives the steps of several sequences of one length, once, as environments of one simulation.

    abouts: what is known of each. keyframes: number of the last one. fallen: of sequences that have diverged, why.
    """

    def __init__(self, plans: Sequence[Plan], simulation: Simulation) -> None:
        self._simulation, self._count = simulation, len(plans)
        self._first = simulation.reset()
        self.keyframes = last_keyframe(plans[0], simulation)
        parts = (simulation.alone(self._first, env) for env in range(self._count))
        self.abouts = [about_of(plan, simulation, part) for plan, part in zip(plans, parts)]
        self.fallen: dict[int, str] = {}

    def steps(self) -> Iterator[Step]:
        """Gives the steps of all environments; `alone` takes them apart. Raises what the simulation raises, but for
        environments that diverge: the others go on."""
        yield self._first
        for _ in range(self.keyframes):
            try:
                step = self._simulation.step()
            except Diverged as error:
                step = error.step
                self.fallen |= {env: str(error) for env in error.envs if env not in self.fallen}
            yield step
        yield self._simulation.finish()

    def alone(self, step: Step, env: int) -> Step:
        """Gives what one sequence has of a step; what stays on a GPU is copied only where it is read."""
        return self._simulation.alone(step, env)


class Warm:
    """Plays sequences one after another, on the simulations of the last scenes."""

    def __init__(self, besides: Sequence[str] = ()) -> None:
        """besides: outputs of `evis.Simulation` that steps are to have beside those of the recipe."""
        self._besides = tuple(besides)
        self._kept: dict[Any, tuple[Any, Simulation]] = {}

    @contextmanager
    def play(self, plan: Plan) -> Iterator[Playing]:
        """Plays a sequence from its start, on the last simulation where only the seed is another.

        Raises SimulationError. What is left in the middle is well; where anything is raised, the next sequence begins
        with a simulation of its own.
        """
        place = (plan.scene, plan.arguments.get("width"), plan.arguments.get("height"))
        wanted = (plan.given, plan.outputs, plan.labels)
        known = self._kept.pop(place, None)
        if known is not None and known[0] != wanted:
            known[1].close()
            known = None
        simulation = known[1] if known is not None else self._made(plan, seed=plan.seed, **plan.given)
        try:
            yield Playing(plan, simulation)
        except BaseException:
            simulation.close()
            raise
        self._kept[place] = wanted, simulation
        while len(self._kept) > MOST_WARM:
            self._kept.pop(next(iter(self._kept)))[1].close()

    @contextmanager
    def play_together(self, plans: Sequence[Plan]) -> Iterator[PlayingTogether]:
        """Plays sequences of one scene, length and kind of outputs at once, from their start.

        Raises SimulationError also where they cannot be environments of one simulation.
        """
        shared = {name: value for name, value in plans[0].given.items() if _shared(name, value, plans)}
        own = [{name: value for name, value in plan.given.items() if name not in shared} for plan in plans]
        each = [{**arguments, "seed": plan.seed} for arguments, plan in zip(own, plans)]
        simulation = self._made(plans[0], each=each, **shared)
        try:
            yield PlayingTogether(plans, simulation)
        finally:
            simulation.close()

    def _made(self, plan: Plan, **how: Any) -> Simulation:
        outputs = [*dict.fromkeys((*plan.outputs, INFO, *self._besides)), *(f"labels.{kind}" for kind in plan.labels)]
        return Simulation(plan.scene, outputs=outputs, **how)

    def close(self) -> None:
        """Ends all simulations."""
        for _, simulation in self._kept.values():
            simulation.close()
        self._kept.clear()


def _shared(name: str, value: Any, plans: Sequence[Plan]) -> bool:
    """Whether all sequences have one value of an argument."""
    return all(name in plan.given and plan.given[name] == value for plan in plans)


def last_keyframe(plan: Plan, simulation: Simulation) -> int:
    """Gives the number of a sequence's last keyframe."""
    return max(keyframe_count(round(plan.duration_s * 1e9), simulation.keyframe_rate) - 1, 1)


def about_of(plan: Plan, simulation: Simulation, first: Step) -> About:
    """Makes the description of a sequence from its plan and its first step."""
    rate = simulation.keyframe_rate
    cameras: dict[str, CameraInfo] = {name: o.info for name, o in first.cameras.items() if o.info is not None}
    return About(
        name=plan.name,
        scene=plan.scene_name,
        arguments=dict(plan.arguments),
        seed=plan.seed,
        duration_ns=keyframe_stamp(last_keyframe(plan, simulation), rate),
        keyframe_rate=rate,
        cameras=cameras,
        labels=plan.labels,
    )
