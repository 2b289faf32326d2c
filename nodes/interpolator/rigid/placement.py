"""Where the bodies are at the sub-frames: in closed form where that is known, else between the sub-steps of /state."""

from __future__ import annotations

import numpy as np

from evis.geometry import se3
from evis.geometry.interpolate import pose_at
from evis.scene.model import Scene, Trajectory
from evis.scene.motion import Prescribed
from nodes.interpolator.keyframe import States


class Placement:
    """Poses of a scene's bodies at any time of a gap."""

    def __init__(self, scene: Scene) -> None:
        paths = [body.trajectory for body in scene.bodies]
        self._driven = np.array([n for n, path in enumerate(paths) if path is None], np.int64)
        self._alone: list[tuple[int, Trajectory]] = []
        carried: dict[int, list[int]] = {}
        for n, path in enumerate(paths):
            if path is None or path.is_static():
                continue
            if isinstance(path, Prescribed) and path.parent is not None and not path.shifts and not path.turns:
                carried.setdefault(id(path.parent), []).append(n)
            else:
                self._alone.append((n, path))
        # What is fixed to one parent goes where that goes, all of it at once.
        self._carried: list[tuple[Trajectory, np.ndarray, np.ndarray]] = []
        for members in carried.values():
            fixed = [path for n in members if isinstance(path := paths[n], Prescribed)]
            assert fixed[0].parent is not None
            self._carried.append((fixed[0].parent, np.array(members), np.stack([path.start for path in fixed])))

    def at(self, stamps: np.ndarray, states: States) -> np.ndarray:
        """Poses float64 [K, E, N, 7] at stamps int64 [K] ns within the interval of `states`; the last stamp is its end.

        Raises ValueError where the states do not reach back to the first stamp.
        """
        last = np.asarray(states.pose[:, -1], np.float64)
        poses = np.repeat(last[None], len(stamps), axis=0)
        if len(stamps) == 1:
            return poses
        # A carrier is most often a body too.
        known: dict[int, np.ndarray] = {}
        for n, path in self._alone:
            known[id(path)] = path.pose(stamps[:-1])[:, None]
            poses[:-1, :, n] = known[id(path)]
        for path, members, starts in self._carried:
            carrier = known[id(path)] if id(path) in known else path.pose(stamps[:-1])[:, None]
            poses[:-1, :, members] = se3.compose(carrier[:, None], starts)
        if len(self._driven):
            pose, twist = (np.asarray(a)[:, :, self._driven] for a in (states.pose, states.twist))
            poses[:-1, :, self._driven] = np.swapaxes(pose_at(stamps[:-1], states.t, pose, twist), 0, 1)
        return poses
