"""Takes the steps of environments over a gap, together or one by one, and writes their states to a course."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from msgs.world import EVERY
from nodes.physics.dynamics.batch.batch_stepper import BatchStepper
from nodes.physics.dynamics.batch.environment_data import EnvironmentData
from nodes.physics.dynamics.batch.stepped_states import JOINTS, SteppedStates
from nodes.physics.dynamics.checked_steps import take_checked_steps
from nodes.physics.dynamics.course.course import Course
from nodes.physics.dynamics.course.recorded import RecordedCourse, Seen
from nodes.physics.dynamics.followers import Followers
from nodes.physics.dynamics.kept_data import TakenSteps
from nodes.physics.dynamics.saved_state import SavedState
from nodes.physics.dynamics.traced_steps import TracedSteps
from nodes.physics.dynamics.watch import Watch
from nodes.physics.precision.sub_steps import SubSteps

PART = 1 << 18
"""Numbers of a state, of all environments and steps whose states are worked on at once: they stay in a core's cache."""


@dataclass(frozen=True)
class GapRequest:
    """Asks for the steps of a gap: one from each time of `grid` [ns] in each environment that is awake.

    alone: those that the batch cannot step. ahead: those whose steps were foreseen. begin_next: begins the steps after
    these, of all that the batch steps. It is called where all these come of one call and their states are many, before
    they are written; what is to be taken back of the steps that it began is.
    """

    grid: range
    awake: Sequence[int]
    alone: Set[int]
    ahead: Set[int]
    begin_next: Callable[[], None] | None = None


@dataclass(frozen=True)
class GapOutcome:
    """Holds what is to be told of a gap's steps, whose states are in the course.

    faults: of each environment that has diverged. notices: environment and text, of others. checked: the environments
    that were stepped again with a check of each state.
    """

    faults: dict[int, str]
    notices: list[tuple[int, str]]
    checked: list[int]


class GapSteps:
    """Takes steps of E environments of a model. What may be wrong in them is stepped again with a check of each state.

    taken: steps of environments that were taken before, which come next. checked: how often an environment was stepped
    with checks. constrained: bool [E], whether anything was touched or limited at the last step.
    """

    def __init__(
        self,
        model: Any,
        data: EnvironmentData,
        batch: BatchStepper | None,
        sub_steps: list[SubSteps] | None,
        followers: Followers,
        traced: TracedSteps | None,
        recorded: RecordedCourse | None,
    ) -> None:
        """Takes what steps are taken with.

        batch: steps environments together. sub_steps: divide the steps of each, where there is a tolerance. followers:
        what is mounted on bodies. traced, recorded: take and write steps without a look at each state.
        """
        self._model, self._data, self._batch, self._sub_steps = model, data, batch, sub_steps
        self._followers, self._traced, self._recorded = followers, traced, recorded
        self.taken: dict[int, TakenSteps] = {}
        self.checked = 0
        self.constrained = np.zeros(len(data), bool)

    def of(self, envs: Sequence[int], data: EnvironmentData, sub_steps: list[SubSteps] | None) -> GapSteps:
        """Makes that of these environments alone; data, sub_steps: theirs."""
        part = copy.copy(self)
        part._data, part._sub_steps, part.taken = data, sub_steps, {}
        part.constrained = self.constrained[list(envs)]
        return part

    def begin(self) -> None:
        """Forgets the steps before, as all environments are at their start."""
        self.taken = {}
        self.constrained[:] = False

    def take(self, course: Course, watch: Watch, request: GapRequest) -> GapOutcome:
        """Takes the steps of a gap, and writes their states to the course; watch: what looks for faults in them."""
        grid, begin_next = request.grid, request.begin_next
        single = [k for k in request.awake if self._batch is None or k in request.alone]
        batched = [k for k in request.awake if k not in single]
        # Those that were foreseen may have been taken in one call, and the others in another.
        parts = [k for k in batched if k in request.ahead], [k for k in batched if k not in request.ahead]
        if self._recorded is None or single or not parts[0] or parts[1] or course.paths.kept:
            begin_next = None
        odd = [k for part in parts for k in self._together(course, watch, part, grid, begin_next)]
        odd += self._one_by_one(course, watch, single, grid)
        faults, notices = {}, []
        for k in sorted(odd):
            self.checked += 1
            step = self._step_function(k)
            found = take_checked_steps(self._model, self._data[k], grid, step, watch.dogs[k], self._followers)
            notices += [(k, text) for text in found.notices]
            if found.fault:
                faults[k] = found.fault
            self.constrained[k] = self._data[k].nefc > 0
            course.write(np.array([k]), found.state)
        return GapOutcome(faults, notices, odd)

    def _together(
        self, course: Course, watch: Watch, awake: list[int], grid: range, begin_next: Callable[[], None] | None
    ) -> list[int]:
        """Steps environments at once, and writes those to the course in which nothing is wrong. Gives the others: a
        check of each state must tell what it is. begin_next: as of GapRequest."""
        if not awake:
            return []
        assert self._batch is not None
        found = self._batch.result([self._data.row(k) for k in awake])
        self._data.stepped(awake)
        if begin_next is not None:
            begin_next()
        envs = np.array(awake)
        if self._recorded is not None:
            odd = self._take_recorded(course, watch, envs, found, self._recorded)
        else:
            each = len(grid) * (13 * (self._model.nbody - 1) + self._model.nq + self._model.nv)
            parts = [slice(k, k + max(1, PART // each)) for k in range(0, len(awake), max(1, PART // each))]
            odd = [k for part in parts for k in self._take_part(course, watch, envs[part], found, part)]
        for k in odd:
            self._data.restore_before_steps(k)
        if begin_next is not None and odd:
            self._data.cancel(odd)
        return odd

    def _take_recorded(
        self, course: Course, watch: Watch, envs: np.ndarray, found: SteppedStates, recorded: RecordedCourse
    ) -> list[int]:
        """Writes environments without a fault to the course, as `_take_part` does, from MuJoCo's own records."""
        records, places = found.records, found.places
        assert records is not None and places is not None
        seen = recorded.write(records, places, envs, course)
        quiet = watch.quiet(envs, found, seen.speed, seen.twist[:, 1])
        if not quiet.all():
            seen = Seen(seen.pose[quiet], seen.twist[quiet], seen.speed[quiet], seen.fastest[quiet])
            places = places[quiet]
        # To choose all of them would copy them.
        well = envs[quiet]
        chosen = EVERY if len(well) == len(self.constrained) else well
        in_order = len(places) == len(records.each["qpos"]) and (places[1:] > places[:-1]).all()
        rows = EVERY if in_order else places
        last_two = {"pose": seen.pose, "twist": seen.twist}
        last_two |= {name: records.each[name][rows, -2:] for name in JOINTS}
        course.stepped(chosen, last_two)
        course.fastest[chosen] = seen.fastest
        for name, values in course.of_joints.items():
            values[chosen, course.first : -1] = records.each[name][rows, :-1]
        self.constrained[well] = found.constrained[quiet]
        return envs[~quiet].tolist()

    def _take_part(
        self, course: Course, watch: Watch, envs: np.ndarray, found: SteppedStates, part: slice
    ) -> list[int]:
        """Writes the states of environments without a fault to the course; gives the other environments."""
        state = found.part(part)
        quiet = watch.quiet(envs, found, watch.speed(state), state["twist"][:, -1], part)
        course.write(envs[quiet], {name: values[quiet] for name, values in state.items()})
        self.constrained[envs[quiet]] = found.constrained[part][quiet]
        return envs[~quiet].tolist()

    def _one_by_one(self, course: Course, watch: Watch, awake: list[int], grid: range) -> list[int]:
        """Steps environments one after the other; gives those that need a check of each state, as `_together` does."""
        if self._traced is None or self._recorded is None:
            return awake
        odd = []
        for k in awake:
            before, level = SavedState(self._model, self._data[k]), None
            if (taken := self.taken.pop(k, None)) is not None:
                before, alone = taken.before, taken.found
            else:
                level = self._sub_steps[k].snapshot() if self._sub_steps is not None else None
                alone = self._traced.take(self._data[k], grid, self._step_function(k))
            if self._take_recorded(course, watch, np.array([k]), alone, self._recorded):
                before.restore(self._model, self._data[k])
                if self._sub_steps is not None and level is not None:
                    self._sub_steps[k].restore(level)
                odd.append(k)
        return odd

    def _step_function(self, k: int) -> Callable[[Any, Any], None]:
        """Gives the function that steps environment k."""
        return mujoco.mj_step if self._sub_steps is None else self._sub_steps[k].step
