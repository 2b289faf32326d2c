"""Compares the event sensor with closed forms and other simulators, and measures what each fault costs.

    evis bench event_sensor [--quick]
    EVIS_PEERS=DIR evis bench event_sensor

DIR holds a checkout of rpg_vid2e, whose core of ESIM then runs beside it (peers.py). CPU seconds are process time of
one core; frames are in memory, compilation is done before.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bench import command
from bench.event_sensor.accuracy import RATES, closed_forms, edges, sinusoids
from bench.event_sensor.peers import QUOTED
from bench.event_sensor.speed import omissions, speed


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures all tables; quick: fewer pixels, frames and repetitions."""
    sections: dict[str, Any] = {}
    for table in (sinusoids, closed_forms, speed, edges, omissions):
        sections |= table(quick)
    return sections


def plot(sections: dict[str, Any], out: Path) -> list[Path]:
    """Plots the sinusoids' median time error against run time, a line per method over the frame rates."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6.8, 4.6), dpi=140)
    lines: dict[tuple[str, str], list[tuple[float, float, int]]] = {}
    for rate in RATES:
        for row in sections[f"sinusoid_{rate}"]["rows"]:
            if row.get("CPU [s]"):
                key = (row["method"], row["source"])
                lines.setdefault(key, []).append((row["CPU [s]"], row["median [us]"], rate))
    for (name, source), points in lines.items():
        ours = source != QUOTED
        label = name if ours else f"{name} (quoted)"
        axes.plot(*zip(*[p[:2] for p in points]), "o-" if ours else "x:", label=label, alpha=1.0 if ours else 0.5)
    axes.set(xscale="log", yscale="log", xlabel="CPU seconds for 0.5 s, 125, 250 and 1000 Hz frames",
             ylabel="median time error [us]", title="Sinusoids against closed form")  # fmt: skip
    axes.grid(True, which="both", alpha=0.25)
    axes.legend(fontsize=6, ncol=2)
    figure.tight_layout()
    path = out / "event_sensor_sinusoids.png"
    figure.savefig(path)
    plt.close(figure)
    return [path]


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
