"""Error against run time: every method and keyframe rate against a dense reference, in one run on one machine.

`python -m bench.error [--quick]`. The reference is dense rendering at REFERENCE_HZ with linear crossing times; its own
error is estimated against half that rate and printed with the results.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from bench.metrics import Stream, count_error, event_frame_error, time_error, victor_purpura
from bench.pipeline import Run, simulate

REFERENCE_HZ = 16_000
SCENES: dict[str, dict[str, object]] = {"spinning_disk": {"omega": 50.0, "width": 346, "height": 260}}
CONFIGURATIONS = (
    ("none", 1000, 1), ("none", 500, 1), ("none", 250, 1), ("none", 2000, 1), ("none", 4000, 1),
    ("splat", 500, 2), ("splat", 250, 4), ("splat", 125, 8), ("splat", 62.5, 16), ("splat", 31.25, 32),
)


def compare(run: Run, reference: Stream, duration: float) -> dict[str, Any]:
    """All metrics of one run, and its run time per simulated second."""
    median, most = time_error(run.stream, reference)
    return {
        "run time [s/s]": round(float(run.wall_s) / duration, 3),
        "events": len(run.stream.t),
        "VP 1/ms": round(victor_purpura(run.stream, reference, 1.0), 4),
        "VP 10/ms": round(victor_purpura(run.stream, reference, 10.0), 4),
        "count": round(count_error(run.stream, reference), 4),
        "1 ms frames": round(event_frame_error(run.stream, reference), 3),
        "time 50 % [us]": round(median, 1),
        "time 90 % [us]": round(most, 1),
    }


def measure(quick: bool = False) -> dict[str, Any]:
    """One section per scene."""
    duration = 0.064 if quick else 0.256
    sections = {}
    for scene, overrides in SCENES.items():
        def at(method: str, rate: float, k: int, scene: str = scene, overrides: dict = overrides) -> Run:
            return simulate(scene, overrides, method, rate, k, duration)

        reference = at("none", REFERENCE_HZ, 1)
        half = at("none", REFERENCE_HZ / 2, 1)
        rows = [
            {"method": "dense" if method == "none" else method, "keyframes x K": f"{rate:g}x{k}"}
            | compare(at(method, rate, k), reference.stream, duration)
            for method, rate, k in CONFIGURATIONS
        ]
        itself = victor_purpura(half.stream, reference.stream, 1.0)
        sections[scene] = {
            "title": f"{scene}, {overrides['width']}x{overrides['height']}, {overrides['omega']} rad/s, threshold 0.2",
            "command": "evis bench error",
            "rows": rows,
            "note": f"Reference: dense at {REFERENCE_HZ} Hz, {len(reference.stream.t)} events; half that rate is "
            f"{itself:.4f} from it in VP 1/ms. One core.",
        }
    return sections


def plot(sections: dict[str, Any], out: Path) -> list[Path]:
    """Error against run time, both logarithmic, one PNG per scene."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    paths = []
    for scene, section in sections.items():
        figure, axes = plt.subplots(figsize=(6.4, 4.2), dpi=140)
        for method, style in (("dense", "o-"), ("splat", "s-")):
            rows = sorted((r for r in section["rows"] if r["method"] == method), key=lambda r: r["run time [s/s]"])
            axes.plot([r["run time [s/s]"] for r in rows], [r["VP 1/ms"] for r in rows], style, label=method)
            for r in rows:
                axes.annotate(r["keyframes x K"], (r["run time [s/s]"], r["VP 1/ms"]), fontsize=7,
                              xytext=(4, 4), textcoords="offset points")
        axes.set(xscale="log", yscale="log", xlabel="run time [s per simulated s], one core",
                 ylabel="spike-train error (Victor-Purpura, 1/ms)", title=section["title"])
        axes.grid(True, which="both", alpha=0.25)
        axes.legend()
        figure.tight_layout()
        paths.append(out / f"error_{scene}.png")
        figure.savefig(paths[-1])
        plt.close(figure)
    return paths


if __name__ == "__main__":
    print(json.dumps(measure("--quick" in sys.argv), indent=1))
