"""Runs physics as a node: it publishes /state at every keyframe stamp, and takes /action where a controller closes the
loop.

Environments begin anew when they diverge, when a message on /reset asks for it, and by `restart` in the hands of who
steps the graph.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from evis.config.params import EACH
from evis.runtime.clock import NS, keyframe_count, keyframe_stamp, rate
from evis.runtime.hosting.seeds import check_seeds
from evis.runtime.node import Node
from evis.scene.digest import motion
from evis.scene.model import Scene
from evis.scene.parameters import seeds_of, worlds_of
from evis.scene.worlds import Worlds
from msgs.header import Header, Message
from msgs.own_time import CONFIGURED
from msgs.physics_error import PhysicsError
from msgs.world import Action, Reset, WorldState
from nodes.physics.actuators import NO_ACTUATORS, actions_without_effect, check_controls_in_range
from nodes.physics.declaration import PhysicsDeclaration
from nodes.physics.engines.choice import EngineMaker
from nodes.physics.engines.engine import Engine
from nodes.physics.environments.environments import Environments, EnvironmentsState
from nodes.physics.environments.episodes import Episodes
from nodes.physics.environments.resets import ResetRefused, checked
from nodes.physics.environments.told_together import named, told_together
from nodes.physics.interval import Interval
from nodes.physics.precision.errors import Errors, Kept
from nodes.physics.precision.notice import notice
from nodes.physics.precision.tolerance import Tolerance

_KEPT = ("_episodes", "_asked", "episode", "k", "_held", "_driven", "first")
MOST_TOLD = 20
"""Lines on faults of a run: a model that always diverges would fill the log."""


@dataclass(frozen=True)
class PhysicsState:
    """Holds where the node is: node by the names of _KEPT."""

    environments: EnvironmentsState
    worlds: Worlds
    errors: Kept
    node: dict[str, Any]


class PhysicsNode(PhysicsDeclaration, Node):
    """Publishes one WorldState per keyframe stamp, k = 0, 1, ... while the stamp is within `duration`."""

    def setup(self) -> None:
        """Loads the scene and the engine that it needs."""
        p = self.params
        worlds = self.worlds = worlds_of(self.name, p, visuals=False)
        scene = self.scene = worlds.scenes[0]
        for note in scene.notes:
            self.warn(f"scene {scene.name}: {note}")
        self.errors = Errors()
        """Of environment 0, which stands for the others."""
        self._make = EngineMaker(p, partial(self.wants, "state", "moving_pose"), self.warn)
        self.engine = self._make.of_worlds(worlds, self.errors)
        self.held = self.divides(p)
        self.names = [body.name for body in scene.bodies]
        self._begin()
        self.count_all = keyframe_count(round(p["duration"] * NS), p["keyframe_rate"]) if p["duration"] else None
        if self.count_all is not None:
            self._say_end(self.count_all - 1)

    def _begin(self) -> None:
        """Stands before the first stamp of a run."""
        self.environments = Environments(self.engine, self.params["envs"], self.params["keyframe_rate"])
        self._episodes = Episodes(self.params["envs"])
        self._asked: list[tuple[list[int], list[int]]] = []
        """Environments that begin anew at the next step, and their seeds."""
        self.episode = 0
        self.k = 0
        self._held: np.ndarray | None = None
        self._driven = False
        """Whether an action differed from the one before: then no keyframe is begun before its action is there."""
        self.first = 0
        """Number of the stamp at which the run's episode began: cameras and actions are counted from it."""
        self._faults_told = 0
        """Faults of the run that were told of."""

    @property
    def episodes(self) -> np.ndarray:
        """Returns the number of the episode that each environment is in, int32 [E]."""
        return self._episodes.numbers

    def rewind(self, params: Mapping[str, Any]) -> bool:
        """Puts the engine back to time 0, with another seed where that is all that differs and moves nothing else."""
        if EACH in params or {**params, "seed": 0} != {**self.params, "seed": 0}:
            return False
        configured = self.worlds.from_seeds(seeds_of(self.params))
        worlds = configured.from_seeds(seeds_of(params))
        if len(worlds.changed(configured, motion)):
            return False
        self.params, self.worlds = dict(params), worlds
        self.errors.clear()
        self.engine.rewind(params["seed"])
        self._begin()
        return True

    def _say_end(self, last: int) -> None:
        """Warns where the run's last keyframe, of number `last`, comes before its end: the rest is not simulated."""
        duration, rate = self.params["duration"], self.params["keyframe_rate"]
        if last == 0:
            self.warn(
                f"a duration of {duration:g} s ends before the second keyframe, at {1 / rate:.4g} s: "
                "nothing moves, and there are no events; a longer duration or a higher keyframe_rate helps"
            )
        elif (end := keyframe_stamp(last, rate)) < round(duration * NS):
            within = f"its last keyframe within {duration:g} s at {rate:g} keyframes a second"
            self.warn(f"the run ends at {end / NS:.6g} s, {within}")

    def _say_lost_actions(self) -> None:
        """Warns where actions come faster than steps."""
        keyframes = rate(self.params["keyframe_rate"])
        if lost := actions_without_effect(keyframes / self.held, keyframes, self.engine.step_ns):
            self.warn(lost)

    def due(self) -> Mapping[str, int]:
        """Gives the stamp of the action for the next step, that published last, where one is due."""
        if not self.k or (self.k - 1 - self.first) % self.held:
            return {}
        return {"action": keyframe_stamp(self.k - 1, self.params["keyframe_rate"])}

    def offer(self, port: str) -> Mapping[str, Any]:
        """Describes the actuators. Raises ValueError where there are none."""
        if port != "action":
            return {}
        actuators = self.engine.actuators
        if not actuators.names:
            raise ValueError(f"scene {self.scene.name} {NO_ACTUATORS}: there is nothing to control")
        low, high = actuators.low.tolist(), actuators.high.tolist()
        return {"envs": self.params["envs"], "names": list(actuators.names), "low": low, "high": high}

    def admit(self, port: str, message: Message) -> None:
        """Raises ValueError for an action that is not finite or out of range, a reset of what is not there."""
        if isinstance(message, Action):
            check_controls_in_range(np.asarray(message.controls), self.params["envs"], self.engine.actuators)
        elif isinstance(message, Reset):
            checked(message.envs, message.seeds, self.params["envs"])

    def step(self, inputs: Mapping[str, Message]) -> bool:
        """Publishes the state at the next stamp, and those after it that others wait for to take them at once, where
        all motion is in closed form: nothing that comes of them moves anything."""
        if self.may_lag and not self.scene.dynamic and not self._asked and (ahead := self._ahead()) > 1:
            states = []
            for k in range(self.k, self.k + ahead):
                stamp = keyframe_stamp(k, self.params["keyframe_rate"])
                states.append(self._state(stamp, self.environments.advance(k)))
            self.k += ahead
            self.publish_all("state", states)
            return self.count_all is None or self.k < self.count_all
        stamp = keyframe_stamp(self.k, self.params["keyframe_rate"])
        action = inputs.get("action")
        controls = np.array(action.controls) if isinstance(action, Action) else None
        for envs, seeds in self._asked:
            try:
                self._begin_anew(envs, seeds, self.k)
            except ResetRefused as error:
                self._refuse(error)
                continue
            self.count("resets", len(envs))
            if len(envs) == self.params["envs"]:
                self.first = self.k
                self.episode += int(self.k > 0 and len(envs) == 1)
        self._asked = []
        if controls is not None:
            if not self._driven and self._held is not None and not np.array_equal(controls, self._held):
                self._driven = True
                self._say_lost_actions()
            self._held = controls
        ahead = not self._driven and self.k + 1 != self.count_all
        interval = self.environments.advance(self.k, controls, ahead)
        self._faults(interval, stamp)
        self._publish(stamp, interval)
        self.k += 1
        return self.count_all is None or self.k < self.count_all

    def _ahead(self) -> int:
        """Tells how many states are waited for at once, as far as the run goes."""
        if not self.wants("state"):
            return 1
        count = self.gathered("state")
        return count if self.count_all is None else min(count, self.count_all - self.k)

    def receive(self, port: str, message: Message) -> None:
        """Takes a reset, for the next step; one that asks for what is not there is refused with a warning."""
        assert isinstance(message, Reset)
        try:
            self._asked.append(checked(message.envs, message.seeds, self.params["envs"]))
        except ValueError as error:
            self._refuse(error)

    def _refuse(self, why: ValueError) -> None:
        """Tells of a reset that cannot be; the run goes on."""
        self.count("resets_refused")
        self.warn(f"{why}; nothing is reset")

    def restart(self, envs: Sequence[int] = (), seeds: Sequence[int] = ()) -> None:
        """Begins environments anew at once, and publishes their start.

        Where all begin anew, or nothing was published yet, that is the state at stamp 0, and time starts again. Else it
        is a state of the stamp published last, in which the others are as they were.

        Args:
            envs: which; none = all.
            seeds: of each of these, -1 = it keeps its own; none = all keep theirs.

        Raises ValueError for an environment that is not there and for seeds that do not fit, ResetRefused where a seed
        draws a world with other things, or a node cannot go on with it.
        """
        chosen, given = checked(envs, seeds, self.params["envs"])
        if not self.k or len(chosen) == self.params["envs"]:
            self._begin_anew(chosen, given, 0)
            self.episode += int(self.k > 0)
            self.k = self.first = 0
            interval = self.environments.advance(0)
            self.k = 1
        else:
            self._begin_anew(chosen, given, self.k - 1)
            interval = self.environments.present()
        self._publish(keyframe_stamp(self.k - 1, self.params["keyframe_rate"]), interval)

    def present(self) -> None:
        """Publishes the state of the stamp published last once more, of that one instant."""
        self._publish(keyframe_stamp(self.k - 1, self.params["keyframe_rate"]), self.environments.present())

    def kept(self) -> PhysicsState | None:
        """Gives where physics is, as copies; None where an engine cannot tell, as one of MuJoCo Warp."""
        environments = self.environments.state()
        if environments is None:
            return None
        node = {name: copy.deepcopy(getattr(self, name)) for name in _KEPT}
        return PhysicsState(environments, self.worlds, self.errors.snapshot(), node)

    def go_on(self, state: PhysicsState) -> None:
        """Goes on from what `kept` gave, after a `rewind`."""

        def make(scene: Scene, envs: np.ndarray) -> Engine:
            return self._make.of_scene(scene, 0, len(envs), self.errors if 0 in envs else None)

        self.environments.restore(state.environments, make)
        for name, value in state.node.items():
            setattr(self, name, copy.deepcopy(value))
        self.worlds = state.worlds
        self.errors.restore(state.errors)

    def state(self) -> int:
        """Gives how many faults were told of. Where the bodies are is in `kept`, or comes of the run's actions and
        resets, which are taken again."""
        return self._faults_told

    def restore(self, state: int) -> None:
        """Has told of as many faults."""
        self._faults_told = state

    def _begin_anew(self, envs: list[int], seeds: list[int], k: int) -> None:
        """Begins environments anew at keyframe k, in time of their own. Raises ResetRefused."""
        try:
            check_seeds(self.runtime.plan, self.name, dict(zip(*_given(envs, seeds))))
            worlds = self.worlds.with_seeds(*_given(envs, seeds))
            engines = self._make.of_changed(worlds, self.worlds, self.engine.actuators.count, self.errors)
        except ValueError as error:
            raise ResetRefused(str(error)) from None
        self.worlds = worlds
        resets = self._episodes.begin(envs, seeds, again=bool(self.k))
        self.environments.restart(envs, seeds, resets, k, engines)

    def _faults(self, interval: Interval, stamp: int) -> None:
        """Begins the next episode of each environment that diverged, at this stamp; of a single one it is the run's
        too."""
        if interval.again:
            self.count("stepped_again_by_mujoco", interval.again)
        for envs, text in told_together(interval.warnings):
            self.count("physics_warnings", len(envs))
            self.warn(f"{named(envs)}: {text}")
        for envs, text in told_together(interval.faults):
            again = self._episodes.begin_diverged(envs)
            self.count("diverged", len(envs))
            self._faults_told += 1
            if self._faults_told <= MOST_TOLD:
                last = "; from now on such faults are only counted (diverged)" if self._faults_told == MOST_TOLD else ""
                self.warn(f"{named(envs)}: {text}; {again} at {stamp * 1e-9:g} s{last}")
        if interval.faults and self.params["envs"] == 1:
            self.episode += 1
            self.first = self.k
            interval.keep_last()

    def finish(self) -> None:
        """Reports how far the bodies were off, where an engine integrated their motion."""
        worst = self.errors.worst()
        if worst is None:
            return
        stamp = keyframe_stamp(max(self.k - 1, 0), self.params["keyframe_rate"])
        told = PhysicsError(Header(stamp, episode=self.episode), self.names[worst.body], worst.position, worst.rotation)
        self.result("physics_error", told.scalars())
        tolerance = Tolerance.of(self.params["physics_tolerance"])
        for what in self.errors.erased:
            self.warn(f"discrete erases the oscillation of {what}, which physics_error does not count")
        if text := notice(worst, told.body, tolerance, stamp * 1e-9, self.engine.missed()):
            self.warn(text)
        if self.wants("error"):
            self.publish("error", told)

    def _publish(self, stamp: int, interval: Interval) -> None:
        if self.wants("state"):
            self.publish("state", self._state(stamp, interval))

    def _state(self, stamp: int, interval: Interval) -> WorldState:
        given = {name: getattr(interval, name) for name in ("t", "end_pose", "moving", "moving_pose", "moving_twist")}
        given["episodes"] = self._episodes.numbers.copy()
        if interval.own_t is not None:
            given |= {"own": self.environments.own(self._episodes.since_seed), "own_t": interval.own_t}
        for name in ("qpos", "qvel", "acceleration", "gravity"):
            if (values := getattr(interval, name)) is not None:
                given[name] = values
        if interval.contacts is not None:
            given |= {f"contact_{n}": a for n, a in vars(interval.contacts).items()}
        if not interval.lasting:
            arrays = self.loan("state", **{name: (value.shape, value.dtype) for name, value in given.items()})
            for name, value in given.items():
                arrays[name][...] = value
            given = arrays
        return WorldState(Header(stamp, episode=self.episode), names=self.names, **given)


def _given(envs: list[int], seeds: list[int]) -> tuple[list[int], list[int]]:
    """Selects those environments that are given a seed, and their seeds."""
    pairs = [(env, seed) for env, seed in zip(envs, seeds) if seed != CONFIGURED]
    return [env for env, _ in pairs], [seed for _, seed in pairs]
