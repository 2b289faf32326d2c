"""Collects how the recorded run went, its error and its run time, for the bag's metadata."""

from __future__ import annotations

import time

from msgs.audit import Audit
from msgs.header import Message
from msgs.physics_error import PhysicsError
from msgs.world import WorldState


class Outcome:
    """Collects the errors of a run from its messages, and its duration from its first state on."""

    def __init__(self) -> None:
        self._audits: dict[str, Audit] = {}
        self._physics: PhysicsError | None = None
        self._first: tuple[int, float] | None = None
        self._last = (0, 0.0)

    def take(self, topic: str, message: Message) -> None:
        """Notes what a message tells of the run's outcome."""
        if isinstance(message, Audit):
            self._audits[topic] = message
        if isinstance(message, PhysicsError):
            self._physics = message
        if isinstance(message, WorldState | Audit):
            self._last = (max(self._last[0], message.header.stamp_ns), time.monotonic())
            self._first = self._first or (message.header.stamp_ns, self._last[1])

    def metadata(self) -> dict[str, dict[str, str]]:
        """Returns the tables of the run: `physics_error`, where an engine integrated motion; `audit`, by
        `CAMERA.number`, and `run_time`, simulated and wall time [s], where something was audited."""
        told: dict[str, dict[str, str]] = {}
        if (off := self._physics) is not None:
            numbers = {"position_m": f"{off.position_m:.6g}", "rotation_rad": f"{off.rotation_rad:.6g}"}
            told["physics_error"] = {"body": off.body} | numbers
        if not self._audits or self._first is None:
            return told
        found: dict[str, str] = {}
        for topic, audit in sorted(self._audits.items()):
            camera = topic.split("/")[-2]
            for name in ("pixels", "vp", "vp_low", "vp_high", "events_wrong", "vp_frames", "events", "cause"):
                found[f"{camera}.{name}"] = str(getattr(audit, name))
            worst = zip(audit.worst_pixel.tolist(), audit.worst_distance.tolist())
            found[f"{camera}.worst"] = "; ".join(f"env {e} x {x} y {y}: {d:.3g}" for (e, x, y), d in worst)
        wall = self._last[1] - self._first[1]
        simulated = (self._last[0] - self._first[0]) / 1e9
        return told | {"audit": found, "run_time": {"sim_s": f"{simulated:.9g}", "wall_s": f"{wall:.6g}"}}
