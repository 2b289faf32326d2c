"""Keyframes have colour where somebody reads it, and luminance everywhere else; all who read them take both."""

import io
import subprocess
import sys
import time

import numpy as np
import OpenEXR
import pytest
import zmq
from mcap.reader import make_reader
from node_bus import start, state
from PIL import Image

from evis.bag.export.topics import export
from evis.bag.reader import BagReader
from evis.bag.writer import BagWriter
from evis.bus import Publisher, Subscriber, endpoints_for
from evis.launch.explain import as_text
from evis.launch.planner import Options, plan_target
from evis.runtime.hosting.host import Host
from evis.runtime.hosting.join import Join
from evis.runtime.plan import NodePlan
from evis.scene import load_scene
from msgs.camera import Keyframe
from msgs.fields import MessageError
from msgs.header import Header
from nodes.interpolator.interpolator import Interpolator
from nodes.recorder.preview import PreviewMaker
from nodes.renderer.node import RendererNode
from nodes.visualizer.views.images import ImageView

LEFT_OUT = "keyframes: luminance only; nobody reads colour"


def plan(name="spinning_disk", record=None, topics=(), view=True, **given):
    return plan_target(name, given, Options(record=record, record_topics=topics, view=view))


@pytest.mark.parametrize(
    "given", [{}, {"interpolator": "none"}, {"interpolator": "splat"}, {"labels": "depth"}], ids=str
)
@pytest.mark.parametrize("view", [True, False])
def test_luminance_will_do_where_only_events_are_made(given, view):
    made = plan(view=view, **given)
    assert made.topics["/cam0/keyframe"].arrays == ["luminance"]
    assert LEFT_OUT in as_text(made)


def test_colour_events_and_bags_need_colour(tmp_path):
    bag = str(tmp_path / "a.mcap")
    for made in (plan(colour="true"), plan(colour="true", interpolator="none")):
        assert made.topics["/cam0/keyframe"].arrays == ["radiance"] and LEFT_OUT not in as_text(made)
    # The preview of every bag is made from keyframes.
    for topics in ((), ("/cam0/keyframe",)):
        made = plan(record=bag, topics=topics)
        assert made.topics["/cam0/keyframe"].arrays is None and LEFT_OUT not in as_text(made)
    stereo = plan("stereo_room")
    assert [stereo.topics[f"/{name}/keyframe"].arrays for name in ("left", "right")] == [["luminance"]] * 2
    assert as_text(stereo).count(LEFT_OUT) == 1


def test_a_viewer_gets_colour_while_it_looks(tmp_path):
    context = zmq.Context()
    topic, where = "/cam0/keyframe", endpoints_for(str(tmp_path), "/cam0/keyframe")
    publisher = Publisher(context, topic, "renderer", where, [], message_type=Keyframe)
    publisher.start()
    node = RendererNode("renderer", {})
    host = Host(node, NodePlan("renderer", "", {}, "p", outputs={"keyframe": topic}), Join([]), {topic: publisher})
    host.arrays[topic] = ["luminance"]
    host.downstream.append((host, "keyframe", topic))
    assert host.wants_array("keyframe", "luminance") and not host.wants_array("keyframe", "radiance")
    viewer = Subscriber(context, topic, "viewer", "tap", publisher.endpoints, message_type=Keyframe, tap=True)
    viewer.start()
    until(publisher, lambda: host.wants_array("keyframe", "radiance"))
    viewer.close()
    until(publisher, lambda: not host.wants_array("keyframe", "radiance"))
    publisher.close()
    context.destroy(linger=0)


def until(publisher, condition):
    deadline = time.monotonic() + 60
    while not condition():
        publisher.pump()
        assert time.monotonic() < deadline


@pytest.mark.parametrize("keyframes", ["auto", "rgb", "luminance"])
def test_the_node_sends_what_is_read(keyframes):
    disk = load_scene("spinning_disk", {"width": 48, "height": 36})
    node, bus = start("keyframe", keyframes=keyframes)
    bus.take()
    sent = []
    for reads_colour in (True, False, True):
        bus.wants = lambda node, port, array="", colour=reads_colour: port == "keyframe" and (colour or not array)
        node.update({"state": state(disk, 0.0)})
        sent.append(bus.take()["keyframe"])
    coloured = {"auto": [True, False, True], "rgb": [True] * 3, "luminance": [False] * 3}[keyframes]
    assert [message.radiance is not None for message in sent] == coloured
    assert [message.luminance is None for message in sent] == coloured
    assert {message.image.shape[:3] for message in sent} == {(1, 36, 48)}


def test_colour_frames_of_keyframes_without_colour_are_an_error():
    with pytest.raises(ValueError, match="keyframes carry luminance, colour frames need their radiance"):
        Interpolator("none", 1, colour=True).push(0, np.zeros(1, np.int32), np.ones((1, 4, 5), np.float32), None, None)
    with pytest.raises(MessageError, match="neither radiance nor luminance"):
        _ = Keyframe(Header(0), np.zeros(1, np.int32)).image


@pytest.mark.parametrize(("dtype", "encoding"), [(np.float32, b"32FC1"), (np.float16, b"16FC1")])
def test_luminance_in_bags_and_files(tmp_path, dtype, encoding):
    luminance = np.geomspace(1e-3, 1e4, 2 * 12 * 9).reshape(2, 12, 9).astype(dtype)
    message = Keyframe(Header(7), np.zeros(2, np.int32), luminance=luminance, margin=1)
    with BagWriter(tmp_path / "a.mcap") as writer:
        writer.write("/cam0/keyframe", message)
    with open(tmp_path / "a.mcap", "rb") as file:
        raw = [m.data for _, c, m in make_reader(file).iter_messages() if c.topic == "/env1/cam0/keyframe"]
    assert len(raw) == 1 and encoding in raw[0] and luminance[1].tobytes() in raw[0]
    with BagReader(tmp_path / "a.mcap") as reader:
        ((_, back),) = reader.messages(["/cam0/keyframe"])
    assert back.radiance is None and back.luminance.dtype == dtype
    np.testing.assert_array_equal(back.luminance, luminance)
    assert export(tmp_path / "a.mcap", "/cam0/keyframe", tmp_path / "out", half=False)["channels"] == ["Y"]
    with OpenEXR.File(str(tmp_path / "out" / "env1" / "000000.exr")) as file:
        np.testing.assert_array_equal(file.channels()["Y"].pixels, luminance[1, 1:-1, 1:-1])


def test_pictures_of_luminance_are_grey():
    luminance = np.tile(np.geomspace(0.01, 10, 16).astype(np.float32), (1, 8, 1))
    message = Keyframe(Header(0), np.zeros(1, np.int32), luminance=luminance)
    preview = PreviewMaker("/cam0/keyframe", 10.0).update(message)
    assert preview is not None and preview.data.shape == (8, 16, 3)
    assert (preview.data[..., :1] == preview.data).all() and (np.diff(preview.data[0, :, 0].astype(int)) > 0).all()
    view = ImageView("radiance", 0)
    view.capture(message)
    part = view.render(0)
    assert part is not None
    shown = np.asarray(Image.open(io.BytesIO(part.payload)))
    assert shown.shape == (8, 16) and int(shown[0, -1]) > int(shown[0, 0]) + 100


@pytest.mark.slow
def test_a_stereo_graph_gives_the_same_events(tmp_path):
    """Two cameras and all processes; the bag's preview is what reads colour."""
    found = {}
    for keyframes in ("rgb", "luminance"):
        bag = tmp_path / f"{keyframes}.mcap"
        words = ["width:=48", "height:=36", "upsampling:=4", f"keyframes:={keyframes}", "margin:=4"]
        command = [sys.executable, "-m", "evis", "launch", "stereo_room", "--duration", "0.1", "--no-view", *words]
        subprocess.run([*command, "--record", str(bag)], check=True, timeout=600, capture_output=True)
        with BagReader(bag) as reader:
            topics = ["/left/events", "/right/events"]
            found[keyframes] = [(t, *(getattr(m, n).tobytes() for n in "txyp")) for t, m in reader.messages(topics)]
            preview = next(m for _, m in reader.messages(["/left/image"])).data
        assert (preview[..., :1] == preview).all() == (keyframes == "luminance")
    assert sum(len(packet[2]) for packet in found["rgb"]) > 1000
    assert found["rgb"] == found["luminance"]
