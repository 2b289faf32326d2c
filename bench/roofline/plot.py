"""Plots the roofline: operations per second of kernels against operations per byte, and the ceilings of the device."""

from __future__ import annotations

from pathlib import Path
from typing import Any

COLOURS = ("tab:red", "tab:blue", "tab:green", "tab:orange")
LABELS = 8
"""Kernels of each run that are named, those that take longest."""


def plot_roofline(sections: dict[str, Any], out: Path) -> Path:
    """Writes roofline.png: both axes logarithmic, the area of a point the time of its kernel in a gap."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    memory, cache, top = (row["rate"] for row in sections["ceilings"]["rows"])
    rows = [row for row in sections["roofline"]["rows"] if row.get("op/byte") and row["Gop/s"]]
    figure, axes = plt.subplots(figsize=(10, 6.5), dpi=120)
    reach = [row["op/byte"] for row in rows] or [1.0]
    x0, x1 = min(0.02, *reach, *reach) / 2, max(2 * top / memory, *reach, *reach) * 2
    for rate, line, name in ((cache, "-", "caches"), (memory, "--", "memory")):
        bend = top / rate
        axes.plot([x0, bend, x1], [rate * x0, top, top], "k" + line, lw=1.2, label=f"{name}, {rate:,.0f} GB/s")
    axes.text(top / cache, top * 1.1, f"float32, {top:,.0f} Gop/s", fontsize=9)
    longest = max((row["us a gap"] for row in rows), default=1.0)
    for colour, run in zip(COLOURS, dict.fromkeys(row["run"] for row in rows)):
        of_run = [row for row in rows if row["run"] == run]
        sizes = [20 + 400 * row["us a gap"] / longest for row in of_run]
        x, y = [row["op/byte"] for row in of_run], [row["Gop/s"] for row in of_run]
        axes.scatter(x, y, s=sizes, color=colour, alpha=0.55, label=run, edgecolors="none")
        for row in of_run[:LABELS]:
            axes.annotate(
                row["kernel"], (row["op/byte"], row["Gop/s"]), fontsize=7, color=colour, xytext=(5, 4),
                textcoords="offset points",
            )  # fmt: skip
    axes.set(xscale="log", yscale="log", xlim=(x0, x1), xlabel="operations a byte", ylabel="Gop/s")
    axes.set_title(sections["roofline"]["title"] + "; area: time in a gap", fontsize=11)
    axes.grid(True, which="major", alpha=0.3)
    handles, names = axes.get_legend_handles_labels()
    legend = axes.legend(handles, names, loc="lower right", fontsize=9, frameon=False)
    for handle in legend.legend_handles[2:]:
        if handle is not None and hasattr(handle, "set_sizes"):
            handle.set_sizes([40])
    figure.tight_layout()
    path = out / "roofline.png"
    figure.savefig(path)
    plt.close(figure)
    return path
