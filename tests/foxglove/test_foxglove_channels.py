"""What the channels carry, decoded by another library from the schemas that a client is told."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from foxglove_node import Foxglove, Served, make_plan

from msgs.camera import CameraInfo, Depth, EventPacket, Image, Imu, Keyframe, Labels
from msgs.diagnostics import Diagnostics
from msgs.header import Header
from msgs.world import WorldState
from nodes.foxglove import pictures
from nodes.foxglove.channels import MOST_ENVS

W, H = 7, 5
MS = 1_000_000


def packet(k: int, seed: int, envs: int = 1, **changes: object) -> EventPacket:
    """Forty events of each environment in the ms before k."""
    rng, n = np.random.default_rng(seed), 40 * envs
    t = np.sort(rng.integers((k - 1) * MS + 1, k * MS + 1, n))
    x, y = rng.integers(0, W, n).astype(np.uint16), rng.integers(0, H, n).astype(np.uint16)
    fields = {"width": W, "height": H, "t0_ns": (k - 1) * MS, **changes}
    offsets = np.arange(0, n + 1, 40, dtype=np.int64)
    return EventPacket(Header(k * MS, k), offsets, t, x, y, rng.integers(0, 2, n).astype(np.uint8), **fields)  # type: ignore[arg-type]


def camera_info() -> CameraInfo:
    k = np.array([[150.0, 0, 3], [0, 151, 2], [0, 0, 1]])
    lens = np.array([0.1, -0.2, 0.001, 0.002, 0.05])
    return CameraInfo(Header(0), k, lens, width=W, height=H, distortion_model="plumb_bob", instances=["background"])


def test_every_part_of_every_topic_has_a_channel(client: Foxglove) -> None:
    """Before any message has come; as a bag names them, and the two pictures."""
    images, texts = "sensor_msgs/msg/Image", "evis/"
    expected = {
        "/state": "tf2_msgs/msg/TFMessage", "/state/meta": "evis/WorldState",
        "/cam0/info": "sensor_msgs/msg/CameraInfo", "/cam0/info/meta": "evis/CameraInfo",
        "/cam0/keyframe": images, "/cam0/keyframe/preview": images, "/cam0/keyframe/meta": "evis/Keyframe",
        "/cam0/depth": images, "/cam0/depth/meta": "evis/Depth",
        "/cam0/events": "event_camera_msgs/msg/EventPacket", "/cam0/events/picture": images,
        "/cam0/events/meta": "evis/EventPacket", "/cam0/labels": "evis/Labels", "/cam0/labels/flow": images,
        "/cam0/labels/depth": images, "/cam0/labels/segmentation": images, "/cam0/labels/semantic": images,
        "/cam0/imu": "sensor_msgs/msg/Imu", "/cam0/imu/meta": "evis/Imu", "/cam0/image": images,
        "/cam0/image/meta": "evis/Image", "/clock": "evis/Clock", "/diagnostics": "evis/Diagnostics",
    }  # fmt: skip
    assert {name: channel["schemaName"] for name, channel in client.channels.items()} == expected
    assert len({channel["id"] for channel in client.channels.values()}) == len(expected)
    for channel in client.channels.values():
        kinds = ("json", "jsonschema") if channel["schemaName"].startswith(texts) else ("cdr", "ros2msg")
        assert (channel["encoding"], channel["schemaEncoding"]) == kinds
    info = client.info
    assert info["op"] == "serverInfo" and info["capabilities"] == ["time"] and info["sessionId"] == "run-1"
    assert info["metadata"] == {"graph": "disk", "mode": "lockstep", "seed": "7"}


def test_images_are_those_that_were_published(served: Served, client: Foxglove) -> None:
    depth = np.random.default_rng(1).random((1, H, W), np.float32)
    depth[0, 0, 0] = np.inf
    client.subscribe("/cam0/depth")
    served.until_tapped("/cam0/depth")
    served.send("/cam0/depth", Depth(Header(1_500_000_007, 3), depth))
    time_ns, payload = client.next("/cam0/depth")
    image = client.decode("/cam0/depth", payload)
    assert time_ns == 1_500_000_007 and (image.header.stamp.sec, image.header.stamp.nanosec) == (1, 500_000_007)
    assert (image.width, image.height, image.encoding, image.header.frame_id) == (W, H, "32FC1", "cam0")
    assert np.array_equal(np.frombuffer(image.data, "<f4").reshape(H, W), depth[0])


def test_parts_with_a_suffix_come_alone(served: Served, client: Foxglove) -> None:
    flow = np.random.default_rng(2).normal(size=(1, H, W, 2)).astype(np.float32)
    client.subscribe("/cam0/labels/flow", "/cam0/labels")
    served.until_tapped("/cam0/labels")
    ids = np.arange(H * W, dtype=np.int32).reshape(1, H, W)
    served.send("/cam0/labels", Labels(Header(5 * MS), flow=flow, segmentation=ids, names=["disk"]))
    image = client.read("/cam0/labels/flow")
    assert image.encoding == "32FC2" and np.array_equal(np.frombuffer(image.data, "<f4").reshape(flow.shape), flow)
    assert client.read("/cam0/labels")["names"] == ["disk"]
    assert served.runtime.requested == ["/cam0/labels"]  # its node was asleep
    assert not client.received["/cam0/labels/segmentation"]


def test_a_part_that_messages_are_without_is_told_once(served: Served, client: Foxglove) -> None:
    """An empty panel would not say whether it waits or is in vain. Of what is there nothing is told."""
    flow = np.zeros((1, H, W, 2), np.float32)
    first, *_ = client.subscribe("/cam0/labels/depth", "/cam0/labels/flow")
    served.until_tapped("/cam0/labels")
    expected = "/cam0/labels/depth: the newest message of /cam0/labels has no such part"
    for k in range(3):
        served.send("/cam0/labels", Labels(Header(k * MS), flow=flow))
        client.next("/cam0/labels/flow")
    assert [status["message"] for status in client.statuses] == [expected]
    assert client.statuses[0]["level"] == 1
    client.say("unsubscribe", subscriptionIds=[first])
    client.subscribe("/cam0/labels/depth")
    status = [status["message"] for status in client.statuses]

    def again() -> bool:
        served.send("/cam0/labels", Labels(Header(9 * MS), flow=flow))
        client.hear(0.02)
        return len(client.statuses) > len(status)

    served.until(again)
    assert [one["message"] for one in client.statuses] == [expected] * 2


def test_camera_info(served: Served, client: Foxglove) -> None:
    client.subscribe("/cam0/info", "/cam0/info/meta")
    served.until_tapped("/cam0/info")
    info = camera_info()
    served.send("/cam0/info", info)
    got = client.read("/cam0/info")
    assert (got.width, got.height, got.distortion_model) == (W, H, "plumb_bob")
    assert np.array_equal(np.reshape(got.k, (3, 3)), info.k) and np.array_equal(got.d, info.distortion)
    assert client.read("/cam0/info/meta")["instances"] == ["background"]


def test_state_is_transforms(served: Served, client: Foxglove) -> None:
    """What the 3D panel reads."""
    pose = np.array([[[[1, 2, 3, 0, 0, 0.6, 0.8]]]], np.float64)
    state = WorldState.dense(
        Header(9 * MS), np.array([9 * MS]), pose, np.zeros((1, 1, 1, 6)), np.zeros(1, np.int32), names=["disk"]
    )
    client.subscribe("/state")
    served.until_tapped("/state")
    served.send("/state", state)
    (transform,) = client.read("/state").transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("world", "disk")
    moved, turned = transform.transform.translation, transform.transform.rotation
    assert (moved.x, moved.y, moved.z) == (1, 2, 3) and (turned.x, turned.y, turned.z, turned.w) == (0, 0, 0.6, 0.8)


def test_all_samples_of_a_message_come(served: Served, client: Foxglove) -> None:
    """A message of the graph is several of ROS: only the newest message waits, but all of it."""
    t = np.arange(1, 9, dtype=np.int64) * MS
    acceleration = np.arange(24, dtype=np.float64).reshape(8, 3)
    client.subscribe("/cam0/imu")
    served.until_tapped("/cam0/imu")
    served.send("/cam0/imu", Imu(Header(8 * MS), t, acceleration, -acceleration))
    got = [client.next("/cam0/imu") for _ in t]
    assert [time_ns for time_ns, _ in got] == t.tolist()
    read = [client.decode("/cam0/imu", payload).linear_acceleration for _, payload in got]
    assert np.array_equal([[a.x, a.y, a.z] for a in read], acceleration)


def test_events_are_the_packets(served: Served, client: Foxglove) -> None:
    """`mono` of event_camera_msgs: 8 bytes each, time after the base in 32 bits, x in 16, y in 15, polarity in one. Of
    a camera's packet, which has its own bytes too, the decoded ones.
    """
    sent = packet(4, 1, raw=np.arange(8, dtype=np.uint8), encoding="evt3")
    client.subscribe("/cam0/events")
    served.until_tapped("/cam0/events")
    served.send("/cam0/events", sent)
    got = client.read("/cam0/events")
    words = np.frombuffer(got.events, "<u8").astype(np.uint64)
    assert got.encoding == "mono" and (got.width, got.height) == (W, H)
    assert np.array_equal((words & 0xFFFFFFFF).astype(np.int64) + got.time_base, sent.t)
    assert np.array_equal(words >> np.uint64(32) & np.uint64(0xFFFF), sent.x)
    assert np.array_equal(words >> np.uint64(48) & np.uint64(0x7FFF), sent.y)
    assert np.array_equal(words >> np.uint64(63), sent.p)


def drawn(*packets: EventPacket) -> np.ndarray:
    """The picture of packets, pixel by pixel: white, and the colour of the newest event."""
    picture = np.full((H, W, 3), 255, np.uint8)
    for one in packets:
        assert one.x is not None and one.y is not None and one.p is not None
        for x, y, p in zip(one.x.tolist(), one.y.tolist(), one.p.tolist()):
            if x < W and y < H:
                picture[y, x] = pictures.COLOURS[1 + p]
    return picture


def pixels(image: object) -> np.ndarray:
    """The pixels of a decoded rgb8 image."""
    assert image.encoding == "rgb8"  # type: ignore[attr-defined]
    return np.frombuffer(image.data, np.uint8).reshape(image.height, image.width, 3)  # type: ignore[attr-defined]


def test_the_picture_of_events_has_the_newest_of_each_pixel(served: Served, client: Foxglove) -> None:
    assert len({tuple(colour) for colour in pictures.COLOURS.tolist()}) == 3
    client.subscribe("/cam0/events/picture")
    served.until_tapped("/cam0/events", "/cam0/info")
    sent = packet(1, 1)
    sent.x[-1] = 60000  # type: ignore[index]
    served.send("/cam0/events", sent)
    got = client.read("/cam0/events/picture")
    assert np.array_equal(pixels(got), drawn(sent)) and got.header.stamp.nanosec == MS
    served.node.idle()
    assert served.runtime.counted["events_outside"] == 1


def test_between_two_pictures_no_event_is_lost(
    served: Served, client: Foxglove, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All are drawn into the next one, which comes also if no further packet does."""
    monkeypatch.setattr(pictures, "EVENTS_HZ", 0.5)
    client.subscribe("/cam0/events/picture")
    served.until_tapped("/cam0/events", "/cam0/info")
    sent = [packet(k, k) for k in range(1, 6)]
    for one in sent:
        served.send("/cam0/events", one)
    got = [pixels(client.read("/cam0/events/picture", served.node.idle)) for _ in range(2)]
    assert np.array_equal(got[0], drawn(sent[0])) and np.array_equal(got[1], drawn(*sent[1:]))


def test_an_episode_begins_with_a_white_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pictures, "EVENTS_HZ", 1e-6)
    picture = pictures.EventPicture()
    assert picture.add(packet(1, 1), W, H) == 0 and picture.take("cam0") is not None
    picture.add(packet(2, 2), W, H)
    assert picture.take("cam0") is None  # not due
    last = packet(3, 3)
    last.header.episode = 1
    picture.add(last, W, H)
    picture.pace = pictures.Pace(1e9)
    data = picture.take("cam0")
    assert data is not None
    assert np.array_equal(np.frombuffer(data[-3 * W * H :], np.uint8).reshape(H, W, 3), drawn(last))


def test_the_size_of_the_picture_may_come_from_the_info(served: Served, client: Foxglove) -> None:
    client.subscribe("/cam0/events/picture")
    served.until_tapped("/cam0/events", "/cam0/info")
    served.send("/cam0/info", camera_info())
    sent = packet(1, 1, width=0, height=0)
    served.send("/cam0/events", sent)
    assert np.array_equal(pixels(client.read("/cam0/events/picture")), drawn(sent))


def test_what_cannot_be_drawn_is_told_once_and_the_rest_goes_on(served: Served, client: Foxglove) -> None:
    client.subscribe("/cam0/events", "/cam0/events/picture")
    served.until_tapped("/cam0/events", "/cam0/info")
    for k in range(3):
        header = Header(k * MS, k)
        raw = np.arange(8, dtype=np.uint8)
        served.send("/cam0/events", EventPacket(header, np.zeros(2, np.int64), raw=raw, encoding="evt3", width=W))
        assert client.read("/cam0/events").encoding == "evt3"
    status = client.status()
    assert status["level"] == 2 and "/cam0/events cannot be shown" in status["message"]
    served.node.idle()
    assert len(served.runtime.said) == 1 and client.statuses == []


def test_the_preview_is_tone_mapped_and_without_margin(served: Served, client: Foxglove) -> None:
    """Reinhard et al. 2002, eq. 1-3, and the sRGB curve, in float64; the table of the real one has 4096 steps."""
    radiance = np.random.default_rng(3).random((1, H + 4, W + 4, 3)).astype(np.float32) * 50
    client.subscribe("/cam0/keyframe/preview")
    served.until_tapped("/cam0/keyframe")
    served.send("/cam0/keyframe", Keyframe(Header(MS), np.zeros(1, np.int32), radiance, margin=2))
    linear = radiance[0, 2:-2, 2:-2].astype(np.float64)
    gain = 0.18 / np.exp(np.log(linear @ [0.2126, 0.7152, 0.0722]).mean())
    u = gain * linear / (1 + gain * linear)
    srgb = 255 * np.where(u <= 0.0031308, 12.92 * u, 1.055 * u ** (1 / 2.4) - 0.055)
    got = pixels(client.read("/cam0/keyframe/preview"))
    assert got.shape == (H, W, 3) and np.abs(got - srgb).max() < 1.0


def test_keyframes_of_luminance_alone_are_grey_floats(served: Served, client: Foxglove) -> None:
    luminance = np.random.default_rng(4).random((1, H, W), np.float32)
    client.subscribe("/cam0/keyframe")
    served.until_tapped("/cam0/keyframe")
    served.send("/cam0/keyframe", Keyframe(Header(MS), np.zeros(1, np.int32), luminance=luminance))
    image = client.read("/cam0/keyframe")
    assert image.encoding == "32FC1" and np.array_equal(np.frombuffer(image.data, "<f4"), luminance.ravel())


def test_time_is_the_stamps(served: Served, client: Foxglove) -> None:
    """It goes back at the beginning of an episode alone; what the system says by the wall's clock stands at it."""
    client.subscribe("/cam0/depth", "/diagnostics")
    served.until_tapped("/cam0/depth", "/diagnostics")
    steps = ((0, 5), (0, 7), (0, 6), (1, 2))
    for k, (episode, ms) in enumerate(steps):
        served.send("/cam0/depth", Depth(Header(ms * MS, k, episode=episode), np.zeros((1, H, W), np.float32)))
        assert client.next("/cam0/depth")[0] == ms * MS
    assert client.times == [5 * MS, 7 * MS, 2 * MS]
    served.send("/diagnostics", Diagnostics(Header(1_800_000_000 * 10**9, 0, "wall"), node="simulator"))
    time_ns, payload = client.next("/diagnostics")
    assert time_ns == 2 * MS and client.decode("/diagnostics", payload)["node"] == "simulator"


def test_environments_have_channels_of_their_own(serve: Callable[..., Served]) -> None:
    served = serve(make_plan(envs=3))
    with Foxglove(served.address) as client:
        assert {"/env0/cam0/depth", "/env2/cam0/depth", "/env1/state", "/cam0/info", "/clock"} <= client.channels.keys()
        assert not {"/cam0/depth", "/env3/cam0/depth", "/env0/clock"} & client.channels.keys()
        client.subscribe("/env1/cam0/depth", "/env2/cam0/events/picture", "/env1/cam0/image")
        served.until_tapped("/cam0/depth", "/cam0/events", "/cam0/info", "/cam0/image")
        depth = np.random.default_rng(1).random((3, H, W), np.float32)
        served.send("/cam0/depth", Depth(Header(MS), depth))
        assert np.array_equal(np.frombuffer(client.read("/env1/cam0/depth").data, "<f4"), depth[1].ravel())
        sent = packet(1, 5, envs=3)
        served.send("/cam0/events", sent)
        assert sent.x is not None and sent.y is not None and sent.p is not None and sent.t is not None
        own = EventPacket(sent.header, np.array([0, 40]), sent.t[80:], sent.x[80:], sent.y[80:], sent.p[80:])
        assert np.array_equal(pixels(client.read("/env2/cam0/events/picture")), drawn(own))
        for env in (0, 1):
            served.send("/cam0/image", Image(Header(MS), np.full((H, W, 1), env, np.uint8), "mono8", env=env, envs=3))
        assert bytes(client.read("/env1/cam0/image").data) == bytes([1]) * (W * H)


def test_environments_that_a_message_tells_of_get_channels_then(served: Served, client: Foxglove) -> None:
    """As of a bag that is played: the plan does not know them."""
    client.subscribe("/cam0/depth")
    served.until_tapped("/cam0/depth")
    depth = np.random.default_rng(1).random((20, H, W), np.float32)
    served.send("/cam0/depth", Depth(Header(MS), depth))
    texts = [client.status()["message"] for _ in range(2)]
    assert texts[0].startswith("/cam0/depth has 20 environments: they are on /env0/cam0/depth")
    assert texts[1] == f"of 20 environments the first {MOST_ENVS} have channels; the others are left out"
    assert f"/env{MOST_ENVS - 1}/cam0/depth" in client.channels and f"/env{MOST_ENVS}/cam0/depth" not in client.channels
    client.subscribe("/env15/cam0/depth")
    image = client.read("/env15/cam0/depth", lambda: served.send("/cam0/depth", Depth(Header(2 * MS), depth)))
    assert np.array_equal(np.frombuffer(image.data, "<f4"), depth[15].ravel())
    with Foxglove(served.address) as later:
        assert "/env15/cam0/depth" in later.channels and "16" in later.status()["message"]
