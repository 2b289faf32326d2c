"""Computes labels from meshes, in each environment from those of its own world."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from evis.scene.digest import appearance
from evis.scene.model import Scene
from evis.scene.parameters import camera_of
from evis.scene.worlds import Worlds
from msgs.camera import INTERVAL_FLOWS
from msgs.world import WorldState
from nodes.labeler.event_labels import EventLabeler, EventLabels
from nodes.labeler.interval_flow import IntervalFlow
from nodes.labeler.kinds import RAY_CAST
from nodes.labeler.oriented_boxes import Boxes3D, OrientedBoxes
from nodes.labeler.rays.motion_history import MotionHistories
from nodes.labeler.rays.ray_caster import RayCaster


def instant_in(times: np.ndarray, share: float) -> int:
    """Computes the instant [ns] at a share of the way from the first of some times int64 [S] to the last."""
    first, last = int(times[0]), int(times[-1])
    return first + round(share * (last - first))


@dataclass
class WorldLabelers:
    """Holds what labels the environments of one world; None for labels that nobody asked for."""

    boxes: OrientedBoxes | None = None
    caster: RayCaster | None = None
    events: EventLabeler | None = None
    interval_flow: IntervalFlow | None = None


def make_world_labelers(scene: Scene, params: Mapping[str, Any], kinds: Collection[str]) -> WorldLabelers:
    """Makes what labels environments that look like a scene.

    params: of LabelerNode. kinds: labels that are asked for, of which those of meshes count.
    """
    camera, labelers = camera_of(scene, params["camera"]), WorldLabelers()
    if "boxes3d" in kinds:
        labelers.boxes = OrientedBoxes(scene, params["camera"])
    if RAY_CAST.isdisjoint(kinds):
        return labelers
    caster = labelers.caster = RayCaster(scene, camera, params["device"])
    if "events" in kinds:
        caster.prepare(len(scene.bodies))
        step = 1e9 / (params["keyframe_rate"] * params["upsampling"])
        labelers.events = EventLabeler(caster, step, 1e9 * params["time_tolerance"])
    if not set(INTERVAL_FLOWS).isdisjoint(kinds):
        labelers.interval_flow = IntervalFlow(scene, camera, caster)
        labelers.interval_flow.prepare(caster.still_motion(len(scene.bodies)))
    return labelers


class MeshLabels:
    """Labels E environments, those that look the same together."""

    def __init__(self, worlds: Worlds, make: Callable[[Scene], WorldLabelers]) -> None:
        """Takes the worlds of the environments, and what makes the labelers of those that look like a scene."""
        self._make = make
        self.worlds = worlds
        self._made: dict[bytes, WorldLabelers] = {}
        self._group()

    def follow(self, worlds: Worlds) -> None:
        """Replaces the worlds that labels are computed from."""
        changed = len(worlds.changed(self.worlds, appearance)) > 0
        self.worlds = worlds
        if changed:
            self._group()

    def _group(self) -> None:
        groups = self.worlds.groups(appearance)
        keys = [appearance(scene) if len(groups) > 1 or self._made else b"" for scene, _ in groups]
        self._made = {key: self._made.get(key) or self._make(scene) for key, (scene, _) in zip(keys, groups)}
        self._groups = [(self._made[key], envs) for key, (_, envs) in zip(keys, groups)]

    def boxes(self, pose: np.ndarray) -> Boxes3D:
        """Gives the boxes of all environments, by environment, for poses float64 [E, N, 7] of the bodies."""
        parts = []
        for labelers, envs in self._groups:
            assert labelers.boxes is not None
            part = labelers.boxes(pose[envs])
            part.env = envs[part.env].astype(np.int32)
            parts.append(part)
        joined = {f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Boxes3D)}
        order = np.argsort(joined["env"], kind="stable")
        return Boxes3D(**{name: values[order] for name, values in joined.items()})

    def flow(
        self, histories: MotionHistories, state: WorldState, start: float, end: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Gives the flow of all environments and whether it is valid, as IntervalFlow.

        state: the one that `histories` took last. start, end: shares of its interval, of each environment in its own
        time.
        """
        found: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        for _, together, history in histories:
            times = state.t if state.own_t is None else state.own_t[together[0]]
            t = [instant_in(times, share) for share in (start, end)]
            for labelers, envs in self._groups:
                assert labelers.interval_flow is not None and labelers.caster is not None
                if len(mine := np.intersect1d(together, envs)):
                    flow, valid = labelers.interval_flow(labelers.caster.motion(history), mine, *t)
                    found |= {env: (flow[k], valid[k]) for k, env in enumerate(mine.tolist())}
        rows = [found[env] for env in sorted(found)]
        return np.stack([flow for flow, _ in rows]), np.stack([valid for _, valid in rows])

    def events(
        self, histories: MotionHistories, t: np.ndarray, x: np.ndarray, y: np.ndarray, env_offsets: np.ndarray
    ) -> EventLabels:
        """Labels the events of all environments, each in its own time, with arguments as of EventLabeler."""
        counts = np.diff(env_offsets)
        numbers = np.arange(len(counts))
        env = np.repeat(numbers.astype(np.int32), counts)
        made = EventLabels(env, np.zeros(len(t), np.int32), np.zeros((len(t), 2), np.float32))
        for origin, together, history in histories:
            for labelers, envs in self._groups:
                assert labelers.events is not None
                chosen = np.isin(numbers, np.intersect1d(together, envs))
                mine = np.repeat(chosen, counts)
                own = np.cumsum([0, *np.where(chosen, counts, 0)])
                part = labelers.events(history, t[mine] - origin, x[mine], y[mine], own)
                made.instance[mine], made.flow[mine] = part.instance, part.flow
        return made
