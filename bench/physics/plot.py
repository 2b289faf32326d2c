"""Draws work-precision diagrams: error against run time, a panel per case.

Each integrator has a line over its time steps, and one line goes over tolerances.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bench.physics.tables import GROUPS
from bench.physics.trial import NAMES, RIGHT

STYLES = dict(zip(NAMES, (("o", "tab:blue"), ("s", "tab:orange"), ("v", "tab:green"), ("^", "tab:red"),
                                ("D", "tab:purple"), ("*", "black")), strict=True))  # fmt: skip
"""Marker and colour by method."""
LEAST = 1e-12
"""Errors below are drawn here: rounding. None at all, of what only has to stay before a wall, at 1 % of the limit."""
COLUMNS = 4
Row = Mapping[str, Any]


def plot(sections: Mapping[str, Any], out: Path) -> list[Path]:
    """Writes physics_GROUP.png of every group that has trials, and returns the files."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.lines import Line2D

    written = []
    for group, title in GROUPS.items():
        rows = [row for row in sections["trials"]["rows"] if row["group"] == group]
        if not rows:
            continue
        cases = list(dict.fromkeys(row["case"] for row in rows))
        height = -(-len(cases) // COLUMNS)
        figure, panels = plt.subplots(height, COLUMNS, figsize=(14, 2.9 * height + 0.8), dpi=90, squeeze=False)
        for axes, case in zip(panels.flat, cases):
            _panel(axes, [row for row in rows if row["case"] == case])
        for axes in panels.flat[len(cases) :]:
            axes.axis("off")
        for axes in panels.flat[max(0, len(cases) - COLUMNS) : len(cases)]:
            axes.set_xlabel("CPU seconds per simulated second", fontsize=8)
        handles = [Line2D([], [], marker=m, color=c, label=name) for name, (m, c) in STYLES.items()]
        handles += [
            Line2D([], [], marker="o", color="grey", ls="", label="within the limit (green)"),
            Line2D([], [], marker="o", color="grey", ls="", fillstyle="none", label="off"),
            Line2D([], [], marker="x", color="grey", ls="", label="diverged, at the upper edge"),
        ]
        figure.legend(handles=handles, loc="lower center", ncols=len(handles), fontsize=8, frameon=False)
        figure.suptitle(
            f"{title}: error against run time; from left to right shorter steps, or smaller tolerances", fontsize=11
        )
        inches = figure.get_figheight()
        figure.subplots_adjust(0.05, 0.9 / inches, 0.99, 1 - 0.8 / inches, wspace=0.24, hspace=0.42)
        written.append(out / f"physics_{group}.png")
        figure.savefig(written[-1])
        plt.close(figure)
    return written


def _panel(axes: Any, rows: Sequence[Row]) -> None:
    """One case."""
    from matplotlib.ticker import LogLocator, NullFormatter

    limit = rows[0]["limit"]
    errors = [_drawn(row) for row in rows if row["error"] is not None]
    low, high = min([*errors, limit]) / 3, max([*errors, limit]) * 3
    for integrator, (marker, colour) in STYLES.items():
        own = [row for row in rows if row["integrator"] == integrator]
        line = [(row["CPU [s/s]"], _drawn(row), row) for row in own if row["error"] is not None]
        axes.plot([p[0] for p in line], [p[1] for p in line], "-", color=colour, lw=1)
        for x, y, row in line:
            fill = "full" if row["verdict"].startswith(RIGHT) else "none"
            axes.plot(x, y, marker, color=colour, ms=5, fillstyle=fill)
        failed = [row["CPU [s/s]"] for row in own if row["error"] is None]
        axes.plot(failed, [high] * len(failed), "x", color=colour, ms=6)
    axes.axhspan(low, limit, color="tab:green", alpha=0.08, lw=0)
    times = [row["CPU [s/s]"] for row in rows]
    axes.set(
        xscale="log", yscale="log", ylim=(low, 3 * high), xlim=(min(times) / 2, max(20 * min(times), 2 * max(times)))
    )
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(numticks=7))
        axis.set_minor_formatter(NullFormatter())
    axes.set_title(textwrap.fill(rows[0]["case"], 48), fontsize=8)
    axes.set_ylabel(f"error [{rows[0]['unit']}]", fontsize=8)
    axes.tick_params(labelsize=7)
    axes.grid(True, which="major", alpha=0.3)


def _drawn(row: Row) -> float:
    """The error as it is drawn."""
    return max(row["error"], LEAST) if row["error"] else row["limit"] / 100
