"""Labels that look at meshes, in each environment at those of its own world."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from evis.scene.digest import appearance
from evis.scene.model import Scene
from evis.scene.worlds import Worlds
from nodes.labeler.event_labels import EventLabeler, EventLabels
from nodes.labeler.interval_flow import IntervalFlow
from nodes.labeler.oriented_boxes import Boxes3D, OrientedBoxes
from nodes.labeler.sight import Histories, History, Sight


@dataclass
class Looks:
    """Holds what labels the environments of one world; None for labels that nobody asked for."""

    boxes: OrientedBoxes | None = None
    sight: Sight | None = None
    events: EventLabeler | None = None
    between: IntervalFlow | None = None


class Geometry:
    """Labels E environments, those that look the same together."""

    def __init__(self, worlds: Worlds, make: Callable[[Scene], Looks]) -> None:
        """make: what labels environments that look like a scene."""
        self._make = make
        self.worlds = worlds
        self._made: dict[bytes, Looks] = {}
        self._group()

    def follow(self, worlds: Worlds) -> None:
        """Looks at these worlds from now on."""
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
        for looks, envs in self._groups:
            assert looks.boxes is not None
            part = looks.boxes(pose[envs])
            part.env = envs[part.env].astype(np.int32)
            parts.append(part)
        joined = {f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Boxes3D)}
        order = np.argsort(joined["env"], kind="stable")
        return Boxes3D(**{name: values[order] for name, values in joined.items()})

    def flow(self, history: History, start: int, end: int) -> tuple[np.ndarray, np.ndarray]:
        """Gives the flow of all environments from `start` to `end` [ns] and whether it is valid, as IntervalFlow."""
        found: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        for looks, envs in self._groups:
            assert looks.between is not None and looks.sight is not None
            flow, valid = looks.between(looks.sight.motion(history), envs, start, end)
            found |= {env: (flow[k], valid[k]) for k, env in enumerate(envs.tolist())}
        rows = [found[env] for env in sorted(found)]
        return np.stack([flow for flow, _ in rows]), np.stack([valid for _, valid in rows])

    def events(
        self, histories: Histories, t: np.ndarray, x: np.ndarray, y: np.ndarray, env_offsets: np.ndarray
    ) -> EventLabels:
        """Labels the events of all environments, each in its own time, with arguments as of EventLabeler."""
        counts = np.diff(env_offsets)
        numbers = np.arange(len(counts))
        env = np.repeat(numbers.astype(np.int32), counts)
        made = EventLabels(env, np.zeros(len(t), np.int32), np.zeros((len(t), 2), np.float32))
        for origin, together, history in histories:
            for looks, envs in self._groups:
                assert looks.events is not None
                chosen = np.isin(numbers, np.intersect1d(together, envs))
                mine = np.repeat(chosen, counts)
                own = np.cumsum([0, *np.where(chosen, counts, 0)])
                part = looks.events(history, t[mine] - origin, x[mine], y[mine], own)
                made.instance[mine], made.flow[mine] = part.instance, part.flow
        return made
