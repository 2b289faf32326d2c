"""Plots the results of `bench.interpolation.methods`: error against run time, one panel per scene."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

STYLES = {
    "dense": ("o", "tab:blue"),
    "splat": ("s", "tab:orange"),
    "rigid": ("^", "tab:red"),
    "rigid, further samples": ("*", "tab:green"),
}
"""Marker and colour by method."""
SAMPLED_RATE = "31.25x"
"""Keyframe rate at which `rigid` with further samples is shown, by its tolerance of time."""
LEAST_FRAMES = 249
"""Frames per second from which on points are shown."""
LINES = {1000: ("-", "full"), 4000: ("--", "none")}
"""Line and filling by frames per second."""


def plot(sections: dict[str, Any], out: Path) -> list[Path]:
    """Writes interpolation.png: both axes logarithmic, the best crossing method of each point."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.lines import Line2D

    scenes = [name for name, section in sections.items() if any("VP 10/ms" in row for row in section["rows"])]
    columns = min(2, len(scenes))
    rows = -(-len(scenes) // columns)
    figure, panels = plt.subplots(rows, columns, figsize=(6 * columns, 1.1 + 4.2 * rows), dpi=120, squeeze=False)
    for axes in panels.flat[len(scenes) :]:
        axes.remove()
    for axes, name in zip(panels.flat, scenes):
        _panel(axes, sections[name]["rows"])
        axes.set_title(sections[name]["title"], fontsize=11)
    for axes in panels[-1]:
        axes.set_xlabel("run time [s per simulated s], one core")
    for axes in panels[:, 0]:
        axes.set_ylabel("spike-train error (Victor-Purpura, 1/ms)")
    handles = [Line2D([], [], marker=m, color=c, label=name) for name, (m, c) in STYLES.items()]
    handles += [
        Line2D([], [], marker="x", ls=":", color="grey", label="splat, stamps of frames (the published method)")
    ]
    handles += [
        Line2D([], [], color="black", ls=ls, marker="o", fillstyle=fill, label=f"{frames} frames/s")  # type: ignore[arg-type]
        for frames, (ls, fill) in LINES.items()
    ]
    handles += [Line2D([], [], color="tab:red", ls="", marker="^", ms=4, label="rigid, 250 to 500 frames/s")]
    figure.legend(handles=handles, loc="lower center", ncols=4, fontsize=9, frameon=False)
    figure.suptitle(
        "Error against run time, axes of each panel its own; labels: keyframes per second at the ends of a line",
        fontsize=12,
    )
    figure.tight_layout(rect=(0, 0.06, 1, 1))
    path = out / "interpolation.png"
    figure.savefig(path)
    plt.close(figure)
    return [path]


def _panel(axes: Any, rows: Sequence[dict[str, Any]]) -> None:
    """One scene."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for method, (marker, colour) in STYLES.items():
        if "samples" in method:
            _tolerances(axes, [r for r in rows if r["method"] == method], marker, colour)
            continue
        points = _points([r for r in rows if r["method"] == method])
        if method == "dense":
            _line(axes, points, marker, colour, "-", "full", (6, 5))
            continue
        # Rigid's labels below its line, splat's above: they never cross.
        place = (0, -13) if method == "rigid" else (0, 7)
        for frames, (line, fill) in LINES.items():
            # More frames do not help splat.
            if frames == 1000 or method == "rigid":
                family = [p for p in points if abs(p[0] * p[1] - frames) < 1]
                _line(axes, family, marker, colour, line, fill, place)
        for rate, k, *at in (p for p in points if p[0] * p[1] < 900):
            axes.plot(*at, marker, color=colour, ms=4)
            if k == 8:
                place = (-5, -3) if rate < 60 else (5, -3)
                side = "right" if rate < 60 else "left"
                axes.annotate(
                    f"{rate:.0f} x {k}", at, fontsize=6, color=colour, xytext=place, textcoords="offset points", ha=side
                )
    published = [r for r in rows if r["method"] == "splat" and r["crossing"] == "frame"]
    family = [p for p in _points(published) if abs(p[0] * p[1] - 1000) < 1]
    axes.plot([p[2] for p in family], [p[3] for p in family], "x:", color="grey", ms=6, zorder=1)
    axes.set(xscale="log", yscale="log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
    axes.grid(True, which="major", alpha=0.3)
    axes.margins(0.08)


def _tolerances(axes: Any, rows: Sequence[dict[str, Any]], marker: str, colour: str) -> None:
    """Joins runs that differ in their tolerance of time, and writes it beside each."""
    chosen = [r for r in rows if r["keyframes x K"].startswith(SAMPLED_RATE)]
    points = sorted((r["run time [s/s]"], r["VP 1/ms"], r["keyframes x K"].partition(", ")[2]) for r in chosen)
    axes.plot([p[0] for p in points], [p[1] for p in points], marker + "-", color=colour, ms=10, lw=1.6, zorder=3)
    for x, y, label in points:
        axes.annotate(label, (x, y), fontsize=7, color=colour, xytext=(0, -14), textcoords="offset points", ha="center")


def _points(rows: Sequence[dict[str, Any]]) -> list[tuple[float, int, float, float]]:
    """Keyframe rate, K, run time and error by the best crossing method, the highest rate first; what has few frames per
    second is left out."""
    best: dict[str, dict[str, Any]] = {}
    for r in rows:
        key = r["keyframes x K"]
        if key not in best or r["VP 1/ms"] < best[key]["VP 1/ms"]:
            best[key] = r
    found = []
    for key, r in best.items():
        rate, k = key.split("x")
        if float(rate) * int(k) >= LEAST_FRAMES:
            found.append((float(rate), int(k), r["run time [s/s]"], r["VP 1/ms"]))
    return sorted(found, reverse=True)


def _line(
    axes: Any,
    points: Sequence[tuple[float, int, float, float]],
    marker: str,
    colour: str,
    line: str,
    fill: str,
    place: tuple[float, float],
) -> None:
    """Points joined in the order of their keyframe rates; the ends are labelled, at an offset [pt]."""
    x, y = [p[2] for p in points], [p[3] for p in points]
    axes.plot(x, y, marker + line, color=colour, fillstyle=fill, ms=6, lw=1.2)
    ends = [points[0], points[-1]] if len(points) > 1 else points
    for rate, _, *at in ends:
        axes.annotate(
            f"{rate:.0f}", at, fontsize=7, color=colour, xytext=place, textcoords="offset points", ha="center"
        )
