"""What an audit costs beside its run, and how wide its interval is, scene by scene and pixel count by pixel count."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from bench import command
from bench.interpolation.light import CASES
from evis.runtime.clock import NS, keyframe_count, keyframe_stamp
from evis.scene import load_scene
from evis.scene.model import Scene
from msgs.header import Header
from msgs.world import WorldState
from nodes.audit.audit import Audit, AuditOptions
from nodes.audit.budget import Rates, pixels_for
from nodes.event_sensor.sensor import EventSensor
from nodes.interpolator.auto.setting import LIGHT
from nodes.interpolator.auto.world import World
from nodes.interpolator.interpolator import Interpolator
from nodes.interpolator.keyframe import States
from nodes.renderer.renderer import Renderer

COMMAND = "evis bench audit"
SCENES = (
    "spinning_disk", "fidget_spinner", "falling_objects", "robot_arm", "drone", "stereo_room", "warehouse",
    "tunnel_exit",
)  # fmt: skip
THRESHOLD = 0.2
COUNTS = (16, 32, 64)
"""Pixels beside those by default."""
SETTINGS = ((346, 260, 30.0, 8), (96, 72, 30.0, 32))
"""Width, height, keyframes a second and frames to each."""
SKIPPED = 2
"""Keyframes whose time does not count, for in them memory is found and kernels are loaded."""

Gap = tuple[np.ndarray, np.ndarray, np.ndarray, WorldState]


class Recorded:
    """A run of a scene's first camera in one process: its gaps, and CPU seconds for each simulated second."""

    def __init__(self, scene: Scene, seconds: float, rate: float, upsampling: int) -> None:
        self.scene, self.seconds = scene, seconds
        self.gaps: list[Gap] = []
        spent: list[float] = []
        for took, gap in _gaps(scene, seconds, rate, upsampling):
            spent.append(took)
            self.gaps.append(gap)
        self.run_s = float(np.mean(spent[SKIPPED:])) * rate

    def audited(self, pixels: int) -> tuple[Audit, float]:
        """Gives an audit of the run, and its CPU seconds for each simulated second."""
        audit = Audit(self.scene, self.scene.cameras[0], AuditOptions(pixels, horizon_ns=round(self.seconds * NS)))
        audit.prepare()
        start = time.process_time()
        for gap in self.gaps:
            audit.push(*gap)
        audit.finish()
        return audit, (time.process_time() - start) / self.seconds


def _gaps(scene: Scene, seconds: float, rate: float, upsampling: int) -> Iterator[tuple[float, Gap]]:
    """CPU seconds of each gap in renderer, interpolator and sensor, and what an audit gets of it."""
    camera, duration = scene.cameras[0], round(seconds * NS)
    world, renderer = World(scene, duration), Renderer(scene, camera)
    interpolator = Interpolator("rigid", upsampling, scene=scene, camera=camera)
    sensor = EventSensor(camera.height, camera.width, threshold=THRESHOLD)
    episodes, before, previous = np.zeros(1, np.int32), 0, None
    for k in range(keyframe_count(duration, rate)):
        stamp = keyframe_stamp(k, rate)
        poses, states = world.poses(stamp), States(*world.states(before, stamp))
        start = time.process_time()
        image = renderer.render(poses, previous, {LIGHT}, {}, stamp)[LIGHT].copy()
        t, frames = interpolator.push(stamp, episodes, image, None, None, states=states)
        sensor.process(np.asarray(frames), t, episodes)
        took = time.process_time() - start
        message = WorldState.dense(Header(stamp), states.t, states.pose, states.twist, episodes)
        yield took, (np.array(frames), np.array(t), episodes, message)
        previous, before = poses, stamp


def rows(name: str, scene: str, setting: tuple[int, int, float, int], seconds: float, quick: bool) -> Iterator[Any]:
    """Measures one scene with the pixels of the default, and with more and fewer."""
    width, height, rate, upsampling = setting
    world = load_scene(scene, {"width": width, "height": height})
    usual = pixels_for(world, world.cameras[0], Rates(rate, upsampling))
    recorded = Recorded(world, seconds, rate, upsampling)
    for pixels in dict.fromkeys((usual, *(() if quick else COUNTS))):
        audit, took = recorded.audited(pixels)
        report = audit.report()
        yield {
            "scene": name,
            "pixels": pixels,
            "by default": "yes" if pixels == usual else "",
            "run [s/s]": round(recorded.run_s, 2),
            "audit [s/s]": round(took, 3),
            "share [%]": round(100 * took / recorded.run_s, 1),
            "looks/pixel [1/s]": round(audit.looks / pixels / seconds),
            "error": round(report.vp.value, 2),
            "interval": f"{report.vp.low:.2f} to {report.vp.high:.2f}",
            "width": round(report.vp.high - report.vp.low, 2),
        }


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures the scenes that come with EVIS, and small light scenes; quick: two of each, by default alone."""
    small = sorted(CASES.glob("*.yaml"))
    scenes: tuple[tuple[str, str], ...] = tuple(
        (name, name) for name in (SCENES[:1] + SCENES[3:4] if quick else SCENES)
    )
    cases = tuple((path.stem, str(path)) for path in (small[:2] if quick else small))
    seconds = 0.2 if quick else 1.0
    note = (
        f"{seconds:g} s simulated; CPU times of one process, the audit's from the first frame on; start with "
        "OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1, as EVIS starts its processes."
    )
    sections = {}
    for key, setting, listed in zip(("scenes", "small"), SETTINGS, (scenes, cases)):
        sections[key] = {
            "title": "Audits beside their runs, {}x{}, {:g} keyframes per second x {}".format(*setting),
            "command": COMMAND,
            "rows": [row for name, scene in listed for row in rows(name, scene, setting, seconds, quick)],
            "note": note,
        }
    return sections


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
