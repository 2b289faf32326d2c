"""The labeler node: asks for no more than it needs, publishes what was asked for, margin cropped."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from evis.geometry import pinhole, se3
from msgs.camera import CameraInfo, Depth, Ids
from msgs.header import Header
from msgs.world import WorldState
from nodes.labeler.node import LabelerNode

WIDTH, HEIGHT, MARGIN = 12, 10, 3
K = pinhole.intrinsics(WIDTH, HEIGHT, 20.0)


def on_host(message):
    return {name: a if isinstance(a, np.ndarray) else a.numpy() for name, a in message.arrays().items()}


class Wire:
    """Stands for the executor: keeps what the node publishes."""

    def __init__(self):
        self.messages, self.loans = [], []

    def wants(self, node, port):
        return True

    def loan(self, node, port, arrays):
        self.loans.append(set(arrays))
        return {name: np.empty(shape, dtype) for name, (shape, dtype) in arrays.items()}

    def loan_on(self, node, port, device, arrays):
        self.loans.append(set(arrays))
        return {name: wp.empty(shape, dtype=dtype, device=device) for name, (shape, dtype) in arrays.items()}

    def publish(self, node, port, message):
        replace(message, **{n: a for n, a in on_host(message).items()}).check()
        self.messages.append(message)


@pytest.fixture
def inputs():
    """Two environments; a body of id 1 that moves sideways at 2 m/s (and 4 m/s) before a static wall of id 2."""
    header = Header(33_333_333, seq=1, episode=2)
    pose = np.tile(se3.IDENTITY, (2, 3, 2, 1))
    twist = np.zeros((2, 3, 2, 6))
    twist[0, -1, 0, 0], twist[1, -1, 0, 0] = 2.0, 4.0
    t = np.array([0, 16_000_000, 33_333_333])
    state = WorldState.dense(header, t, pose, twist, np.zeros(2, np.int32), names=["ball", "cam0"])
    depth = np.full((2, HEIGHT + 2 * MARGIN, WIDTH + 2 * MARGIN), 5.0, np.float32)
    ids = np.full(depth.shape, 2, np.int32)
    depth[:, 4:7, 5:9], ids[:, 4:7, 5:9] = 2.0, 1
    return {"state": state, "depth": Depth(header, depth, MARGIN), "ids": Ids(header, ids, MARGIN)}


def info():
    return CameraInfo(
        Header(0), K, np.zeros(0), width=WIDTH, height=HEIGHT, margin=MARGIN, envs=2,
        instances=["background", "ball", "wall"], instance_bodies=["", "ball", ""],
        semantic=np.array([0, 4, 2], np.int32),
    )  # fmt: skip


def node_of(labels, device="cpu"):
    node = LabelerNode("labeler", {"labels": labels, "device": device})
    node.runtime = Wire()
    node.setup()
    return node


def test_only_what_is_asked_for_is_needed():
    """So that the planner leaves the rest of the graph out."""
    wanted = frozenset({"labels"})
    assert LabelerNode.needs({"labels": ["depth"]}, wanted) == {"depth"}
    assert LabelerNode.needs({"labels": "boxes,segmentation"}, wanted) == {"ids"}
    assert LabelerNode.needs({"labels": ["poses", "contacts"]}, wanted) == {"state"}
    assert LabelerNode.needs({"labels": ["flow"]}, wanted) == {"state", "depth", "ids", "info"}
    assert LabelerNode.needs({"labels": ["flow"]}, frozenset()) == frozenset()
    with pytest.raises(ValueError, match="no label 'flwo'; did you mean 'flow'"):
        LabelerNode.needs({"labels": ["flwo"]}, wanted)


def test_images_are_cropped_and_exact(inputs):
    """Flow f v / z px/s on the body, 0 on the wall; depth and ids as rendered; boxes within the cropped image."""
    node = node_of(["flow", "depth", "segmentation", "boxes"])
    node.receive("info", info())
    node.update(inputs)
    out = node.runtime.messages[0]
    assert (out.header.stamp_ns, out.header.episode) == (33_333_333, 2)
    assert np.array_equal(out.depth, inputs["depth"].depth[:, 3:-3, 3:-3])
    assert np.array_equal(out.segmentation, inputs["ids"].ids[:, 3:-3, 3:-3])
    ball = out.segmentation == 1
    for e, speed in enumerate((2.0, 4.0)):
        assert np.allclose(out.flow[e][ball[e]], [20.0 * speed / 2.0, 0.0])
        assert not out.flow[e][~ball[e]].any()
    assert out.box[0].tolist() == [2, 1, 5, 3] and out.box_id.tolist() == [1, 2, 1, 2]
    assert out.pose is None and out.contact_env is None


@pytest.mark.parametrize("own", ["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)])
@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)])
def test_images_on_a_device_have_the_labels_of_the_host_s(inputs, device, own):
    """Warp's arrays and numpy's by turns, as they come from another process while a viewer reads one of them; own: the
    labeler's device."""
    there = dict(inputs)
    for name, kind in (("depth", wp.float32), ("ids", wp.int32)):
        array = wp.array(getattr(inputs[name], name), dtype=kind, device=device)
        there[name] = replace(inputs[name], **{name: array})
    node = node_of(["flow", "depth", "segmentation", "semantic", "boxes"], device=own)
    node.receive("info", info())
    mixed = [inputs, there, {**inputs, "ids": there["ids"]}, {**there, "ids": inputs["ids"]}, inputs]
    for given in mixed:
        node.update(given)
    node.finish()
    first, *others = [on_host(message) for message in node.runtime.messages]
    assert len(others) == 4 and first["flow"].any() and not np.isnan(first["flow"]).any()
    for other in others:
        for name in ("flow", "depth", "segmentation", "semantic", "box"):
            assert np.array_equal(first[name], other[name]), name


@pytest.mark.gpu
def test_an_id_without_a_body_in_the_last_images_is_told(inputs):
    node = node_of(["flow"], device="cuda")
    node.receive("info", info())
    strange = np.full(inputs["ids"].ids.shape, 7, np.int32)
    there = {"depth": wp.array(inputs["depth"].depth, device="cuda"), "ids": wp.array(strange, device="cuda")}
    node.update({**inputs, **{name: replace(inputs[name], **{name: array}) for name, array in there.items()}})
    with pytest.raises(ValueError, match="ids run from 0 to 7, CameraInfo names 3"):
        node.finish()


def test_bodies(inputs):
    """Poses and velocities at the stamp, named; nothing is loaned for images nobody asked for."""
    node = node_of(["poses", "velocities"])
    node.update({"state": inputs["state"]})
    out = node.runtime.messages[0]
    assert out.pose.shape == (2, 2, 7) and out.velocity[:, 0, 0].tolist() == [2, 4] and out.names == ["ball", "cam0"]
    assert out.flow is None and node.runtime.loans == []


def test_contacts(inputs):
    """Handed on as physics gave them; asking for them without is an error with the remedy."""
    node = node_of(["contacts"])
    with pytest.raises(ValueError, match="start physics with contacts:=true"):
        node.update({"state": inputs["state"]})
    state = inputs["state"]
    state.contact_env, state.contact_body = np.array([1], np.int32), np.array([[-1, 0]], np.int32)
    state.contact_position, state.contact_force = np.ones((1, 3)), np.full((1, 3), 2.0)
    node.update({"state": state})
    out = node.runtime.messages[0]
    assert out.contact_body.tolist() == [[-1, 0]] and out.contact_force.tolist() == [[2, 2, 2]]


def test_flow_without_camera_info_says_so(inputs):
    """And a body that the state does not have is named."""
    node = node_of(["flow"])
    with pytest.raises(ValueError, match="no CameraInfo of cam0"):
        node.update(inputs)
    wrong = info()
    wrong.instance_bodies[1] = "bat"
    node.receive("info", wrong)
    with pytest.raises(ValueError, match="no body 'bat'"):
        node.update(inputs)
