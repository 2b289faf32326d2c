"""The physics node: publishes /state at every keyframe stamp, and takes /action where a controller closes the loop."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from evis.config.params import Param
from evis.runtime.clock import NS, keyframe_count, keyframe_stamp, times_slower
from evis.runtime.node import Input, Node, Output
from evis.scene.parameters import SCENE, scene_of
from msgs.header import Header, Message
from msgs.world import Action, Reset, WorldState
from nodes.physics.from_outside import check_action, check_reset
from nodes.physics.interval import Engine, Interval


class PhysicsNode(Node):
    """Publishes one WorldState per keyframe stamp, k = 0, 1, ... while the stamp is within `duration`."""

    SOURCE: ClassVar[bool] = True
    PARAMS: ClassVar[Mapping[str, Param]] = {
        **SCENE,
        "seed": Param(int, 0, "seed of where free bodies start; environment k has seed + k", "", 0, 2**63 - 1),
        "envs": Param(int, 1, "parallel environments", "", 1, 65536),
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
        "contacts": Param(bool, False, "publish contacts and their forces"),
        "joints": Param(bool, False, "publish joint positions and velocities (MuJoCo's qpos and qvel) in /state"),
        "accelerations": Param(bool, False, "publish accelerations of the bodies"),
        "speed_limit": Param(float, 1000.0, "speed of a body beyond which the simulation has diverged", "m/s", 1e-3),
    }  # fmt: skip
    INPUTS: ClassVar[Mapping[str, Input]] = {
        "action": Input("/action", join=False, delayed=True, outside=True),
        "reset": Input("/reset", join=False, outside=True),
    }
    OUTPUTS: ClassVar[Mapping[str, Output]] = {"state": Output("/state")}

    @classmethod
    def needs(cls, params: Mapping[str, Any], wanted: frozenset[str]) -> frozenset[str]:
        """Raises ValueError for contacts or joints in a scene that has none."""
        from evis.scene.load import is_dynamic

        scene = params.get("scene")
        asked = [name for name in ("contacts", "joints") if params[name]]
        if asked and scene:
            with contextlib.suppress(OSError):  # who loads it says so
                if not is_dynamic(scene):
                    raise ValueError(f"scene {scene} moves in closed form and has no {asked[0]}; leave {asked[0]} out")
        return frozenset(cls.INPUTS)

    @classmethod
    def imports(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """Tells that MuJoCo is left out where all motion is prescribed."""
        from evis.scene.load import is_dynamic

        scene = params.get("scene")
        if scene and not is_dynamic(scene):
            return {"mujoco": f"all motion of scene {scene} is prescribed in closed form"}
        return {}

    @classmethod
    def random(cls, params: Mapping[str, Any]) -> tuple[str, ...]:
        """Names what is random: where free bodies start, in a scene that says how far from its own start."""
        from evis.scene.load import starts_at_random

        scene = params.get("scene")
        with contextlib.suppress(OSError):  # who loads it says so
            if scene and starts_at_random(scene):
                return ("start of free bodies",)
        return ()

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
        scene = self.scene = scene_of(self.name, p, visuals=False)
        for note in scene.notes:
            self.warn(f"scene {scene.name}: {note}")
        self.engine_seed: int = p["seed"]
        self.engine = self._engine(self.engine_seed)
        self.origin_ns = 0
        """Stamp at which the engine began."""
        self.next_seed: int | None = None
        """Seed of an engine that is to begin at the next step."""
        self.held = self.divides(p)
        self.names = [body.name for body in scene.bodies]
        self._begin()
        self.count_all = keyframe_count(round(p["duration"] * NS), p["keyframe_rate"]) if p["duration"] else None
        if self.count_all is not None:
            self._say_end(self.count_all - 1)

    def _begin(self) -> None:
        """Stands before the first stamp of a run."""
        self.episodes = np.zeros(self.params["envs"], np.int32)
        self.episode = 0
        self.k = 0
        self.first = 0
        """Number of the stamp at which the run's episode began: cameras and actions are counted from it."""

    def rewind(self, params: Mapping[str, Any]) -> bool:
        """Puts the engine back to time 0, with another seed where that is all that differs."""
        if {**params, "seed": 0} != {**self.params, "seed": 0}:
            return False
        self.params = dict(params)
        self.engine.rewind(params["seed"])
        self._begin()
        return True

    def _engine(self, seed: int) -> Engine:
        p = self.params
        if not self.scene.dynamic:
            from nodes.physics.prescribed import PrescribedEngine

            return PrescribedEngine(self.scene, p["envs"], p["accelerations"])
        from nodes.physics.mujoco_engine import MujocoEngine

        return MujocoEngine(
            self.scene, seed, p["envs"], timestep=p["timestep"], contacts=p["contacts"], joints=p["joints"],
            accelerations=p["accelerations"], speed_limit=p["speed_limit"],
        )  # fmt: skip

    def _say_end(self, last: int) -> None:
        """Warn where the run's last keyframe, of number `last`, comes before its end: the rest is not simulated."""
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
            raise ValueError(f"scene {self.scene.name} has no actuators: there is nothing to control")
        low, high = actuators.low.tolist(), actuators.high.tolist()
        return {"envs": self.params["envs"], "names": list(actuators.names), "low": low, "high": high}

    def admit(self, port: str, message: Message) -> None:
        """Raises ValueError for an action that is not finite or out of range, a reset of what is not there."""
        if isinstance(message, Action):
            check_action(message, self.params["envs"], self.engine.actuators)
        elif isinstance(message, Reset):
            check_reset(message, self.params["envs"])
            self._seed_of(message)

    def receive(self, port: str, message: Message) -> None:
        """Takes a reset, which is done at the next step."""
        if isinstance(message, Reset):
            self.restart(message.envs, message.seeds)

    def restart(self, envs: np.ndarray, seeds: np.ndarray) -> None:
        """Begins environments anew at the next step: the state at its stamp is their start, under no action.

        envs: int32 [R], none = all. seeds: int64 [R] or none, -1 = keep.
        """
        self.next_seed = self._seed_of(Reset(Header(0), envs, seeds))

    def _seed_of(self, reset: Reset) -> int:
        """The run's seed after a reset. Raises ValueError where it begins not all environments as one run does."""
        count = self.params["envs"]
        if len(reset.envs) not in (0, count):
            raise ValueError(f"a reset begins all {count} environments of this run anew, and not {len(reset.envs)}")
        order = np.argsort(reset.envs) if len(reset.envs) else np.arange(count)
        seeds = np.asarray(reset.seeds)[order] if len(reset.seeds) else np.full(count, -1)
        if (seeds == -1).all():
            return self.engine_seed
        if not np.array_equal(seeds, seeds[0] + np.arange(count)):
            raise ValueError("the seeds of a reset must follow one another: environment k has seed + k")
        return int(seeds[0])

    def step(self, inputs: Mapping[str, Message]) -> bool:
        """Publishes the state at the next stamp."""
        stamp = keyframe_stamp(self.k, self.params["keyframe_rate"])
        action = inputs.get("action")
        controls = np.array(action.controls) if isinstance(action, Action) else None
        if self.next_seed is not None and self.k:
            interval = self._begin_anew(stamp, self.next_seed)
        elif self.k:
            interval = self.engine.advance(stamp - self.origin_ns, controls)
        else:
            interval = self.engine.start()
        if self.origin_ns:
            interval.t = interval.t + self.origin_ns
        self._faults(interval, stamp)
        self._publish(stamp, interval)
        self.k += 1
        return self.count_all is None or self.k < self.count_all

    def _begin_anew(self, stamp: int, seed: int) -> Interval:
        """Start an engine of this seed at a stamp, where an episode of all environments begins."""
        self.engine_seed, self.next_seed, self.origin_ns = seed, None, stamp
        self.engine = self._engine(seed)
        self.episodes += 1
        self.count("resets", len(self.episodes))
        if len(self.episodes) == 1:
            self.episode += 1
            self.first = self.k
        return self.engine.start()

    def _faults(self, interval: Interval, stamp: int) -> None:
        """An environment that diverged begins its next episode at this stamp; with only one, so does the run."""
        for env, text in interval.warnings:
            self.count("physics_warnings")
            self.warn(f"environment {env}: {text}")
        for env, text in interval.faults:
            self.episodes[env] += 1
            self.count("diverged")
            again = f"it starts again as episode {self.episodes[env]} at {stamp * 1e-9:g} s"
            self.warn(f"environment {env}: {text}; {again}")
        if interval.faults and len(self.episodes) == 1:
            self.episode += 1
            self.first = self.k
            interval.keep_last()

    def _publish(self, stamp: int, interval: Interval) -> None:
        if not self.wants("state"):
            return
        given = {name: getattr(interval, name) for name in ("t", "end_pose", "moving", "moving_pose", "moving_twist")}
        given["episodes"] = self.episodes
        asked = {"qpos": interval.qpos, "qvel": interval.qvel, "acceleration": interval.acceleration}
        given |= {name: array for name, array in asked.items() if array is not None}
        if interval.contacts is not None:
            given |= {f"contact_{n}": a for n, a in vars(interval.contacts).items()}
        arrays = self.loan("state", **{name: (value.shape, value.dtype) for name, value in given.items()})
        for name, value in given.items():
            arrays[name][...] = value
        self.publish("state", WorldState(Header(stamp, episode=self.episode), names=self.names, **arrays))
