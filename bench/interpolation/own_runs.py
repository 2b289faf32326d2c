"""Reads error and run time of recorded runs from their bags, and plots one against the other."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

COLUMNS = ("bag", "scene", "interpolator", "keyframe_rate", "upsampling", "camera", "pixels", "error", "low", "high")


def read(bags: Sequence[str | Path]) -> list[dict[str, Any]]:
    """Reads the audit and run time from bags; returns a row for each audited camera.

    Each has the columns of COLUMNS and `run time` [s per simulated s]. Raises ValueError naming a bag that has no
    audit, and what the bag reader raises for one that cannot be read.
    """
    from evis.bag.info import describe

    rows: list[dict[str, Any]] = []
    for bag in bags:
        metadata = describe(Path(bag))["metadata"]
        audit, took = metadata.get("audit", {}), metadata.get("run_time", {})
        run = {key.removeprefix("arg."): value for key, value in metadata.get("evis", {}).items()}
        cameras = sorted({key.partition(".")[0] for key in audit})
        if not cameras or not float(took.get("sim_s", 0)):
            raise ValueError(f"{bag} has no audit: record a simulation without audit:=0 that takes some time")
        for camera in cameras:
            numbers = {name: round(float(audit[f"{camera}.{name}"]), 4) for name in ("vp", "vp_low", "vp_high")}
            rows.append({
                "bag": Path(bag).name,
                **{key: run.get(key, "") for key in ("scene", "interpolator", "keyframe_rate", "upsampling")},
                "camera": camera,
                "pixels": int(audit[f"{camera}.pixels"]),
                "error": numbers["vp"],
                "low": numbers["vp_low"],
                "high": numbers["vp_high"],
                "run time": round(float(took["wall_s"]) / float(took["sim_s"]), 4),
            })  # fmt: skip
    return rows


def plot(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Writes a picture of the rows: error with its 95 % interval over run time, each bag by its name."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(8, 6), dpi=120)
    for row in (r for r in rows if r["error"] == r["error"]):
        reach = [[row["error"] - row["low"]], [row["high"] - row["error"]]]
        axes.errorbar(row["run time"], row["error"], yerr=reach, fmt="o", capsize=3)
        several = sum(r["bag"] == row["bag"] for r in rows) > 1
        name = f"{row['bag']} {row['camera']}" if several else row["bag"]
        axes.annotate(name, (row["run time"], row["error"]), xytext=(6, 4), textcoords="offset points", fontsize=8)
    axes.set_xscale("log")
    axes.set_ylim(0, 1)
    axes.set_xlabel("run time [s per simulated s]")
    axes.set_ylabel("spike-train error (Victor-Purpura, 1/ms), 95 % interval")
    axes.set_title("Audits of recorded runs")
    figure.tight_layout()
    figure.savefig(path)
    plt.close(figure)
