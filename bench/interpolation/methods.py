"""Measures error against run time of every interpolation method and keyframe rate, against dense rendering.

    evis bench interpolation [--quick]

The reference is dense rendering at the scene's reference rate with linear crossing times; half that rate against it is
the reference's own error, printed with the results. Run times are CPU time of one core, of renderer, interpolator and
sensor, without what is made once. Where shading is expensive, the run time follows from the number of pixels shaded: a
table gives it at shading costs beyond that of these scenes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from bench import command
from bench.interpolation import cases as interpolation_cases
from bench.interpolation import paths as interpolation_paths
from bench.interpolation.auto import Fixed, compare, label_of
from bench.interpolation.pipeline import reference, simulate, visibility_seconds
from bench.interpolation.plot import plot
from bench.interpolation.tables import (
    ALONE_HZ,
    DENSE_HZ,
    MANY,
    RATES,
    Row,
    by_method,
    equal_shading,
    equal_time,
    failures,
    half_error,
    shown,
)
from evis.events.measure.distance import EventStream, count_error, event_frame_error, time_error, victor_purpura
from evis.runtime.clock import NS
from evis.scene import load_scene
from nodes.interpolator.auto.setting import METHODS
from nodes.interpolator.auto.world import World

__all__ = ["measure", "plot", "run_scene"]

FEW = ((62.5, 8), (31.25, 8), (31.25, 10), (31.25, 12), (31.25, 16), (31.25, 24))
"""Keyframe rates [Hz] and K of less than 1000 frames per second, for where time is short."""
SAMPLED = (
    (31.25, 4, 8e-4), (31.25, 4, 3e-4), (31.25, 8, 1e-4), (62.5, 4, 1e-4), (125, 4, 1e-4), (250, 4, 1e-4),
)  # fmt: skip
"""Keyframe rates [Hz], K and tolerances of time [s] at which `rigid` also takes further samples; K as
`upsampling:=auto` has it, and 4 where that would be less."""
CROSSINGS = ("frame", "linear", "monotone")
KEEP_NS = 1_000_000
COMMAND = "evis bench interpolation"


@dataclass(frozen=True)
class Case:
    """Describes a scene to measure: arguments, the reference's rate [Hz], simulated time [ns] if quick and if not."""

    overrides: dict[str, object]
    reference_hz: float
    quick_ns: int
    full_ns: int
    light: dict[str, Any] = field(default_factory=dict)


SCENES = {
    "spinning_disk": Case({"omega": 50.0, "width": 346, "height": 260}, 16_000, 64_000_000, 256_000_000),
    "falling_objects": Case({"width": 346, "height": 260}, 8_000, 64_000_000, 256_000_000),
    "drone": Case({"width": 346, "height": 260}, 8_000, 64_000_000, 128_000_000),
    "warehouse": Case({"width": 173, "height": 130}, 8_000, 64_000_000, 128_000_000, {"light_samples": 4}),
}


def errors(stream: EventStream, truth: EventStream) -> dict[str, float]:
    """Computes all metrics of events against the reference."""
    median, most = time_error(stream, truth)
    return {
        "VP 1/ms": victor_purpura(stream, truth, 1.0),
        "VP 10/ms": victor_purpura(stream, truth, 10.0),
        "count": count_error(stream, truth),
        "1 ms frames": event_frame_error(stream, truth),
        "time 50 % [us]": median,
        "time 90 % [us]": most,
    }


def configurations() -> list[tuple[str, float, int, float]]:
    """Lists methods, keyframe rates [Hz], K, and `time_tolerance` [s]."""
    found: list[tuple[str, float, int, float]] = [("none", rate, 1, 0.0) for rate in (*ALONE_HZ, *DENSE_HZ)]
    found += [(method, rate, k, 0.0) for method in METHODS if method != "none" for rate, k in (*RATES, *MANY)]
    found += [("rigid", rate, k, 0.0) for rate, k in FEW]
    return found + [("rigid", *sampled) for sampled in SAMPLED]


def run_scene(name: str, quick: bool) -> tuple[list[Row], dict[str, Any]]:
    """Measures a scene: all its rows, and facts about the reference."""
    case = SCENES[name]
    duration_ns = case.quick_ns if quick else case.full_ns
    world = World(load_scene(name, case.overrides), duration_ns)
    truth, half, frames = reference(world, case.reference_hz, duration_ns, KEEP_NS, case.light)
    rows = []
    for method, rate, k, tolerance in configurations():
        warp = {"time_tolerance": tolerance} if tolerance else {}
        # Between further samples ln I is a line.
        crossings = ("linear",) if tolerance else CROSSINGS
        run = simulate(world, method, rate, k, duration_ns, crossings, frames, case.light, warp)
        rows += [Row(method, rate, k, tolerance, c, run, errors(run.streams[c], truth)) for c in crossings]
    dense = next(r.run for r in rows if r.method == "none" and r.rate == 1000)
    keyframes = duration_ns * 1000 // NS
    seen = visibility_seconds(world, 1000, duration_ns)
    facts: dict[str, Any] = {
        "seconds": duration_ns / NS,
        "events": len(truth.t),
        "reference_hz": case.reference_hz,
        "reference_vp": victor_purpura(half, truth, 1.0),
        "keyframe_ms": dense.render_s / keyframes * 1e3,
        "shading_us": max(dense.render_s / keyframes - seen, 0.0) / (dense.shaded / keyframes) * 1e6,
    }
    facts["auto"] = _auto(name, world, truth, duration_ns, rows)
    return rows, facts


def _auto(name: str, world: World, truth: EventStream, duration_ns: int, rows: list[Row]) -> list[dict[str, Any]]:
    """What auto makes of a scene, beside all rows with linear crossing times."""
    done = {
        (r.method, r.rate, r.k): Fixed(label_of(r.method, r.rate, r.k), r.seconds(duration_ns / NS), r.error["VP 1/ms"])
        for r in rows
        if r.crossing == "linear" and not r.time_tolerance and r.rate * r.k >= DENSE_HZ[0]
    }

    def known(*way: Any) -> Fixed | None:
        return done.get(way)

    return compare(name, world, truth, duration_ns, list(done.values()), SCENES[name].light, known)


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures all scenes: tables of error at equal shading and time, of paths, of auto, of failures, one per scene."""
    everything = {name: run_scene(name, quick) for name in SCENES}
    sections: dict[str, Any] = {}
    sections["equal shading"] = {
        "title": "Error at an equal number of shaded keyframes",
        "command": COMMAND,
        "rows": [line for name, (rows, _) in everything.items() for line in equal_shading(name, rows)],
        "note": "VP 1/ms. keyframes alone: dense rendering at the keyframe rate, linear crossing times. "
        "paper: splat at 1000 frames per second with their stamps as time stamps. Of the others the best K, for rigid "
        "also with further samples, and, but for `splat, stamps of frames`, the best crossing method. times less: "
        "paper over rigid, keyframes alone over rigid, and the best K of splat with stamps of frames over rigid. "
        "excess: VP above dense rendering "
        "of the same frames and crossing method at 1000 frames per second, rigid over splat. Keyframes alone can be "
        "better than paper: see `Runs that fail`.",
    }
    sections["half"] = {
        "title": "From which cost of shading on a method has at most half of splat's error at equal run time",
        "command": COMMAND,
        "rows": [half_error(name, rows, facts) for name, (rows, facts) in everything.items()],
        "note": "At each cost, the best rate, K and crossing of splat and of the method, of those that take no longer "
        "than splat at 125x8 with stamps of frames. auto picks from `rigid or dense`. Shading is the keyframe's run "
        "time beyond visibility, over its pixels. Costs beyond the scene's own follow from the pixels shaded: all of a "
        "keyframe, as paths have it, and those anew. Where camera and lights stand still, direct light on still "
        "surfaces is remembered: in the last column their pixels cost nothing more.",
    }
    sections["equal time"] = {
        "title": "Least error at equal run time, by what shading a pixel costs",
        "command": COMMAND,
        "rows": [line for name, (rows, facts) in everything.items() for line in equal_time(name, rows, facts)],
        "note": "VP 1/ms of the best rate, K and crossing of each method that is no slower than splat at 125x8 with "
        "the stamps of frames. The first line of a scene is its own cost; those beyond are as in the table above.",
    }
    sections["paths"] = {
        "title": "Run time where shading is dear: as it follows from pixels shaded, and measured",
        "command": COMMAND,
        "rows": interpolation_paths.rows(),
        "note": f"{interpolation_paths.SCENE} with light over one more surface by paths, traced for all pixels of all "
        "keyframes. `rigid` shades more anew there, for paths change light that direct light leaves as it is.",
    }
    sections["auto"] = {
        "title": "interpolator:=auto beside the best fixed choice at its run time",
        "command": COMMAND,
        "rows": [line for _, facts in everything.values() for line in facts["auto"]],
        "note": "Its own rule, then with the run time and with the error of a fixed choice wanted; each "
        "pick is run in full, linear crossing times. error ratio: its VP error over the least of all fixed rows that "
        "take no more time than it takes; wanted time: than was wanted. time ratio: its run time over the least of "
        "all fixed rows with no more error than it has or was wanted. Predictions are made before the run, from two "
        "windows of the motion; what decides was tried.",
    }
    failed = [line for name, (rows, _) in everything.items() for line in failures(name, rows)]
    cases = interpolation_cases.measured()
    sections["by method"] = {
        "title": "Where each method fails",
        "command": COMMAND,
        "rows": by_method(failed, cases),
        "note": "The runs and cases of the next two tables: runs at 1000 frames per second with more than twice the "
        "error of dense rendering at that rate, and hard cases with more than 2 % of the pixels off by more than a "
        "threshold, of which the share is given. Dense rendering has no error but that of its rate.",
    }
    sections["failures"] = {
        "title": "Runs that fail",
        "command": COMMAND,
        "rows": failed,
        "note": "Runs with more than twice the error of dense rendering of the same number of frames, and sub-frames "
        "more than one threshold off. Many more events than dense rendering has are the work of `splat`'s silhouettes: "
        "the nearest point wins with any weight, so that they grow by up to a pixel in all frames but the keyframes.",
    }
    sections["cases"] = {
        "title": "Hard cases, one gap each: error of the sub-frames, ln I over C",
        "command": COMMAND,
        "rows": interpolation_cases.rows(cases),
        "note": "Root mean square, and in brackets the pixels that are more than one threshold off; 96x72 px, K = 8. "
        "A shadow or a highlight that runs over a surface within a gap is what every reprojection can miss: `rigid` "
        "shades anew only where the two keyframes disagree.",
    }
    for name, (rows, facts) in everything.items():
        case = SCENES[name]
        sections[name] = {
            "title": f"{name}, {case.overrides['width']}x{case.overrides['height']}, threshold 0.2",
            "command": COMMAND,
            "rows": [shown(r, facts["seconds"]) for r in rows],
            "note": f"Reference: dense at {facts['reference_hz']:g} Hz, {facts['events']} events; half that rate is "
            f"{facts['reference_vp']:.4f} from it in VP 1/ms. A keyframe takes {facts['keyframe_ms']:.1f} ms, of that "
            f"shading {facts['shading_us']:.3f} us a pixel.",
        }
    return sections


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
