"""Reports the error that an audit has found so far, with its interval, and where and why it is largest."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from nodes.audit.estimate import Interval, ratio

WORST = 5
"""Pixels that are named."""


@dataclass
class Units:
    """Holds pixels of episodes, one each: env, x, y int64 [U]; chance float64 [U] of being drawn; vp float64 [U];
    unpaired and events int64 [U], of both runs; instance int64 [U], what the most change was seen of, -1 for none;
    own float64 [U], the share of the change that happened while one thing was seen; frames_vp and frames_events, as vp
    and events, of the frames alone."""

    env: np.ndarray
    x: np.ndarray
    y: np.ndarray
    chance: np.ndarray
    vp: np.ndarray
    unpaired: np.ndarray
    events: np.ndarray
    instance: np.ndarray
    own: np.ndarray
    frames_vp: np.ndarray
    frames_events: np.ndarray

    @staticmethod
    def joined(parts: list[Units]) -> Units:
        """Joins several groups of pixels into one."""
        names = Units.__dataclass_fields__
        return Units(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


@dataclass
class AuditReport:
    """Holds the result: pixels audited, the Victor-Purpura distance and the share of events without a partner, each
    with its 95 % interval, events of both runs at these pixels, and an estimate of those of all pixels, samples that
    were not finite, the pixels with the largest distances as (env, x, y, distance, events), what most of the error is
    about, and the distance of the frames alone."""

    pixels: int
    vp: Interval
    wrong: Interval
    events: int
    total: float = 0.0
    nonfinite: int = 0
    worst: list[tuple[int, int, int, float, int]] = field(default_factory=list)
    instance: int = -1
    own: float = 0.0
    frames: float = float("nan")

    @staticmethod
    def of(units: Units, pixels: int, nonfinite: int) -> AuditReport:
        """Works out the report from pixels of episodes."""
        events = units.events.astype(np.float64)
        order = np.lexsort((units.y, units.x, -units.vp))[:WORST]
        worst = [
            (int(units.env[k]), int(units.x[k]), int(units.y[k]), float(units.vp[k]), int(units.events[k]))
            for k in order.tolist()
            if units.vp[k] > 0
        ]
        report = AuditReport(
            pixels,
            ratio(units.vp, events, units.chance),
            ratio(units.unpaired.astype(np.float64), events, units.chance),
            int(units.events.sum()),
            float((events / units.chance).sum()),
            nonfinite,
            worst,
            frames=ratio(units.frames_vp, units.frames_events.astype(np.float64), units.chance).value,
        )
        weight = units.vp / units.chance
        seen = units.instance >= 0
        if weight[seen].sum() > 0:
            report.instance = int(np.bincount(units.instance[seen], weight[seen]).argmax())
            mine = seen & (units.instance == report.instance)
            report.own = float((weight * units.own)[mine].sum() / weight[mine].sum())
        return report
