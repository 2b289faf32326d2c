"""Brings what MuJoCo's threads have recorded of many environments into their course, in one pass over it."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from evis.gpu.building import LAUNCH_BLOCK
from evis.gpu.exchange import cpu_array
from evis.runtime.workers import Workers
from evis.warp_start import start_warp
from nodes.physics.dynamics.batch.course_kernels import Recorded, Written, write_course
from nodes.physics.dynamics.batch.stepped_states import Records
from nodes.physics.dynamics.course import Course

start_warp()

PLACES = {"xpos": "xpos", "xquat": "xquat", "cvel": "cvel", "subtree_com": "com"}
"""MuJoCo's fields, and their names in Recorded."""


class RecordedCourse:
    """Writes records of environments of a model into a Course."""

    def __init__(self, model: Any, reach: np.ndarray, own: tuple[np.ndarray, np.ndarray], threads: int) -> None:
        """reach: float64 [nbody] m, distance of a body's farthest point. own: see Assembly. threads: that share
        environments."""
        column = np.full(model.nbody, -1)
        column[own[1] + 1] = own[0]
        self._of_bodies = [cpu_array(np.asarray(values, np.int32)) for values in (model.body_rootid, column)]
        self._of_bodies.append(cpu_array(np.asarray(reach, np.float64)))
        self._bodies, self._threads = model.nbody - 1, threads
        self._pool = Workers(threads, "course") if threads > 1 else None
        self._given: tuple[Records, Any] | None = None
        """The last records, and what the kernel takes them as."""

    @staticmethod
    def kernels() -> list[tuple[wp.Kernel, int]]:
        """Gives the kernel that is launched, as `build_together` takes it."""
        return [(write_course, LAUNCH_BLOCK)]

    def write(
        self, records: Records, places: np.ndarray, envs: np.ndarray, course: Course
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Writes the steps but the last into `course`, of m environments.

        places: int [m], their rows in the records. envs: int [m], in the course. Returns poses [m, 2, bodies, 7] and
        twists [m, 2, bodies, 6] after the last two steps, the first of which counts only of two or more; the greatest
        speed of any point [m], not finite where anything is not; and the greatest component of a velocity before the
        last step [m].
        """
        recorded = self._of(records)
        pose, twist = (np.empty((len(envs), 2, self._bodies, n)) for n in (7, 6))
        speed, fastest = np.empty(len(envs)), np.empty(len(envs))
        written: Any = Written()
        written.poses, written.twists, written.first = (
            *map(cpu_array, (course.poses, course.twists)),
            course.first,
        )
        written.state_pose, written.state_twist = cpu_array(pose), cpu_array(twist)
        written.speed, written.fastest = cpu_array(speed), cpu_array(fastest)
        which = [cpu_array(np.asarray(rows, np.int32)) for rows in (places, envs)]

        def work(part: np.ndarray) -> None:
            inputs = [int(part[0]), *which, *self._of_bodies, recorded, written]
            wp.launch(write_course, len(part), inputs, device="cpu")

        parts = np.array_split(np.arange(len(envs)), min(self._threads, len(envs)))
        # To hand over a single part takes longer than most of them do.
        for _done in (map if self._pool is None or len(parts) == 1 else self._pool.map)(work, parts):
            pass
        return pose, twist, speed, fastest

    def _of(self, records: Records) -> Any:
        """Gives records to the kernel; environments that began at different times have them in common."""
        if self._given is None or self._given[0] is not records:
            recorded: Any = Recorded()
            for name, field in PLACES.items():
                setattr(recorded, field, cpu_array(records.each[name]))
                now = records.each[name][:, -1] if records.now is None else records.now[name]
                setattr(recorded, f"now_{field}", cpu_array(np.ascontiguousarray(now)))
            recorded.qpos, recorded.qvel = (cpu_array(records.each[name]) for name in ("qpos", "qvel"))
            recorded.late = int(records.now is not None)
            self._given = records, recorded
        return self._given[1]
