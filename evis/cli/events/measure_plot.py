"""Draws the picture of `evis events measure`: speed and event rate over time."""

from __future__ import annotations

from typing import Any

from evis.files.whole_file import missing_folder


def check(path: str) -> None:
    """Raises ValueError before the work where it could not be drawn after it."""
    if not path.lower().endswith(".png"):
        raise ValueError(f"{path}: --png writes a .png file")
    if missing := missing_folder(path):
        raise ValueError(missing)
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        raise ValueError("--png needs matplotlib: pip install 'evis[bench]'") from None


def draw(result: dict[str, Any], path: str) -> None:
    """Writes the picture; times count from the first event."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    rotation, rate = result["rotation"], result["rate"]
    start = result["t_first_ns"] or 0
    figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(8, 5), layout="constrained")
    if rotation and rotation["series"]:
        above.plot([(t - start) * 1e-9 for t, _ in rotation["series"]], [w for _, w in rotation["series"]], ".", ms=3)
        if rotation["steady"]:
            above.axhline(rotation["omega_rad_s"], color="0.5", lw=1)
        above.set_title(f"{rotation['omega_rad_s']:.4g} rad/s, confidence {rotation['confidence']:.2f}", fontsize=10)
    else:
        above.text(0.5, 0.5, "no rotation found", ha="center", transform=above.transAxes)
    above.set_ylabel("speed [rad/s]")
    if rate:
        below.step([(t - start) * 1e-9 for t, _ in rate["series"]], [v for _, v in rate["series"]], where="post", lw=1)
    below.set_ylabel("events / s")
    below.set_xlabel("time since the first event [s]")
    figure.savefig(path, dpi=120)
    plt.close(figure)
