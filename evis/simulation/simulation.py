"""Simulation: the graph that `evis launch` would start, in this process, stepped by the caller."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from evis.launch.planner import COMPOSED
from evis.runtime.clock import keyframe_stamp, times_slower
from evis.runtime.executor import Executor
from evis.runtime.host import NodeFailed, describe
from evis.scene.model import Scene
from evis.scene.parameters import SCENE, scene_of
from evis.simulation.actuators import Actuator
from evis.simulation.caller import CallerNode
from evis.simulation.errors import Diverged, SimulationError, SimulationWarning
from evis.simulation.graph import CALLER, Planner, needs_sockets
from evis.simulation.outputs import OF_CAMERA, parse
from evis.simulation.step import Step, value_of
from evis.supervisor.run_directory import RunDirectory

NS = 1e9


class Simulation:
    """Runs a scene or a launch file in this process, one keyframe at a time.

    The graph is the one that `evis launch` starts, with the same nodes and parameters, and for a seed it gives the same
    events, byte for byte; what `outputs` does not name is not computed. It opens no socket and starts no process.

        with evis.Simulation("spinning_disk", omega=20, outputs=["events", "depth"]) as sim:
            step = sim.reset(seed=3)
            step = sim.step()
            step.events.t, step.depth

    Only one thread may use it at a time.
    """

    def __init__(
        self, scene_or_launch: str | Path, /, *, outputs: Sequence[str] = ("events",), seed: int = 0, **arguments: Any
    ) -> None:
        """Plans the graph and prepares its nodes; the first time that takes as long as its kernels take to compile.

        Args:
            scene_or_launch: what may stand after `evis launch`: a scene or launch file by name or path, an MJCF
                or URDF.
            outputs: what steps are to have: events, frames, keyframe, depth, ids, motion, normal, labels, imu, state,
                of all cameras, or of one (`cam1.events`), or one kind of label (`labels.flow`).
            seed: of what is random; environment k has seed + k.
            arguments: those of the launch file and of the scene, as `evis launch NAME --help` lists them.

        Raises:
            SimulationError: in one line, for anything that `evis launch` would refuse.
        """
        self._closed = False
        self._asked = parse(outputs)
        self._seed = seed
        self._planner = Planner(str(scene_or_launch), self._asked, arguments)
        self._said: list[tuple[str, str, str]] = []
        self._graph = self._planner.plan(seed)
        self._plans = {seed: self._graph}
        self._directory: RunDirectory | None = None
        self._build()

    # -- what it is --------------------------------------------------------------------------------------------------

    @property
    def envs(self) -> int:
        """Number of parallel environments."""
        return int(self._physics("envs", 1))

    @property
    def keyframe_rate(self) -> float:
        """Steps per simulated second [Hz]."""
        return float(self._physics("keyframe_rate", 0.0))

    @property
    def actuators(self) -> tuple[Actuator, ...]:
        """The model's actuators, in the order of an action's last axis."""
        return self._graph.actuators.all

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the cameras in the graph, the first one first."""
        return tuple(self._cameras)

    @property
    def scene(self) -> Scene:
        """The scene that is simulated. Raises SimulationError for a graph without one."""
        if not self._graph.physics:
            raise SimulationError(f"{self._graph.plan.name} simulates no scene")
        params = self._graph.plan.nodes[self._graph.physics].params
        return scene_of("simulation", {name: params.get(name) for name in SCENE})

    @property
    def stamp_ns(self) -> int:
        """Simulated time [ns] of the last step."""
        return self._caller.stamp_ns

    def _physics(self, name: str, otherwise: Any) -> Any:
        nodes = self._graph.plan.nodes
        return nodes[self._graph.physics].params[name] if self._graph.physics else otherwise

    # -- life --------------------------------------------------------------------------------------------------------

    def _build(self) -> None:
        """Makes the nodes and prepares them."""
        self._broken = ""
        self._k = -1
        plan = self._graph.plan
        if needs_sockets(plan) and self._directory is None:
            self._directory = RunDirectory()
        if self._directory is not None:
            plan.run_id, plan.directory = self._directory.run_id, str(self._directory.path)
        try:
            self._executor = Executor(plan, COMPOSED, say=lambda *line: self._said.append(line))
            with self._guarded():
                self._executor.setup()
        except NodeFailed as error:
            raise SimulationError(str(error)) from error.__cause__
        caller = self._executor.node(CALLER)
        assert isinstance(caller, CallerNode)
        self._caller = caller
        topics = plan.nodes[CALLER].inputs["messages"]
        wanted = set(self._asked.topics(topics))
        camera_topics = [t for t in plan.topics if t.count("/") > 1 and t.rpartition("/")[2] in OF_CAMERA]
        self._cameras = list(dict.fromkeys(t[1:].rpartition("/")[0] for t in camera_topics))
        self._topics = [t for t in plan.topics if t in wanted]

    def reset(self, seed: int | Sequence[int] | None = None, envs: Sequence[int] | None = None) -> Step:
        """Begins a run at time 0, or puts some environments back to their start at the present time.

        Args:
            seed: of the run, environment k having seed + k, or a seed for each environment that is reset; not given =
                the constructor's.
            envs: environments to put back; the others go on. Not given = all of them, and time starts at 0.

        Returns the step at keyframe 0, or, of some environments, at the present stamp. Raises SimulationError.
        """
        self._check_open()
        if envs is not None:
            return self._reset_some(envs, seed)
        seeds = None if seed is None or np.ndim(seed) == 0 else seed
        wanted = self._seed if seed is None or seeds is not None else int(seed)  # type: ignore[arg-type]
        if wanted not in self._plans:
            self._plans = {self._seed: self._plans[self._seed], wanted: self._planner.plan(wanted)}
        other = self._graph is not self._plans[wanted]
        self._graph = self._plans[wanted]
        if self._broken:
            self._executor.close()
            self._build()
        elif self._k >= 0 or other:
            with self._guarded():
                self._graph.plan.directory = self._executor.plan.directory
                self._executor.rewind(self._graph.plan)
        self._k = -1
        self._over = False
        self._controls = np.tile(self._graph.actuators.start, (self.envs, 1))
        self._episodes = np.zeros(self.envs, np.int32)
        if seeds is None:
            return self._advance()
        self._k = 0
        return self._reset_some(range(self.envs), seeds)

    def _reset_some(self, envs: Sequence[int], seed: int | Sequence[int] | None) -> Step:
        """Puts some environments to their start at the present stamp."""
        self._check_usable()
        if self._k < 0:
            self.reset()
        chosen = np.asarray(envs, np.int64).reshape(-1)
        if (wrong := chosen[(chosen < 0) | (chosen >= self.envs)]).size:
            raise SimulationError(f"there is no environment {wrong[0]}; there are {self.envs}, 0 to {self.envs - 1}")
        if not chosen.size:
            raise SimulationError("reset of no environment; leave envs out to reset all of them")
        seeds = np.full(len(chosen), -1, np.int64)
        if seed is not None:
            seeds = np.asarray(seed, np.int64).reshape(-1)
            seeds = seeds[0] + chosen if seeds.size == 1 else seeds
        if len(seeds) != len(chosen):
            raise SimulationError(f"reset has {len(seeds)} seeds for {len(chosen)} environments; it takes one for each")
        physics = self._executor.node(self._graph.physics) if self._graph.physics else None
        restart = getattr(physics, "restart", None)
        if restart is None:
            raise SimulationError(f"{self._graph.plan.name} cannot put single environments back; reset() puts all")
        with self._guarded():
            self._executor.settle(lambda: restart(chosen, seeds))
        assert self._caller.state is not None
        self._episodes = self._caller.state[1]
        self._controls[chosen] = self._graph.actuators.start
        return self._taken()

    def step(self, action: Any = None) -> Step:
        """Goes on to the next keyframe.

        Args:
            action: controls [E, nu], or [nu] of a single environment, in the units of the model's actuators, for the
                time up to the next keyframe; not given = as before, at first the model's own.

        Returns what was asked for of the interval that ends there. Raises SimulationError for an action of a wrong
        shape, not finite or out of range (nothing has happened then), and for a node that failed (`reset` begins anew);
        Diverged where an environment has diverged, and begins its next episode.
        """
        self._check_usable()
        if self._k < 0:
            self.reset()
        if self._over:
            raise SimulationError(f"{self._graph.plan.name} has ended; reset() begins anew")
        if action is not None:
            self._take_action(action)
        if self._graph.acts:
            self._caller.act(keyframe_stamp(self._k, self.keyframe_rate), self._controls.copy())
        return self._advance()

    def _take_action(self, action: Any) -> None:
        graph = self._graph
        if not graph.acts:
            why = f"node {graph.controller} publishes its actions" if graph.controller else "it has no actuators"
            raise SimulationError(f"{graph.plan.name} takes no action: {why}; step without one")
        controls = graph.actuators.controls(action, self.envs)
        rate = self._physics("action_rate", None)
        held = 1 if rate is None else times_slower(self.keyframe_rate, rate)
        if self._k % held:
            raise SimulationError(
                f"an action is due at every {held}. keyframe (action_rate={rate:g}) and is held until the next; "
                f"step {held - self._k % held} times without one"
            )
        self._controls = controls

    def run(self, seconds: float, action: Any = None) -> list[Step]:
        """Goes on for so many simulated seconds, and returns every step; the first of a run is that at keyframe 0.

        action: see `step`; held all the time.
        """
        if not seconds > 0:
            raise SimulationError(f"run takes a time longer than 0 s, not {seconds}")
        self._check_usable()
        steps = [self.reset()] if self._k < 0 else []
        end = self.stamp_ns + round(seconds * NS)
        while not self._over and self._next_stamp() <= end:
            steps.append(self.step(action))
            action = None
        return steps

    def _next_stamp(self) -> int:
        return keyframe_stamp(self._k + 1, self.keyframe_rate) if self._graph.physics else self.stamp_ns

    def finish(self) -> Step:
        """Ends the run, and returns what the nodes had held back: the last events of a sensor that looks ahead."""
        self._check_usable()
        with self._guarded():
            self._executor.finish()
        self._over = True
        return self._taken()

    def close(self) -> None:
        """Ends the run and releases memory and files. A second call does nothing."""
        if self._closed:
            return
        self._closed = True
        try:
            if not self._broken and self._k >= 0 and not self._over:
                self._executor.finish()
        finally:
            try:
                self._executor.close_nodes()
            finally:
                self._executor.close()
                if self._directory is not None:
                    self._directory.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # -- one step ----------------------------------------------------------------------------------------------------

    def _advance(self) -> Step:
        with self._guarded():
            self._over = not self._executor.advance()
        self._k += 1
        lines = [text for name, _, text in self._said if name == self._graph.physics]
        step = self._taken()
        if (step.episodes != self._episodes).any():
            envs = np.flatnonzero(step.episodes != self._episodes).tolist()
            self._controls[envs] = self._graph.actuators.start
            self._episodes = step.episodes
            raise Diverged("; ".join(lines) or f"environments {envs} diverged", step, envs)
        return step

    def _taken(self) -> Step:
        """Makes the step of what has arrived."""
        taken = self._caller.take()
        values = {topic: value_of(taken.get(topic)) for topic in self._topics}
        cameras: dict[str, dict[str, Any]] = {name: {} for name in self._cameras}
        others: dict[str, Any] = {}
        for topic, value in values.items():
            camera, _, name = topic[1:].rpartition("/")
            (cameras[camera] if camera in cameras else others)[name] = value
        episodes = self._caller.state[1] if self._caller.state is not None else np.zeros(self.envs, np.int32)
        self._warn()
        return Step(self._caller.stamp_ns, episodes, cameras, others, self._over)

    def _warn(self) -> None:
        """Passes on what nodes have said, as Python's warnings, which are told once each."""
        said, self._said = self._said, []
        for name, level, text in said:
            if level != "info":
                warnings.warn(f"{name}: {text}", SimulationWarning, stacklevel=4)

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        """Notes that the graph is broken where it is left in the middle of something."""
        try:
            yield
        except BaseException as error:
            cause = error.__cause__ if isinstance(error, NodeFailed) and error.__cause__ else error
            node = f"{error.node}: " if isinstance(error, NodeFailed) else ""
            self._broken = f"{node}{describe(cause)}"
            if isinstance(error, Exception):
                raise SimulationError(f"{self._broken}; reset() begins anew") from cause
            raise

    def _check_open(self) -> None:
        if self._closed:
            raise SimulationError("the simulation is closed; make another one")

    def _check_usable(self) -> None:
        self._check_open()
        if self._broken:
            raise SimulationError(f"the simulation has stopped ({self._broken}); reset() begins anew")
