"""Simulates dynamics with MuJoCo in float64: E environments of one model, each with its own state.

Steps lie on one grid of fixed length (at most 1 ms) that knows nothing of keyframes, so that a world takes the same
course whatever the keyframe rate. At a stamp between two grid points a pose is that of `evis.geometry.interpolate`, a
velocity lies on a straight line, and a later message goes on from there. An action takes effect at the first grid point
at or after its stamp: at once where the keyframe interval is a multiple of the step.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Sequence, Set
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import mujoco
import numpy as np

from evis.geometry.interpolate_kernels import place_between
from evis.gpu.building import LAUNCH_BLOCK, build_together
from evis.runtime.workers import Workers
from evis.scene.model import Scene
from nodes.physics.actuators import check_controls
from nodes.physics.dynamics.actuators import actuators_of
from nodes.physics.dynamics.assembly import Assembly
from nodes.physics.dynamics.batch.batch_stepper import BatchStepper, make_batch_stepper, why_not_batched
from nodes.physics.dynamics.batch.environment_data import EnvironmentData
from nodes.physics.dynamics.batch.unsupported import Unsupported
from nodes.physics.dynamics.contacts import contacts_of
from nodes.physics.dynamics.course.course import Course, CourseState
from nodes.physics.dynamics.course.paths import KERNELS as MOVING
from nodes.physics.dynamics.course.recorded import RecordedCourse
from nodes.physics.dynamics.gap_steps import GapRequest, GapSteps
from nodes.physics.dynamics.kept_data import KeptData
from nodes.physics.dynamics.rest import Rest
from nodes.physics.dynamics.sleep import is_slow, wake
from nodes.physics.dynamics.start import put_to_start
from nodes.physics.dynamics.states import State, snapshot
from nodes.physics.dynamics.stepped_model import prepared_model
from nodes.physics.dynamics.traced_steps import TracedSteps
from nodes.physics.dynamics.watch import Watch
from nodes.physics.interval import Contacts, Extras, Interval
from nodes.physics.precision.errors import Errors
from nodes.physics.precision.sampled import shadow_of
from nodes.physics.precision.stepping import Stepping
from nodes.physics.precision.sub_steps import FINEST, SubSteps
from nodes.physics.watchdog import Limits


@dataclass(frozen=True)
class MujocoState:
    """Holds where an engine's environments are, as MujocoEngine has it.

    data: of those that it steps. sub_steps: of each environment. taken_to: the stamp [ns] to which steps lead that were
    taken already.
    """

    seeds: list[int]
    numbers: list[int]
    left: frozenset[int]
    rests: list[Rest]
    controls: np.ndarray
    data: dict[int, KeptData]
    course: CourseState
    watch: tuple[Any, ...]
    sub_steps: list[tuple[int, int]]
    shadow: Any
    constrained: np.ndarray
    warnings: list[tuple[int, str]]
    taken_to: int


class MujocoEngine:
    """Steps E environments of one model on a fixed grid of time. Faults come back in Interval.faults."""

    def __init__(
        self,
        scene: Scene,
        seed: int = 0,
        envs: int = 1,
        *,
        stepping: Stepping | None = None,
        extras: Extras | None = None,
        errors: Errors | None = None,
        threads: int = 1,
        warp: str | None = None,
    ) -> None:
        """Loads the model and puts every environment to its start.

        Args:
            scene: with an MJCF model.
            seed: seed + k is that of environment k: where its free bodies start.
            envs: E.
            stepping: how steps are taken; None = as Stepping().
            extras: what intervals have beside poses and twists; None = nothing.
            errors: where to note how far the bodies of environment 0 are off; None = it is not looked at.
            threads: that share the environments; their number changes no bit.
            warp: device on which MuJoCo Warp takes the steps; None = MuJoCo does.

        Raises Unsupported for what MuJoCo Warp cannot take, SceneError for a model that cannot be compiled or whose
        controls are delayed beside a tolerance.
        """
        # Without a handler MuJoCo writes a log file into the working directory; the watchdog reads the counters.
        mujoco.set_mju_user_warning(lambda text: None)
        stepping, extras = stepping or Stepping(), extras or Extras()
        self.scene, self.envs, tolerance = scene, envs, stepping.tolerance
        unbatched = why_not_batched(scene, tolerance)
        if unbatched and warp is not None:
            raise Unsupported(unbatched)
        batched = not unbatched and (envs > 1 or warp is not None)
        self.model, self.step_ns = prepared_model(
            scene, stepping.timestep, tolerance, deepest=tolerance is None and warp is None
        )
        self._sub_steps = [SubSteps(self.model, tolerance) for _ in range(envs)] if tolerance is not None else None
        self.actuators = actuators_of(self.model)
        self._batch: BatchStepper | None = None
        if batched:
            self._batch = make_batch_stepper(self.model, envs, threads, warp)
        self.data = EnvironmentData(self.model, envs, self._batch)
        self._scratch = mujoco.MjData(self.model) if extras.contacts or extras.accelerations else None
        self._extras = extras
        finest = self.model.opt.timestep / (1 if tolerance is None else 2**FINEST)
        limits = self._limits = Limits(self.model, stepping.speed_limit, finest)
        self._watch: Watch
        self._assembly = Assembly(scene, self.model)
        pool = Workers(threads, "states") if batched and threads > 1 else None
        self._course = Course(self._assembly, self.model, self.step_ns, extras.joints, extras.accelerations, pool)
        traced: TracedSteps | None = None
        recorded: RecordedCourse | None = None
        # What follows a body is looked up after each step.
        if warp is None and not len(self._assembly.followers):
            recorded = RecordedCourse(self.model, limits.reach.of_body, self._assembly.own, threads)
            whole = tolerance is None and self.model.opt.integrator != mujoco.mjtIntegrator.mjINT_RK4
            traced = TracedSteps(self.model, whole)
        # Otherwise the first gap waits for them, or all threads at once.
        kernels = [(place_between, LAUNCH_BLOCK), *MOVING, *self._assembly.kernels()]
        build_together("cpu", kernels + ([] if recorded is None else recorded.kernels()))
        followers = self._assembly.followers
        self._steps = GapSteps(self.model, self.data, self._batch, self._sub_steps, followers, traced, recorded)
        self._warp = warp is not None
        self._prepared = -1
        """The stamp up to which steps were requested."""
        self._lacking = False
        """Whether those of some environments were taken back since, and are to be requested again."""
        self._foreseen: set[int] = set()
        """Environments whose steps were requested before it was known that they will be wanted."""
        self._shadow = shadow_of(self.model, errors) if errors is not None else None
        self._shadowed = 0
        """Which environment the shadow follows."""
        self._warnings: list[tuple[int, str]] = []
        self.rewind(seed)
        self._warnings = [(0, text) for text in limits.risks()]

    def rewind(self, seed: int) -> None:
        """Puts every environment to its start at stamp 0, in the first episode of seed + k."""
        self._warnings = []
        # What was told in the run before is told again, and what was noted there is forgotten.
        self._watch = Watch(self._limits, self.envs)
        self._begin([seed + k for k in range(self.envs)], [0] * self.envs)

    def _begin(self, seeds: list[int], numbers: list[int]) -> None:
        """Puts all environments to their start at stamp 0; numbers: how often each has begun anew with its seed."""
        self._seeds, self._numbers = seeds, numbers
        self._left: set[int] = set()
        self._rests = [Rest() for _ in range(self.envs)]
        self._controls = np.zeros((self.envs, self.actuators.count))
        for k in range(self.envs):
            self._reset(k)
        if self._shadow is not None:
            self._shadow.begin(self.data[self._shadowed])
        self._prepared, self._foreseen = -1, set()
        self._steps.begin()
        self._slow: set[int] = set()
        """Environments that a batch would step otherwise: of bodies that sleep, or are about to, it knows nothing but
        what came of its own steps. They are stepped by themselves until all is awake."""
        self._taken_to = -1
        """The stamp to which steps lead that were taken before."""
        self._begin_course()

    def _begin_course(self) -> None:
        """Begins the course at stamp 0 in the present state of all environments."""
        self._course.begin(snapshot(self.model, list(self.data), self._assembly.followers))

    def leave(self, env: int) -> None:
        """Stops stepping an environment."""
        self._left.add(env)
        self._steps.taken.pop(env, None)
        self._foreseen = self._foreseen - {env}

    def anew(self, envs: Sequence[int], seeds: Sequence[int | None], numbers: Sequence[int]) -> MujocoEngine:
        """Makes an engine of these environments alone, at their start and stamp 0; they are moved by it from then on.

        seeds: of each, None = its own of now. numbers: how often each has begun anew since it got its seed.
        """
        engine = self.part(envs)
        engine._begin([self._seeds[k] if s is None else s for k, s in zip(envs, seeds)], list(numbers))
        return engine

    def part(self, envs: Sequence[int]) -> MujocoEngine:
        """Makes an engine of these environments alone, for `restore`; they are moved by it from then on."""
        engine = copy.copy(self)
        engine.envs, engine._warnings = len(envs), []
        if self._shadowed in envs:
            engine._shadowed = list(envs).index(self._shadowed)
        else:
            engine._shadow = None
        engine.data, engine._watch, engine._course = self.data.of(envs), self._watch.of(envs), self._course.anew()
        engine._sub_steps = [self._sub_steps[k] for k in envs] if self._sub_steps is not None else None
        engine._steps = self._steps.of(envs, engine.data, engine._sub_steps)
        return engine

    def state(self) -> MujocoState | None:
        """Gives where its environments are, as copies; None where MuJoCo Warp has them."""
        if self._warp:
            return None
        mine = [k for k in range(self.envs) if k not in self._left]
        data = {k: self.data.keep(k) for k in mine}
        # Steps that `restore` has brought are still ahead.
        data |= {k: replace(data[k], taken=taken) for k, taken in self._steps.taken.items()}
        taken_to = self._taken_to if self._steps.taken else self._prepared
        shadow = self._shadow if self._shadowed in mine else None
        return MujocoState(
            seeds=[*self._seeds],
            numbers=[*self._numbers],
            left=frozenset(self._left),
            rests=copy.deepcopy(self._rests),
            controls=self._controls.copy(),
            data=data,
            course=self._course.state(),
            watch=self._watch.state(),
            sub_steps=[parts.state() for parts in self._sub_steps or ()],
            shadow=None if shadow is None else shadow.state(),
            constrained=self._steps.constrained.copy(),
            warnings=[*self._warnings],
            taken_to=taken_to if any(kept.taken is not None for kept in data.values()) else -1,
        )

    def restore(self, state: MujocoState) -> None:
        """Goes on from what `state` gave of as many environments of the same model."""
        self._seeds, self._numbers, self._left = [*state.seeds], [*state.numbers], set(state.left)
        self._rests, self._controls = copy.deepcopy(state.rests), state.controls.copy()
        for k, kept in state.data.items():
            self.data.put_back(k, kept)
        self._course.restore(state.course)
        self._watch.restore(state.watch)
        for parts, own in zip(self._sub_steps or (), state.sub_steps, strict=True):
            parts.go_on(own)
        if self._shadow is not None and state.shadow is not None:
            self._shadow.restore(state.shadow)
        self._steps.constrained, self._warnings = state.constrained.copy(), [*state.warnings]
        self._prepared, self._foreseen = -1, set()
        self._steps.taken = {k: kept.taken for k, kept in state.data.items() if kept.taken is not None}
        self._taken_to = state.taken_to
        self._slow = set()
        self._find_slow(state.data)

    def _find_slow(self, envs: Iterable[int]) -> None:
        """Finds those of some environments that a batch cannot take over yet."""
        self._slow = {k for k in envs if self._batch is not None and is_slow(self.model, self.data.look(k))}

    def _take_back(self, envs: Iterable[int]) -> None:
        """Puts environments to before steps that were taken, for nobody will want these."""
        for k in envs:
            self._steps.taken.pop(k).before.restore(self.model, self.data[k])
            wake(self.model, self.data[k])
            self._slow.discard(k)

    def start(self) -> Interval:
        """Gives the state at stamp 0."""
        return self._told(self._course.start())

    def prepare(self, to_ns: int, controls: np.ndarray | None = None) -> None:
        """Asks for the steps up to a stamp, under controls as of `advance`, without a wait for them: `advance` to it
        takes them with those that other engines, made by `anew`, have asked for.
        """
        others: list[int] = []
        if controls is not None:
            check_controls(controls, self.envs, self.actuators)
            changed = np.flatnonzero((self._controls != controls).any(axis=1)).tolist()
            others = [k for k in changed if k not in self._left]
        wrong = self._foreseen if self._prepared != to_ns else self._foreseen & set(others)
        if wrong:
            self.data.cancel(sorted(wrong))
            self._foreseen = self._foreseen - wrong
        self._take_back([k for k in self._steps.taken if self._taken_to != to_ns or k in others])
        for k in others:
            self._rests[k].wake()
        # To have other controls wakes all.
        self._slow -= {*others}
        if controls is not None:
            self.data.control(others, controls[others])
            self._controls = controls.copy()
        self._prepared, self._lacking = to_ns, False
        grid = range(self._course.grid, to_ns, self.step_ns)
        if self._batch is not None and grid:
            self.data.request([k for k in self._in_batch() if k not in self._foreseen], grid)

    def foresee(self, to_ns: int) -> None:
        """Asks for the steps up to a stamp that will come, as far as can be told now; `begin` then takes them."""
        if self._batch is not None:
            self.prepare(to_ns)
            self._foreseen = set(self._in_batch()) if to_ns > self._course.grid else set()

    def begin(self) -> None:
        """Begins to take the steps asked for while others work."""
        if self._batch is not None and self._foreseen:
            self._batch.begin()

    # Of what diverges the faults of an interval tell; that its squares overflow is nothing to warn of besides.
    @np.errstate(over="ignore", invalid="ignore")
    def advance(self, to_ns: int, controls: np.ndarray | None = None, then_ns: int | None = None) -> Interval:
        """Moves on to stamp `to_ns` [ns] under controls [E, nu]; the steps to `then_ns` begin as of `Preparing`.

        Raises ValueError for controls of a wrong shape or not finite.
        """
        if self._prepared != to_ns or self._lacking or controls is not None:
            self.prepare(to_ns, controls)
        ahead, self._prepared, self._foreseen = self._foreseen, -1, set()
        if self.envs > len(self._left) and not self._awake():
            return self._told(self._course.rest(to_ns))
        for parts in self._sub_steps or ():
            parts.taken.clear()
        # Contacts and accelerations are those of each environment's MjData, which the batch brings up to date.
        looked_at = self._extras.contacts or self._extras.accelerations
        interval = self._step_to(to_ns, ahead, None if looked_at else then_ns)
        if looked_at and then_ns is not None:
            self.foresee(then_ns)
            self.begin()
        return interval

    def _awake(self) -> list[int]:
        """Gives the environments that are to be stepped."""
        return [k for k in range(self.envs) if k not in self._left and not self._rests[k].now]

    def _in_batch(self) -> list[int]:
        """Gives those of them that the batch steps."""
        return [k for k in self._awake() if k not in self._slow]

    def _watch_rest(self, start_ns: int) -> None:
        """Puts environments to rest that do not move any more, each by itself, at their last step."""
        if self.model.na or self.model.nplugin or self.model.nhistory:  # these may be about to move something
            return
        fallen: list[int] = []
        for k, (rest, fastest) in enumerate(zip(self._rests, self._course.fastest.tolist())):
            if not rest.now and k not in self._left:
                rest.see(start_ns, self._course.stamp, fastest)
                fallen += [k] if rest.now else []
        if fallen:
            self._course.put_to_rest(fallen)
            if begun := self._foreseen & {*fallen}:
                self.data.cancel(sorted(begun))
                self._foreseen = self._foreseen - begun

    def _followed(self) -> bool:
        """Tells whether the shadow follows its environment, which is stepped."""
        env = self._shadowed
        return self._shadow is not None and env not in self._left and not self._rests[env].now

    def _measure(self, steps: int, begins: bool) -> None:
        """Has the shadow follow the steps just taken; begins: whether an episode does."""
        env, bodies = self._shadowed, self.model.nbody - 1
        if self._shadow is None or not self._followed():
            return
        data = self.data.look(env)
        if begins:
            self._shadow.begin(data)
        else:
            before, now = (state["pose"][env, :bodies] for state in (self._course.before, self._course.now))
            parts = self._sub_steps[env].taken if self._sub_steps is not None else None
            self._shadow.follow(data, steps, before, now, bool(self._steps.constrained[env]), parts)

    def _go_on(self, to_ns: int, keep: bool = False) -> None:
        """Begins the steps that follow those of the open interval, up to a stamp. keep: as of `BatchStepper.begin`."""
        # The shadow is to see where its environment is now: after this the batch may be ahead.
        if self._followed():
            self.data.look(self._shadowed)
        grid, awake, self._prepared = range(self._course.next_grid, to_ns, self.step_ns), self._in_batch(), to_ns
        if self._batch is not None and grid and awake:
            self.data.request(awake, grid)
            self._foreseen = set(awake)
            self._batch.begin(keep)

    def _step_to(self, to_ns: int, ahead: Set[int], then_ns: int | None) -> Interval:
        """Advances to a stamp by steps of the environments that do not rest.

        ahead: whose steps were foreseen. then_ns: to which the next ones begin meanwhile, None = they do not.
        """
        course, awake, begun = self._course, self._awake(), self._course.stamp
        grid = course.open(to_ns)
        course.hold([k for k in range(self.envs) if k in self._left or self._rests[k].now] if len(grid) else [])
        faults: dict[int, str] = {}
        checked = self.checked
        if len(grid):
            begin_next = None if then_ns is None else partial(self._go_on, then_ns, keep=True)
            request = GapRequest(grid, awake, self._slow, ahead, begin_next)
            outcome = self._steps.take(course, self._watch, request)
            faults, again = outcome.faults, {*outcome.checked}
            self._lacking = bool(self._foreseen & again)
            self._foreseen = self._foreseen - again
            self._warnings += outcome.notices
            for k in {*range(self.envs)} - self._left:
                self._watch.dogs[k].passed((grid[-1] + self.step_ns) * 1e-9)
            for k in sorted(faults):
                course.restart(k, self._restart(k))
            self._find_slow(self._slow)
        if then_ns is not None and self._prepared != then_ns:
            self._go_on(then_ns)
        interval = course.close()
        interval.faults = sorted(faults.items())
        interval.again = self.checked - checked if self._warp else 0
        self._watch_rest(begun)
        self._measure(len(grid), self._shadowed in faults)
        return self._told(interval)

    @property
    def checked(self) -> int:
        """Counts how often an environment was stepped to a stamp with a check of each state."""
        return self._steps.checked

    def missed(self) -> int:
        """Counts the steps that were not exact enough in as many parts as there may be."""
        return sum(parts.missed for parts in self._sub_steps or ())

    def _reset(self, k: int) -> None:
        """Puts environment k to its start."""
        put_to_start(self.scene, self.model, self.data[k], self._seeds[k], self._numbers[k])
        self._controls[k] = self.data[k].ctrl
        self._watch.dogs[k].restart(self.data[k])
        if self._sub_steps is not None:
            self._sub_steps[k].begin()

    def _restart(self, k: int) -> State:
        """Begins the next episode of environment k; returns its start, which is its part of the whole interval."""
        self._numbers[k] += 1
        self._rests[k].wake()
        self._reset(k)
        return snapshot(self.model, [self.data[k]], self._assembly.followers)

    def _told(self, interval: Interval) -> Interval:
        """Adds gravity and warnings to an interval, and contacts and accelerations at its end where asked for."""
        interval.gravity = np.tile(self.model.opt.gravity, (self.envs, 1))
        interval.warnings, self._warnings = self._warnings, []
        if self._extras.contacts:
            each = [contacts_of(self.model, data, self._scratch) for data in self.data]
            interval.contacts = Contacts.joined(each, [[k] for k in range(self.envs)])
        if self._extras.accelerations:
            end = self._course.last
            interval.acceleration = self._assembly.accelerations(
                interval, list(self.data), self._scratch, end["qpos"], end["qvel"]
            )
        return interval
