"""Dynamics with MuJoCo in float64: E environments of one model, each with its own state.

Steps lie on one grid of fixed length (at most 1 ms) that knows nothing of keyframes, so that a world takes the same
course whatever the keyframe rate; a stamp between two grid points is interpolated (`evis.geometry.interpolate`, exact
to fourth order), and a later message goes on along the very same curve. An action takes effect at the first grid
point at or after its stamp: at once where the keyframe interval is a multiple of the step.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from evis.geometry import interpolate, se3
from evis.scene.mjcf.changes import apply_start
from evis.scene.mjcf.dynamics import compile_model
from evis.scene.model import Scene
from nodes.physics.contacts import contacts_of, gather
from nodes.physics.followers import Followers
from nodes.physics.interval import Interval
from nodes.physics.prescribed import PrescribedStates
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
        speed_limit: float = 1000.0,
    ) -> None:
        """Loads the model and puts every environment to its start.

        Args:
            scene: with an MJCF model.
            seed: seed + k is that of environment k: where its free bodies start.
            envs: E.
            timestep: sub-step [s], at most 1 ms; None = the model's own, cut into equal parts of at most 1 ms.
            contacts: whether intervals have contacts with their forces.
            joints: whether they have positions and velocities of the joints.
            speed_limit: speed [m/s] of a body beyond which an environment has diverged.
        """
        # Without a handler MuJoCo writes a log file into the working directory; the watchdog reads the counters.
        mujoco.set_mju_user_warning(lambda text: None)
        self.scene, self.seed, self.envs = scene, seed, envs
        self.model = compile_model(scene)
        # MuJoCo would put a diverged state back to its start and go on as if nothing had happened.
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        self.step_ns = step_length(self.model.opt.timestep, timestep)
        self.model.opt.timestep = self.step_ns * 1e-9
        self.controls: int = self.model.nu
        self.data = [mujoco.MjData(self.model) for _ in range(envs)]
        self._scratch = mujoco.MjData(self.model) if contacts else None
        self._joints = joints
        self._watchdogs = [Watchdog(self.model, speed_limit) for _ in range(envs)]
        self._warnings = [(0, text) for text in self._watchdogs[0].risks()]
        self._episodes = [0] * envs
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
        self._stamp, self._grid = 0, 0
        for k in range(envs):
            self._reset(k)
        self._before = self._now = self._snapshot()
        self._last = self._state_at(0)
        """The state at the stamp published last, where the next message begins."""

    def start(self) -> Interval:
        """Gives the state at stamp 0."""
        return self._interval(np.zeros(1, np.int64), [self._now], [])

    def advance(self, to_ns: int, controls: np.ndarray | None = None) -> Interval:
        """Moves on to stamp `to_ns` [ns] under controls [E, nu].

        Raises ValueError for controls of a wrong shape or not finite.
        """
        if controls is not None:
            self._control(controls)
        times, states = [self._stamp], [self._last]
        faults: dict[int, str] = {}
        while self._grid < to_ns:
            if self._grid > self._stamp:
                times.append(self._grid)
                states.append(self._now)
            self._step(faults)
        times.append(to_ns)
        states.append(self._state_at(to_ns))
        self._stamp = to_ns
        for k in faults:
            self._restart(k, states)
        self._last = states[-1]
        return self._interval(np.array(times, np.int64), states, sorted(faults.items()))

    def _control(self, controls: np.ndarray) -> None:
        if controls.shape != (self.envs, self.controls):
            raise ValueError(
                f"an action has controls {list(controls.shape)}, the model takes [{self.envs}, {self.controls}] "
                "(environments, actuators)"
            )
        if not np.isfinite(controls).all():
            k, u = np.argwhere(~np.isfinite(controls))[0]
            raise ValueError(f"an action has {controls[k, u]} for actuator {u} of environment {k}; it must be finite")
        for data, values in zip(self.data, controls):
            data.ctrl[:] = values

    def _step(self, faults: dict[int, str]) -> None:
        """All environments one grid step on; one that has diverged waits for the end of the interval."""
        for k, data in enumerate(self.data):
            if k in faults:
                continue
            # MuJoCo adds up its time in floating point; ours is exact.
            data.time = self._grid * 1e-9
            mujoco.mj_step(self.model, data)
            # mj_step leaves poses and velocities of the state before the step.
            mujoco.mj_kinematics(self.model, data)
            mujoco.mj_comPos(self.model, data)
            mujoco.mj_comVel(self.model, data)
        self._grid += self.step_ns
        self._before, self._now = self._now, self._snapshot()
        for k, data in enumerate(self.data):
            if k not in faults:
                twist = self._now["twist"][k, : self.model.nbody - 1]
                fault = self._watchdogs[k].check(data, twist)
                if fault:
                    faults[k] = fault
                else:
                    self._warnings += [(k, text) for text in self._watchdogs[k].notices(data, twist)]

    def _reset(self, k: int) -> None:
        """Environment k to its start: the scene's keyframe, moved a little by seed + k and the episode's number."""
        data = self.data[k]
        if self.scene.keyframe >= 0:
            mujoco.mj_resetDataKeyframe(self.model, data, self.scene.keyframe)
        else:
            mujoco.mj_resetData(self.model, data)
        apply_start(self.model, data, self.scene.changes)
        spread, turn = self.scene.initial_spread
        random = np.random.Generator(np.random.Philox(key=[self.seed + k, self._episodes[k]]))
        for joint in np.flatnonzero(self.model.jnt_type == mujoco.mjtJoint.mjJNT_FREE):
            shift, rotation = random.standard_normal((2, 3))
            at = self.model.jnt_qposadr[joint]
            data.qpos[at : at + 3] += spread * shift
            q = se3.from_mujoco(data.qpos[at + 3 : at + 7])
            data.qpos[at + 3 : at + 7] = se3.to_mujoco(se3.multiply(se3.exp(turn * rotation), q))
        mujoco.mj_forward(self.model, data)
        self._watchdogs[k].restart(data)

    def _restart(self, k: int, states: list[dict[str, np.ndarray]]) -> None:
        """Begin the next episode of environment k at the stamp; its part of the interval is the new start all along."""
        self._episodes[k] += 1
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

    def _interval(self, t: np.ndarray, states: list[dict[str, Any]], faults: list[tuple[int, str]]) -> Interval:
        """The engine's bodies, the prescribed ones and the mounted ones, put together."""
        pose, twist = (np.tile(a, (self.envs, 1, 1, 1)) for a in self._prescribed.at(t))
        moved, columns = self._moved, self._columns
        pose[:, :, moved] = np.stack([s["pose"][:, columns] for s in states], axis=1)
        twist[:, :, moved] = np.stack([s["twist"][:, columns] for s in states], axis=1)
        for n, body in enumerate(self.scene.bodies):
            if body.mount is not None:
                parent, offset = body.mount
                above, above_twist = pose[:, :, parent], twist[:, :, parent]
                pose[:, :, n] = se3.compose(above, offset)
                twist[:, :, n] = se3.compose_twist(above, above_twist, offset, np.zeros(6))
        result = Interval.dense(t, pose, twist, faults=faults, warnings=self._warnings)
        self._warnings = []
        if self._joints:
            result.qpos, result.qvel = (np.stack([s[n] for s in states], axis=1) for n in ("qpos", "qvel"))
        if self._scratch is not None:
            result.contacts = gather([contacts_of(self.model, data, self._scratch) for data in self.data])
        return result
