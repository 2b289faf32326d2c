"""Brings what MuJoCo has recorded of environments into their course, in one pass over it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from evis.gpu.building import LAUNCH_BLOCK
from evis.gpu.exchange import cpu_array
from evis.gpu.repeated_launch import RepeatedLaunch
from evis.runtime.workers import Workers
from nodes.physics.dynamics.batch.stepped_states import Records
from nodes.physics.dynamics.course.course import Course
from nodes.physics.dynamics.course.course_kernels import Recorded, Written, write_course

FIELDS = {"xpos": "xpos", "xquat": "xquat", "cvel": "cvel", "subtree_com": "com"}
"""MuJoCo's fields, and their names in Recorded."""
FEW, MOST_KEPT = 64, 16
"""Environments up to which arrays are kept of several numbers of them, and of how many."""
SHARE = 16
"""Environments that are worth a thread: to hand over fewer takes longer than they do."""


@dataclass
class Seen:
    """Holds the last states and the greatest speeds of m environments in their steps.

    pose, twist: [m, 2, bodies, ...] after the last two steps, the first of which counts only of two or more. speed,
    fastest: float64 [m], the greatest speed of a point [m/s], not finite where anything is not, and the greatest
    component of a twist before the last step [m/s, rad/s].
    """

    pose: np.ndarray
    twist: np.ndarray
    speed: np.ndarray
    fastest: np.ndarray


class _Room:
    """Holds the arrays of a number of environments that the kernel is given beside their records."""

    def __init__(self, count: int, bodies: int) -> None:
        self.places, self.envs = np.empty(count, np.int32), np.empty(count, np.int32)
        pose, twist = (np.empty((count, 2, bodies, n)) for n in (7, 6))
        self.seen = Seen(pose, twist, np.empty(count), np.empty(count))
        written: Any = Written()
        written.state_pose, written.state_twist = cpu_array(pose), cpu_array(twist)
        written.speed, written.fastest = cpu_array(self.seen.speed), cpu_array(self.seen.fastest)
        self.which, self.written = [cpu_array(self.places), cpu_array(self.envs)], written


class RecordedCourse:
    """Writes records of environments of a model into a Course."""

    def __init__(self, model: Any, reach: np.ndarray, own: tuple[np.ndarray, np.ndarray], threads: int) -> None:
        """Takes a model. reach: float64 [nbody] m, distance of a body's farthest point. own: see Assembly. threads:
        that share environments."""
        column = np.full(model.nbody, -1)
        column[own[1] + 1] = own[0]
        self._of_bodies = [cpu_array(np.asarray(values, np.int32)) for values in (model.body_rootid, column)]
        self._of_bodies.append(cpu_array(np.asarray(reach, np.float64)))
        self._bodies, self._threads = model.nbody - 1, threads
        self._pool = Workers(threads, "course") if threads > 1 else None
        self._rooms: dict[int, _Room] = {}

    @staticmethod
    def kernels() -> list[tuple[wp.Kernel, int]]:
        """Gives the kernel that is launched, as `build_together` takes it."""
        return [(write_course, LAUNCH_BLOCK)]

    def write(self, records: Records, places: np.ndarray, envs: np.ndarray, course: Course) -> Seen:
        """Writes the steps but the last into `course`, of m environments.

        places: int [m], their rows in the records. envs: int [m], in the course. What is returned is written again with
        the next ones.
        """
        room = self._room(len(envs))
        room.places[:], room.envs[:] = places, envs
        launch = self._launch(records, room, course)
        shares = min(self._threads, len(envs) // SHARE)
        if self._pool is None or shares < 2:
            launch.whole(len(envs))
        else:
            size = -(-len(envs) // shares)
            parts = [(start, min(size, len(envs) - start)) for start in range(0, len(envs), size)]
            for _done in self._pool.map(lambda part: launch.part(*part), parts):
                pass
        return room.seen

    def _room(self, count: int) -> _Room:
        if count not in self._rooms:
            # Of many environments they are large, and of as many as before mostly.
            few = {n: room for n, room in self._rooms.items() if n <= FEW}
            self._rooms = few if len(few) < MOST_KEPT else {}
            self._rooms[count] = _Room(count, self._bodies)
        return self._rooms[count]

    def _launch(self, records: Records, room: _Room, course: Course) -> RepeatedLaunch:
        """Gives records, room and course to the kernel."""
        # Environments that begin at different times and a course of several numbers of steps change all by turns.
        launches, key = course.paths.launches, (self, len(room.envs), course.first)
        known = launches.get(key)
        if known is not None and known[0] is records and known[1] is room:
            return known[2]
        recorded: Any = Recorded()
        for name, field in FIELDS.items():
            setattr(recorded, field, cpu_array(records.each[name]))
            # The kernel asks for those after the last step only of such as are recorded before each.
            now = records.each[name][:, -1] if records.now is None else records.now[name]
            setattr(recorded, f"now_{field}", cpu_array(now))
        recorded.qpos, recorded.qvel = (cpu_array(records.each[name]) for name in ("qpos", "qvel"))
        recorded.late = int(records.now is not None)
        given = [*room.which, *self._of_bodies, recorded, room.written, course.first, *course.paths.views]
        launch = RepeatedLaunch(write_course, given)
        launches[key] = records, room, launch
        return launch
