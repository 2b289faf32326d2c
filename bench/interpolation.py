"""Error against run time: every interpolation method and keyframe rate against dense rendering, in one run.

`evis bench interpolation [--quick] --out DIR`. The reference is dense rendering at the scene's reference rate with
linear crossing times; half that rate against it is the reference's own error, printed with the results. Run times are
CPU time of one core, of renderer, interpolator and sensor. Where shading is dear, the run time follows from the number
of pixels shaded: a table gives it at shading costs beyond that of these scenes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bench import interpolation_cases
from bench.interpolation_auto import Fixed, compare, label_of
from bench.metrics import Stream, count_error, event_frame_error, time_error, victor_purpura
from bench.pipeline import Run, reference, simulate
from bench.world import World
from evis.clock import NS
from evis.scene import load_scene

RATES = ((1000, 1), (250, 4), (125, 8), (62.5, 16), (31.25, 32))
"""Keyframe rates [Hz] and K that give 1000 frames per second."""
FREE_K = ((31.25, 128), (62.5, 64))
"""The same shading as 31.25x32 and 62.5x16, four times the frames: what shading does not limit."""
METHODS = ("splat", "splat-forward", "rigid")
CROSSINGS = ("frame", "linear", "monotone")
PAPER = "frame"
"""Time stamps of the published method: those of the frames."""
SHADING_US = (1.0, 3.0, 10.0, 30.0)
"""Costs of shading a pixel [us] at which run times are compared."""
KEEP_NS = 1_000_000
STYLES = {"none": "o-", "splat": "s-", "splat-forward": "D--", "rigid": "^-"}


@dataclass(frozen=True)
class Case:
    """A scene to be measured: its arguments, the reference's rate [Hz], the simulated time [ns] when quick and not."""

    overrides: dict[str, object]
    reference_hz: float
    quick_ns: int
    full_ns: int
    light_samples: int = 16


SCENES = {
    "spinning_disk": Case({"omega": 50.0, "width": 346, "height": 260}, 16_000, 64_000_000, 256_000_000),
    "falling_objects": Case({"width": 346, "height": 260}, 8_000, 64_000_000, 256_000_000),
    "drone": Case({"width": 346, "height": 260}, 8_000, 64_000_000, 128_000_000),
    "warehouse": Case({"width": 173, "height": 130}, 8_000, 64_000_000, 128_000_000, 4),
}


@dataclass
class Row:
    """One method at one rate with one crossing method."""

    method: str
    rate: float
    k: int
    crossing: str
    run: Run
    error: dict[str, float] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """Keyframes per second x K."""
        return f"{self.rate:g}x{self.k}"

    def seconds(self, duration_s: float, extra_us: float = 0.0) -> float:
        """Run time per simulated second, every shaded pixel costing extra_us more than it did."""
        return (self.run.seconds(self.crossing) + self.run.shaded * extra_us * 1e-6) / duration_s


def errors(stream: Stream, truth: Stream) -> dict[str, float]:
    """All metrics of events against the reference."""
    median, most = time_error(stream, truth)
    return {
        "VP 1/ms": victor_purpura(stream, truth, 1.0),
        "VP 10/ms": victor_purpura(stream, truth, 10.0),
        "count": count_error(stream, truth),
        "1 ms frames": event_frame_error(stream, truth),
        "time 50 % [us]": median,
        "time 90 % [us]": most,
    }


def configurations(name: str) -> list[tuple[str, float, int]]:
    """Methods and rates of a scene."""
    dense = [("none", rate, 1) for rate in (250, 500, 1000, 2000)]
    warped = [(m, rate, k) for m in METHODS for rate, k in RATES[1:]]
    free = [("rigid", rate, k) for rate, k in FREE_K]
    return [*dense, *warped, *free]


def run_scene(name: str, quick: bool) -> tuple[list[Row], dict[str, Any]]:
    """All rows of a scene and what was measured about the reference."""
    case = SCENES[name]
    duration_ns = case.quick_ns if quick else case.full_ns
    world = World(load_scene(name, case.overrides), duration_ns)
    truth, half, frames = reference(world, case.reference_hz, duration_ns, KEEP_NS, case.light_samples)
    rows = []
    for method, rate, k in configurations(name):
        run = simulate(world, method, rate, k, duration_ns, CROSSINGS, frames, case.light_samples)
        rows += [Row(method, rate, k, c, run, errors(run.streams[c], truth)) for c in CROSSINGS]
    camera = world.scene.camera("cam0")
    dense = next(r.run for r in rows if r.method == "none" and r.rate == 1000)
    facts: dict[str, Any] = {
        "seconds": duration_ns / NS,
        "pixels": camera.width * camera.height,
        "events": len(truth.t),
        "reference_hz": case.reference_hz,
        "reference_vp": victor_purpura(half, truth, 1.0),
        "keyframe_us": dense.render_s / max(dense.shaded, 1) * 1e6,
    }
    facts["auto"] = _auto(name, world, truth, duration_ns, rows)
    return rows, facts


def _auto(name: str, world: World, truth: Stream, duration_ns: int, rows: list[Row]) -> list[dict[str, Any]]:
    """What auto makes of a scene, beside all rows with linear crossing times."""
    done = {
        (r.method, r.rate, r.k): Fixed(label_of(r.method, r.rate, r.k), r.seconds(duration_ns / NS), r.error["VP 1/ms"])
        for r in rows
        if r.crossing == "linear"
    }

    def known(*way: Any) -> Fixed | None:
        return done.get(way)

    return compare(name, world, truth, duration_ns, list(done.values()), SCENES[name].light_samples, known)


def measure(quick: bool = False) -> dict[str, Any]:
    """A table per scene, one of run times where shading is dear, one of claims, one of failures."""
    sections: dict[str, Any] = {}
    everything = {name: run_scene(name, quick) for name in SCENES}
    for name, (rows, facts) in everything.items():
        case = SCENES[name]
        sections[name] = {
            "title": f"{name}, {case.overrides['width']}x{case.overrides['height']}, threshold 0.2",
            "command": "evis bench interpolation",
            "rows": [_shown(r, facts["seconds"]) for r in rows],
            "note": f"Reference: dense at {facts['reference_hz']:g} Hz, {facts['events']} events; half that rate is "
            f"{facts['reference_vp']:.4f} from it in VP 1/ms. A keyframe costs {facts['keyframe_us']:.3f} us a pixel.",
        }
    sections["equal time"] = {
        "title": "Least error at equal run time, by what shading a pixel costs",
        "command": "evis bench interpolation",
        "rows": [line for name, (rows, facts) in everything.items() for line in _equal_time(name, rows, facts)],
        "note": "VP 1/ms of the best rate and crossing of each method that is no slower than splat at 125x8 with the "
        "stamps of frames. Costs beyond the scene's own follow from the pixels shaded.",
    }
    sections["auto"] = {
        "title": "interpolator:=auto beside the best fixed choice at its run time",
        "command": "evis bench interpolation",
        "rows": [line for _, facts in everything.values() for line in facts["auto"]],
        "note": "Its own rule, and with the run time of a fixed choice wanted; each pick is run in full. ratio: its VP "
        "error over the least of all fixed rows that take no more time than it takes, or than was wanted; linear "
        "crossing times. Predictions are made before the run, from two windows of the motion.",
    }
    sections["equal shading"] = {
        "title": "Error at an equal number of shaded keyframes",
        "command": "evis bench interpolation",
        "rows": [line for name, (rows, _) in everything.items() for line in _equal_shading(name, rows)],
        "note": "paper: splat with the stamps of frames. rigid: any K and crossing. excess: VP above dense rendering "
        "of the same frames and crossing method, rigid over splat.",
    }
    sections["failures"] = {
        "title": "Where each method fails",
        "command": "evis bench interpolation",
        "rows": [line for name, (rows, _) in everything.items() for line in _failures(name, rows)],
        "note": "Runs with more than twice the error of dense rendering of the same number of frames, and sub-frames "
        "more than one threshold off.",
    }
    sections["cases"] = {
        "title": "Hard cases, one gap each: error of the sub-frames, ln I over C",
        "command": "evis bench interpolation",
        "rows": interpolation_cases.rows(),
        "note": "Root mean square, and in brackets the pixels that are more than one threshold off; 96x72 px, K = 8. "
        "A shadow or a highlight that runs over a surface within a gap is what every reprojection can miss: `rigid` "
        "shades anew only where the two keyframes disagree.",
    }
    return sections


def _shown(row: Row, seconds: float) -> dict[str, Any]:
    shown: dict[str, Any] = {
        "method": "dense" if row.method == "none" else row.method,
        "keyframes x K": row.label,
        "crossing": row.crossing,
        "run time [s/s]": round(row.seconds(seconds), 3),
        "events": len(row.run.streams[row.crossing].t),
    }
    shown |= {name: round(value, 4 if value < 10 else 1) for name, value in row.error.items()}
    samples = max(row.run.samples, 1)
    return shown | {
        "frames, ln I / C": round(row.run.frame_error, 3),
        "shaded anew [%]": round(100 * row.run.reshaded / samples, 2),
        "guessed [%]": round(100 * row.run.filled / samples, 2),
    }


def _equal_time(name: str, rows: list[Row], facts: dict[str, Any]) -> list[dict[str, Any]]:
    """For each cost of shading, the least error of every method within the time of the paper's configuration."""
    lines = []
    paper = next(r for r in rows if (r.method, r.rate, r.crossing) == ("splat", 125, PAPER))
    for cost in (facts["keyframe_us"], *(c for c in SHADING_US if c > facts["keyframe_us"])):
        extra = cost - facts["keyframe_us"]
        budget = paper.seconds(facts["seconds"], extra)
        line: dict[str, Any] = {"scene": name, "shading [us/px]": round(cost, 2), "run time [s/s]": round(budget, 2)}
        for method in ("none", *METHODS):
            fits = [r for r in rows if r.method == method and r.seconds(facts["seconds"], extra) <= 1.02 * budget]
            best = min(fits, key=lambda r: r.error["VP 1/ms"], default=None)
            shown = "dense" if method == "none" else method
            line[shown] = f"{best.error['VP 1/ms']:.4f} ({best.label})" if best else "none as fast"
        lines.append(line)
    return lines


def _equal_shading(name: str, rows: list[Row]) -> list[dict[str, Any]]:
    """At each keyframe rate: the paper's method, the best of rigid, and the excess over dense rendering at equal K."""
    lines = []
    dense = {r.crossing: r.error["VP 1/ms"] for r in rows if r.method == "none" and r.rate == 1000}
    for rate, k in RATES[1:]:
        here = [r for r in rows if r.rate == rate]
        paper = next(r for r in here if r.method == "splat" and r.crossing == PAPER).error["VP 1/ms"]
        best = min((r for r in here if r.method == "rigid"), key=lambda r: r.error["VP 1/ms"])
        line: dict[str, Any] = {
            "scene": name,
            "keyframes [Hz]": f"{rate:g}",
            "paper": round(paper, 4),
            "rigid": f"{best.error['VP 1/ms']:.4f} ({best.label} {best.crossing})",
            "ratio": round(paper / max(best.error["VP 1/ms"], 1e-9), 1),
        }
        for crossing in ("linear", "monotone"):
            excess = {
                m: next(r for r in here if (r.method, r.k, r.crossing) == (m, k, crossing)).error["VP 1/ms"]
                - dense[crossing]
                for m in ("splat", "rigid")
            }
            line[f"excess, {crossing}"] = round(excess["rigid"] / excess["splat"], 3) if excess["splat"] > 0 else ""
        lines.append(line)
    return lines


def _failures(name: str, rows: list[Row]) -> list[dict[str, Any]]:
    dense = {r.crossing: r.error["VP 1/ms"] for r in rows if r.method == "none" and r.rate == 1000}
    lines = []
    for row in rows:
        if row.method == "none" or row.crossing != "linear":
            continue
        times = row.error["VP 1/ms"] / max(dense[row.crossing], 1e-9)
        if times > 2 or row.run.frame_error > 1:
            lines.append({
                "scene": name, "method": row.method, "keyframes x K": row.label,
                "error over dense 1000x1": round(times, 1), "frames, ln I / C": round(row.run.frame_error, 2),
            })  # fmt: skip
    return lines


def plot(sections: dict[str, Any], out: Path) -> list[Path]:
    """Error against run time, both logarithmic, one panel per scene; the best crossing method of each point."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(2, 2, figsize=(11, 8), dpi=130)
    for axes, name in zip(panels.flat, SCENES, strict=True):
        section = sections[name]
        for method, style in STYLES.items():
            shown = "dense" if method == "none" else method
            best: dict[str, dict[str, Any]] = {}
            for r in (r for r in section["rows"] if r["method"] == shown):
                key = r["keyframes x K"]
                if key not in best or r["VP 1/ms"] < best[key]["VP 1/ms"]:
                    best[key] = r
            rows = sorted(best.values(), key=lambda r: r["run time [s/s]"])
            axes.plot([r["run time [s/s]"] for r in rows], [r["VP 1/ms"] for r in rows], style, label=shown, ms=5)
            for r in rows:
                at = (r["run time [s/s]"], r["VP 1/ms"])
                axes.annotate(r["keyframes x K"], at, fontsize=6, xytext=(4, 4), textcoords="offset points")
        paper = [r for r in section["rows"] if r["method"] == "splat" and r["crossing"] == PAPER]
        axes.plot(
            [r["run time [s/s]"] for r in paper],
            [r["VP 1/ms"] for r in paper],
            "x:",
            color="grey",
            label="splat, stamps of frames",
        )
        axes.set(
            xscale="log",
            yscale="log",
            title=section["title"],
            xlabel="run time [s per simulated s], one core",
            ylabel="spike-train error (Victor-Purpura, 1/ms)",
        )
        axes.grid(True, which="both", alpha=0.25)
    panels.flat[0].legend(fontsize=8)
    figure.tight_layout()
    path = out / "interpolation.png"
    figure.savefig(path)
    plt.close(figure)
    return [path]
