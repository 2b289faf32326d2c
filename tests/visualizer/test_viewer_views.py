"""What the panels get, against values worked out by hand."""

from __future__ import annotations

import dataclasses
import io
import json
import math
import tracemalloc

import numpy as np
import pytest
from PIL import Image
from synthetic_graph import HEIGHT, WIDTH, events_at, images_at, labels_at

from evis.media.colour import srgb_from_linear
from msgs.camera import Depth, EventPacket, Frames, Ids, Imu, Keyframe, Motion, Trigger
from msgs.camera import Image as ImageMessage
from msgs.diagnostics import Diagnostics
from msgs.header import Header
from msgs.world import Clock
from nodes.visualizer import colour
from nodes.visualizer.catalog import VIEWS, make_view
from nodes.visualizer.session import bundle
from nodes.visualizer.statistics import Meter, Statistics, plain
from nodes.visualizer.views.events import MAX_EVENTS, MAX_PACKETS, EventView, newest_of_pixels
from nodes.visualizer.views.images import MAX_SIDE, ImageView
from nodes.visualizer.views.part import PanelPart

WORD = 6
"""Bytes of one event of a part: a word and an age."""
MS = 1_000_000


def unpack(payload: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x, y, p of the words, by the layout that the page's script reads."""
    words = np.frombuffer(payload, "<u4", len(payload) // WORD)
    return words & 0x3FFF, words >> 14 & 0x3FFF, words >> 31


def test_events_survive_packing() -> None:
    view = EventView("events", 0)
    packet = events_at(3)
    view.capture(packet)
    part = view.render(0)
    assert part is not None
    x, y, p = unpack(part.payload)
    assert np.array_equal(x, packet.x) and np.array_equal(y, packet.y) and np.array_equal(p, packet.p)
    assert part.meta["events"] == len(packet.x) and part.meta["on"] == int(packet.p.sum())
    assert part.meta["undrawn"] == 0 and part.meta["t"] == packet.header.stamp_ns / 1e9
    assert view.render(part.version) is None


def test_no_events_is_a_part_too() -> None:
    """The picture must fade although nothing happens."""
    view = EventView("events", 0)
    view.capture(events_at(1, n=0))
    part = view.render(0)
    assert part is not None and part.payload == b"" and part.meta["events"] == 0


def spread(k: int, n: int) -> EventPacket:
    """n events, each on a pixel of its own, on a large sensor."""
    pixel = np.arange(n)
    x, y = (pixel % 1280).astype(np.uint16), (pixel // 1280).astype(np.uint16)
    t, offsets = np.full(n, k, np.int64), np.array([0, n], np.int64)
    return EventPacket(Header(k, k), offsets, t, x, y, np.ones(n, np.uint8), width=1280, height=720, t0_ns=k - 1)


def test_huge_packets_are_thinned_and_counted() -> None:
    view = EventView("events", 0)
    n = 3 * MAX_EVENTS + 17
    view.capture(spread(1, n))
    part = view.render(0)
    assert part is not None
    drawn = len(part.payload) // WORD
    assert drawn <= MAX_EVENTS and drawn > MAX_EVENTS // 2
    assert part.meta["events"] == n and part.meta["undrawn"] == n - drawn
    for k in range(2, 8):
        view.capture(spread(k, MAX_EVENTS // 2))
    part = view.render(part.version)
    assert part is not None and len(part.payload) // WORD <= MAX_EVENTS
    assert part.meta["events"] == 6 * (MAX_EVENTS // 2)
    assert part.meta["undrawn"] == part.meta["events"] - len(part.payload) // WORD


@pytest.mark.parametrize("per_pixel", [1, 3])
def test_a_flash_of_all_pixels_is_thinned_without_stripes(per_pixel: int) -> None:
    """Of 1280 x 720 pixels that fire at once as many are drawn in each column as in the others, and in each row."""
    width, height = 1280, 720
    y, x = (np.tile(part.astype(np.uint16), per_pixel) for part in np.divmod(np.arange(width * height), width))
    t = np.repeat(np.arange(per_pixel, dtype=np.int64) * MS, width * height)
    view = EventView("events", 0)
    offsets = np.array([0, len(x)])
    view.capture(
        EventPacket(Header(33 * MS, 1), offsets, t, x, y, np.ones(len(x), np.uint8), width=width, height=height)
    )
    part = view.render(0)
    assert part is not None
    words = np.frombuffer(part.payload, "<u4", len(part.payload) // WORD)
    for place, size in ((words & 0x3FFF, width), (words >> 14 & 0x3FFF, height)):
        drawn = np.bincount(place, minlength=size) / (len(words) / size)
        assert len(drawn) == size and drawn.min() > 0.5 and drawn.max() < 1.5


def test_dense_packets_lose_only_what_is_painted_over() -> None:
    """More events than pixels: the picture is that of all of them in order, and nothing counts as not drawn."""
    packet = events_at(1, n=200_000)
    expected = {}
    for x, y, p in zip(packet.x.tolist(), packet.y.tolist(), packet.p.tolist()):
        expected[x, y] = p
    view = EventView("events", 0)
    view.capture(packet)
    part = view.render(0)
    assert part is not None and part.meta["events"] == 200_000 and part.meta["undrawn"] == 0
    x, y, p = unpack(part.payload)
    assert {(a, b): c for a, b, c in zip(x.tolist(), y.tolist(), p.tolist())} == expected
    assert len(x) == len(expected)


def test_a_sensor_of_any_size_costs_what_its_events_do() -> None:
    """A recording may say 16384 x 16384: the newest of each pixel are found as for a small one, without its table."""
    rng = np.random.default_rng(5)
    x, y = (rng.integers(0, 60, 20_000).astype(np.uint16) for _ in range(2))
    tracemalloc.start()
    try:
        large = newest_of_pixels(x, y, 1 << 14, 1 << 14)
        assert tracemalloc.get_traced_memory()[1] < 16e6
    finally:
        tracemalloc.stop()
    newest = {(a, b): i for i, (a, b) in enumerate(zip(x.tolist(), y.tolist()))}
    assert large.tolist() == [newest[key] for key in sorted(newest, key=lambda key: (key[1], key[0]))]
    assert np.array_equal(newest_of_pixels(x, y, 60, 60), large)


def test_environments_are_told_apart() -> None:
    packet = events_at(1, n=40, envs=3)
    for env in range(3):
        view = EventView("events", env)
        view.capture(packet)
        part = view.render(0)
        assert part is not None
        assert np.array_equal(unpack(part.payload)[0], packet.x[40 * env : 40 * env + 40])


def test_events_outside_the_sensor_are_left_out_and_said() -> None:
    view = EventView("events", 0)
    view.capture(events_at(1, n=100, bad=True))
    part = view.render(0)
    assert part is not None and len(part.payload) == WORD * 97
    assert part.meta["note"] == "3 events outside the sensor" and part.meta["undrawn"] == 3


def test_raw_packets_are_said_not_guessed() -> None:
    view = EventView("events", 0)
    raw = np.zeros(4, np.uint8)
    view.capture(EventPacket(Header(5), np.zeros(2, np.int64), raw=raw, encoding="evt3", width=4, height=4))
    part = view.render(0)
    assert part is not None and part.payload == b"" and "evt3" in part.meta["note"]


def test_a_new_episode_forgets_the_old_events() -> None:
    view = EventView("events", 0)
    view.capture(events_at(1, n=10))
    first = view.render(0)
    view.capture(events_at(2, n=10))
    again = events_at(1, n=7)
    again.header = dataclasses.replace(again.header, episode=1)
    view.capture(again)
    part = view.render(first.version if first else 0)
    assert part is not None and part.meta["episode"] == 1 and part.meta["events"] == 7


def test_a_client_that_is_behind_gets_a_bounded_backlog() -> None:
    view = EventView("events", 0)
    view.capture(events_at(1, n=10))
    first = view.render(0)
    for k in range(2, 2 + 3 * MAX_PACKETS):
        view.capture(events_at(k, n=10))
    part = view.render(first.version if first else 0)
    assert part is not None and len(part.payload) == WORD * 10 * MAX_PACKETS
    assert part.meta["events"] == 10 * 3 * MAX_PACKETS and part.meta["undrawn"] == 10 * 2 * MAX_PACKETS


def picture(view: ImageView) -> np.ndarray:
    """The decoded picture of a view's newest part."""
    part = view.render(0)
    assert part is not None
    return np.asarray(Image.open(io.BytesIO(part.payload)))


def test_a_single_pixel_of_an_instance_has_the_colour_of_the_legend() -> None:
    """And its neighbours theirs: what stands for a value is not smeared."""
    ids = np.ones((1, 13, 17), np.int32)
    ids[0, 3:6, 4:8], ids[0, 1, 14] = 3, 2
    view = ImageView("ids", 0)
    view.capture(Ids(Header(0), ids))
    found, part = picture(view), view.render(0)
    assert part is not None
    for number, written in part.meta["instances"]["shown"]:
        assert (found[ids[0] == number] == [int(written[k : k + 2], 16) for k in (1, 3, 5)]).all()


def test_nothing_moves_beside_what_moves() -> None:
    """A still pixel of a small picture is as dark as one without any motion near."""
    motion = np.zeros((1, 16, 16, 2), np.float32)
    motion[0, 5:9, 5:9] = 7, -7
    view = ImageView("motion", 0)
    view.capture(Motion(Header(0), motion))
    found = picture(view)
    still = found[0, 0]
    assert (found[(motion[0] == 0).all(axis=-1)] == still).all() and found[6, 6].max() > 3 * still.max()


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_an_image_of_two_channels(dtype: type) -> None:
    """As other programs record it: its first channel is shown in grey, and that is said."""
    data = np.zeros((16, 16, 2), dtype)
    data[:8, :, 0], data[:, :8, 1] = np.iinfo(dtype).max if dtype != np.float32 else 1, 1
    view = ImageView("image", 0)
    view.capture(ImageMessage(Header(0), data, "two"))
    part = view.render(0)
    assert part is not None and part.meta["note"] == "channel 1 of 2"
    found = np.asarray(Image.open(io.BytesIO(part.payload))).astype(int)
    assert found.shape == (16, 16) and found[:7].min() > found[9:].max() + 100 and np.ptp(found[:7]) < 5


def test_depth_that_is_not_a_number() -> None:
    """Near is lighter than far, sky is empty, NaN and what lies behind the camera stand out and are counted."""
    depth = np.full((8, 8), 2.0, np.float32)
    depth[:4] = 1.0
    depth[7] = np.inf
    depth[6] = (np.nan, -np.inf, -1, 0, 2, 2, 2, 2)
    result, near, far, bad = colour.depth_colours(depth, colour.Smoothed())
    assert bad == 4 and (result[6, :4] == colour.UNKNOWN).all()
    assert (result[7] == colour.EMPTY).all()
    assert result[0, 0].astype(int).sum() > result[5, 0].astype(int).sum() + 200
    assert near == pytest.approx(1.0) and far == pytest.approx(2.0)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 0.0, 1e-40, 1e38, -5.0])
def test_maps_of_one_value_do_not_fail(value: float) -> None:
    """Degenerate images: no limits can be had from them, and no warning may come either."""
    plane = np.full((6, 5), value, np.float32)
    with np.errstate(all="raise", under="ignore"):
        assert colour.depth_colours(plane, colour.Smoothed())[0].shape == (6, 5, 3)
        assert colour.tone_map(plane, colour.Smoothed())[0].shape == (6, 5)
        assert colour.tone_map(np.repeat(plane[..., None], 3, -1), colour.Smoothed())[0].shape == (6, 5, 3)
        assert colour.normal_colours(np.repeat(plane[..., None], 3, -1))[0].shape == (6, 5, 3)
        assert colour.flow_colours(np.repeat(plane[..., None], 2, -1), colour.Smoothed())[0].shape == (6, 5, 3)


def test_tone_map_is_monotone_and_holds_a_bright_lamp() -> None:
    """More radiance is never darker, and one pixel of 1e6 does not turn the rest black."""
    radiance = np.geomspace(0.01, 10, 4096, dtype=np.float32).reshape(64, 64)
    result, bad = colour.tone_map(radiance, colour.Smoothed())
    assert bad == 0 and (np.diff(result.reshape(-1).astype(int)) >= 0).all()
    lamp = np.full((64, 64), 1.0, np.float32)
    lamp[0, 0] = 1e6
    assert 90 < colour.tone_map(lamp, colour.Smoothed())[0][32, 32] < 200


def test_exposure_does_not_jump() -> None:
    """The first frame sets the exposure at once; a later one a hundred times brighter moves it slowly."""
    exposure = colour.Smoothed()
    frame = np.linspace(0.5, 1.5, 400, dtype=np.float32).reshape(20, 20)
    first, _ = colour.tone_map(frame, exposure)
    assert np.array_equal(first, colour.tone_map(frame, exposure)[0])
    fresh, _ = colour.tone_map(100 * frame, colour.Smoothed())
    assert np.abs(fresh.astype(int) - first).max() <= 2  # exposure is relative; the curve is looked up in steps
    jump, _ = colour.tone_map(100 * frame, exposure)
    assert jump.mean() > first.mean() + 40


def test_a_black_start_does_not_set_the_exposure() -> None:
    frame = np.linspace(0.5, 1.5, 400, dtype=np.float32).reshape(20, 20)
    exposure = colour.Smoothed()
    assert colour.tone_map(np.zeros_like(frame), exposure)[0].max() == 0
    assert np.array_equal(colour.tone_map(frame, exposure)[0], colour.tone_map(frame, colour.Smoothed())[0])


def test_flow_directions_have_their_own_hues() -> None:
    flow = np.zeros((1, 5, 2), np.float32)
    flow[0, :4] = [(1, 0), (0, 1), (-1, 0), (0, -1)]
    result, full, unknown = colour.flow_colours(flow, colour.Smoothed())
    assert full == pytest.approx(1.0) and unknown == 0
    apart = [np.abs(result[0, i].astype(int) - result[0, j]).max() for i in range(4) for j in range(i)]
    assert min(apart) > 60
    assert result[0, 4].max() < 40  # no motion is dark
    flow[0, 0] = np.nan
    result, _, unknown = colour.flow_colours(flow, colour.Smoothed())
    assert unknown == 1 and (result[0, 0] == colour.EMPTY).all()


def test_srgb_is_the_standard() -> None:
    """IEC 61966-2-1: 0.5 linear is 188, 0.0031308 is the knee of both pieces."""
    assert round(255 * float(srgb_from_linear(np.array(0.5)))) == 188
    assert float(srgb_from_linear(np.array(0.0031308))) == pytest.approx(12.92 * 0.0031308)
    assert float(srgb_from_linear(np.array(1.0))) == pytest.approx(1.0)


def test_margin_is_cropped_and_large_images_are_thinned() -> None:
    radiance = np.zeros((1, 20, 30, 3), np.float32)
    radiance[:, 4:16, 4:26] = 1
    view = ImageView("radiance", 0)
    view.capture(Keyframe(Header(0), np.zeros(1, np.int32), radiance, margin=4))
    shown = picture(view)
    assert shown.shape == (12, 22, 3) and shown.min() > 60
    view = ImageView("depth", 0)
    view.capture(Depth(Header(0), np.ones((1, 100, 2 * MAX_SIDE + 1), np.float32)))
    part = view.render(0)
    assert part is not None and part.meta["width"] == 2 * MAX_SIDE + 1
    assert Image.open(io.BytesIO(part.payload)).size[0] <= MAX_SIDE


@pytest.mark.parametrize(
    ("data", "encoding", "expected"),
    [
        (np.full((4, 4, 1), 77, np.uint8), "mono8", (77,)),
        (np.full((4, 4, 1), 77 * 256, np.uint16), "mono16", (77,)),
        (np.tile(np.array([200, 30, 60], np.uint8), (4, 4, 1)), "rgb8", (200, 30, 60)),
        (np.tile(np.array([60, 30, 200], np.uint8), (4, 4, 1)), "bgr8", (200, 30, 60)),
    ],
)
def test_camera_images_keep_their_values(data: np.ndarray, encoding: str, expected: tuple[int, ...]) -> None:
    """To within JPEG's rounding: 6 of 255."""
    view = ImageView("image", 0)
    view.capture(ImageMessage(Header(0), data, encoding))
    assert np.abs(np.atleast_1d(picture(view)[2, 2]).astype(int) - expected).max() <= 6


def test_an_image_of_another_environment_is_passed_by() -> None:
    """Images come one by one, each of its environment; a panel of one that is not there shows the last."""
    views = [ImageView("image", env) for env in (0, 1, 7)]
    for env in (0, 1):
        image = ImageMessage(Header(0), np.full((4, 4, 1), 60 + 100 * env, np.uint8), "mono8", 1, 0, env, 2)
        for view in views:
            view.capture(image)
    assert [round(float(picture(view)[2, 2]), -1) for view in views] == [60, 160, 160]


def test_frames_show_the_last_one() -> None:
    luminance = np.stack([np.full((8, 8), 1e-3, np.float32), np.tile(np.linspace(0, 1, 8, dtype=np.float32), (8, 1))])
    view = ImageView("luminance", 0)
    view.capture(Frames(Header(9), np.array([4, 9]), np.zeros(1, np.int32), luminance=luminance[None]))
    shown = picture(view)
    assert shown[0, 7] > shown[0, 0] + 100


def test_captured_arrays_are_copies() -> None:
    """The graph writes the next message into the same memory."""
    keyframe = images_at(1)["/cam0/keyframe"]
    view = ImageView("radiance", 0)
    view.capture(keyframe)
    keyframe.radiance[:] = 0  # type: ignore[attr-defined]
    assert picture(view).std() > 20
    packet = events_at(1)
    events = EventView("events", 0)
    events.capture(packet)
    before = packet.x.copy()
    packet.x[:] = 0
    part = events.render(0)
    assert part is not None and np.array_equal(unpack(part.payload)[0], before)


def test_labels_without_what_is_asked() -> None:
    """A graph that makes boxes alone says so instead of an image."""
    labels = dataclasses.replace(labels_at(1), flow=None, segmentation=None)
    view = ImageView("flow", 0)
    view.capture(labels)
    part = view.render(0)
    assert (
        part is not None
        and part.payload == b""
        and part.meta["note"] == "no flow in these labels; labels:=flow asks for it"
    )


def test_instances_in_view_are_named_by_colour() -> None:
    view = ImageView("segmentation", 0)
    view.capture(labels_at(4))
    part = view.render(0)
    assert part is not None and [i for i, _ in part.meta["instances"]["shown"]] == [1, 2]
    assert part.meta["instances"]["more"] == 0
    for instance, css in part.meta["instances"]["shown"]:
        rows, columns = np.nonzero(labels_at(4).segmentation[0] == instance)
        middle = np.argsort(np.hypot(rows - rows.mean(), columns - columns.mean()))[0 if instance == 1 else -1]
        shown = picture(view)[rows[middle], columns[middle]]
        wanted = [int(css[i : i + 2], 16) for i in (1, 3, 5)]
        assert np.abs(shown.astype(int) - wanted).max() < 40


def test_not_finite_numbers_are_strict_json() -> None:
    view = make_view("Imu", "samples", 0, 80)
    view.capture(Imu(Header(1), np.array([1]), np.array([[np.nan, np.inf, 1.0]]), np.zeros((1, 3))))
    part = view.render(0)
    assert part is not None
    text = bundle([("a", part)])[4:]
    assert json.loads(text.rstrip(b"\0 "))[0]["samples"][0][1:4] == ["nan", "inf", 1.0]
    assert plain({"a": [np.float32(2), np.nan, None, object]})["a"][:3] == [2.0, "nan", None]


def test_every_view_of_the_catalog_can_be_made() -> None:
    for message_type, views in VIEWS.items():
        for view in views:
            assert make_view(message_type, view, 0, 80).render(0) is None
    with pytest.raises(ValueError, match="EventPacket has no view 'x'; it has events"):
        make_view("EventPacket", "x", 0, 80)


def test_a_bundle_of_numbers_that_are_none_is_strict_json() -> None:
    """A recording's inf must not end what the page gets."""
    data = bundle([("d", PanelPart("image", 1, {"legend": {"to": math.inf, "from": [math.nan, 1.5]}}))])
    length = int.from_bytes(data[:4], "little")
    (part,) = json.loads(data[4 : 4 + length], parse_constant=lambda word: pytest.fail(word))
    assert part["legend"] == {"to": "inf", "from": ["nan", 1.5]}


def test_payloads_start_aligned() -> None:
    """The page reads events as 32-bit words straight out of the bundle."""
    data = bundle([("a", PanelPart("image", 1, {}, b"12345")), ("b", PanelPart("events", 1, {}, b"abcdefgh"))])
    assert data.index(b"12345") % 4 == 0 and data.index(b"abcdefgh") % 4 == 0


def test_meter_measures_a_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    meter, now = Meter(), 100.0
    monkeypatch.setattr("nodes.visualizer.statistics.time.monotonic", lambda: now)
    for i in range(100):
        meter.add(now - 2 + 0.02 * i, 7 * i)
    assert meter.rate() == pytest.approx(350)
    meter.add(now, 3)  # the node came back and counts from zero
    assert meter.rate() == 0.0


def test_real_time_factor_is_of_the_last_moments(monkeypatch: pytest.MonkeyPatch) -> None:
    """A device's clock starts anywhere: a recording from 7 s on that plays at half speed shows 0.5."""
    now = [100.0]
    monkeypatch.setattr("nodes.visualizer.statistics.time.monotonic", lambda: now[0])
    statistics = Statistics()
    for k in range(100):
        now[0] = 100 + 0.02 * k
        statistics.saw("/clock", Clock(Header(7_000_000_000 + 10_000_000 * k), real_time_factor=5.0))
    assert statistics.snapshot()["clock"]["rtf"] == pytest.approx(0.5)


def test_two_cameras_have_two_clocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Time and factor are those of one, and of the other where that has ended; never of the step between them."""
    now = [100.0]
    monkeypatch.setattr("nodes.visualizer.statistics.time.monotonic", lambda: now[0])
    statistics = Statistics()
    for k in range(300):
        now[0] = 100 + 0.02 * k
        if k < 100:
            statistics.saw("/clock", Clock(Header(10_000_000 * k, clock="device:a")))
        statistics.saw("/clock", Clock(Header(1_600_000_000_000_000_000 + 5_000_000 * k, clock="device:b")))
        if k in (99, 299):
            shown = statistics.snapshot()["clock"]
            assert shown["clock"] == ("device:a" if k == 99 else "device:b")
            assert shown["rtf"] == pytest.approx(0.5 if k == 99 else 0.25)


def test_a_graph_that_hangs_has_no_real_time_factor(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor do its heartbeats count as news: only what it publishes does."""
    now = [100.0]
    monkeypatch.setattr("nodes.visualizer.statistics.time.monotonic", lambda: now[0])
    statistics = Statistics()
    assert statistics.snapshot()["quiet_s"] is None
    lives = lambda published: Diagnostics(Header(0), node="a", values={"published": {"/cam0/events": published}})
    for k in range(100):
        now[0] = 100 + 0.02 * k
        statistics.saw("/clock", Clock(Header(10_000_000 * k)))
        assert ("rtf" in statistics.snapshot()["clock"]) == (k > 0)  # of one stamp there is none
        statistics.saw("/diagnostics", lives(k))
    for _ in range(10):
        now[0] += 1
        statistics.saw("/diagnostics", lives(99))
    assert statistics.snapshot()["clock"]["rtf"] == 0 and statistics.snapshot()["quiet_s"] == 10
    statistics.saw("/diagnostics", lives(100))  # of a topic that nobody looks at
    assert statistics.snapshot()["quiet_s"] == 0
    now[0] += 60
    statistics.forget("/diagnostics")  # the last page was closed, and it is opened again
    assert statistics.snapshot()["quiet_s"] is None


def test_the_time_of_a_recording_is_that_of_its_round() -> None:
    """What came in an earlier round, of a topic that is closed by now or rare, is later than what is played."""
    statistics, none = Statistics(), np.empty(0, np.uint8)
    at = lambda topic, k, episode: statistics.saw(
        topic, Trigger(Header(k * 10**9, k, episode=episode), none, none, none)
    )
    at("/cam0/trigger", 7, 0)
    at("/cam0/events", 8, 0)
    at("/cam0/events", 1, 1)
    assert statistics.snapshot()["clock"] == {"t": 1.0}
    at("/cam0/image", 2, 1)
    statistics.forget("/cam0/image")
    assert statistics.snapshot()["clock"] == {"t": 1.0}


def test_gaps_in_the_sequence_are_counted() -> None:
    statistics = Statistics()
    for k in (1, 2, 5, 6):
        statistics.saw("/cam0/events", events_at(k, n=5))
    assert statistics.snapshot()["topics"]["/cam0/events"]["skipped"] == 2
    statistics.forget("/cam0/events")
    statistics.saw("/cam0/events", events_at(90, n=5))
    assert statistics.snapshot()["topics"]["/cam0/events"]["skipped"] == 2
    statistics.saw("/cam0/events", events_at(3, n=5))  # of a publisher that was started again: 0 to 2 did not come
    assert statistics.snapshot()["topics"]["/cam0/events"]["skipped"] == 5


def test_sizes_of_the_synthetic_scene() -> None:
    """The pictures of the other tests are of this size."""
    assert images_at(1)["/cam0/keyframe"].radiance.shape == (1, HEIGHT, WIDTH, 3)  # type: ignore[attr-defined]
