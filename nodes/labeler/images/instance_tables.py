"""Looks up what a camera's info tells of the instances that it sees: their boxes' ids, classes and motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from msgs.camera import CameraInfo
from msgs.world import WorldState
from nodes.labeler.images.box_groups import groups

if TYPE_CHECKING:
    from nodes.labeler.images.flow_field import FlowField


class InstanceTables:
    """Keeps the last CameraInfo, and what is made of it once for all images until another one comes."""

    def __init__(self, owner: str, camera: str) -> None:
        """Begins without an info. owner: the labeler that errors name. camera: its name."""
        self._owner, self._camera = owner, camera
        self._info: CameraInfo | None = None
        self._box_ids: np.ndarray | None = None
        self._flow_fields: list[FlowField] = []
        """One for all environments, or one for each where their cameras differ; none before the first flow."""

    def take(self, info: CameraInfo) -> None:
        """Takes an info, and copies its arrays: the message is latched, its memory is not."""
        before, self._info = self._info, info
        info.k, info.distortion = np.array(info.k), np.array(info.distortion)
        for name in ("semantic", "env_k", "env_distortion"):
            array = getattr(info, name)
            setattr(info, name, None if array is None else np.array(array))
        if before is None or not _same_view(before, info):
            self._flow_fields = []
        self._box_ids = None

    def box_ids(self, of: str, classes: Sequence[str] | None) -> np.ndarray:
        """Gives the id of each instance's box, int32 [N], with arguments and errors as of `groups`."""
        if self._box_ids is None:
            if self._info is None:
                raise ValueError(f"{self._owner} has no CameraInfo of {self._camera}, which box_classes needs")
            self._box_ids = groups(self._info, of, classes)
        return self._box_ids

    def semantic_ids(self) -> np.ndarray:
        """Gives the semantic id of each instance, int32 [N]. Raises ValueError for an info without any."""
        if self._info is None or self._info.semantic is None:
            raise ValueError(f"{self._owner}: /{self._camera}/info has no semantic ids; leave semantic out")
        return self._info.semantic

    def flow_fields(self, state: WorldState, device: str) -> list[FlowField]:
        """Gives what computes flow on a device, for all environments or, where their cameras differ, for each.

        Raises ValueError without an info, and for one that names a body which the state has not.
        """
        if self._flow_fields:
            return self._flow_fields
        from nodes.labeler.images.flow_field import FlowField
        from nodes.labeler.projection import Projection

        info = self._info
        if info is None:
            raise ValueError(f"{self._owner} has no CameraInfo of {self._camera}, which flow needs")
        index = {"": -1} | {name: n for n, name in enumerate(state.names)}
        missing = [body for body in (*info.instance_bodies, self._camera) if body not in index]
        if missing:
            raise ValueError(f"{self._owner}: /state has no body '{missing[0]}', which CameraInfo names")
        bodies = [index[body] for body in info.instance_bodies]
        lenses = [(info.k, info.distortion)]
        if info.env_k is not None and info.env_distortion is not None:
            lenses = list(zip(info.env_k, info.env_distortion))
        for k, distortion in lenses:
            projection = Projection.of(k, info.distortion_model, distortion)
            size = info.width, info.height
            self._flow_fields.append(FlowField(projection, size, bodies, index[self._camera], device))
        return self._flow_fields

    def settle(self) -> None:
        """Raises ValueError for ids of the last images that no body has."""
        for field in self._flow_fields:
            field.settle()


def _same_view(a: CameraInfo, b: CameraInfo) -> bool:
    """Tells whether flow is computed for both in the same way."""
    names = ("distortion_model", "width", "height", "instance_bodies")
    lenses = ("k", "distortion", "env_k", "env_distortion")
    return all(getattr(a, name) == getattr(b, name) for name in names) and all(
        np.array_equal(getattr(a, name), getattr(b, name)) for name in lenses
    )
