"""Implements Simulation: the graph that `evis launch` would start, in this process, stepped by the caller."""

from __future__ import annotations

import math
import operator
import os
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Never, Self

import numpy as np

from evis.client.resets import environments_of, seeds_of
from evis.config.suggestions import environments_there
from evis.runtime.process.garbage_collection import without_garbage_collection
from evis.scene.model import Scene
from evis.scene.parameters import SCENE, of_environment, scene_of
from evis.scene.parameters import seeds_of as seeds_of_environments
from evis.simulation.actuators import Actuator, each
from evis.simulation.each import alone, info_of
from evis.simulation.errors import SimulationError
from evis.simulation.graph import Graph, Planner
from evis.simulation.outputs import parse
from evis.simulation.picture import Viewer, as_html, events_over_light
from evis.simulation.run import AGAIN, Run, kind_of
from evis.simulation.saved import SimulationState, check_kind
from evis.simulation.step import Step, on_host
from evis.simulation.threads import one_at_a_time
from msgs.own_time import CONFIGURED


class Simulation:
    """Runs a scene or a launch file in this process, one keyframe at a time.

    The graph is the one that `evis launch` starts, with the same nodes and parameters, and for a seed it gives the same
    events, byte for byte; what `outputs` does not name is not computed. It opens no socket and starts no process.

        with evis.Simulation("spinning_disk", omega=20, outputs=["events", "depth"]) as sim:
            step = sim.reset(seed=3)
            step = sim.step()
            step.events.t, step.depth

    Only one thread may use it at a time; another is refused meanwhile.
    """

    def __init__(
        self,
        scene_or_launch: str | Path,
        /,
        *,
        outputs: Sequence[str] = ("events",),
        seed: int | None = None,
        each: Sequence[Mapping[str, Any]] | None = None,
        **arguments: Any,
    ) -> None:
        """Plans the graph and prepares its nodes; the first time that takes as long as its kernels take to compile.

        Args:
            scene_or_launch: what may stand after `evis launch`: a scene or launch file by name or path, an MJCF or URDF
                file.
            outputs: what steps are to have: events, frames, keyframe, depth, ids, motion, normal, labels, imu, state,
                of all cameras, or of one (`cam1.events`), or one kind of label (`labels.flow`); what `finish` is to
                have: physics_error.
            seed: of what is random; environment k has seed + k. None = that of the launch file, 0 unless it says
                another, and of a replay that of the recorded run.
            each: arguments that parallel environments have for themselves, a mapping for each of them: of the scene,
                as far as they change values and not what there is, of the event sensor, and `seed`. None = they
                have all in common.
            arguments: those of the launch file and of the scene, as `evis launch NAME --help` lists them.

        Raises:
            SimulationError: in one line, for anything that `evis launch` would refuse.
        """
        self._closed = True
        self._process = os.getpid()
        """Of which the threads are that the run may have."""
        self._in_use = threading.RLock()
        self._seeds: dict[int, int] = {}
        """Environment -> the seed that it was reset with, where that is not the run's and its number."""
        self._asked = parse(outputs)
        self._planner = Planner(str(scene_or_launch), self._asked, arguments, each)
        with without_garbage_collection():
            graph = self._planner.plan(seed)
            self._own_seed = self._seed = graph.seed if seed is None else seed
            self._graphs = {self._own_seed: graph}
            self._run = Run(graph, self._asked)
        self._viewers: dict[str, Viewer] = {}
        self._closed = False
        self._run.warn()

    # -- what it is --------------------------------------------------------------------------------------------------

    @property
    def envs(self) -> int:
        """Returns the number of parallel environments."""
        return self._run.envs

    @property
    def keyframe_rate(self) -> float:
        """Returns the steps per simulated second [Hz]; 0 in a graph without physics."""
        return float(self._run.parameter("keyframe_rate", 0.0))

    @property
    def actuators(self) -> tuple[Actuator, ...]:
        """Returns the model's actuators, in the order of an action's last axis."""
        return each(self._run.graph.actuators)

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names the cameras in the graph, the first one first."""
        return self._run.cameras

    @property
    def scene(self) -> Scene:
        """Returns the scene that is simulated, as environment 0 has it; it is shared, and nobody may write to it.

        Raises SimulationError without one.
        """
        return self._scene_of(0)

    def _scene_of(self, env: int) -> Scene:
        """Returns the scene as an environment has it now, with arguments of its own and drawn by its seed."""
        graph = self._run.graph
        if not graph.physics:
            raise SimulationError(f"{graph.plan.name} simulates no scene")
        params = graph.plan.nodes[graph.physics].params
        own = of_environment(params, env)
        seed = self._seeds.get(env, seeds_of_environments(params)[env])
        return scene_of("simulation", {**{name: own.get(name) for name in SCENE}, "seed": seed})

    @property
    def chosen(self) -> Mapping[str, Any]:
        """Returns what `interpolator="auto"` or `upsampling="auto"` has chosen, and why: method, keyframe rate, frames
        and what was measured, as `evis launch --json` tells it. It holds for every seed; empty without auto.
        """
        return dict(self._run.graph.plan.chosen)

    @property
    def stamp_ns(self) -> int:
        """Returns the simulated time [ns] of the last step."""
        return self._run.stamp_ns

    def summary(self) -> dict[str, Any]:
        """Tells what each node has done since the last reset of all: calls, time [s], messages, and what it counted, as
        `nodes` in the summary of `evis launch --json`.
        """
        return self._run.summary()

    # -- what it does ------------------------------------------------------------------------------------------------

    @one_at_a_time
    def reset(self, seed: int | Sequence[int] | None = None, envs: Sequence[int] | None = None) -> Step:
        """Begins a run at time 0, or puts some environments back to their start at the present time.

        Args:
            seed: of the run, environment k having seed + k, or a seed for each environment that is reset. Not given:
                the constructor's; of some environments, the one that each has.
            envs: numbers of those to put back; the others go on. Not given = all of them, and time starts at 0.

        Returns the step at keyframe 0, or, of some environments, at the present stamp. Raises SimulationError.
        """
        self.check_open()
        chosen, seeds = self._named(envs, seed)
        if len(chosen) < self.envs:
            return self._reset_some(chosen, seeds)
        if seed is not None and seeds is not None and np.ndim(seed):
            return self._reset_to(chosen, seeds)
        self._begin(self._own_seed if seeds is None else seeds[chosen.tolist().index(0)])
        step = self._run.advance()
        self._run.warn()
        return step

    def _begin(self, seed: int) -> None:
        """Stands before keyframe 0 of a run with this seed."""
        graph = self._graph_of(seed)
        self._seed = seed
        if self._run.broken or self._run.graph.things != graph.things:
            self._run.close()
            self._run = Run(graph, self._asked)
        elif self._run.k >= 0 or self._run.graph is not graph:
            self._run.rewind(graph)
        self._seeds = {}

    def _reset_to(self, chosen: np.ndarray, seeds: list[int]) -> Step:
        """Begins a run with a seed for each environment, in a graph that is planned for the constructor's.

        Where those draw what that graph has no room for, such as another event model, it is planned for the seed of
        environment 0, with which the others have to go together then.
        """
        self._begin(self._own_seed)
        try:
            return self._reset_some(chosen, seeds)
        except SimulationError:
            first = seeds[chosen.tolist().index(0)]
            if self._run.broken or first == self._own_seed:
                raise
            try:
                self._begin(first)
                return self._reset_some(chosen, seeds)
            except SimulationError:
                self._begin(self._own_seed)
                raise

    def _named(
        self, envs: Sequence[int] | None, seed: int | Sequence[int] | None
    ) -> tuple[np.ndarray, list[int] | None]:
        """Checks which environments a reset is of, int64 [R], and their seeds, before anything has happened."""
        try:
            chosen = np.arange(self.envs) if envs is None else environments_of(envs)
            seeds = None if seed is None else seeds_of(seed, chosen.tolist())
        except ValueError as error:
            raise SimulationError(str(error)) from None
        if (wrong := chosen[chosen >= self.envs]).size:
            self._check_environment(int(wrong[0]))
        if not chosen.size or len(np.unique(chosen)) < len(chosen):
            raise SimulationError("reset takes each environment once, and at least one; without envs it resets all")
        if seeds is not None and len(seeds) != len(chosen):
            raise SimulationError(f"reset has {len(seeds)} seeds for {len(chosen)} environments; it takes one for each")
        return chosen, seeds

    def _reset_some(self, chosen: np.ndarray, seeds: list[int] | None) -> Step:
        """Puts environments int64 [R] to their start at the present stamp; seeds: of each, None = they keep theirs."""
        self._check_going()
        if self._run.k < 0 and len(chosen) < self.envs:
            self._run.advance()
        given = np.full(len(chosen), CONFIGURED) if seeds is None else np.array(seeds, np.int64)
        step = self._run.restart(chosen, given)
        self._seeds |= {env: value for env, value in zip(chosen.tolist(), given.tolist()) if value != CONFIGURED}
        self._run.warn()
        return step

    @one_at_a_time
    def step(self, action: Any = None) -> Step:
        """Simulates up to the next keyframe, and returns the outputs of that interval.

        Args:
            action: controls [E, nu], or [nu] of a single environment, in the units of the model's actuators, for the
                time up to the next keyframe; not given = as before, at first the model's own.

        Raises SimulationError for an action of a wrong shape, not finite or out of range (nothing has happened then),
        and for a node that failed (`reset` begins anew); Diverged where an environment has diverged, and begins its
        next episode.
        """
        self._check_going()
        if self._run.k < 0:
            self._run.advance()
        if action is not None:
            self._run.act(action)
        try:
            return self._run.advance()
        finally:
            self._run.warn()

    @one_at_a_time
    def run(self, seconds: float, action: Any = None) -> list[Step]:
        """Simulates so many seconds, and returns every step; the first of a run is that at keyframe 0.

        action: see `step`; held all the time.
        """
        if not _is_duration(seconds):
            raise SimulationError(f"run takes a finite time longer than 0 s, not {seconds!r:.60}")
        self._check_going()
        steps = [self.reset(self._seed)] if self._run.k < 0 else []
        # Each of both stamps, and the time itself, is rounded to whole ns.
        end = self.stamp_ns + round(seconds * 1e9) + 1
        while not self._run.over and self._run.next_stamp() <= end:
            steps.append(self.step(action))
            action = None
        return steps

    def alone(self, step: Step, env: int) -> Step:
        """Extracts one environment from a step of parallel environments: what a simulation of that one, with its seed,
        would have given. Events are in numpy arrays.

        Raises SimulationError for an output that cannot be taken apart, and for an environment that is not there.
        """
        self._check_environment(env)
        if not isinstance(step, Step):
            raise SimulationError(f"alone takes a step, as sim.step() gives it, not {step!r:.60}")
        told = {name: info for name, outputs in step.cameras.items() if (info := vars(outputs).get("info")) is not None}
        if not told:
            return alone(step, env, {})
        graph = self._run.graph
        if graph.each and env not in self._seeds:
            plan = graph.each[env]
        else:
            plan = self._planner.plan_of(env, self._seeds.get(env, self._seed + env))
        return alone(step, env, {name: info_of(info, env, plan, graph.physics) for name, info in told.items()})

    @one_at_a_time
    def finish(self) -> Step:
        """Ends the run, and returns what the nodes had held back: the last events of a sensor that looks ahead."""
        self._check_usable()
        try:
            return self._run.finish()
        finally:
            self._run.warn()

    @one_at_a_time
    def save(self, bag: str | Path) -> None:
        """Writes the bag that `evis launch --record` would have made of the run since time 0.

        Nothing is recorded while the run goes on: it is run once more here, from its seed and its actions, and as the
        same seed gives the same bytes the bag holds what the steps gave. It takes as long as the run took. An older bag
        of that name is kept, as `evis launch` keeps it. Raises SimulationError.
        """
        self.check_open()
        if not isinstance(bag, str | Path) or not str(bag):
            raise SimulationError(f"save takes the path of a bag, as 'run.mcap', not {bag!r:.60}")
        done = self._run
        if done.k < 0 or done.broken:
            raise SimulationError(f"there is no run to save; {done.broken or 'reset() and step() first'}")
        if not done.history.whole:
            raise SimulationError("the run has more actions than are kept for `save`; reset() begins a shorter one")
        again = Run(self._planner.plan(self._seed, record=str(bag)), self._asked)
        try:
            again.replay(done.history, done.k)
        finally:
            again.close()

    # -- its state ---------------------------------------------------------------------------------------------------

    @one_at_a_time
    def state(self) -> SimulationState:
        """Keeps where all environments are, so that `restore` goes on from here, as often as wanted.

        The same actions then give the same bytes as the first time. It can be restored in any simulation that is made
        by the same arguments, in this process. Raises SimulationError where a node cannot tell its state: an audit,
        one of your own without `state()`, a recording that is played.
        """
        self._check_usable()
        return SimulationState(self.stamp_ns, self._seed, dict(self._seeds), self._run.state())

    @one_at_a_time
    def restore(self, state: SimulationState) -> Step:
        """Goes on from a `state`, whatever has happened since; returns the step at whose end it was taken.

        One keyframe is rendered for that. Physics that cannot be copied takes the steps up to there again.
        Raises SimulationError for the state of another simulation; nothing has happened then.
        """
        self.check_open()
        if not isinstance(state, SimulationState):
            raise SimulationError(f"restore takes what sim.state() gave, not {state!r:.60}")
        graph = self._graph_of(state._seed)
        check_kind(state._run.kind, kind_of(graph))
        if self._run.broken or self._run.graph.things != graph.things:
            self._run.close()
            self._run = Run(graph, self._asked)
        step = self._run.restore(graph, state._run)
        self._seed, self._seeds = state._seed, dict(state._seeds)
        self._run.warn()
        return step

    def _graph_of(self, seed: int) -> Graph:
        """Gives the graph of a seed; that of the constructor's and the last one are kept."""
        if seed not in self._graphs:
            own = self._graphs[self._own_seed]
            self._graphs = {self._own_seed: own, seed: self._planner.plan(seed)}
        return self._graphs[seed]

    # -- how it looks ------------------------------------------------------------------------------------------------

    @one_at_a_time
    def show(self, env: int = 0) -> dict[str, np.ndarray]:
        """Draws the last step, camera -> uint8 [H, W, 3]: its events over the light that the camera sees now.

        A notebook shows it for a Simulation by itself. Without events among the outputs it is the light alone. Raises
        SimulationError for a graph without a renderer.
        """
        self.check_open()
        last, poses = self._run.last, self._run.poses
        if last is None or self._run.k < 0:
            raise SimulationError("nothing has run yet; reset() first")
        self._check_environment(env)
        found = {}
        for node in self._run.graph.plan.nodes.values():
            if node.target.endswith(":RendererNode") and poses is not None:
                camera, scene = node.params["camera"], self._scene_of(env)
                viewer = self._viewers.get(camera)
                if viewer is None or not viewer.suits(scene):
                    viewer = self._viewers[camera] = Viewer(scene, node.params)
                light = viewer.luminance(poses[env : env + 1], self._run.time_of(env))
                packet = vars(last.cameras[camera]).get("events")
                found[camera] = events_over_light(light, packet if packet is None else on_host(packet), env)
        if not found:
            raise SimulationError(f"{self._run.graph.plan.name} renders nothing that could be shown")
        return found

    def _repr_html_(self) -> str:
        title = f"{self._run.graph.plan.name}, {self.stamp_ns * 1e-9:g} s"
        try:
            return as_html(self.show(), title)
        except SimulationError:  # closed, not begun, or nothing is rendered: a notebook would show a traceback
            return f"<div>{title}</div>"

    # -- its end -----------------------------------------------------------------------------------------------------

    def close(self) -> None:
        """Ends the run and releases memory and files. A second call does nothing, nor does one in a forked process,
        whose copy of the run goes with it."""
        if os.getpid() != self._process:
            return
        with self._in_use:  # waits for what another thread is in
            if not self._closed:
                self._closed = True
                try:
                    self._run.close()
                finally:
                    self._run.warn()  # some things are known at the end of a run only

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __reduce__(self) -> Never:
        raise SimulationError("a simulation cannot be copied or pickled; make one where it is needed, by its arguments")

    def _check_environment(self, env: Any) -> None:
        try:
            found = 0 <= operator.index(env) < self.envs
        except TypeError:
            found = False
        if not found:
            raise SimulationError(f"there is no environment {env!r:.60}; {environments_there(self.envs)}")

    def check_open(self) -> None:
        """Raises SimulationError where it was closed, or belongs to the process that this one was forked from."""
        if self._closed:
            raise SimulationError("the simulation is closed; make another one")
        if os.getpid() != self._process:
            raise SimulationError(
                "a simulation cannot go on in a process that was forked from its own, whose threads are not there; "
                "make one where it is needed, by its arguments"
            )

    def _check_usable(self) -> None:
        self.check_open()
        if self._run.broken:
            raise SimulationError(f"the simulation has stopped ({self._run.broken}){AGAIN}")

    def _check_going(self) -> None:
        self._check_usable()
        if self._run.over:
            raise SimulationError(f"{self._run.graph.plan.name} has ended{AGAIN}")


def _is_duration(seconds: Any) -> bool:
    """Tells whether it is a number of seconds that can be simulated."""
    try:
        return bool(0 < seconds < math.inf)
    except (TypeError, ValueError):
        return False
