"""Runs the labeler as a node: ground truth on /<camera>/labels at every stamp, only what was asked for."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from functools import partial
from typing import Any, ClassVar

import numpy as np

from evis.config.params import Param
from evis.gpu.host_copies import host_array
from evis.runtime.node import Input, Node, Output
from evis.scene.parameters import SCENE, SEED, seeds_of, worlds_of
from msgs.camera import INTERVAL_FLOWS, CameraInfo, Depth, Ids, Labels
from msgs.header import Header, Message
from msgs.world import WorldState
from nodes.labeler.body_labels import add_body_labels
from nodes.labeler.images.box_groups import OF
from nodes.labeler.images.instance_tables import InstanceTables
from nodes.labeler.kinds import DEFAULT, NEEDS, OF_MESHES, RAY_CAST, kinds_of

KEPT = ("event_history", "flow_history", "pairing")
"""What labels go on from besides the messages of their stamp, where there is any of it."""


class LabelerNode(Node):
    """Publishes the labels of one camera.

    The scene is loaded for labels of OF_MESHES alone: for the others CameraInfo tells which body each id belongs to.
    """

    PARAMS: ClassVar[Mapping[str, Param]] = {
        "camera": Param(str, "cam0", "camera that is labelled"),
        "labels": Param(
            list, None,
            f"ground truth to make, of {', '.join(NEEDS)}; not given = {', '.join(DEFAULT)}, once a viewer opens them",
            optional=True,
        ),
        "flow_from": Param(
            float, 0.0, "where forward_flow begins, as a part of the packet's interval: 0 = the stamp before", "", 0, 1
        ),
        "flow_to": Param(float, 1.0, "where forward_flow ends and backward_flow begins: 1 = the stamp", "", 0, 1),
        "box_of": Param(str, "instance", "what has a box of its own: each instance, or each body", choices=OF),
        "box_classes": Param(list, None, "classes of what gets boxes; not given = all", optional=True),
        "keyframe_rate": Param(float, 30.0, "rate of the states", "Hz", 1e-3, 1e6),
        "upsampling": Param(int, 8, "frames per keyframe interval (K), the sensor's steps", "", 1, 4096),
        "time_tolerance": Param(
            float, 0.0, "of the times of pixels' samples between frames, for labels of events; 0 = there are none",
            "s", 0, 1,
        ),
        "device": Param(str, "cpu", "where kernels run: cpu, cuda, cuda:1"),
        **SCENE,
        "seed": SEED,
        "envs": Param(int, 1, "parallel environments", "", 1, 65536),
    }  # fmt: skip
    PER_ENVIRONMENT: ClassVar[bool] = True
    INPUTS: ClassVar[Mapping[str, Input]] = {
        "state": Input("/state"),
        "depth": Input("/{camera}/depth", on_device=True),
        "ids": Input("/{camera}/ids", on_device=True),
        "info": Input("/{camera}/info", join=False),
        "events": Input("/{camera}/events", join=False),
        "signal": Input("/{camera}/signal", join=False),
    }
    OUTPUTS: ClassVar[Mapping[str, Output]] = {"labels": Output("/{camera}/labels")}

    @classmethod
    def needs(cls, params: Mapping[str, Any], wanted: frozenset[str]) -> frozenset[str]:
        """Names the inputs of the labels asked for. Raises ValueError for one that does not exist."""
        asked = kinds_of(params.get("labels"))
        found = frozenset().union(*(NEEDS[kind] for kind in asked)) if wanted else frozenset()
        return found | {"info"} if "ids" in found and _some_boxes(params) else found

    @classmethod
    def without_effect(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """Names the parameters of flow over an interval, and of boxes, where no such label is asked for."""
        asked = set(kinds_of(params.get("labels")))
        idle: dict[str, str] = {}
        if asked.isdisjoint(INTERVAL_FLOWS):
            why = "no label is a flow over an interval (labels:=forward_flow)"
            idle |= dict.fromkeys(("flow_from", "flow_to"), why)
        if "boxes" not in asked:
            idle |= dict.fromkeys(("box_of", "box_classes"), "no label is of boxes (labels:=boxes)")
        return idle

    def setup(self) -> None:
        """Checks the list of labels, and prepares what looks at meshes. Raises ValueError for an empty interval."""
        from nodes.labeler.images import image_labels

        self.image_labels = image_labels
        self.kinds = kinds_of(self.params["labels"])
        self.tables = InstanceTables(self.name, self.params["camera"])
        self.pairing: Any = None
        self.mesh_labels: Any = None
        if OF_MESHES & set(self.kinds):
            self._prepare_mesh_labels()

    def _prepare_mesh_labels(self) -> None:
        p = self.params
        if p["flow_from"] >= p["flow_to"]:
            raise ValueError(f"flow_from {p['flow_from']:g} must be less than flow_to {p['flow_to']:g}")
        from nodes.labeler.mesh_labels import MeshLabels, make_world_labelers

        make = partial(make_world_labelers, params=p, kinds=self.kinds)
        self.mesh_labels = MeshLabels(worlds_of(self.name, p, textures=False), make)
        if RAY_CAST & set(self.kinds):
            from nodes.labeler.rays.motion_history import MotionHistories

            self.event_history, self.flow_history = MotionHistories(), MotionHistories()
        if "events" in self.kinds:
            from nodes.labeler.event_pairing import EventPairing

            self.pairing = EventPairing()

    def rewind(self, params: Mapping[str, Any]) -> bool:
        """Keeps everything but worlds that are others: no label knows of another stamp."""
        if {**params, "seed": 0} != {**self.params, "seed": 0}:
            return False
        self.params = dict(params)
        if self.mesh_labels is not None:
            self.mesh_labels.follow(self.mesh_labels.worlds.from_seeds(seeds_of(params)))
        return True

    def state(self) -> Any:
        """Gives the motion of the last states, and labels and events that wait for one another."""
        return copy.deepcopy({name: vars(self)[name] for name in KEPT if name in vars(self)})

    def restore(self, state: Any) -> None:
        """Goes on from these."""
        vars(self).update(copy.deepcopy(state))

    def receive(self, port: str, message: Message) -> None:
        """Keeps the latched CameraInfo, and events until the labels of their stamp are there."""
        if port in ("events", "signal"):
            self.pairing.take(message)
            self._publish_paired()
        if isinstance(message, CameraInfo):
            self.tables.take(message)

    def update(self, inputs: Mapping[str, Message]) -> None:
        """Publishes the labels of one stamp."""
        if not self.wants("labels"):
            return
        state, depth, ids = inputs.get("state"), inputs.get("depth"), inputs.get("ids")
        assert isinstance(state, WorldState | None) and isinstance(depth, Depth | None) and isinstance(ids, Ids | None)
        source = next(iter(inputs.values())).header
        out = Labels(Header(source.stamp_ns, clock=source.clock, episode=source.episode))
        z = self._image(depth.depth, depth.margin) if depth is not None else None
        i = self._image(ids.ids, ids.margin) if ids is not None else None
        self._label_images(out, state, z, i)
        if "boxes" in self.kinds and i is not None:
            seen = host_array(i)
            if _some_boxes(self.params):
                seen = np.take(self.tables.box_ids(self.params["box_of"], self.params["box_classes"]), seen)
            out.box, out.box_env, out.box_id = self.image_labels.boxes(seen)
        if state is not None:
            add_body_labels(out, state, self.kinds, self.name)
            self._label_meshes(out, state)
        if self.pairing is None:
            self.publish("labels", out)
            return
        assert state is not None
        self.pairing.label(out, state)
        self._publish_paired()

    def finish(self) -> None:
        """Publishes the labels of what the sensor held back. Raises ValueError for ids of the last images."""
        self.tables.settle()
        if self.pairing is not None:
            self._publish_paired(ended=True)

    def _publish_paired(self, ended: bool = False) -> None:
        """Publishes the labels whose events are there."""
        while (found := self.pairing.next(ended)) is not None:
            out, state, packet = found
            if out is None:
                h = packet.header
                out = Labels(Header(h.stamp_ns, clock=h.clock, episode=h.episode))
            else:
                self.event_history.add(state)
                self.mesh_labels.follow(self.mesh_labels.worlds.follow(state.own))
            made = self.mesh_labels.events(self.event_history, packet.t, packet.x, packet.y, packet.env_offsets)
            out.event_env, out.event_instance, out.event_flow = made.env, made.instance, made.flow
            out.event_signal = packet.signal
            self.publish("labels", out)

    def _image(self, image: Any, margin: int) -> Any:
        """Gives the image of a message without its margin: where it came, but for flow on the device that flow is of.

        Of another process images come on the host while anybody reads them there, and flow has other roundings there.
        """
        if self.pairing is not None or "flow" in self.kinds:
            if self._flow_device() == "cpu":
                image = host_array(image)
            elif isinstance(image, np.ndarray) or image.device.is_cpu:
                import warp as wp

                image = wp.array(host_array(image), device=self._flow_device())
        return self.image_labels.crop(image, margin)

    def _flow_device(self) -> str:
        """Names the device that flow is computed on: the labeler's, but the host where labels wait for events."""
        return "cpu" if self.pairing is not None else str(self.params["device"])

    def _label_images(self, out: Labels, state: WorldState | None, depth: Any, ids: Any) -> None:
        wanted: dict[str, tuple[tuple[int, ...], Any]] = {}
        if "flow" in self.kinds and depth is not None:
            wanted["flow"] = ((*depth.shape, 2), np.float32)
        if "depth" in self.kinds and depth is not None:
            wanted["depth"] = (depth.shape, np.float32)
        if "segmentation" in self.kinds and ids is not None:
            wanted["segmentation"] = (ids.shape, np.int32)
        on_gpu = next((a.device for a in (depth, ids) if a is not None and not isinstance(a, np.ndarray)), None)
        if "semantic" in self.kinds and ids is not None:
            if on_gpu is None:
                wanted["semantic"] = (ids.shape, np.int32)
            else:
                out.semantic = np.take(self.tables.semantic_ids(), host_array(ids))
        arrays = self._memory(wanted, on_gpu)
        for name, image in (("depth", depth), ("segmentation", ids)):
            if name in arrays and on_gpu is None:
                arrays[name][...] = image
            elif name in arrays:
                arrays[name].assign(image)
        if "semantic" in arrays:
            np.take(self.tables.semantic_ids(), ids, out=arrays["semantic"])
        if "flow" in arrays and state is not None and ids is not None:
            fields, twist = self.tables.flow_fields(state, self._flow_device()), state.end_twist()
            share = len(depth) // len(fields)
            for k, field in enumerate(fields):
                own = slice(k * share, (k + 1) * share)
                field(state.end_pose[own], twist[own], depth[own], ids[own], arrays["flow"][own])
        for name, array in arrays.items():
            setattr(out, name, array)

    def _memory(self, wanted: Mapping[str, tuple[tuple[int, ...], Any]], on_gpu: Any) -> dict[str, Any]:
        """Allocates arrays of (shape, dtype) to write labels into, on a GPU if it is given."""
        if not wanted:
            return {}
        if on_gpu is not None:
            import warp as wp

            there = {name: (shape, wp.dtype_from_numpy(np.dtype(dtype))) for name, (shape, dtype) in wanted.items()}
            return self.loan_on("labels", on_gpu, **there)
        if self.pairing is None:
            return {**self.loan("labels", **wanted)}
        # These wait for events, and a loan is for what is sent next.
        return {name: np.empty(shape, dtype) for name, (shape, dtype) in wanted.items()}

    def _label_meshes(self, out: Labels, state: WorldState) -> None:
        """Labels where meshes are at this stamp, and how their points move within its interval."""
        if self.mesh_labels is not None:
            self.mesh_labels.follow(self.mesh_labels.worlds.follow(state.own))
        if "boxes3d" in self.kinds:
            boxes = self.mesh_labels.boxes(np.asarray(state.end_pose))
            out.box3d_env, out.box3d_id, out.box3d_size = boxes.env, boxes.id, boxes.size
            out.box3d_pose, out.box3d_in_camera = boxes.pose, boxes.in_camera
        asked = [name for name in ("forward", "backward") if f"{name}_flow" in self.kinds]
        if not asked:
            return
        self.flow_history.add(state)
        from nodes.labeler.mesh_labels import instant_in

        shares = [self.params[name] for name in ("flow_from", "flow_to")]
        out.flow_t = np.array([instant_in(state.t, share) for share in shares], np.int64)
        for name in asked:
            start, end = shares if name == "forward" else shares[::-1]
            flow, valid = self.mesh_labels.flow(self.flow_history, state, start, end)
            setattr(out, f"{name}_flow", flow)
            setattr(out, f"{name}_valid", valid)


def _some_boxes(params: Mapping[str, Any]) -> bool:
    """Tells whether not every instance has a box of its own."""
    return params.get("box_of", OF[0]) != OF[0] or params.get("box_classes") is not None
