"""Steps all environments of one simulation together, and puts them back to their start one by one."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, NamedTuple, Never

import numpy as np
from gymnasium.spaces import Dict, Space

from evis.env.actions import Actions
from evis.env.answers import of_each, told
from evis.env.episodes import episode_seed, last_step
from evis.env.observation import Moment, Observation, Observed, Setting, by_name, is_of_events, needs_camera
from evis.env.observations import Frames
from evis.env.picture import Painter
from evis.env.saved import BatchState
from evis.env.state import State
from evis.env.task import Task
from evis.env.tasks import TASKS
from evis.runtime.clock import keyframe_stamp
from evis.runtime.hosting.node_call import describe
from evis.simulation.errors import Diverged, SimulationError
from evis.simulation.run import AGAIN
from evis.simulation.simulation import Simulation
from evis.simulation.step import Step
from nodes.event_sensor.parameters import LOOK_AHEAD

_TAKEN = {
    "envs": "gymnasium.make_vec(..., num_envs=4) makes several",
    "outputs": "what is observed says what the simulation gives",
    "seed": "reset(seed=3) says it",
    "action_rate": "there is an action for every step, and keyframe_rate says how many steps a second has",
}
"""Arguments of a simulation that environments give by themselves."""

_KEPT = ("steps", "_seeds", "_episodes", "_begun", "_actions", "_seen")
"""What a batch goes on from besides its simulation, its observations and its task."""


class NotCopied:
    """Refuses to be copied or pickled, as what has a simulation must: a copy would step that of the first one."""

    def __reduce__(self) -> Never:
        raise SimulationError(
            "an environment cannot be copied or pickled; make one where it is needed, by gymnasium.make"
        )


class Outcome(NamedTuple):
    """Holds what a step gave, each with axis E: as Gymnasium's `step` returns it."""

    observation: Observed
    reward: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray
    info: dict[str, np.ndarray]


class Batch(NotCopied):
    """Holds a task's simulation of E environments, with what is observed of it and how it is acted on."""

    def __init__(
        self,
        task: str | Task,
        envs: int,
        /,
        *,
        observation: Observation | Mapping[str, Observation] | None = None,
        normalise: bool = True,
        seconds: float | None = None,
        max_episode_steps: int | None = None,
        joints: bool = False,
        picture: bool = False,
        **arguments: Any,
    ) -> None:
        """Starts the simulation.

        Args:
            task: one of one's own, or the name of one that comes with EVIS.
            envs: E.
            observation: in place of the task's.
            normalise: whether actions from -1 to 1 stand for the range of each actuator.
            seconds: when an episode is cut off, in place of the task's; 0 = never.
            max_episode_steps: after how many steps it is cut off at the latest, as Gymnasium has it; None or -1 = no
                such limit.
            joints: whether the state has the joints, for a reward that asks for them.
            picture: whether `paint` will be asked for.
            arguments: of the launch file and the scene, over those of the task.

        Raises ValueError in one line.
        """
        if isinstance(task, str) and task not in TASKS:
            raise ValueError(f"there is no task '{task}'; there are {', '.join(TASKS)}")
        if not isinstance(task, str | Task):
            raise ValueError(f"task is {task!r:.80}; it must be a Task, or the name of one: {', '.join(TASKS)}")
        self.task: Task = TASKS[task]() if isinstance(task, str) else task
        for name, remedy in _TAKEN.items():
            if name in arguments or name in self.task.arguments:
                raise ValueError(f"{name} is no argument of an environment; {remedy}")
        self._parts = by_name(copy.deepcopy(self.task.observation if observation is None else observation))
        outputs = dict.fromkeys([*(part.output for part in self._parts.values()), "state"])
        # Tells what the sensor is, and how often there is something of the camera.
        outputs |= dict.fromkeys(
            f"{part.camera}.info".lstrip(".") for part in self._parts.values() if needs_camera(part)
        )
        given = {**self.task.arguments, **arguments, "envs": envs}
        for part in self._parts.values():
            given.update(part.ARGUMENTS)
        if joints:
            given["joints"] = True
        self._painter = Painter() if picture else None
        if self._painter:
            outputs |= dict.fromkeys(("keyframe", "events"))
        self.simulation = Simulation(self.task.scene, outputs=tuple(outputs), **given)
        self.envs = self.simulation.envs
        self._broken = ""
        """Why what is observed does not go with the simulation, "" where it does."""
        try:
            self._prepare(normalise, self.task.seconds if seconds is None else seconds, max_episode_steps)
        except BaseException:
            self.simulation.close()
            raise

    def _prepare(self, normalise: bool, seconds: float, most: int | None) -> None:
        simulation = self.simulation
        self.actions = Actions(simulation.actuators, normalise)
        self.action_space = self.actions.space()
        first = simulation.reset()
        state = first.state
        assert state is not None
        self._check_crossing(first)
        for part in self._parts.values():
            if not isinstance(part, Frames) or part.grey:
                continue
            if first.cameras[part.camera or simulation.cameras[0]].keyframe.ndim == 3:
                raise ValueError(
                    "Frames(grey=False) shows colour, and keyframes=luminance has none; leave keyframes out, or take "
                    "Frames()"
                )
        positions, velocities = (0 if a is None else a.shape[-1] for a in (state.qpos, state.qvel))
        self.rate = simulation.keyframe_rate
        spaces: dict[str, Space[Any]] = {}
        for name, part in self._parts.items():
            height, width, apart = 0, 0, 1
            if needs_camera(part):
                camera = part.camera or simulation.cameras[0]
                seen, info = simulation.scene.camera(camera), first.cameras[camera].info
                height, width = seen.height, seen.width
                if info is not None:
                    apart = round(self.rate / info.keyframe_rate)
            bodies, joints = tuple(state.names), (positions, velocities)
            spaces[name] = part.begin(
                Setting(self.envs, height, width, self.rate, bodies, joints, self.action_space, apart)
            )
        self.observation_space = spaces[""] if "" in spaces else Dict(spaces)
        self.steps = np.zeros(self.envs, np.int64)
        """Steps since each environment's reset."""
        self._last_step = last_step(seconds, self.rate, most)
        self._seeds = np.zeros(self.envs, np.int64)
        self._episodes = np.zeros(self.envs, np.int64)
        """Episodes of each environment since it was given its seed."""
        self._begun = np.zeros(self.envs, np.int64)
        """Stamp of the reset of each environment."""
        self._rest = np.clip(np.zeros_like(self.action_space.low), self.action_space.low, self.action_space.high)
        self._actions = np.tile(self._rest, (self.envs, 1))
        """Last action of each environment."""
        self._seen: dict[str, np.ndarray] = {}
        """What was observed last, by part: what environments go on to observe when others are put back."""

    def _check_crossing(self, step: Step) -> None:
        """Raises ValueError where events come later than the step that they are of. step: one that begins a run."""
        cameras = self.simulation.cameras
        for camera in {part.camera or cameras[0] for part in self._parts.values() if is_of_events(part)}:
            info = step.cameras[camera].info
            if info is not None and (crossing := info.sensor.get("crossing")) in LOOK_AHEAD:
                raise ValueError(
                    f"crossing={crossing} gives events one frame late, after the step whose end is observed; "
                    "take crossing=linear"
                )

    def reset(self, envs: np.ndarray, seeds: np.ndarray | None = None) -> Observed:
        """Puts environments back to their start, and returns what all of them observe.

        The first reset is of all; later, those that go on observe what they did before. envs: their numbers. seeds: of
        each, or None: their seeds stay, and another episode of each begins. Raises ValueError for a seed that draws a
        sensor whose events come late, and in the simulation's words for one that it cannot begin with: of some, nothing
        has happened then.
        """
        every = len(envs) == self.envs
        if not every:
            self._check_going()
        own, episodes = self._seeds.copy(), self._episodes.copy()
        if seeds is not None:
            own[envs], episodes[envs] = seeds, 0
        else:
            episodes[envs] += 1
        given = [episode_seed(seed, episode) for seed, episode in zip(own[envs].tolist(), episodes[envs].tolist())]
        # A run that is refused is none, and the one before has ended with that.
        with self.whole(*(() if every else (SimulationError,))):
            step = self.simulation.reset(seed=given, envs=envs.tolist())
            self._check_crossing(step)  # the scene may draw it
            self._seeds, self._episodes = own, episodes
            self.steps[envs] = 0
            self._begun[envs] = step.stamp_ns
            self._actions[envs] = self._rest
            for part in self._parts.values():
                part.forget(envs)
            fresh = np.zeros(self.envs, bool)
            fresh[envs] = True
            observed = self._observed(step, fresh)
            self._broken = ""
        return observed

    def step(self, actions: Any, ignored: np.ndarray | None = None) -> Outcome:
        """Acts on all environments up to the next keyframe. Raises ValueError for an action that is none, and behind a
        step or reset that was left in the middle.

        ignored: bool [E], environments whose action nobody looks at.
        """
        self._check_going()
        controls = self.actions.controls(actions, self.envs, ignored)
        with self.whole(SimulationError):
            return self._stepped(actions, controls, ignored)

    def _stepped(self, actions: Any, controls: np.ndarray, ignored: np.ndarray | None) -> Outcome:
        diverged = np.zeros(self.envs, bool)
        try:
            step = self.simulation.step(controls)
        except Diverged as error:
            step = error.step
            diverged[error.envs] = True
        assert step.state is not None
        # What is accepted may lie beyond the space by a rounding.
        self._actions = np.clip(np.array(actions, np.float32), self.action_space.low, self.action_space.high)
        if ignored is not None:
            self._actions[ignored] = self._rest
        self.steps += 1
        state = State(step.state, self.steps / self.rate, controls)
        # One that has diverged is at its next start already, which is not to be judged.
        reward = np.where(diverged, 0.0, of_each("reward", self.task.reward(state), self.envs))
        terminated = of_each("terminated", self.task.terminated(state), self.envs).astype(bool) | diverged
        truncated = ~terminated & (self._last_step is not None) & (self.steps >= (self._last_step or 0))
        info = {name: told(name, value, self.envs) for name, value in self.task.info(state).items()}
        info["diverged"] = diverged
        observed = self._observed(step, np.ones(self.envs, bool))
        return Outcome(observed, reward, terminated, truncated, info)

    @contextmanager
    def whole(self, *refusals: type[Exception]) -> Iterator[None]:
        """Notes where something is left in the middle, as by Ctrl-C or an error of a task: observations, rewards and
        ends would be of another time than the simulation. refusals: errors before which nothing has happened, if the
        simulation stands where it did.
        """
        stamp = self.simulation.stamp_ns
        try:
            yield
        except BaseException as error:
            if not isinstance(error, refusals) or self.simulation.stamp_ns != stamp:
                self._broken = describe(error)
            raise

    def _check_going(self) -> None:
        self.simulation.check_open()
        if self._broken:
            raise ValueError(f"a step or reset was left in the middle ({self._broken}){AGAIN}")

    def _observed(self, step: Any, fresh: np.ndarray) -> Observed:
        starts, ends = (self._begun + self._stamps(steps) for steps in (np.maximum(self.steps - 1, 0), self.steps))
        if self._painter:
            self._painter.take(step, fresh)
        moment = Moment(step, starts, ends, self._actions, fresh)
        made = {name: part.values(moment) for name, part in self._parts.items()}
        # The step of a reset has nothing of those that go on: their events came with the step before it.
        for name, before in self._seen.items():
            made[name][~fresh] = before[~fresh]
        # Copies, as the arrays are the caller's from here on.
        self._seen = {name: values.copy() for name, values in made.items()}
        return made[""] if "" in made else made

    def _stamps(self, steps: np.ndarray) -> np.ndarray:
        """Computes the stamps of each environment's keyframe of this number since its reset, int64 [E] ns."""
        return np.array([keyframe_stamp(k, self.rate) for k in steps.tolist()], np.int64)

    def state(self) -> BatchState:
        """Keeps where all environments are, and what was observed of them. Raises ValueError before the first reset,
        and for what cannot be kept."""
        if not self._seen:
            raise ValueError("nothing has begun; reset() first")
        self._check_going()
        try:
            parts = {name: part.state() for name, part in self._parts.items()}
        except TypeError as error:
            raise ValueError(f"an observation keeps what cannot be copied, and has no state(): {error}") from None
        kept = {name: copy.deepcopy(getattr(self, name)) for name in _KEPT}
        painted = self._painter.steps() if self._painter else {}
        kinds = {name: type(part) for name, part in self._parts.items()}
        return BatchState(self.simulation.state(), kinds, parts, self.task.state(), kept, painted)

    def restore(self, state: BatchState) -> Observed:
        """Goes on from a `state`, and returns what all environments observed there. Raises ValueError for a state of
        other environments; nothing has happened then."""
        if {name: type(own) for name, own in self._parts.items()} != state.kinds:
            raise ValueError("the state is of environments that observe something else; make some by the same options")
        with self.whole(SimulationError):
            self.simulation.restore(state.simulation)
            for name, part in self._parts.items():
                part.restore(state.parts[name])
            self.task.restore(state.task)
            for name, value in copy.deepcopy(state.kept).items():
                setattr(self, name, value)
            if self._painter:
                self._painter.restore(state.painted)
            self._broken = ""
        seen = {name: values.copy() for name, values in self._seen.items()}
        return seen[""] if "" in seen else seen

    def paint(self, env: int) -> np.ndarray:
        """Returns the picture of an environment after the last step, uint8 [H, W, 3]. Raises ValueError."""
        if self._painter is None:
            raise ValueError('render needs render_mode="rgb_array" when the environment is made')
        return self._painter.picture(env)

    def close(self) -> None:
        """Ends the simulation."""
        self.simulation.close()
