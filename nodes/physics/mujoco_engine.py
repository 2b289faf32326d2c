"""Dynamics with MuJoCo in float64: E environments of one model, each with its own state.

Steps lie on one grid of fixed length (at most 1 ms) that knows nothing of keyframes, so that a world takes the same
course whatever the keyframe rate; a stamp between two grid points is interpolated (`evis.geometry.interpolate`, exact
to fourth order), and a later message goes on along the very same curve. An action takes effect at the first grid
point at or after its stamp: at once where the keyframe interval is a multiple of the step.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np

from evis.geometry import interpolate, se3
from evis.scene.mjcf.changes import apply_start
from evis.scene.mjcf.dynamics import compile_model
from evis.scene.model import Scene
from nodes.physics.accelerations import mounted_acceleration, mujoco_accelerations, prescribed_accelerations
from nodes.physics.actuators import actuators_of
from nodes.physics.contacts import contacts_of, gather
from nodes.physics.followers import Followers
from nodes.physics.interval import Interval, check_controls, grid_inside
from nodes.physics.joint_start import start_joints
from nodes.physics.precision.errors import Errors
from nodes.physics.precision.sampled import shadow_of
from nodes.physics.precision.sub_steps import FINEST, SubSteps, take_best_integrator
from nodes.physics.precision.tolerance import Tolerance
from nodes.physics.prescribed import PrescribedStates
from nodes.physics.rest import Rest
from nodes.physics.stride import Before, Trace, take_steps
from nodes.physics.watchdog import Watchdog

MAX_STEP_NS = 1_000_000
"""Longest sub-step [ns]; a model with a longer timestep is stepped in equal parts of it."""


def step_length(model_timestep: float, asked: float | None) -> int:
    """Computes the sub-step [ns] of a model with this timestep [s], unless another was asked for."""
    if asked is not None:
        return max(1, round(asked * 1e9))
    timestep = max(1, round(model_timestep * 1e9))
    return round(timestep / -(-timestep // MAX_STEP_NS))


class MujocoEngine:
    """Steps E environments of one model on a fixed grid of time. Faults come back in Interval.faults."""

    def __init__(
        self,
        scene: Scene,
        seed: int = 0,
        envs: int = 1,
        *,
        timestep: float | None = None,
        contacts: bool = False,
        joints: bool = False,
        accelerations: bool = False,
        speed_limit: float = 1000.0,
        errors: Errors | None = None,
        tolerance: Tolerance | None = None,
    ) -> None:
        """Loads the model and puts every environment to its start.

        Args:
            scene: with an MJCF model.
            seed: seed + k is that of environment k: where its free bodies start.
            envs: E.
            timestep: sub-step [s], at most 1 ms; None = the model's own, cut into equal parts of at most 1 ms.
            contacts: whether intervals have contacts with their forces.
            joints: whether they have positions and velocities of the joints.
            accelerations: whether they have those of the bodies; NaN for cameras that MuJoCo has follow a body.
            speed_limit: speed [m/s] of a body beyond which an environment has diverged.
            errors: where to note how far the bodies of environment 0 are off; None = it is not looked at.
            tolerance: for which steps are taken in parts; None = all steps are whole.
        """
        # Without a handler MuJoCo writes a log file into the working directory; the watchdog reads the counters.
        mujoco.set_mju_user_warning(lambda text: None)
        self.scene, self.envs = scene, envs
        self.model = compile_model(scene)
        # MuJoCo would put a diverged state back to its start and go on as if nothing had happened.
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        self.step_ns = step_length(self.model.opt.timestep, timestep)
        self.model.opt.timestep = self.step_ns * 1e-9
        if tolerance is not None:
            take_best_integrator(self.model)
        self._sub_steps = [SubSteps(self.model, tolerance) for _ in range(envs)] if tolerance is not None else None
        self.controls: int = self.model.nu
        self.actuators = actuators_of(self.model)
        self.data = [mujoco.MjData(self.model) for _ in range(envs)]
        self._scratch = mujoco.MjData(self.model) if contacts or accelerations else None
        self._contacts, self._joints, self._accelerations = contacts, joints, accelerations
        finest = self.model.opt.timestep / (1 if tolerance is None else 2**FINEST)
        self._watchdogs = [Watchdog(self.model, speed_limit, finest) for _ in range(envs)]
        follows = [(n, body.follows) for n, body in enumerate(scene.bodies) if body.follows is not None]
        self._followers = Followers(self.model, [what for _, what in follows])
        own = [
            n
            for n, body in enumerate(scene.bodies)
            if body.trajectory is None and body.mount is None and body.follows is None
        ]
        if own and own[-1] >= self.model.nbody - 1:
            raise ValueError(f"scene {scene.name}: body '{scene.bodies[own[-1]].name}' has no motion")
        self._moved = [*own, *(n for n, _ in follows)]
        self._columns = [*own, *range(self.model.nbody - 1, self.model.nbody - 1 + len(follows))]
        """Which rows of a snapshot the bodies of `_moved` are: the model's own bodies come first there."""
        self._prescribed = PrescribedStates(scene)
        self._shadow = shadow_of(self.model, errors) if errors is not None else None
        self._shadowed = 0
        """Which environment the shadow follows."""
        self._warnings: list[tuple[int, str]] = []
        self.rewind(seed)
        self._warnings = [(0, text) for text in self._watchdogs[0].risks()]

    def rewind(self, seed: int) -> None:
        """Puts every environment to its start at stamp 0, in the first episode of seed + k."""
        self._warnings = []
        self._begin([seed + k for k in range(self.envs)], [0] * self.envs)

    def _begin(self, seeds: list[int], numbers: list[int]) -> None:
        """All environments to their start at stamp 0: seeds and how often each began anew with its seed."""
        self._seeds, self._numbers = seeds, numbers
        self._stamp, self._grid = 0, 0
        self._left: set[int] = set()
        self._rests = [Rest() for _ in range(self.envs)]
        for k in range(self.envs):
            self._reset(k)
        if self._shadow is not None:
            self._shadow.begin(self.data[self._shadowed])
        self._before = self._now = self._snapshot()
        self._last = self._state_at(0)
        """The state at the stamp published last, where the next message begins."""

    def leave(self, env: int) -> None:
        """Steps an environment no more."""
        self._left.add(env)

    def anew(self, envs: Sequence[int], seeds: Sequence[int | None], numbers: Sequence[int]) -> MujocoEngine:
        """Makes an engine of these environments alone, at their start and stamp 0; they are moved by it from then on.

        seeds: of each, None = its own of now. numbers: how often each has begun anew since it got its seed.
        """
        engine = copy.copy(self)
        engine.envs, engine._warnings = len(envs), []
        if self._shadowed in envs:
            engine._shadowed, self._shadow = list(envs).index(self._shadowed), None
        else:
            engine._shadow = None
        engine.data = [self.data[k] for k in envs]
        engine._watchdogs = [self._watchdogs[k] for k in envs]
        engine._sub_steps = [self._sub_steps[k] for k in envs] if self._sub_steps is not None else None
        engine._begin([self._seeds[k] if s is None else s for k, s in zip(envs, seeds)], list(numbers))
        return engine

    def start(self) -> Interval:
        """Gives the state at stamp 0."""
        return self._interval(np.zeros(1, np.int64), {name: value[:, None] for name, value in self._now.items()}, [])

    def advance(self, to_ns: int, controls: np.ndarray | None = None) -> Interval:
        """Moves on to stamp `to_ns` [ns] under controls [E, nu].

        Raises ValueError for controls of a wrong shape or not finite.
        """
        if controls is not None:
            check_controls(controls, self.envs, self.controls)
            for data, values, rest in zip(self.data, controls, self._rests):
                if not np.array_equal(data.ctrl, values):
                    rest.wake()
                data.ctrl[:] = values
        stayed = [rest.now for k, rest in enumerate(self._rests) if k not in self._left]
        if stayed and all(stayed):
            return self._resting(to_ns)
        grid = self._grid
        for parts in self._sub_steps or ():
            parts.taken.clear()
        strode = self._stride(to_ns)
        if strode is not None:
            times, course = strode
            end = {name: value[:, None] for name, value in self._state_at(to_ns).items()}
            course = {name: np.concatenate((value, end[name]), axis=1) for name, value in course.items()}
            self._stamp, self._last = to_ns, {name: value[:, -1] for name, value in course.items()}
            interval = self._interval(np.append(times, to_ns), course, [])
            self._watch_rest(int(times[0]), course)
        else:
            interval = self._step_by_step(to_ns)
        self._measure((self._grid - grid) // self.step_ns, interval)
        return interval

    def _resting(self, to_ns: int) -> Interval:
        """Goes on to a stamp without a step: all that MuJoCo moves stays where it is."""
        inner = grid_inside(self._stamp, to_ns, self.step_ns) if len(self._prescribed.moving) else ()
        times = np.array([self._stamp, *inner, to_ns], np.int64)
        self._grid += -(-max(to_ns - self._grid, 0) // self.step_ns) * self.step_ns
        self._stamp = to_ns
        course = {name: np.repeat(value[:, None], len(times), axis=1) for name, value in self._last.items()}
        return self._interval(times, course, [], still=True)

    def _watch_rest(self, start_ns: int, course: dict[str, np.ndarray]) -> None:
        """Puts environments to rest that do not move any more, each by itself, at their last step."""
        if self.model.na or self.model.nplugin:  # these may be about to move something
            return
        fallen: list[int] = []
        for k, rest in enumerate(self._rests):
            if not rest.now and k not in self._left:
                rest.see(start_ns, self._stamp, course["twist"][k])
                fallen += [k] if rest.now else []
        if fallen:
            self._before, self._last, self._now = (
                {name: value.copy() for name, value in state.items()} for state in (self._before, self._last, self._now)
            )
            self._now["twist"][fallen] = 0.0
            for name, value in self._now.items():
                self._before[name][fallen] = self._last[name][fallen] = value[fallen]

    def _measure(self, steps: int, interval: Interval) -> None:
        """Has the shadow follow the steps just taken."""
        env, bodies = self._shadowed, self.model.nbody - 1
        if self._shadow is None or env in self._left or self._rests[env].now:
            return
        if any(env == faulty for faulty, _ in interval.faults):
            self._shadow.begin(self.data[env])
        else:
            before, now = (state["pose"][env, :bodies] for state in (self._before, self._now))
            parts = self._sub_steps[env].taken if self._sub_steps is not None else None
            self._shadow.follow(self.data[env], steps, before, now, parts)

    def _step_by_step(self, to_ns: int) -> Interval:
        """Moves on to a stamp, looking at every state."""
        moments, states = [self._stamp], [self._last]
        faults: dict[int, str] = {}
        while self._grid < to_ns:
            if self._grid > self._stamp:
                moments.append(self._grid)
                states.append(self._now)
            self._step(faults)
        moments.append(to_ns)
        states.append(self._state_at(to_ns))
        self._stamp = to_ns
        for k in faults:
            self._restart(k, states)
        self._last = states[-1]
        course = {name: np.stack([state[name] for state in states], axis=1) for name in self._last}
        interval = self._interval(np.array(moments, np.int64), course, sorted(faults.items()))
        self._watch_rest(moments[0], course)
        return interval

    def _stride(self, to_ns: int) -> tuple[np.ndarray, dict[str, np.ndarray]] | None:
        """Takes all steps up to `to_ns` at once.

        Returns the times int64 [S] from the last stamp on and before `to_ns`, and the states then, each [E, S, ...].
        None, and nothing has happened, where a state must be looked at.
        """
        if len(self._followers):
            return None
        grid = range(self._grid, to_ns, self.step_ns)
        count, chosen = len(grid), [k for k in range(self.envs) if k not in self._left]
        # The states at all grid points, that of now the first.
        made = {name: np.repeat(value[:, None], count + 1, axis=1) for name, value in self._now.items()}
        before = [Before(self.model, self.data[k]) for k in chosen]
        levels = [parts.kept() for parts in self._sub_steps or ()]
        for place, k in enumerate(chosen):
            if self._rests[k].now:
                continue
            trace = Trace.empty(self.model, count)
            take_steps(self.model, self.data[k], grid, trace, self._taker(k))
            twist, pose = trace.twist_and_pose(self.model)
            if count and not self._watchdogs[k].quiet(self.data[k], trace.qpos, trace.qvel, pose, twist, trace.nearest):
                for n, remembered in zip(chosen[: place + 1], before):
                    remembered.restore(self.model, self.data[n])
                for parts, level in zip(self._sub_steps or (), levels):
                    parts.restore(level)
                return None
            for name, value in (("pose", pose), ("twist", twist), ("qpos", trace.qpos), ("qvel", trace.qvel)):
                made[name][k, 1:] = value
        if count:
            for k in chosen:
                self._watchdogs[k].passed(self.data[k])
            self._grid += count * self.step_ns
            self._before, self._now = ({name: value[:, i] for name, value in made.items()} for i in (-2, -1))
        times = np.array(grid, np.int64)
        inside = np.flatnonzero(times > self._stamp)
        course = {n: np.concatenate((self._last[n][:, None], made[n][:, inside]), axis=1) for n in made}
        return np.concatenate(([self._stamp], times[inside])), course

    def _step(self, faults: dict[int, str]) -> None:
        """All environments one grid step on; one that has diverged waits for the end of the interval."""
        for k, data in enumerate(self.data):
            if k in faults or k in self._left or self._rests[k].now:
                continue
            # MuJoCo adds up its time in floating point; ours is exact.
            data.time = self._grid * 1e-9
            self._taker(k)(self.model, data)
            # mj_step leaves poses and velocities of the state before the step.
            mujoco.mj_kinematics(self.model, data)
            mujoco.mj_comPos(self.model, data)
            mujoco.mj_comVel(self.model, data)
        self._grid += self.step_ns
        self._before, self._now = self._now, self._snapshot()
        resting = [k for k, rest in enumerate(self._rests) if rest.now]
        for name, value in self._before.items():
            self._now[name][resting] = value[resting]
        for k, data in enumerate(self.data):
            if k not in faults and k not in self._left:
                pose, twist = (self._now[name][k, : self.model.nbody - 1] for name in ("pose", "twist"))
                fault = self._watchdogs[k].check(data, twist)
                if fault:
                    faults[k] = fault
                else:
                    self._warnings += [(k, text) for text in self._watchdogs[k].notices(data, pose, twist)]

    def _taker(self, k: int) -> Callable[[Any, Any], None]:
        """What takes a step of environment k."""
        return mujoco.mj_step if self._sub_steps is None else self._sub_steps[k].step

    def missed(self) -> int:
        """Counts the steps that were not exact enough in as many parts as there may be."""
        return sum(parts.missed for parts in self._sub_steps or ())

    def _reset(self, k: int) -> None:
        """Environment k to its start: the scene's keyframe, moved a little by its seed and the episode's number."""
        data = self.data[k]
        if self.scene.keyframe >= 0:
            mujoco.mj_resetDataKeyframe(self.model, data, self.scene.keyframe)
        else:
            mujoco.mj_resetData(self.model, data)
        apply_start(self.model, data, self.scene.changes)
        spread, turn = self.scene.initial_spread
        random = np.random.Generator(np.random.Philox(key=[self._seeds[k] % 2**64, self._numbers[k]]))
        for joint in np.flatnonzero(self.model.jnt_type == mujoco.mjtJoint.mjJNT_FREE):
            shift, rotation = random.standard_normal((2, 3))
            at = self.model.jnt_qposadr[joint]
            data.qpos[at : at + 3] += spread * shift
            q = se3.from_mujoco(data.qpos[at + 3 : at + 7])
            data.qpos[at + 3 : at + 7] = se3.to_mujoco(se3.multiply(se3.exp(turn * rotation), q))
        start_joints(self.model, data, self.scene.initial_joints, self._seeds[k] % 2**64, self._numbers[k])
        mujoco.mj_forward(self.model, data)
        self._watchdogs[k].restart(data)
        if self._sub_steps is not None:
            self._sub_steps[k].begin()

    def _restart(self, k: int, states: list[dict[str, np.ndarray]]) -> None:
        """Begin the next episode of environment k at the stamp; its part of the interval is the new start all along."""
        self._numbers[k] += 1
        self._rests[k].wake()
        self._reset(k)
        fresh = self._snapshot()
        for state in (*states, self._before, self._now):
            for name, value in fresh.items():
                state[name][k] = value[k]

    def _snapshot(self) -> dict[str, np.ndarray]:
        """Poses and twists of the model's bodies, then of what follows them, and joints, of all environments."""
        model = self.model
        bodies = model.nbody - 1
        n = bodies + len(self._followers)
        result = {"pose": np.empty((self.envs, n, 7)), "twist": np.empty((self.envs, n, 6))}
        result["qpos"], result["qvel"] = np.empty((self.envs, model.nq)), np.empty((self.envs, model.nv))
        for k, data in enumerate(self.data):
            pose, twist = result["pose"][k], result["twist"][k]
            pose[:bodies, :3] = data.xpos[1:]
            pose[:bodies, 3:] = se3.from_mujoco(data.xquat[1:])
            # cvel is (omega, v) of the point of the body that is at the centre of mass of its kinematic tree
            omega, v = data.cvel[1:, :3], data.cvel[1:, 3:]
            arm = data.xpos[1:] - data.subtree_com[model.body_rootid[1:]]
            twist[:bodies, :3] = v + se3.cross(omega, arm)
            twist[:bodies, 3:] = omega
            if len(self._followers):
                velocity = np.concatenate((np.zeros((1, 6)), twist[:bodies]))
                pose[bodies:], twist[bodies:] = self._followers.state(data, velocity)
            result["qpos"][k], result["qvel"][k] = data.qpos, data.qvel
        return result

    def _state_at(self, t: int) -> dict[str, np.ndarray]:
        """The state at a time between the last two grid points."""
        if t == self._grid:
            return {name: value.copy() for name, value in self._now.items()}
        times = np.array([self._grid - self.step_ns, self._grid])
        poses, twists = (np.stack((self._before[n], self._now[n]), axis=1) for n in ("pose", "twist"))
        u = (t - times[0]) / self.step_ns
        qpos = np.empty_like(self._now["qpos"])
        for k, (a, b) in enumerate(zip(self._before["qpos"], self._now["qpos"])):
            rate = np.empty(self.model.nv)
            mujoco.mj_differentiatePos(self.model, rate, 1.0, a, b)
            qpos[k] = a
            mujoco.mj_integratePos(self.model, qpos[k], rate, u)
        pose, twist = interpolate.state_at(t, times, poses, twists)
        qvel = (1 - u) * self._before["qvel"] + u * self._now["qvel"]
        return {"pose": pose, "twist": twist, "qpos": qpos, "qvel": qvel}

    def _interval(
        self, t: np.ndarray, course: dict[str, np.ndarray], faults: list[tuple[int, str]], still: bool = False
    ) -> Interval:
        """The engine's bodies, the prescribed ones and the mounted ones, put together. still: the engine's rest."""
        pose, twist = (np.tile(a, (self.envs, 1, 1, 1)) for a in self._prescribed.at(t))
        moved, columns = self._moved, self._columns
        pose[:, :, moved], twist[:, :, moved] = (course[name][:, :, columns] for name in ("pose", "twist"))
        for n, body in enumerate(self.scene.bodies):
            if body.mount is not None:
                parent, offset = body.mount
                above, above_twist = pose[:, :, parent], twist[:, :, parent]
                pose[:, :, n] = se3.compose(above, offset)
                twist[:, :, n] = se3.compose_twist(above, above_twist, offset, np.zeros(6))
        if still:
            twist += 0.0  # of what is mounted it may be -0.0, which is not the bits of a body that rests
        result = Interval.dense(t, pose, twist, faults=faults, warnings=self._warnings)
        self._warnings = []
        if self._joints:
            result.qpos, result.qvel = course["qpos"], course["qvel"]
        if self._contacts:
            result.contacts = gather([contacts_of(self.model, data, self._scratch) for data in self.data])
        if self._accelerations:
            last = {name: course[name][:, -1] for name in ("qpos", "qvel")}
            result.acceleration = self._accelerations_at(int(t[-1]), last, pose[:, -1], twist[:, -1])
        return result

    def _accelerations_at(
        self, t: int, state: dict[str, np.ndarray], pose: np.ndarray, twist: np.ndarray
    ) -> np.ndarray:
        """Accelerations [E, N, 6] of all bodies at the end of an interval, of which these are poses and twists."""
        result = np.tile(prescribed_accelerations(self.scene, t), (self.envs, 1, 1))
        own = [(n, column) for n, column in zip(self._moved, self._columns) if column < self.model.nbody - 1]
        for k, data in enumerate(self.data):
            joints = state["qpos"][k], state["qvel"][k]
            found = mujoco_accelerations(self.model, data, self._scratch, *joints)
            for n, column in own:
                result[k, n] = found[column]
        for n, body in enumerate(self.scene.bodies):
            if body.mount is not None:
                parent, offset = body.mount
                result[:, n] = mounted_acceleration(pose[:, parent], twist[:, parent], result[:, parent], offset)
        return result
