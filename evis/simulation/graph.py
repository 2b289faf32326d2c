"""Makes the plan of a graph in this process from a scene or launch file and its arguments, with the caller in it."""

from __future__ import annotations

import copy
import dataclasses
import warnings
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from evis.config.document import LaunchError
from evis.config.params import ParamError
from evis.launch import catalog
from evis.launch.expand import Expanded, NodeSpec
from evis.launch.planner import Options, plan_launch
from evis.launch.target import read_target
from evis.runtime.plan import COMPOSED, Plan
from evis.scene.parameters import SCENE, SEED, scene_of
from evis.scene.worlds import things_of
from evis.simulation.actuators import actuators_of
from evis.simulation.auto import Chosen, without_auto
from evis.simulation.each import together
from evis.simulation.errors import SimulationError, SimulationWarning
from evis.simulation.output_names import LABELS
from evis.simulation.outputs import RequestedOutputs
from msgs.topics import SYSTEM_TOPICS
from nodes.physics.actuators import Actuators

CALLER = "caller"
"""Name of the caller's node."""
ACTION = "/action"
IMAGE = "image"
OF_OUTPUTS = {LABELS: "labels.flow", IMAGE: IMAGE}
"""Arguments that are turned on by an output of steps, as the second names it."""


@dataclass
class Graph:
    """Holds the plan of a graph, and what the caller can move.

    seed: of the run, environment k having seed + k unless it has one of its own. physics: name of the node that steps
    the world; "" without one.

    controller: node of the launch file that publishes /action, so that the caller cannot. start: controls float64 [nu]
    that the model starts with.
    """

    plan: Plan
    seed: int = 0
    physics: str = ""
    controller: str = ""
    actuators: Actuators = field(default_factory=Actuators)
    start: np.ndarray = field(default_factory=lambda: np.zeros(0))
    things: Mapping[str, list[str]] = field(default_factory=dict)
    """What nodes are made for, as `things_of` gives it, of environment 0."""
    each: Sequence[Plan] = ()
    """The plans of environments that have arguments of their own, as they would be by themselves."""

    @property
    def acts(self) -> bool:
        """Tells whether the caller publishes actions."""
        return ACTION in self.plan.topics and self.plan.topics[ACTION].node == CALLER


class Planner:
    """Plans one simulation again and again: with another seed, or with a recorder.

    target: what may stand after `evis launch`. asked: outputs. arguments: of the launch file and the scene. each: those
    that environments have for themselves, a mapping for each of them, also their `seed`; None = all have the same.
    """

    def __init__(
        self,
        target: str,
        asked: RequestedOutputs,
        arguments: Mapping[str, Any],
        each: Sequence[Mapping[str, Any]] | None = None,
    ) -> None:
        self._target = target
        self._asked = asked
        self._arguments = _plain(arguments)
        self._each = _checked(each, arguments.get("envs"))
        self._found = Graph(Plan("", "", ""))
        self._chosen: Chosen | None = None
        """In place of auto; for every seed the same, as one interpolator stays from reset to reset."""
        self._folder = Path()
        """Where the launch file lies, and nodes of the user's own beside it."""

    def plan(self, seed: int | None, record: str | None = None) -> Graph:
        """Makes the plan. seed: None = as the launch file, or the bag that it replays, has it. record: path of a bag
        that is recorded. Raises SimulationError in one line."""
        if not self._each:
            return self._plan(seed, record, self._arguments)
        if seed is None:
            seed = self._plan(None, None, self._arguments_of(0)).seed
        seeds = [own.get("seed", seed + env) for env, own in enumerate(self._each)]
        graphs = [self._plan(own, record, self._arguments_of(env)) for env, own in enumerate(seeds)]
        each = [copy.deepcopy(graph.plan) for graph in graphs]
        return dataclasses.replace(graphs[0], plan=together([graph.plan for graph in graphs]), seed=seed, each=each)

    def plan_of(self, env: int, seed: int) -> Plan:
        """Makes the plan of one environment with its arguments and this seed. Raises SimulationError in one line."""
        return self._plan(seed, None, self._arguments_of(env)).plan

    def _arguments_of(self, env: int) -> Mapping[str, Any]:
        """Gives the arguments of an environment, and those that it shares with the others."""
        if not self._each:
            return self._arguments
        own = {name: value for name, value in self._each[env].items() if name != "seed"}
        return {**self._arguments, "envs": len(self._each), **own}

    def _plan(self, seed: int | None, record: str | None, arguments: Mapping[str, Any]) -> Graph:
        given = {name: value for name, value in arguments.items() if value is not None}
        if self._asked.labels:
            named = given.get(LABELS, [])
            given[LABELS] = [*(named.split(",") if isinstance(named, str) else named), *self._asked.labels]
        try:
            target = read_target(self._target, given)
            # Not every launch file has anything random.
            if seed is not None and (seed or "seed" in target.launch.arguments):
                target.given["seed"] = seed
            images = target.launch.arguments.get(IMAGE)
            if IMAGE in self._asked.names and images is not None and images.param.type is bool:
                target.given[IMAGE] = True  # what follows from it, as K, is then as `evis launch` has it
            self._folder = target.launch.path.resolve().parent
            options = Options(record=record, view=False, grouping="compose", stepped=True)
            if self._chosen is None:
                self._chosen = without_auto(target.launch, target.given, options, nullcontext(_unsaid), _warn)
            chosen = self._chosen
            given = {**target.given, **{name: chosen.given[name] for name in chosen.taken}}
            plan = plan_launch(target.launch, given, options, chosen.must_have_effect, self._edit)
        except (LaunchError, ValueError, OSError) as error:
            raise SimulationError(str(error)) from None
        plan.name, plan.chosen = target.name, chosen.told
        if plan.mode == "live":
            raise SimulationError(f"{plan.name} is live: a camera does not wait for steps; start it with `evis launch`")
        plan.nodes = {name: node for name, node in plan.nodes.items() if node.process == COMPOSED}
        plan.topics = {name: topic for name, topic in plan.topics.items() if topic.node in plan.nodes}
        for node in plan.nodes.values():
            node.outside = {}  # the caller alone acts and resets
        return dataclasses.replace(self._found, plan=plan, seed=plan.seed)

    def _edit(self, expanded: Expanded) -> None:
        """Puts the caller into the graph. What it does not ask for is not made."""
        found = Graph(Plan("", "", ""))
        device, asked = "cpu", self._asked.names
        for spec in expanded.nodes:
            if catalog.comes_with_evis(spec.type):
                spec.keep = []
            _, cls = catalog.load(spec.type, spec.where, self._folder)
            if any(output.topic == ACTION for output in cls.OUTPUTS.values()):
                found.controller = spec.name
            if spec.type == "physics":
                found.physics = spec.name
                params = {name: spec.params[name] for name in (*SCENE, "seed") if spec.params.get(name) is not None}
                scene = scene_of(spec.name, params, visuals=False)
                found.actuators, found.start = actuators_of(scene)
                found.things = things_of(scene)
            device = str(spec.params.get("device") or device)
            if "," in device:
                raise SimulationError(
                    f"device is {device}: a simulation that is stepped is one process and has one device; make one for "
                    "each, with envs and seed of its share, or run it with `evis launch`"
                )
            if spec.type == "interpolator" and "samples" in asked and not spec.params.get("time_tolerance"):
                raise SimulationError(
                    "there are no samples between the frames without time_tolerance; give it, as "
                    "time_tolerance=0.0003, or ask for frames"
                )
        for name, why in expanded.absent.items():
            if name in asked:
                raise SimulationError(f"the graph has no output {name}: {why}")
        acts = bool(found.physics and not found.controller and found.actuators.names)
        params = {"topics": list(self._asked.globs), "acts": acts, "device": device}
        where = "the simulation"
        expanded.nodes.append(NodeSpec(CALLER, "evis.simulation.caller:CallerNode", where, params, process=COMPOSED))
        self._found = found


def _checked(each: Any, envs: Any) -> list[dict[str, Any]]:
    """Copies the arguments of environments; envs: how many there are to be, None = as many. Raises SimulationError."""
    if each is None:
        return []
    if not isinstance(each, Sequence) or not each or not all(isinstance(own, Mapping) for own in each):
        raise SimulationError(
            f"each is {each!r}; it must be a list with a mapping for each environment, as [{{'omega': 20}}, {{}}]"
        )
    if envs is not None and str(envs) != str(len(each)):
        raise SimulationError(f"envs is {envs}, and each is of {len(each)} environments; leave envs out")
    made = [_plain(own) for own in each]
    for env, own in enumerate(made):
        if "envs" in own:
            raise SimulationError(f"environment {env} has envs of its own; each tells their number, leave it out")
        if told := next((name for name in OF_OUTPUTS if name in own), None):
            raise SimulationError(
                f"environment {env} has {told} of its own; a step has the same of all environments: name it among the "
                f"outputs, as outputs=['events', '{OF_OUTPUTS[told]}']"
            )
        if "seed" in own:
            try:
                own["seed"] = SEED.convert(f"environment {env}", "seed", own["seed"])
            except ParamError as error:
                raise SimulationError(str(error)) from None
    return made


def _plain(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Copies arguments, in which an array of numbers stands for a list."""
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in arguments.items()}


def _unsaid(line: str) -> None:
    """Drops the line that says what is being measured."""


def _warn(line: str) -> None:
    warnings.warn(f"interpolator auto: {line}", SimulationWarning, stacklevel=2)


def needs_sockets(plan: Plan) -> bool:
    """Tells whether a node reads a topic as a tap, which goes over a socket even within a process."""
    for node in plan.nodes.values():
        for topics in node.inputs.values():
            for topic in topics:
                if topic in SYSTEM_TOPICS or any(
                    e.node == node.name and e.kind == "tap" for e in plan.topics[topic].edges
                ):
                    return True
    return False
