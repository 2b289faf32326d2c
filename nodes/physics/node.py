"""Runs physics as a node: it publishes /state at every keyframe stamp, and takes /action where a controller closes the
loop.

Environments begin anew when they diverge, when a message on /reset asks for it, and by `restart` in the hands of who
steps the graph.
"""

from __future__ import annotations

import contextlib
import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np

from evis.config.params import EACH, Param
from evis.runtime.clock import NS, keyframe_count, keyframe_stamp, times_slower
from evis.runtime.node import Input, Node, Output
from evis.runtime.seeds import check_seeds
from evis.scene.digest import motion
from evis.scene.load import drawn_places, is_dynamic, may_be_driven, parse_args, starts_at_random
from evis.scene.model import Scene
from evis.scene.parameters import SCENE, seeds_of, worlds_of
from evis.scene.worlds import Worlds
from msgs.header import Header, Message
from msgs.own_time import CONFIGURED
from msgs.physics_error import PhysicsError
from msgs.world import Action, Reset, WorldState
from nodes.physics.actuators import NO_ACTUATORS, check_controls_in_range
from nodes.physics.choice import EngineMaker
from nodes.physics.engine import Engine
from nodes.physics.environments import Environments, EnvironmentsState
from nodes.physics.interval import Interval
from nodes.physics.precision.errors import Errors, Kept
from nodes.physics.precision.notice import notice
from nodes.physics.precision.tolerance import Tolerance
from nodes.physics.resets import ResetRefused, checked
from nodes.physics.told_together import named, told_together

_KEPT = ("episodes", "_seeded", "_asked", "episode", "k", "_held", "_driven", "first")
MOST_TOLD = 20
"""Lines on faults of a run: a model that always diverges would fill the log."""


@dataclass(frozen=True)
class PhysicsState:
    """Holds where the node is: node by the names of _KEPT."""

    environments: EnvironmentsState
    worlds: Worlds
    errors: Kept
    node: dict[str, Any]


class PhysicsNode(Node):
    """Publishes one WorldState per keyframe stamp, k = 0, 1, ... while the stamp is within `duration`."""

    SOURCE: ClassVar[bool] = True
    PARAMS: ClassVar[Mapping[str, Param]] = {
        **SCENE,
        "seed": Param(
            int, 0, "seed of what the scene draws and of where free bodies start; environment k has seed + k", "", 0,
            2**63 - 1,
        ),
        "envs": Param(int, 1, "parallel environments", "", 1, 65536),
        "threads": Param(
            int, 0, "CPU threads, which share environments of a MuJoCo model; 0 = one per core", minimum=0, maximum=256
        ),
        "device": Param(str, "cpu", "where kernels run: cpu, cuda, cuda:1"),
        "engine": Param(
            str, "mujoco", "what moves a MuJoCo model: MuJoCo, or MuJoCo Warp, all environments at once on the device",
            choices=("mujoco", "mujoco_warp"),
        ),
        "keyframe_rate": Param(float, 30.0, "rendered keyframes per second", "Hz", 1e-3, 1e6),
        "action_rate": Param(
            float, None,
            "actions per second of a controller that closes the loop, a whole fraction of keyframe_rate; each is held "
            "until the next; not given = keyframe_rate",
            "Hz", 1e-6, 1e6, optional=True,
        ),
        "duration": Param(float, 0.0, "simulated time, 0 = until stopped", "s", 0.0, optional=True),
        "timestep": Param(
            float, None, "sub-step of the dynamics; the model's own, at most 1 ms, if not given", "s", 1e-7, 1e-3,
            optional=True,
        ),
        "physics_tolerance": Param(
            list, [], "METRES,RADIANS of error that a body may gather in a second: dynamics are integrated with RK4, "
            "each step in as many parts as that takes; not given = steps are whole, and the summary says what is wrong",
        ),
        "contacts": Param(bool, False, "publish contacts and their forces"),
        "joints": Param(bool, False, "publish joint positions and velocities (MuJoCo's qpos and qvel) in /state"),
        "accelerations": Param(bool, False, "publish accelerations of the bodies"),
        "speed_limit": Param(
            float, 1000.0, "speed of a body beyond which the simulation has diverged", "m/s", 1e-3, 1e9
        ),
    }  # fmt: skip
    INPUTS: ClassVar[Mapping[str, Input]] = {
        "action": Input("/action", join=False, delayed=True, outside=True),
        "reset": Input("/reset", join=False, optional=True, outside=True),
    }
    OUTPUTS: ClassVar[Mapping[str, Output]] = {"state": Output("/state"), "error": Output("/physics_error")}

    @classmethod
    def needs(cls, params: Mapping[str, Any], wanted: frozenset[str]) -> frozenset[str]:
        """Raises ValueError for contacts or joints in a scene that has none, and as `divides` does."""
        cls.divides(params)
        scene = params.get("scene")
        asked = [name for name in ("contacts", "joints") if params[name]]
        if asked and scene:
            with contextlib.suppress(OSError):  # who loads it says so
                if not is_dynamic(scene):
                    raise ValueError(f"scene {scene} moves in closed form and has no {asked[0]}; leave {asked[0]} out")
        return frozenset(cls.INPUTS)

    @classmethod
    def without_effect(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """Names the parameters of integration, where motion is in closed form."""
        scene = params.get("scene")
        with contextlib.suppress(OSError, ValueError):  # who loads it says so
            if scene and not is_dynamic(scene):
                why = f"all motion of scene {scene} is in closed form, and exact"
                return {"physics_tolerance": why, "timestep": why, "engine": why, "speed_limit": why}
        return {}

    @classmethod
    def moved_from_outside(cls, params: Mapping[str, Any]) -> bool:
        """Says whether there may be actuators."""
        scene = params.get("scene")
        with contextlib.suppress(OSError, ValueError):  # who loads it says so
            return not scene or may_be_driven(scene)
        return True

    @classmethod
    def on_gpu(cls, params: Mapping[str, Any]) -> bool:
        """Says no where MuJoCo takes the steps: a process of its own keeps the interpreter from nobody else."""
        scene = params.get("scene")
        with contextlib.suppress(OSError, ValueError):  # who loads it says so
            if params["engine"] == "mujoco" and scene and is_dynamic(scene):
                return False
        return super().on_gpu(params)

    @classmethod
    def imports(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """Names MuJoCo as spared where all motion is prescribed."""
        scene = params.get("scene")
        if scene and not is_dynamic(scene):
            return {"mujoco": f"all motion of scene {scene} is prescribed in closed form"}
        return {}

    @classmethod
    def random(cls, params: Mapping[str, Any]) -> tuple[str, ...]:
        """Names what is random of the world: what the scene draws, and where bodies and joints start at random."""
        scene = params.get("scene")
        found: list[str] = []
        with contextlib.suppress(OSError, ValueError):  # who loads it says so
            if scene:
                found += [f"start of {what}" for what in starts_at_random(scene)]
                found += drawn_places(scene, parse_args(params.get("scene_args")))
        return tuple(found)

    @classmethod
    def divides(cls, params: Mapping[str, Any]) -> int:
        """Counts the steps for which an action is held. Raises ValueError where that is no whole number."""
        rate, wanted = params["keyframe_rate"], params["action_rate"]
        try:
            return times_slower(rate, rate if wanted is None else wanted)
        except ValueError as error:
            raise ValueError(f"action_rate: {error}") from None

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
        self.episodes = np.zeros(self.params["envs"], np.int32)
        self._seeded = np.zeros(self.params["envs"], np.int32)
        """The episode in which each environment was given its seed: the number of its reset counts from there."""
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

    def _other_engines(self, envs: list[int], seeds: list[int]) -> list[tuple[list[int], Engine, Scene]]:
        """Makes engines of those environments that move otherwise with the seeds that they are given. Raises ValueError
        where one of them has other things, or other actuators, than the run."""
        worlds = self.worlds.with_seeds(*_given(envs, seeds))
        groups = worlds.groups(motion, worlds.changed(self.worlds, motion))
        made = []
        for scene, members in groups:
            engine = self._make.of_scene(scene, 0, len(members), self.errors if 0 in members else None)
            now, before = engine.actuators.count, self.engine.actuators.count
            if now != before:
                raise ValueError(
                    f"scene {scene.name}: environment {members[0]} has {now} actuators with its new seed, "
                    f"and had {before}; worlds side by side need the same ones"
                )
            own = [worlds.seeds[env] for env in members]
            made.append((members.tolist(), engine.anew(range(len(members)), own, [0] * len(members)), scene))
        self.worlds = worlds
        return made

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
            if len(envs) == len(self.episodes):
                self.first = self.k
                self.episode += int(self.k > 0 and len(envs) == 1)
        self._asked = []
        if controls is not None:
            self._driven |= self._held is not None and not np.array_equal(controls, self._held)
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
            self._asked.append(checked(message.envs, message.seeds, len(self.episodes)))
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
        chosen, given = checked(envs, seeds, len(self.episodes))
        if not self.k or len(chosen) == len(self.episodes):
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
            engines = self._other_engines(envs, seeds)
        except ValueError as error:
            raise ResetRefused(str(error)) from None
        if self.k:
            self.episodes[envs] += 1
        given = np.array(seeds) != CONFIGURED
        self._seeded[np.array(envs)[given]] = self.episodes[np.array(envs)[given]]
        numbers = (self.episodes - self._seeded)[envs].tolist()
        self.environments.restart(envs, seeds, numbers, k, engines)

    def _faults(self, interval: Interval, stamp: int) -> None:
        """Begins the next episode of each environment that diverged, at this stamp; of a single one it is the run's
        too."""
        if interval.again:
            self.count("stepped_again_by_mujoco", interval.again)
        for envs, text in told_together(interval.warnings):
            self.count("physics_warnings", len(envs))
            self.warn(f"{named(envs)}: {text}")
        for envs, text in told_together(interval.faults):
            self.episodes[envs] += 1
            self.count("diverged", len(envs))
            self._faults_told += 1
            if self._faults_told <= MOST_TOLD:
                numbers = sorted(set(self.episodes[envs].tolist()))
                again = f"{'it starts' if len(envs) == 1 else 'each starts'} again as episode {_range(numbers)}"
                last = "; from now on such faults are only counted (diverged)" if self._faults_told == MOST_TOLD else ""
                self.warn(f"{named(envs)}: {text}; {again} at {stamp * 1e-9:g} s{last}")
        if interval.faults and len(self.episodes) == 1:
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
        given["episodes"] = self.episodes.copy()
        if interval.own_t is not None:
            given |= {"own": self.environments.own(self.episodes - self._seeded), "own_t": interval.own_t}
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


def _range(numbers: Sequence[int]) -> str:
    """Puts numbers in order into words: `3`, `3 to 5`."""
    return f"{numbers[0]}" if len(numbers) == 1 else f"{numbers[0]} to {numbers[-1]}"
