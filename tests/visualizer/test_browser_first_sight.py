"""What somebody sees who opens the page for the first time: which panels, what they call things, what fits where."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser_panels import pixels, wait_for_picture
from page_show import (
    HEIGHT,
    MS,
    SHELVES,
    WIDTH,
    Show,
    camera_info,
    events,
    graph,
    labelled,
    warehouse,
    with_topics,
    world,
)

from evis.bag.writer import BagWriter
from evis.runtime.plan import NodePlan
from msgs.camera import Image, Imu, Labels
from msgs.diagnostics import Diagnostics
from msgs.header import Header, Message
from msgs.world import Clock

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")


def file_without_frames(k: int) -> dict[str, Message]:
    """Rounds of ten packets, as `again` plays them."""
    return {"/cam0/info": camera_info(), "/cam0/events": events((k - 1) % 10 + 1, episode=(k - 1) // 10)}


def test_file_without_frames_has_no_empty_panel(show: Callable[..., Show], tmp_path: Path) -> None:
    """Nothing waits in a half of the screen, and what is opened by hand and stays empty is low."""
    page = show(graph(tmp_path, file="/data/line.raw", again=True))
    page.play(file_without_frames, lambda: page.tab.locator("#state").inner_text().startswith("rec"), "a picture")
    assert page.panels() == ["/cam0/events", "rates", "graph"]
    assert page.tab.locator(".waiting:visible").count() == 0
    rates, pictures = page.box("[data-panel=rates]"), page.box('[data-panel="/cam0/events"]')
    assert rates["y"] == pictures["y"]  # beside it, not below an empty half
    page.tab.locator('nav button[title^="/cam0/image"]').click()
    empty = page.tab.locator('[data-panel="/cam0/image"] .stage')
    playwright.expect(empty).to_contain_text("not every camera or file has these")
    assert empty.bounding_box()["height"] <= 100


def test_frames_open_a_panel_when_they_come(show: Callable[..., Show], tmp_path: Path) -> None:
    """Before the events, where a graph that is sure to have pictures has them too."""
    page = show(graph(tmp_path, file="/data/davis.aedat4"))

    def messages(k: int) -> dict[str, Message]:
        image = Image(Header(k * 33 * MS, k), np.full((HEIGHT, WIDTH, 1), 90, np.uint8), "mono8")
        return {**file_without_frames(k), **({"/cam0/image": image} if k > 5 else {})}

    page.play(messages, lambda: "/cam0/image" in page.panels(), "the panel of the frames")
    assert page.panels() == ["/cam0/image", "/cam0/events", "rates", "graph"]
    wait_for_picture(page.tab, "/cam0/image")


def test_recording_says_where_it_is(show: Callable[..., Show], tmp_path: Path) -> None:
    """Not live, by its file's name, with its position; rounds are no episodes and tell its length."""
    page = show(graph(tmp_path, file="/data/line.raw", again=True))
    state = page.tab.locator("#state")
    page.play(file_without_frames, lambda: state.inner_text().endswith(" of 0.3 s"), "the length after a round")
    assert state.inner_text().startswith("recording 0.")
    assert page.tab.locator("#run").inner_text() == "line.raw" and "line.raw" in page.tab.title()
    assert "episode" not in page.tab.locator('[data-panel="/cam0/events"] .foot').inner_text()


def test_recording_that_begins_before_0_says_where_it_is(show: Callable[..., Show], tmp_path: Path) -> None:
    """Its description is of no time before 0; from -0.198 s to 0.132 s are 0.3 s."""
    page = show(graph(tmp_path, file="/data/line.raw", again=True))

    def early(k: int) -> dict[str, Message]:
        packet = events((k - 1) % 10 + 1, episode=(k - 1) // 10)
        packet.header.stamp_ns -= 231 * MS
        packet.t0_ns -= 231 * MS
        packet.t = packet.t - 231 * MS
        return {"/cam0/info": camera_info(), "/cam0/events": packet}

    state, seen = page.tab.locator("#state"), set[str]()

    def twice() -> bool:
        seen.add(state.inner_text())
        return "recording 0.2 of 0.3 s" in seen and "recording 0.3 of 0.3 s" in seen

    page.play(early, twice, "the place in the second round")


def test_place_in_a_part_of_a_bag_counts_from_where_it_begins(show: Callable[..., Show], tmp_path: Path) -> None:
    """From 1 s to 2 s of 3 s; the camera's description, which is kept, is of 0 s."""
    with BagWriter(tmp_path / "a.mcap") as bag:
        for stamp_ns in (0, 3_000_000_000):
            bag.write("/cam0/info", camera_info(stamp_ns))
    plan = graph(tmp_path)
    params = {"bag": str(tmp_path / "a.mcap"), "start": 1.0, "duration": 1.0}
    plan.nodes["camera"].target, plan.nodes["camera"].params = "nodes.replayer.node:ReplayerNode", params
    page, state = show(plan), set[str]()

    def part(k: int) -> dict[str, Message]:
        return {"/cam0/info": camera_info(), "/cam0/events": events(30 + k % 30)}

    def full() -> bool:
        state.add(page.tab.locator("#state").inner_text())
        return "recording 0.9 of 1.0 s" in state

    page.play(part, full, "a place in the part")


def test_place_in_a_recording_is_not_that_of_another(show: Callable[..., Show], tmp_path: Path) -> None:
    """Two recordings have clocks of their own, whose times may be 50 years apart."""
    plan = graph(tmp_path, file="/data/left.raw")
    plan.nodes["right"] = NodePlan("right", "nodes.camera.node:CameraNode", {"file": "/data/right.raw"}, "right")
    page = show(with_topics(plan, "right", {"/right/events": "EventPacket", "/right/info": "CameraInfo"}))

    def both(k: int) -> dict[str, Message]:
        today = events(k)
        today.header.stamp_ns += 16 * 10**17
        info = camera_info(16 * 10**17)
        return {"/right/info": info, "/right/events": today, "/cam0/info": camera_info(), "/cam0/events": events(k)}

    feet = page.tab.locator('[data-panel="/cam0/events"] .foot'), page.tab.locator('[data-panel="/right/events"] .foot')
    # The place is written a moment after the panels are.
    placed = lambda: re.match(r"recording \d", page.tab.locator("#state").inner_text())
    page.play(both, lambda: placed() and all("events" in foot.inner_text() for foot in feet), "both cameras")
    seen = set[str]()
    for k in range(100, 110):
        page.send(both(k))
        seen.add(page.tab.locator("#state").inner_text())
    assert all(re.fullmatch(r"recording [0-3]\.\d s", state) for state in seen), seen


def test_bag_of_environments_opens_with_the_events(show: Callable[..., Show], tmp_path: Path) -> None:
    """The preview of the first environment belongs to its camera, and shows whichever environment is chosen."""
    plan = graph(tmp_path)
    plan.nodes["camera"].target, plan.nodes["camera"].params = "nodes.replayer.node:ReplayerNode", {"bag": "a.mcap"}
    plan.args["envs"], plan.topics["/env0/cam0/image"] = 2, plan.topics.pop("/cam0/image")
    plan.topics["/env0/cam0/image"].name = "/env0/cam0/image"
    page = show(plan)
    assert page.panels() == ["/env0/cam0/image", "/cam0/events", "rates", "graph"]
    preview = page.tab.locator('[data-panel="/env0/cam0/image"]')
    assert preview.get_by_title("Environment").count() == 0
    page.tab.locator("nav select").select_option("1")
    image = lambda k: Image(Header(k * 33 * MS, k), np.full((HEIGHT, WIDTH, 1), 90, np.uint8), "mono8", env=0, envs=2)
    waiting = preview.locator(".waiting")
    page.play(lambda k: {"/env0/cam0/image": image(k)}, lambda: not waiting.is_visible(), "the preview")


def test_camera_is_live_and_counts_episodes(show: Callable[..., Show], tmp_path: Path) -> None:
    """A device that came back has a new episode."""
    page = show(graph(tmp_path, serial="00000123"))
    foot = page.tab.locator('[data-panel="/cam0/events"] .foot')
    page.play(file_without_frames, lambda: "episode 1" in foot.inner_text(), "the second episode")
    assert page.tab.locator("#state").inner_text() == "live"


def share_of_full_colour(shown: np.ndarray) -> float:
    """Of the pixels that are not dark, those as bright as a new event."""
    lit = shown.max(axis=-1) > 24
    full = (np.abs(shown - (255, 173, 77)).max(axis=-1) < 12) | (np.abs(shown - (85, 168, 255)).max(axis=-1) < 12)
    return float((full & lit).sum() / max(lit.sum(), 1))


@pytest.mark.parametrize(("turns", "n"), [(0.3, 60_000), (2.0, 60_000)])
def test_fast_disk_does_not_saturate(show: Callable[..., Show], tmp_path: Path, turns: float, n: int) -> None:
    """In 33 ms every pixel of the disk has many events; what is drawn are edges that fade, not two colours."""
    page = show(graph(tmp_path, serial="1"))
    packet = [events(k, turns=turns, n=n) for k in range(1, 6)]
    head, last = packet[:-1], packet[-1]
    for message in head:
        page.send({"/cam0/info": camera_info(), "/cam0/events": message})
    foot = page.tab.locator('[data-panel="/cam0/events"] .foot')
    page.play(lambda k: {"/cam0/events": last}, lambda: "window" in foot.inner_text(), "the window")
    shown = pixels(page.tab, "/cam0/events")
    lit = shown.max(axis=-1) > 24
    assert lit.sum() > 500
    assert share_of_full_colour(shown) < 0.3
    assert len(np.unique(shown.reshape(-1, 3), axis=0)) > 30
    window = float(foot.inner_text().split("window ")[1].split()[0])
    assert foot.inner_text().split("window ")[1].split()[1] == "ms" and 0.1 <= window < 20


def test_slow_line_is_seen_long(show: Callable[..., Show], tmp_path: Path) -> None:
    """Where pixels fire once, the window is as long as it may be, so that something is to be seen."""
    page = show(graph(tmp_path, serial="1"))
    foot = page.tab.locator('[data-panel="/cam0/events"] .foot')
    long = lambda: "window" in (text := foot.inner_text()) and float(text.split("window ")[1].split()[0]) > 20
    page.play(lambda k: {"/cam0/events": events(k, n=60)}, long, "a long window")


def test_newest_packet_alone_is_all_as_new(show: Callable[..., Show], tmp_path: Path) -> None:
    page = show(graph(tmp_path, serial="1"))
    page.tab.locator('[data-panel="/cam0/events"] select').select_option("packet")
    foot = page.tab.locator('[data-panel="/cam0/events"] .foot')
    packet = events(9, n=60)
    page.play(lambda k: {"/cam0/events": packet}, lambda: "newest packet" in foot.inner_text(), "a packet")
    shown = pixels(page.tab, "/cam0/events")
    lit = shown.max(axis=-1) > 24
    assert set(zip(*np.nonzero(lit))) == set(zip(packet.y.tolist(), packet.x.tolist()))
    assert share_of_full_colour(shown) == 1.0


def colours_of_boxes(page: Show) -> set[tuple[int, ...]]:
    """Colours of the lines over the events."""
    found = page.tab.locator('[data-panel="/cam0/events"] canvas.boxes').evaluate(
        """c => [...new Set(new Uint32Array(c.getContext("2d").getImageData(0, 0, c.width, c.height).data.buffer))]"""
    )
    return {(w & 255, w >> 8 & 255, w >> 16 & 255) for w in found if w >> 24 == 255}


def rgb(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in text[text.index("(") + 1 : text.index(")")].split(","))


def test_boxes_can_be_read(show: Callable[..., Show], tmp_path: Path) -> None:
    """Of 94 boxes the two of what moves and is large enough, in the colour of their class; the rest on demand."""
    page = show(warehouse(tmp_path, ["boxes", "segmentation"]))
    note = page.tab.locator('[data-panel="/cam0/events"] .box-note')
    page.play(
        labelled, lambda: note.is_visible() and note.inner_text().startswith("2 boxes"), "the boxes of what moves"
    )
    assert f"{SHELVES + 1} static not shown" in note.inner_text() and "1 under 10 px" in note.inner_text()
    chips = note.locator(".chip")
    assert chips.all_inner_texts() == ["forklift"]
    colour = rgb(chips.first.locator("i").evaluate("i => getComputedStyle(i).backgroundColor"))
    assert colours_of_boxes(page) == {colour}
    page.tab.locator('[data-panel="/cam0/events"]').get_by_label("static").check()
    playwright.expect(note).to_contain_text(f"{SHELVES + 3} boxes, 1 under 10 px")
    assert len(colours_of_boxes(page)) >= 3  # a colour for each class


def test_box_is_named_under_the_pointer(show: Callable[..., Show], tmp_path: Path) -> None:
    page = show(warehouse(tmp_path, ["boxes"]))
    note = page.tab.locator('[data-panel="/cam0/events"] .box-note')
    page.play(
        labelled, lambda: note.is_visible() and note.inner_text().startswith("2 boxes"), "the boxes of what moves"
    )
    stage, tag = (
        page.tab.locator('[data-panel="/cam0/events"] .stage'),
        page.tab.locator('[data-panel="/cam0/events"] .tag'),
    )
    assert not tag.is_visible()
    place = stage.bounding_box()
    point = lambda x, y: (
        place["x"] + place["width"] * (x + 0.5) / WIDTH,
        place["y"] + place["height"] * (y + 0.5) / HEIGHT,
    )
    page.tab.mouse.move(*point(125, 60))
    playwright.expect(tag).to_have_text("forklift_1 (forklift)")
    inside(tag.bounding_box(), place)
    page.tab.mouse.move(*point(2, 2))
    playwright.expect(tag).to_be_hidden()


def test_boxes_are_those_of_the_pictures_time(show: Callable[..., Show], tmp_path: Path) -> None:
    """Labels come by a topic of their own: the newest may be of another time than the events that are shown."""
    page = show(warehouse(tmp_path, ["boxes"]))
    note = page.tab.locator('[data-panel="/cam0/events"] .box-note')
    page.play(labelled, lambda: note.is_visible() and note.inner_text().startswith("2 boxes"), "boxes")
    panel = "evis.panels.find((p) => p.spec.topic === '/cam0/events')"

    def boxes_at(k: int, x0: int) -> dict[str, Message]:
        box = np.array([[x0, 20, x0 + 40, 60]], np.float32)
        forklift = np.array([SHELVES + 2], np.int32)
        return {"/cam0/labels": Labels(Header(k * 33 * MS, k), box=box, box_env=np.zeros(1, np.int32), box_id=forklift)}

    def drawn(expected: int) -> bool:
        return bool(page.tab.evaluate(f"{panel}.boxes.drawn.map((b) => b.x0)") == [expected])

    page.play(lambda _: {**boxes_at(100, 20), "/cam0/events": events(100)}, lambda: drawn(20), "the box of its time")
    arrived = f"Math.round({panel}.inTime.kept.at(-1).t * 1000) === {110 * 33}"
    page.play(lambda _: boxes_at(110, 90), lambda: page.tab.evaluate(arrived), "a later box")
    assert drawn(20) and "the picture" not in note.inner_text()
    page.play(lambda _: {"/cam0/events": events(111)}, lambda: drawn(90), "the box that is nearest")
    assert "33 ms before the picture" in note.inner_text()
    page.play(
        lambda _: {"/cam0/events": events(1, episode=1)}, lambda: not note.is_visible(), "none of an episode before"
    )


def inside(inner: dict[str, float], outer: dict[str, float], slack: float = 0.5) -> None:
    """Whether a rectangle lies in another."""
    assert inner["x"] >= outer["x"] - slack and inner["y"] >= outer["y"] - slack
    assert inner["x"] + inner["width"] <= outer["x"] + outer["width"] + slack
    assert inner["y"] + inner["height"] <= outer["y"] + outer["height"] + slack


def test_labels_that_were_asked_for_are_open(show: Callable[..., Show], tmp_path: Path) -> None:
    """Before the rates, which do not fill the screen; other labels are not offered."""
    page = show(warehouse(tmp_path, ["boxes", "flow", "segmentation", "poses"]))
    labels = ["/cam0/labels segmentation", "/cam0/labels flow"]
    assert page.panels() == ["/cam0/keyframe", "/cam0/events", *labels, "rates", "graph"]
    views = page.tab.locator('[data-panel="/cam0/labels flow"] select[title=View] option').all_inner_texts()
    assert views == ["segmentation", "flow", "objects"]
    assert page.tab.locator('[data-panel="/cam0/events"]').get_by_label("boxes").is_checked()
    wide = lambda k: {**labelled(k), **many_nodes(k)}
    page.play(wide, lambda: page.tab.locator("[data-panel=rates] td").count() > 100, "rates of many nodes")
    assert page.box("[data-panel=rates]")["height"] < 0.45 * 800


def many_nodes(k: int) -> dict[str, Message]:
    """Rates of more nodes and topics than fit on a screen."""
    published = {f"/cam{i}/events": k for i in range(40)}
    values = {"updates": k, "published": published, "counters": {"late_ms": 58.590819999999994}}
    return {"/diagnostics": Diagnostics(Header(k), node=f"node_{k % 40}", values=values)}


@pytest.mark.parametrize(
    ("names", "opened"),
    [
        (["segmentation", "semantic", "flow", "depth", "boxes"], ["segmentation", "semantic", "flow"]),
        (["depth"], ["depth"]),
        (["boxes"], ["objects"]),
    ],
)
def test_labels_of_a_bag_open_with_the_first(
    show: Callable[..., Show], tmp_path: Path, names: list[str], opened: list[str]
) -> None:
    """What they are nobody was told: up to three pictures, else the table; before the rates, in the views' order."""
    plan = graph(tmp_path, again=True)
    plan.nodes["camera"].target, plan.nodes["camera"].params = "nodes.replayer.node:ReplayerNode", {"bag": "a.mcap"}
    page = show(with_topics(plan, "camera", {"/cam0/labels": "Labels"}))
    image, ids = np.ones((1, HEIGHT, WIDTH)), np.ones(1, np.int32)
    flow, box = np.ones((1, HEIGHT, WIDTH, 2), np.float32), np.array([[5, 5, 60, 60]], np.float32)
    dense = {"segmentation": image.astype(np.int32), "semantic": image.astype(np.int32), "flow": flow,
             "depth": image.astype(np.float32), "boxes": box}  # fmt: skip
    given: dict[str, Any] = {name.replace("boxes", "box"): dense[name] for name in names}
    if "boxes" in names:
        given |= {"box_env": 0 * ids, "box_id": ids}
    wanted = ["/cam0/image", "/cam0/events", *(f"/cam0/labels {view}" for view in opened), "rates", "graph"]
    labels = lambda k: {"/cam0/labels": Labels(Header(k * 33 * MS, k), **given)}
    page.play(labels, lambda: page.panels() == wanted, "the panels of the labels")
    for k in range(100, 110):
        page.send(labels(k))
    assert page.panels() == wanted  # and no more of them


def test_list_of_instances_says_how_many_more(show: Callable[..., Show], tmp_path: Path) -> None:
    """Ends in words, scrolls, and no row of it is cut."""
    page = show(warehouse(tmp_path, ["segmentation"]))
    entries = page.tab.locator('[data-panel="/cam0/labels segmentation"] .instances')
    page.play(labelled, lambda: entries.count() and "more" in entries.inner_text(), "the list")
    shown = entries.locator(".chip").count()
    _, _, ids = world()
    foot = page.tab.locator('[data-panel="/cam0/labels segmentation"] .foot')
    assert f"{len(ids)} instances" in foot.inner_text()  # also without scrolling
    assert entries.locator("span").last.inner_text() == f"... and {len(ids) - shown} more" and shown == 64
    cut = """list => { const view = list.getBoundingClientRect();
      const over = (c, y) => c.top < y - 0.5 && c.bottom > y + 0.5;
      return [...list.children].map(c => c.getBoundingClientRect())
        .filter(c => over(c, view.top) || over(c, view.bottom)).length }"""
    assert entries.evaluate(cut) == 0
    assert entries.evaluate("list => { list.scrollTop = 1e6; return list.scrollTop }") > 0
    page.tab.wait_for_timeout(200)
    assert entries.evaluate(cut) == 0


def test_labels_of_axes_stay_in_their_panel(show: Callable[..., Show], tmp_path: Path) -> None:
    """Numbers with a sign and an exponent too: nothing is painted on the canvas's border."""
    page = show(graph(tmp_path, serial="1"))
    page.tab.locator('nav button[title^="/cam0/imu"]').click()
    canvas = page.tab.locator('[data-panel="/cam0/imu"] canvas')

    def samples(k: int) -> dict[str, Message]:
        t = np.linspace((k - 1) * 33 * MS, k * 33 * MS, 8).astype(np.int64)
        wave = -np.abs(np.sin(np.outer(t / 1e9, [2, 3, 5])))
        return {"/cam0/imu": Imu(Header(k * 33 * MS, k), t, wave * 2.345678e8, wave * 0.0567)}

    page.play(samples, lambda: page.tab.locator('[data-panel="/cam0/imu"] .waiting').is_hidden(), "curves")
    border = """c => { const g = c.getContext("2d"), w = c.width, h = c.height;
      const painted = (x, y, dx, dy) => g.getImageData(x, y, dx, dy).data.some((v, i) => i % 4 === 3 && v > 0);
      return [painted(0, 0, 3, h), painted(w - 3, 0, 3, h), painted(0, 0, w, 3), painted(0, h - 3, w, 3)] }"""
    assert canvas.evaluate(border) == [False] * 4


@pytest.mark.parametrize("width", [360, 400, 640, 700, 900, 1280])
def test_all_gauges_can_be_seen(show: Callable[..., Show], tmp_path: Path, width: int) -> None:
    """Drops above all; beside a state that is long, on each width."""
    page = show(graph(tmp_path, file="/data/a_recording_with_a_long_name_of_2024_11_26.aedat4", again=True), width)
    clock = lambda k: {**file_without_frames(k), "/clock": Clock(Header(k * 33 * MS)), **many_nodes(k)}
    page.play(clock, lambda: page.tab.locator("#state").inner_text().endswith(" of 0.3 s"), "a round")
    # Nothing lies over a gauge, and no box that it is in cuts it off: its corners are what can be pointed at there.
    seen = """() => [...document.querySelectorAll("#gauges > div")].map(gauge => [gauge.textContent,
      [...gauge.querySelectorAll("dt, dd")].every(e => { const b = e.getBoundingClientRect();
        const at = x => document.elementFromPoint(x, (b.top + b.bottom) / 2);
        return [b.left + 1, b.right - 1].every(x => e.contains(at(x))) })])"""
    gauges = page.tab.evaluate(seen)
    assert [text for text, whole in gauges if not whole] == []
    assert len(gauges) == 4 and gauges[3][0].startswith("drops")
    header = page.box("header")
    inside(page.box("#state"), header)
    assert page.tab.evaluate("document.documentElement.scrollWidth") <= width


def test_menu_of_a_telephone_lies_over_the_panels(show: Callable[..., Show], tmp_path: Path) -> None:
    page = show(graph(tmp_path, file="/data/line.raw", again=True), 400)
    page.play(file_without_frames, lambda: page.tab.locator("#state").inner_text().startswith("rec"), "a picture")
    before = page.box('[data-panel="/cam0/events"]')
    page.tab.locator("#menu").click()
    nav = page.tab.locator("nav")
    playwright.expect(nav).to_be_visible()
    assert page.box('[data-panel="/cam0/events"]') == before
    page.tab.locator('nav button[title^="/cam0/info"]').click()
    playwright.expect(nav).to_be_hidden()
    assert "/cam0/info" in page.panels()
    page.tab.locator("#menu").click()
    page.tab.mouse.click(390, 400)
    playwright.expect(nav).to_be_hidden()
    close = page.tab.locator('[data-panel="/cam0/events"] button[title=Close]')
    inside(close.bounding_box(), page.box('[data-panel="/cam0/events"]'))


def test_names_of_nodes_stay_in_their_boxes(show: Callable[..., Show], tmp_path: Path) -> None:
    """And a graph of two nodes is not blown up to the panel's width."""
    plan = graph(tmp_path, serial="1")
    plan.nodes["camera"].name = "a_camera_with_quite_a_long_name"
    plan.nodes = {node.name: node for node in plan.nodes.values()}
    for topic in plan.topics.values():
        topic.node = "a_camera_with_quite_a_long_name"
    page = show(plan)
    fits = """svg => [...svg.querySelectorAll(".node")].map(n => {
      const of = name => n.querySelector(name).getBoundingClientRect();
      const fits = of(".title").right < of("circle").left && of("circle").right < of("rect").right;
      return fits && of("rect").height < 50 })"""
    assert page.tab.locator("[data-panel=graph] svg").evaluate(fits) == [True, True]
