"""Makes the engines that move the scenes of a run, by its parameters: in closed form, by MuJoCo, or by MuJoCo Warp."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from evis.config.params import EACH
from evis.scene.digest import motion
from evis.scene.model import Scene
from evis.scene.worlds import Worlds
from nodes.physics.engines.engine import Engine
from nodes.physics.interval import Extras
from nodes.physics.precision.errors import Errors
from nodes.physics.precision.stepping import Stepping
from nodes.physics.precision.tolerance import Tolerance


class EngineMaker:
    """Makes engines, and imports MuJoCo for a scene that has dynamics alone."""

    def __init__(
        self, params: Mapping[str, Any], sub_steps_read: Callable[[], bool], warn: Callable[[str], None]
    ) -> None:
        """Takes the parameters of a node, and what they do not tell.

        params: of PhysicsNode. sub_steps_read: tells whether anybody reads the sub-steps between two stamps now. warn:
        told once where MuJoCo takes the place of MuJoCo Warp.
        """
        self._params, self._sub_steps_read, self._warn = params, sub_steps_read, warn
        self._told: set[str] = set()

    def of_worlds(self, worlds: Worlds, errors: Errors) -> Engine:
        """Makes the engine of all environments: one where they move alike, otherwise one for each of them.

        errors: where to note how far the bodies of environment 0 are off, which stands for the others.
        """
        p, scene = self._params, worlds.scenes[0]
        apart = p.get(EACH) and scene.dynamic
        if len(worlds.groups(motion)) == 1 and not apart:
            return self.of_scene(scene, p["seed"], p["envs"], errors)
        from nodes.physics.engines.separate import SeparateEngines

        each = zip(worlds.scenes, worlds.seeds, [errors, *[None] * (p["envs"] - 1)])
        return SeparateEngines([self.of_scene(own, seed, 1, noted) for own, seed, noted in each])

    def of_scene(self, scene: Scene, seed: int, envs: int, errors: Errors | None) -> Engine:
        """Makes the engine of environments that have one world, of seeds from `seed` on."""
        p = self._params
        if not scene.dynamic:
            from nodes.physics.engines.prescribed import PrescribedEngine

            beside, read = p["envs"], self._sub_steps_read
            return PrescribedEngine(scene, envs, p["accelerations"], p["keyframe_rate"], beside, read)
        from nodes.physics.dynamics.batch.mujoco_threads import threads_for
        from nodes.physics.dynamics.batch.unsupported import Unsupported
        from nodes.physics.engines.mujoco_engine import MujocoEngine

        make = partial(
            MujocoEngine, scene, seed, envs, errors=errors, threads=threads_for(p["threads"], envs),
            stepping=Stepping(p["timestep"], p["speed_limit"], Tolerance.of(p["physics_tolerance"])),
            extras=Extras(p["contacts"], p["joints"], p["accelerations"]),
        )  # fmt: skip
        if p["engine"] == "mujoco_warp":
            try:
                return make(warp=p["device"])
            except Unsupported as why:
                text = f"MuJoCo Warp cannot take scene {scene.name}: {why}; MuJoCo itself moves it"
                if text not in self._told:  # each environment may have an engine
                    self._told.add(text)
                    self._warn(text)
        return make()

    def of_changed(
        self, worlds: Worlds, before: Worlds, actuators: int, errors: Errors
    ) -> list[tuple[list[int], Engine, Scene]]:
        """Makes engines, at their start, of the environments that move otherwise in `worlds` than they did before: each
        with its environments and what it moves.

        actuators: of every environment of the run. errors: as of `of_worlds`. Raises ValueError for another number.
        """
        made = []
        for scene, members in worlds.groups(motion, worlds.changed(before, motion)):
            engine = self.of_scene(scene, 0, len(members), errors if 0 in members else None)
            if (count := engine.actuators.count) != actuators:
                raise ValueError(
                    f"scene {scene.name}: environment {members[0]} has {count} actuators with its new seed, "
                    f"and had {actuators}; worlds side by side need the same ones"
                )
            own = [worlds.seeds[env] for env in members]
            made.append((members.tolist(), engine.anew(range(len(members)), own, [0] * len(members)), scene))
        return made
