"""Joins the states of a MuJoCo model's bodies, of prescribed ones, and of those mounted on either."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from evis.geometry import se3
from evis.scene.model import Scene
from nodes.physics.accelerations import mounted_acceleration, mujoco_accelerations, prescribed_accelerations
from nodes.physics.dynamics.course.mounted import KERNELS, Mounted
from nodes.physics.dynamics.course.paths import Paths
from nodes.physics.dynamics.followers import Followers
from nodes.physics.engines.prescribed import PrescribedStates
from nodes.physics.interval import Interval


class Assembly:
    """Makes intervals of the bodies of a scene from states of the model's.

    followers: what MuJoCo has follow a body. moves: whether anything is prescribed that moves. bodies: N. may_move:
    int32 ascending, bodies that may move; the others never do.
    """

    def __init__(self, scene: Scene, model: Any) -> None:
        """Raises ValueError for a body that nothing moves."""
        self._scene, self._model = scene, model
        follows = [(n, body.follows) for n, body in enumerate(scene.bodies) if body.follows is not None]
        self.followers = Followers(model, [what for _, what in follows])
        own = [
            n
            for n, body in enumerate(scene.bodies)
            if body.trajectory is None and body.mount is None and body.follows is None
        ]
        if own and own[-1] >= model.nbody - 1:
            raise ValueError(f"scene {scene.name}: body '{scene.bodies[own[-1]].name}' has no motion")
        self._moved = [*own, *(n for n, _ in follows)]
        self._columns = [*own, *range(model.nbody - 1, model.nbody - 1 + len(follows))]
        """Which rows of a state the bodies of `_moved` are: the model's own bodies come first there."""
        self._prescribed = PrescribedStates(scene)
        self.moves = len(self._prescribed.moving) > 0
        self.bodies = len(scene.bodies)
        self._still: np.ndarray | None = None
        """Poses of all bodies, of which those count that never move."""
        self.may_move = np.array([n for n in range(self.bodies) if self._may_move(n)], np.int32)

        place = {n: m for m, n in enumerate(self.may_move.tolist())}
        of_model = {n: column for n, column in zip(self._moved, self._columns) if n in place}
        self.own = np.array([place[n] for n in of_model], np.int64), np.array([*of_model.values()], np.int64)
        """Those of `may_move` that the model has, and which rows of a state they are."""
        self._on_paths = [(m, n) for n, m in place.items() if n not in of_model and scene.bodies[n].mount is None]
        mounted = [(place[n], place[b.mount[0]], b.mount[1]) for n, b in enumerate(scene.bodies)
                   if b.mount is not None and n in place]  # fmt: skip
        self._mounted = Mounted(mounted) if mounted else None

    def _may_move(self, n: int) -> bool:
        body = self._scene.bodies[n]
        if body.mount is not None:
            return self._may_move(body.mount[0])
        if body.trajectory is not None:
            return n in self._prescribed.moving
        own = self._columns[self._moved.index(n)] + 1
        # MuJoCo welds to the world what has no joint above it.
        return own >= self._model.nbody or self._model.body_weldid[own] != 0 or self._model.body_mocapid[own] >= 0

    def put_paths(self, t: np.ndarray, poses: np.ndarray, twists: np.ndarray) -> None:
        """Writes what is prescribed at times int64 [S] ns into poses [E, S, M, 7] and twists [E, S, M, 6]."""
        if self._on_paths:
            pose, twist = self._prescribed.at(t)
            for m, n in self._on_paths:
                poses[:, :, m], twists[:, :, m] = pose[:, n], twist[:, n]

    def kernels(self) -> list[tuple[Any, int]]:
        """Gives the kernels that are launched, as `build_together` takes them."""
        return KERNELS if self._mounted is not None else []

    def put_mounted(self, paths: Paths, part: slice | None = None) -> None:
        """Writes what is mounted on others into the paths of all environments, or of a part of them, where all others
        are there."""
        if self._mounted is not None:
            self._mounted.put(paths, part)

    def end_poses(self, poses: np.ndarray, state: np.ndarray) -> np.ndarray:
        """Gives the poses [E, N, 7] of all bodies, from those [E, M, 7] of `may_move` and of the model, [E, n, 7]."""
        if self._still is None:
            self._still = self.whole(self.prescribed(np.zeros(1, np.int64)), state[:1, None], state[:1, None, :, :6])[0]
        result = np.repeat(self._still[:, 0], len(poses), axis=0)
        result[:, self.may_move] = poses
        return result

    def prescribed(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Computes poses [S, N, 7] and twists [S, N, 6] at times int64 [S] ns, NaN of what MuJoCo moves."""
        return self._prescribed.at(t)

    def whole(
        self, prescribed: tuple[np.ndarray, np.ndarray], pose: np.ndarray, twist: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Computes poses [E, S, N, 7] and twists [E, S, N, 6] of all bodies.

        prescribed: of their times. pose, twist: of the model's bodies, [E, S, n, 7] and [E, S, n, 6].
        """
        poses, twists = (np.tile(a, (len(pose), 1, 1, 1)) for a in prescribed)
        moved, columns = self._moved, self._columns
        poses[:, :, moved], twists[:, :, moved] = pose[:, :, columns], twist[:, :, columns]
        for n, body in enumerate(self._scene.bodies):
            if body.mount is not None:
                parent, offset = body.mount
                above, above_twist = poses[:, :, parent], twists[:, :, parent]
                poses[:, :, n] = se3.compose(above, offset)
                twists[:, :, n] = se3.compose_twist(above, above_twist, offset, np.zeros(6))
        return poses, twists

    def interval(self, t: np.ndarray, pose: np.ndarray, twist: np.ndarray, still: bool = False) -> Interval:
        """Makes the interval of times int64 [S] ns from the model's pose [E, S, n, 7] and twist [E, S, n, 6].

        still: the model's bodies rest.
        """
        pose, twist = self.whole(self.prescribed(t), pose, twist)
        if still:
            twist += 0.0  # of what is mounted it may be -0.0, which is not the bits of a body that rests
        return Interval.dense(t, pose, twist)

    def accelerations(
        self, interval: Interval, datas: Sequence[Any], scratch: Any, qpos: np.ndarray, qvel: np.ndarray
    ) -> np.ndarray:
        """Computes the accelerations [E, N, 6] of all bodies at the end of an interval.

        datas: of each environment, whose controls count. scratch: another MjData. qpos [E, nq], qvel [E, nv]: then.
        """
        pose, twist = interval.pose[:, -1], interval.twist[:, -1]
        result = np.tile(prescribed_accelerations(self._scene, int(interval.t[-1])), (len(datas), 1, 1))
        own = [(n, column) for n, column in zip(self._moved, self._columns) if column < self._model.nbody - 1]
        for k, data in enumerate(datas):
            found = mujoco_accelerations(self._model, data, scratch, qpos[k], qvel[k])
            for n, column in own:
                result[k, n] = found[column]
        for n, body in enumerate(self._scene.bodies):
            if body.mount is not None:
                parent, offset = body.mount
                result[:, n] = mounted_acceleration(pose[:, parent], twist[:, parent], result[:, parent], offset)
        return result
