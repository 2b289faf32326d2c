"""The labeler node: ground truth on /<camera>/labels at every stamp, only what was asked for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from evis.config.params import Param
from evis.config.suggestions import nearest
from evis.runtime.node import Input, Node, Output
from msgs.camera import CameraInfo, Depth, Ids, Labels
from msgs.header import Header, Message
from msgs.world import WorldState

NEEDS = {
    "flow": {"state", "depth", "ids", "info"},
    "depth": {"depth"},
    "segmentation": {"ids"},
    "semantic": {"ids", "info"},
    "boxes": {"ids"},
    "poses": {"state"},
    "velocities": {"state"},
    "contacts": {"state"},
}
"""Inputs that each kind of label is made of."""
DEFAULT = ("flow", "depth", "segmentation", "boxes")
"""Labels for a reader who did not say which."""


class LabelerNode(Node):
    """Publishes the labels of one camera. The scene is not loaded: CameraInfo tells which body each id belongs to."""

    PARAMS: ClassVar[Mapping[str, Param]] = {
        "camera": Param(str, "cam0", "camera that is labelled"),
        "labels": Param(
            list, None,
            f"ground truth to make, of {', '.join(NEEDS)}; not given = {', '.join(DEFAULT)}, once a viewer opens them",
            optional=True,
        ),
    }  # fmt: skip
    INPUTS: ClassVar[Mapping[str, Input]] = {
        "state": Input("/state"),
        "depth": Input("/{camera}/depth"),
        "ids": Input("/{camera}/ids"),
        "info": Input("/{camera}/info", join=False),
    }
    OUTPUTS: ClassVar[Mapping[str, Output]] = {"labels": Output("/{camera}/labels")}

    @classmethod
    def needs(cls, params: Mapping[str, Any], wanted: frozenset[str]) -> frozenset[str]:
        """Names the inputs of the labels asked for. Raises ValueError for one that does not exist."""
        asked = kinds(params.get("labels"))
        return frozenset().union(*(NEEDS[kind] for kind in asked)) if wanted else frozenset()

    def setup(self) -> None:
        """Checks the list of labels."""
        from nodes.labeler import labels

        self.pure = labels
        self.kinds = kinds(self.params["labels"])
        self.info: CameraInfo | None = None
        self.flow: list[labels.FlowField] = []

    def receive(self, port: str, message: Message) -> None:
        """Keeps the latched CameraInfo."""
        if isinstance(message, CameraInfo):
            self.info = message
            self.info.k, self.info.distortion = np.array(message.k), np.array(message.distortion)
            self.info.semantic = None if message.semantic is None else np.array(message.semantic)
            for name in ("env_k", "env_distortion"):
                array = getattr(message, name)
                setattr(self.info, name, None if array is None else np.array(array))
            self.flow = []

    def update(self, inputs: Mapping[str, Message]) -> None:
        """Publishes the labels of one stamp."""
        if not self.wants("labels"):
            return
        state, depth, ids = inputs.get("state"), inputs.get("depth"), inputs.get("ids")
        assert isinstance(state, WorldState | None) and isinstance(depth, Depth | None) and isinstance(ids, Ids | None)
        source = next(iter(inputs.values())).header
        out = Labels(Header(source.stamp_ns, clock=source.clock, episode=source.episode))
        z = self.pure.crop(np.asarray(depth.depth), depth.margin) if depth is not None else None
        i = self.pure.crop(np.asarray(ids.ids), ids.margin) if ids is not None else None
        self._images(out, state, z, i)
        if "boxes" in self.kinds and i is not None:
            out.box, out.box_env, out.box_id = self.pure.boxes(i)
        if state is not None:
            self._bodies(out, state)
        self.publish("labels", out)

    def _images(self, out: Labels, state: WorldState | None, depth: np.ndarray | None, ids: np.ndarray | None) -> None:
        wanted: dict[str, tuple[tuple[int, ...], Any]] = {}
        if "flow" in self.kinds and depth is not None:
            wanted["flow"] = ((*depth.shape, 2), np.float32)
        if "depth" in self.kinds and depth is not None:
            wanted["depth"] = (depth.shape, np.float32)
        if "segmentation" in self.kinds and ids is not None:
            wanted["segmentation"] = (ids.shape, np.int32)
        if "semantic" in self.kinds and ids is not None:
            wanted["semantic"] = (ids.shape, np.int32)
        arrays = self.loan("labels", **wanted) if wanted else {}
        if "depth" in arrays:
            arrays["depth"][...] = depth
        if "segmentation" in arrays:
            arrays["segmentation"][...] = ids
        if "semantic" in arrays and ids is not None:
            np.take(self._classes(), ids, out=arrays["semantic"])
        if "flow" in arrays and state is not None and depth is not None and ids is not None:
            fields, twist = self._flow_fields(state), state.end_twist()
            for e in range(len(depth)):
                fields[e % len(fields)](state.end_pose[e], twist[e], depth[e], ids[e], arrays["flow"][e])
        for name, array in arrays.items():
            setattr(out, name, array)

    def _classes(self) -> np.ndarray:
        """Semantic id of each instance id."""
        if self.info is None or self.info.semantic is None:
            raise ValueError(f"{self.name}: /{self.params['camera']}/info has no semantic ids; leave semantic out")
        return self.info.semantic

    def _flow_fields(self, state: WorldState) -> list[Any]:
        """One for all environments, or one for each where their cameras differ."""
        if not self.flow:
            info = self.info
            if info is None:
                raise ValueError(f"{self.name} has no CameraInfo of {self.params['camera']}, which flow needs")
            index = {"": -1} | {name: n for n, name in enumerate(state.names)}
            missing = [b for b in (*info.instance_bodies, self.params["camera"]) if b not in index]
            if missing:
                raise ValueError(f"{self.name}: /state has no body '{missing[0]}', which CameraInfo names")
            bodies = [index[b] for b in info.instance_bodies]
            size, camera = (info.width, info.height), index[self.params["camera"]]
            lenses = [(info.k, info.distortion)]
            if info.env_k is not None and info.env_distortion is not None:
                lenses = list(zip(info.env_k, info.env_distortion))
            for k, distortion in lenses:
                lens = self.pure.lens_of(info.distortion_model, distortion)
                self.flow.append(self.pure.FlowField(k, size, bodies, camera, lens))
        return self.flow

    def _bodies(self, out: Labels, state: WorldState) -> None:
        if "poses" in self.kinds:
            out.pose, out.names = np.array(state.end_pose), list(state.names)
        if "velocities" in self.kinds:
            out.velocity, out.names = state.end_twist(), list(state.names)
        if "contacts" in self.kinds:
            if state.contact_env is None:
                raise ValueError(f"{self.name}: /state has no contacts; start physics with contacts:=true")
            for part in ("env", "body", "position", "force"):
                setattr(out, f"contact_{part}", np.array(getattr(state, f"contact_{part}")))


def kinds(asked: Any) -> list[str]:
    """Gives the labels asked for, those of DEFAULT for None. Raises ValueError that names the nearest one."""
    names = [n.strip() for n in asked.split(",")] if isinstance(asked, str) else [str(n) for n in asked or DEFAULT]
    for name in names:
        if name not in NEEDS:
            raise ValueError(f"no label '{name}'; {nearest(name, NEEDS)}")
    return names
