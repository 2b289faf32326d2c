"""Runs a graph in this process once: it begins at time 0, goes on by keyframes, and can begin again."""

from __future__ import annotations

import math
import os
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np

from evis.runtime.clock import keyframe_stamp, times_slower
from evis.runtime.executor import Executor
from evis.runtime.hosting.node_call import NodeFailed, describe
from evis.runtime.plan import COMPOSED
from evis.simulation.actuators import controls_of
from evis.simulation.caller import CallerNode
from evis.simulation.errors import Diverged, SimulationError, SimulationWarning
from evis.simulation.graph import CALLER, Graph, needs_sockets
from evis.simulation.output_names import OF_CAMERA
from evis.simulation.outputs import RequestedOutputs
from evis.simulation.saved import Copied, Kind, Physics, RunState, take_again
from evis.simulation.step import IMAGE, IMAGES, Step, value_of
from evis.supervisor.run_directory import RunDirectory
from msgs.own_time import STAMP
from nodes.physics.actuators import NO_ACTUATORS
from nodes.physics.environments.resets import ResetRefused

OWN = os.path.dirname(__file__) + os.sep
"""Begins the names of the files of this package."""
MOST_KEPT = 64_000_000
"""Most bytes of actions that are kept for `replay`."""


@dataclass
class History:
    """Records what the caller did since time 0, in order, so that it can be done again.

    done: (keyframe, controls) and (keyframe, environments, seeds). size: of the controls [bytes].
    """

    done: list[tuple[Any, ...]] = field(default_factory=list)
    size: int = 0

    def add(self, *what: Any) -> None:
        """Records one action of the caller; once there is too much, nothing is kept."""
        self.size += sum(part.nbytes for part in what if isinstance(part, np.ndarray))
        self.done.append(what)
        if self.size > MOST_KEPT:
            self.done.clear()

    @property
    def whole(self) -> bool:
        """Tells whether all that was done is there."""
        return self.size <= MOST_KEPT


class Run:
    """Steps a graph from keyframe to keyframe.

    `broken`: why it cannot go on, "" where it can. `k`: number of the last keyframe, -1 before 0. `over`: no step
    follows.
    """

    def __init__(self, graph: Graph, asked: RequestedOutputs) -> None:
        """Makes and prepares all nodes. Raises SimulationError in one line that names the node."""
        self.graph = graph
        self.broken = ""
        self.k = -1
        self.over = self._finished = False
        self.last: Step | None = None
        self._asked = asked
        self._said: list[tuple[str, str, str]] = []
        self._directory: RunDirectory | None = None
        self._released = False
        plan = graph.plan
        if needs_sockets(plan):
            self._directory = RunDirectory()
            plan.run_id, plan.directory = self._directory.run_id, str(self._directory.path)
        try:
            with self._guarded():
                self._executor = Executor(plan, COMPOSED, say=lambda *line: self._said.append(line))
                self._executor.setup()
        except SimulationError as error:
            self._release()
            raise SimulationError(str(error).removesuffix(AGAIN)) from error.__cause__
        except BaseException:
            self._release()
            raise
        caller = self._executor.node(CALLER)
        assert isinstance(caller, CallerNode)
        self._caller = caller
        wanted = set(asked.topics(plan.nodes[CALLER].inputs["messages"]))
        of_cameras = [t for t in plan.topics if t.count("/") > 1 and t.rpartition("/")[2] in OF_CAMERA]
        self.cameras = tuple(dict.fromkeys(t[1:].rpartition("/")[0] for t in of_cameras))
        parts = {topic: topic[1:].rpartition("/") for topic in plan.topics if topic in wanted}
        self._topics = [(t, camera if camera in self.cameras else "", name) for t, (camera, _, name) in parts.items()]
        """Topic, camera or "", and output of what was asked for."""
        self._begin()

    def _begin(self) -> None:
        """Stands before keyframe 0."""
        self.k = -1
        self.over = self._finished = False
        self.history = History()
        self._controls = np.tile(self.graph.start, (self.envs, 1))
        self._episodes = np.zeros(self.envs, np.int32)

    @property
    def envs(self) -> int:
        """Returns the number of environments; without physics that of the messages, 1 before the first of them."""
        return int(self.parameter("envs", 1)) if self.graph.physics else self._caller.envs

    @property
    def stamp_ns(self) -> int:
        """Returns the simulated time [ns] of the last step."""
        return self._caller.stamp_ns

    @property
    def poses(self) -> np.ndarray | None:
        """Returns the poses of all bodies at that time, float64 [E, N, 7]; None in a graph without physics."""
        return self._caller.poses

    def time_of(self, env: int) -> int:
        """Returns the time [ns] of the last step since the reset of an environment."""
        own = self._caller.own
        return self.stamp_ns if own is None else int(own[env, STAMP])

    def parameter(self, name: str, otherwise: Any) -> Any:
        """Returns a parameter of the node that steps the world."""
        return self.graph.plan.nodes[self.graph.physics].params[name] if self.graph.physics else otherwise

    def summary(self) -> dict[str, Any]:
        """Returns the profiles of the nodes, without the caller's."""
        return {name: told for name, told in self._executor.summary().items() if name in self.graph.plan.nodes}

    def next_stamp(self) -> int:
        """Returns the time [ns] of the next keyframe; the present one where nobody knows it."""
        return keyframe_stamp(self.k + 1, self.parameter("keyframe_rate", 0.0)) if self.graph.physics else self.stamp_ns

    # -- what a caller does ------------------------------------------------------------------------------------------

    def rewind(self, graph: Graph) -> None:
        """Goes back to before keyframe 0, in a graph with the same nodes and perhaps another seed."""
        with self._guarded():
            graph.plan.directory, graph.plan.run_id = self.graph.plan.directory, self.graph.plan.run_id
            self.graph = graph
            self._executor.rewind(graph.plan)
            self._begin()

    def act(self, action: Any) -> None:
        """Takes controls for the time from now on. Raises SimulationError; nothing has happened then."""
        graph = self.graph
        if not graph.acts:
            why = f"node {graph.controller} publishes its actions" if graph.controller else f"it {NO_ACTUATORS}"
            raise SimulationError(f"{graph.plan.name} takes no action: {why}; step without one")
        controls = controls_of(action, self.envs, graph.actuators)
        rate = self.parameter("action_rate", None)
        held = 1 if rate is None else times_slower(self.parameter("keyframe_rate", 0.0), rate)
        # They are counted from where physics began, at a divergence anew.
        first = getattr(self._executor.node(self.graph.physics), "first", 0) if self.graph.physics else 0
        if since := (self.k - first) % held:
            raise SimulationError(
                f"an action is due at every {held}. keyframe (action_rate={rate:g}) and is held until the next; "
                f"the next is due at keyframe {self.k - since + held}, this is keyframe {self.k}"
            )
        if not np.array_equal(controls, self._controls):
            self.history.add(self.k, controls)
        self._controls = controls

    def advance(self) -> Step:
        """Simulates up to the next keyframe. Raises Diverged, and SimulationError where a node fails."""
        # An interrupt anywhere in it leaves the run broken: what has arrived and `k` belong together.
        with self._guarded():
            if self.graph.acts and self.k >= 0:
                stamp = keyframe_stamp(self.k, self.parameter("keyframe_rate", 0.0))
                self._caller.act(stamp, self._controls.copy())
            self.over = not self._executor.advance()
            self.k += 1
            lines = [text for name, _, text in self._said if name == self.graph.physics]
            step = self._taken()
            if not self.graph.physics:  # a reset in a bag is a recorded one, and nothing has diverged now
                return step
            fallen = np.flatnonzero(step.episodes != self._episodes).tolist()
            if fallen:
                # What physics has said is in the error.
                self._said = [line for line in self._said if line[0] != self.graph.physics]
                self._set_back(fallen)
        if fallen:
            raise Diverged("; ".join(lines) or f"environments {fallen} diverged", step, fallen)
        return step

    def restart(self, envs: np.ndarray, seeds: np.ndarray) -> Step:
        """Puts environments int64 [R] to their start, now; seeds int64 [R], -1 = it keeps its own. Raises
        SimulationError; nothing has happened where a seed draws other things."""
        physics = self._executor.node(self.graph.physics) if self.graph.physics else None
        restart = getattr(physics, "restart", None)
        if restart is None:
            raise SimulationError(f"{self.graph.plan.name} cannot put single environments back; reset() puts all")
        with self._guarded():
            self._executor.settle(lambda: restart(envs, seeds))
            self.history.add(self.k, envs, seeds)
            self.k = max(self.k, 0)
            step = self._taken()
            self._set_back(envs.tolist())
        return step

    def _set_back(self, envs: Sequence[int]) -> None:
        """Notes that environments are at their start, with the controls of the start."""
        self._controls = self._controls.copy()
        self._controls[list(envs)] = self.graph.start
        assert self.last is not None
        self._episodes = self.last.episodes.copy()

    def replay(self, history: History, last: int) -> None:
        """Repeats what was done in another run, up to keyframe `last`."""
        for entry in [*history.done, (last,)]:
            while self.k < entry[0]:
                with suppress(Diverged):
                    self.advance()
            if len(entry) == 2:
                self.act(entry[1])
            elif len(entry) == 3:
                self.restart(entry[1], entry[2])

    def state(self) -> RunState:
        """Gives where the run is, so that `restore` goes on from here. Raises SimulationError where it cannot."""
        name = self.graph.plan.name
        if not self.graph.physics:
            raise SimulationError(f"{name} plays what was recorded, and its state is that of a file; open it again")
        if self.graph.controller:
            raise SimulationError(
                f"{name} is driven by node {self.graph.controller}, whose state nobody knows; give the actions to step"
            )
        if self.k < 0 or self._finished or self.last is None:
            what = "the run has ended" if self._finished else "nothing has run yet"
            raise SimulationError(f"there is no state to keep: {what}; reset() first")
        physics, first = self._executor.node(self.graph.physics), self._made_from()
        copied = physics.kept() if first == self.k and isinstance(physics, Copied) else None
        if copied is None and not self.history.whole:
            raise SimulationError("the run has more actions than are kept for a state; reset() begins a shorter one")
        try:
            nodes = self._executor.state()
        except ValueError as error:
            raise SimulationError(str(error)) from None
        done, kind, controls = self.history, kind_of(self.graph), self._controls.copy()
        where = self.k, self.over, controls, self.last, first, copied
        return RunState(kind, tuple(done.done), done.size, *where, nodes)

    def restore(self, graph: Graph, state: RunState) -> Step:
        """Goes to where a state was taken; gives the step that ended there.

        Physics is copied, or takes the steps again; of the rest a last keyframe is made, from which the next gap goes
        on, or as many as that depends on.
        """
        self.rewind(graph)
        with self._guarded():
            physics = self._physics()
            if state.physics is not None:
                assert isinstance(physics, Copied)
                physics.go_on(state.physics)
                self._controls = state.controls.copy()
            else:
                earlier = [entry for entry in state.done if entry[0] <= state.first]
                self._controls = take_again(physics, earlier, state.first, graph.start, graph.acts)
            self._executor.settle(physics.present)
            self._taken()
            self.k, self._episodes = state.first, physics.episodes.copy()
            later = [entry for entry in state.done if entry[0] > state.first]
        self.replay(History(later), state.k)
        with self._guarded():
            self._executor.restore(state.nodes)
        self.history = History([*state.done], state.size)
        self.over, self.last = state.over, state.last
        return state.last

    def _physics(self) -> Physics:
        """Gives the node that steps the world."""
        return cast(Physics, self._executor.node(self.graph.physics))

    def _made_from(self) -> int:
        """Gives the number of the keyframe from which on all have to be made for every node to go on from the present
        one: a camera with a rate of its own has not had every keyframe, and some interpolators look back."""
        physics, every, back = self._physics(), 1, 0
        for name, of_node in self.graph.plan.nodes.items():
            node = self._executor.node(name)
            back = max(back, node.looks_back(of_node.params))
            if not node.SOURCE:
                every = math.lcm(every, node.divides(of_node.params))
        return max(physics.first, self.k - (self.k - physics.first) % every - back * every)

    def finish(self) -> Step:
        """Ends the run; gives what the nodes had held back."""
        with self._guarded():
            self._executor.finish()
            self.over = self._finished = True
            return self._taken()

    def close(self) -> None:
        """Ends the run unless it is broken, and releases everything."""
        try:
            if not self.broken and self.k >= 0 and not self._finished:
                self._executor.finish()
        finally:
            self._release()

    def _release(self) -> None:
        """Closes nodes and sockets, once. What was left in the middle of something may fail again when it is closed:
        that is no news, and must not keep another run from beginning."""
        executor, released, self._released = getattr(self, "_executor", None), self._released, True
        if released:
            return
        try:
            if executor is not None:
                with suppress(NodeFailed) if self.broken else nullcontext():
                    executor.close_nodes()
        finally:
            if executor is not None:
                executor.close()
            if self._directory is not None:
                self._directory.close()

    # -- one step ----------------------------------------------------------------------------------------------------

    def _taken(self) -> Step:
        """Makes the step of what has arrived."""
        taken = self._caller.take()
        cameras: dict[str, dict[str, Any]] = {name: {} for name in self.cameras}
        others: dict[str, Any] = {}
        for topic, camera, name in self._topics:
            found = taken.get(topic, [])
            (cameras[camera] if camera else others)[name] = value_of(found[-1] if found else None)
            if name == IMAGE:
                cameras[camera][IMAGES] = tuple(found)
        episodes = np.zeros(self.envs, np.int32) if self._caller.episodes is None else self._caller.episodes
        self.last = Step(self.stamp_ns, episodes, cameras, others, self.over, self._finished)
        return self.last

    def warn(self) -> None:
        """Passes on what nodes have said, as Python's warnings, which are told once each."""
        said, self._said = self._said, []
        # They are told where the caller is.
        stacklevel, frame = 1, sys._getframe()
        while frame.f_back is not None and frame.f_code.co_filename.startswith(OWN):
            stacklevel, frame = stacklevel + 1, frame.f_back
        for name, level, text in said:
            if level != "info":
                warnings.warn(f"{name}: {text}", SimulationWarning, stacklevel=stacklevel)

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        """Notes that the run is broken where it is left in the middle of something."""
        try:
            yield
        except ResetRefused as refused:
            raise SimulationError(str(refused)) from None
        except BaseException as error:
            cause = error.__cause__ if isinstance(error, NodeFailed) and error.__cause__ else error
            node = f"{error.node}: " if isinstance(error, NodeFailed) else ""
            text = describe(cause)
            self.broken = text if text.startswith(node) else node + text
            if isinstance(error, Exception):
                raise SimulationError(self.broken + AGAIN) from cause
            raise


def kind_of(graph: Graph) -> Kind:
    """Gives what a graph computes, which the states of its runs have in common."""
    return {name: (node.target, node.params) for name, node in graph.plan.nodes.items()}


AGAIN = "; reset() begins anew"
