"""Measures what an audit costs beside its run and how wide its interval is, by scene and number of pixels."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from bench import command
from bench.interpolation.light import CASES
from evis.runtime.clock import NS, keyframe_count
from evis.scene import load_scene
from evis.simulation.simulation import Simulation
from msgs.world import WorldState
from nodes.audit.audit import Audit, AuditOptions
from nodes.audit.budget import Rates, pixels_for

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
TIMED = ("renderer", "interpolator", "event_sensor")
SKIPPED = 2
"""Keyframes whose time does not count, for in them memory is found and kernels are loaded."""

Gap = tuple[np.ndarray, np.ndarray, np.ndarray, WorldState]


class Recorded:
    """Records a run of a scene's first camera: its gaps, and the CPU time of renderer, interpolator and sensor.

    run_s: CPU seconds of these three nodes for each simulated second.
    """

    def __init__(self, scene: str, seconds: float, size: Mapping[str, Any], rate: float, upsampling: int) -> None:
        self.seconds = seconds
        self.gaps: list[Gap] = []
        spent = [0.0]
        with Simulation(
            scene, outputs=["events", "frames", "state"], cameras=[load_scene(scene).cameras[0].name],
            threshold=THRESHOLD, keyframe_rate=rate, upsampling=upsampling, **size,
        ) as sim:  # fmt: skip
            self.scene = sim.scene
            for k in range(keyframe_count(round(seconds * NS), rate)):
                step = sim.step() if k else sim.reset()
                spent.append(sum(node["cpu_s"] for name, node in sim.summary().items() if name in TIMED))
                assert step.frames is not None and step.frames.luminance is not None and step.state is not None
                self.gaps.append((step.frames.luminance, step.frames.t, step.episodes, step.state))
        self.run_s = float(np.mean(np.diff(spent)[SKIPPED:])) * rate

    def audited(self, pixels: int) -> tuple[Audit, float]:
        """Audits the run with this many pixels; returns the audit, and its CPU seconds for each simulated second."""
        audit = Audit(self.scene, self.scene.cameras[0], AuditOptions(pixels, horizon_ns=round(self.seconds * NS)))
        audit.prepare()
        start = time.process_time()
        for gap in self.gaps:
            audit.push(*gap)
        audit.finish()
        return audit, (time.process_time() - start) / self.seconds


def rows(name: str, scene: str, setting: tuple[int, int, float, int], seconds: float, quick: bool) -> Iterator[Any]:
    """Measures one scene with the pixels of the default, and with more and fewer."""
    width, height, rate, upsampling = setting
    recorded = Recorded(scene, seconds, {"width": width, "height": height}, rate, upsampling)
    usual = pixels_for(recorded.scene, recorded.scene.cameras[0], Rates(rate, upsampling))
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
