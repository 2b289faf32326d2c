"""Runs a case by the engine of the physics node, and tells whether the result is right and what warnings there were."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.physics.case import INTEGRATORS, MS, Case, Course
from evis.scene import load_scene
from nodes.physics.engines.mujoco_engine import MujocoEngine
from nodes.physics.interval import Extras, Interval
from nodes.physics.precision.errors import Errors, Estimate
from nodes.physics.precision.notice import notice
from nodes.physics.precision.stepping import Stepping
from nodes.physics.precision.tolerance import Tolerance

STAMP_NS = 20 * MS
"""Time between two messages of physics: 50 keyframes a second."""
RIGHT = "right"
TOLERANCE = "tolerance"
NAMES = (*INTEGRATORS, TOLERANCE)
"""Names of methods."""
LEAST = 0.01
"""Share of the limit below which nobody asks how right an estimate is."""


@dataclass(frozen=True)
class Method:
    """Describes how a case is stepped: integrator, time step [ns], and physics_tolerance [m and rad in a second] or
    None.
    """

    integrator: str
    step_ns: int
    tolerance: float | None = None

    @property
    def name(self) -> str:
        """Gives the name of the curve of a diagram that the method is a point of."""
        return self.integrator if self.tolerance is None else TOLERANCE

    @property
    def size(self) -> float:
        """Gives the time step or the tolerance: of methods of one name, the one of least size is the most exact."""
        return self.step_ns if self.tolerance is None else self.tolerance

    @property
    def step(self) -> str:
        """Writes the time step, or the tolerance, as text."""
        if self.tolerance is not None:
            return f"{self.tolerance:g}"
        return f"{self.step_ns / MS:g} ms" if self.step_ns >= MS / 10 else f"{self.step_ns / 1e3:g} us"


@dataclass(frozen=True)
class Trial:
    """Holds what came of a case: its error, NaN where it diverged; CPU seconds per simulated second; what was said.

    ended_s: simulated time. foretold: before the first step. said: while it ran and at its end. fault: why it diverged,
    or "". estimate: how wrong the run itself says it is, None where it does not know. course: what was published.
    checked: how many intervals between stamps were stepped with a check of each state, by MuJoCo.
    """

    case: Case
    method: Method
    error: float
    cpu: float
    ended_s: float
    foretold: tuple[str, ...] = ()
    said: tuple[str, ...] = ()
    fault: str = ""
    estimate: Estimate | None = None
    course: Course | None = None
    checked: int = 0

    @property
    def estimated(self) -> float | None:
        """Gives the estimate in the unit of the case's error, None where there is none of such an error."""
        if self.estimate is None or not self.case.estimated:
            return None
        return math.degrees(self.estimate.rotation) if self.case.unit == "deg" else self.estimate.position

    @property
    def ratio(self) -> float | None:
        """Divides the estimate by the error; None where one is missing, or where both are too small to matter."""
        estimated = self.estimated
        if estimated is None or self.fault or max(estimated, self.error) < LEAST * self.case.limit:
            return None
        return estimated / self.error if self.error else math.inf

    @property
    def verdict(self) -> str:
        """Says in a few words whether it is right, and if not whether the user was told."""
        told = "foretold" if self.foretold else "said" if self.said or self.fault else ""
        if self.fault:
            return f"diverged, {told}"
        if self.error <= self.case.limit:
            return f"{RIGHT}, but warned of" if told else RIGHT
        return f"off, {told or 'unsaid'}"

    @property
    def right(self) -> bool:
        """Tells whether the error is within the limit."""
        return not self.fault and self.error <= self.case.limit


def run(case: Case, method: Method, folder: Path, warp: str | None = None) -> Trial:
    """Steps a case to its end or until it diverges.

    folder: where its scene is written, as a user would write it. warp: device on which MuJoCo Warp takes the steps;
    None = MuJoCo does. CPU time is that of the steps and of what physics publishes, without loading.
    """
    errors = Errors()
    tolerance = None if method.tolerance is None else Tolerance(method.tolerance, method.tolerance)
    scene = load_scene(str(_written(case, method, folder)))
    engine = MujocoEngine(
        scene, errors=errors, warp=warp, stepping=Stepping(tolerance=tolerance), extras=Extras(joints=True)
    )
    controls = np.array([case.controls]) if case.controls else None
    first = engine.start()
    foretold = tuple(text for _, text in first.warnings)
    bodies = engine.model.nbody - 1
    parts = [_part(first, bodies, 0)]
    said: list[str] = []
    spent, stamp, end = 0.0, 0, round(case.seconds * 1e9)
    fault = ""
    while stamp < end and not fault:
        stamp = min(stamp + STAMP_NS, end)
        began = time.process_time()
        interval = engine.advance(stamp, controls)
        spent += time.process_time() - began
        said += [text for _, text in interval.warnings]
        fault = interval.faults[0][1] if interval.faults else ""
        parts.append(_part(interval, bodies, case.sample_ns))
    course = Course(*(np.concatenate(values) for values in zip(*parts, strict=True)))
    error = math.nan if fault else case.error(course)
    worst = errors.worst()
    if worst is not None and (text := notice(worst, f"body{worst.body}", tolerance, stamp * 1e-9, engine.missed())):
        said.append(text)
    seconds = stamp * 1e-9
    return Trial(
        case, method, error, spent / seconds, seconds, foretold, tuple(said), fault, worst, course, engine.checked
    )


def _part(interval: Interval, bodies: int, sample_ns: int) -> tuple[np.ndarray, ...]:
    """What is looked at of an interval: times, poses and twists of the model's bodies, which come first, and qpos."""
    t = interval.t
    # The first state is the last of the message before.
    kept = np.arange(len(t)) >= (len(t) > 1)
    if sample_ns and len(t) > 1:
        kept &= (t % sample_ns == 0) | (t == t[-1])
    assert interval.qpos is not None
    pose, twist = interval.pose[0, kept, :bodies], interval.twist[0, kept, :bodies]
    return t[kept] * 1e-9, pose, twist, interval.qpos[0, kept]


def _written(case: Case, method: Method, folder: Path) -> Path:
    key = f"<keyframe><key {case.start}/></keyframe>" if case.start else ""
    option = f"<option integrator='{method.integrator}' timestep='{method.step_ns * 1e-9:.9f}' {case.option}/>"
    (folder / "model.xml").write_text(f"<mujoco>{option}<worldbody>{case.world}</worldbody>{case.rest}{key}</mujoco>")
    scene = folder / "scene.yaml"
    start = 0 if case.start else "none"
    scene.write_text(f"mjcf: model.xml\nkeyframe: {start}\ncameras: {{cam0: {{fov: 1, position: [0, 0, 9]}}}}\n")
    return scene
