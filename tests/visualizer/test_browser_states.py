"""What the page says of a graph that is silent, that has failed, and of names that come late."""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser_panels import wait_for_picture
from page_show import MS, Show, camera_info, events, graph, labelled, warehouse, world
from run_with_page import START_S, start, stop, viewer_url

from msgs.camera import EventPacket, Trigger
from msgs.diagnostics import Diagnostics
from msgs.header import Header, Message

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

SEGMENTATION = '[data-panel="/cam0/labels segmentation"]'


def test_a_silent_graph_is_not_called_live(show: Callable[..., Show], tmp_path: Path) -> None:
    """A description that was kept, and is shown when its panel opens, is no news; the next packet is."""
    page = show(graph(tmp_path, serial="1"))
    state = page.tab.locator("#state")
    sent = lambda k: {"/cam0/info": camera_info(), "/cam0/events": events(k)}
    page.play(sent, lambda: state.inner_text() == "live", "a live graph")
    playwright.expect(state).to_have_text(re.compile(r"no data for \d+ s"))
    page.tab.locator('nav button[title^="/cam0/info"]').click()
    page.tab.locator('[data-panel="/cam0/info"] td').first.wait_for()
    for _ in range(20):  # a camera that was unplugged says again and again who it was
        page.send({"/cam0/info": camera_info()})
    page.tab.wait_for_timeout(600)  # as soon as it is drawn, or with the next rates, the page would have said so
    assert state.inner_text().startswith("no data for ")
    page.play(lambda k: sent(100 + k), lambda: state.inner_text() == "live", "a graph that goes on")


def test_a_failure_is_told_on_the_page(show: Callable[..., Show], tmp_path: Path) -> None:
    """As text, whatever it holds, and on a telephone too, where nothing sticks out."""
    page = show(graph(tmp_path, serial="1"))
    page.play(
        lambda k: {"/cam0/events": events(k)}, lambda: page.tab.locator("#state").inner_text() == "live", "a graph"
    )
    why = "camera: <img src=x onerror=alert(1)> unplugged in mid-stream after 100286 bytes " + "x" * 300
    page.node.runtime.failure = why
    page.node.finish()
    page.node.close()
    playwright.expect(page.tab.locator("#state")).to_have_text("run has failed")
    assert page.tab.locator("#failure").inner_text() == why
    page.tab.set_viewport_size({"width": 390, "height": 800})
    assert page.tab.evaluate("document.documentElement.scrollWidth") <= 390
    assert page.tab.locator("#failure").bounding_box()["y"] < 300


def test_a_node_that_dies_is_named_on_the_page(browser: Any, private_runs: Path) -> None:
    """The launcher names it on standard error, which whoever looks at the page may not see."""
    process = start("launch", "spinning_disk", "--split", "--duration", "100000")
    try:
        tab = browser.new_page()
        tab.goto(viewer_url(private_runs, process))
        playwright.expect(tab.locator("#state")).to_have_text("live", timeout=START_S * 1000)
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        (victim,) = [c for c in children if Path(f"/proc/{c}/cmdline").read_bytes().endswith(b"\0event_sensor\0")]
        os.kill(int(victim), signal.SIGKILL)
        playwright.expect(tab.locator("#state")).to_have_text("run has failed")
        assert "event_sensor" in tab.locator("#failure").inner_text()
        tab.close()
    finally:
        stop(process)


def test_instances_get_the_names_that_come_late(show: Callable[..., Show], tmp_path: Path) -> None:
    """The labels may be on the page before the camera's description, and nothing may come after it."""
    page = show(warehouse(tmp_path, ["segmentation"]))
    listed = page.tab.locator(f"{SEGMENTATION} .instances")
    shown = labelled(1)
    unnamed = lambda: listed.count() and re.search(r"\bid \d", listed.inner_text())
    page.play(lambda k: {"/cam0/labels": shown["/cam0/labels"]}, unnamed, "a list without names")
    page.send({"/cam0/info": world()[0]})
    playwright.expect(listed).to_contain_text("forklift_0")
    playwright.expect(listed).not_to_contain_text(re.compile(r"\bid \d"))


def test_the_list_of_instances_comes_back_with_its_view(show: Callable[..., Show], tmp_path: Path) -> None:
    """Between segmentation and segmentation a panel shows the flow, whose legend takes the list's place."""
    page = show(warehouse(tmp_path, ["segmentation", "flow"]))
    foot, view = page.tab.locator(f"{SEGMENTATION} .foot"), page.tab.locator(f"{SEGMENTATION} select[title=View]")
    page.play(labelled, lambda: "forklift_0" in foot.inner_text(), "the list")
    view.select_option("flow")
    page.play(labelled, lambda: "px/s" in foot.inner_text(), "the flow's legend")
    view.select_option("segmentation")
    page.play(labelled, lambda: re.search(r"\d+ instances", foot.inner_text()), "the segmentation")
    playwright.expect(foot).to_contain_text("forklift_0")


def test_colours_of_a_colour_sensor_are_explained(show: Callable[..., Show], tmp_path: Path) -> None:
    """Its events are drawn in red, green and blue, not in the colours of ON and OFF."""
    page = show(graph(tmp_path, serial="1"))
    legend = page.tab.locator('[data-panel="/cam0/events"] .legend')
    assert legend.inner_text().split() == ["ON", "OFF"]

    def coloured(k: int) -> EventPacket:
        n = np.arange(90)
        x, y, p, c = n.astype(np.uint16), n.astype(np.uint16), (n % 3 == 0).astype(np.uint8), (n % 3).astype(np.uint8)
        t = np.full(90, k * 33 * MS)
        header = Header(k * 33 * MS, k)
        return EventPacket(header, np.array([0, 90]), t, x, y, p, c, width=173, height=130, t0_ns=(k - 1) * 33 * MS)

    page.play(lambda k: {"/cam0/events": coloured(k)}, lambda: "R" in legend.inner_text(), "the colours")
    wait_for_picture(page.tab, "/cam0/events")
    assert legend.inner_text().replace("\n", " ") == "R G B 33 % ON, OFF darker"
    drawn = legend.locator("i").evaluate_all("all => all.map(i => getComputedStyle(i).backgroundColor)")
    channels = [[int(v) for v in re.findall(r"\d+", colour)] for colour in drawn]
    assert [int(np.argmax(rgb)) for rgb in channels] == [0, 1, 2]


def test_warnings_are_seen_above_many_nodes(show: Callable[..., Show], tmp_path: Path) -> None:
    """Without scrolling, the newest first, beside the rates; what is selected to be copied stays so."""
    page = show(warehouse(tmp_path, ["segmentation"]))
    panel = page.tab.locator("[data-panel=rates]")

    def nodes(k: int) -> dict[str, Message]:
        values = {"updates": k, "published": {"/cam0/events": k}}
        level, text = ("warning", f"cause {k}") if k < 20 else ("ok", "")
        return {"/diagnostics": Diagnostics(Header(k), f"node_{k % 40}", level, text, values=values)}

    page.play(nodes, lambda: "node_39" in panel.inner_text(), "rates of many nodes")
    first = panel.get_by_text("node_19: cause 19")
    first.wait_for()
    # The table is written anew with each message: what is there is looked up and measured in one step.
    head = panel.evaluate("panel => panel.querySelector('thead').getBoundingClientRect().y")
    line, frame = first.bounding_box(), panel.bounding_box()
    assert frame["y"] < line["y"] < head < frame["y"] + frame["height"]
    first.evaluate("line => getSelection().selectAllChildren(line)")
    row = panel.locator("tbody").first.element_handle()
    page.play(
        lambda k: nodes(100 + k), lambda: not row.evaluate("row => row.isConnected"), "rates that are written anew"
    )
    assert page.tab.evaluate("getSelection().toString()") == "node_19: cause 19"


def test_trigger_edges_are_those_of_the_round(show: Callable[..., Show], tmp_path: Path) -> None:
    """A recording that is played again has each edge once."""
    page = show(graph(tmp_path, file="/data/a.aedat4", again=True))
    page.tab.locator('nav button[title^="/cam0/trigger"]').click()
    rows = page.tab.locator('[data-panel="/cam0/trigger"] tbody tr')
    ones = np.ones(1, np.uint8)

    def rounds(k: int) -> dict[str, Message]:
        episode, place = divmod(k - 1, 5)
        edge = Trigger(Header(place * 33 * MS, k, episode=episode), np.array([place * 33 * MS]), ones, ones)
        return {"/cam0/trigger": edge, "/cam0/events": events(place + 1, episode=episode)}

    page.play(rounds, lambda: rows.count() == 5, "all edges of a round")
    counts = []
    for k in range(101, 116):
        page.send(rounds(k))
        counts.append(rows.count())
    assert 0 < max(counts) <= 5


def test_all_words_can_be_read(show: Callable[..., Show], tmp_path: Path) -> None:
    """Each has 4.5 times the luminance of what is behind it, or the other way round (WCAG 2.2, 1.4.3)."""
    page = show(warehouse(tmp_path, ["segmentation", "boxes"]))
    page.tab.locator('nav button[title="Run"]').click()
    page.play(labelled, lambda: page.tab.locator("#state").inner_text() == "live", "a graph")
    page.tab.locator("[data-panel=rates] td").first.wait_for()
    words = page.tab.evaluate("""() => {
      const shown = [...document.querySelectorAll("body *")].filter((e) => e.checkVisibility() &&
        [...e.childNodes].some((n) => n.nodeType === 3 && n.data.trim()) && !e.closest("svg, noscript, option"));
      const ground = (e) => { for (; e; e = e.parentElement) {
        const colour = getComputedStyle(e).backgroundColor;
        if (!/, 0\\)$/.test(colour)) return colour; } };
      return shown.map((e) => [e.textContent.trim(), getComputedStyle(e).color, ground(e)]) }""")
    faint = {text: round(contrast(colour, ground), 2) for text, colour, ground in words}
    assert len(faint) > 40
    assert {text: ratio for text, ratio in faint.items() if ratio < 4.5} == {}


def contrast(*colours: str) -> float:
    """Contrast ratio of two CSS colours, as WCAG 2.2 defines it."""
    numbers = [[int(v) for v in re.findall(r"\d+", colour)[:3]] for colour in colours]
    bright, dark = sorted((srgb_luminance(np.array(rgb) / 255) for rgb in numbers), reverse=True)
    return (bright + 0.05) / (dark + 0.05)


def srgb_luminance(rgb: np.ndarray) -> float:
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def test_keys_alone_are_enough(show: Callable[..., Show], tmp_path: Path) -> None:
    """The focus stays where the work goes on, when its element goes: it would fall back to the top of the page."""
    page = show(warehouse(tmp_path, ["segmentation", "boxes", "poses"]))
    focused = lambda what: page.tab.evaluate(f"(document.activeElement.{what})")
    view = page.tab.locator(f"{SEGMENTATION} select[title=View]")
    view.focus()
    page.tab.keyboard.press("ArrowDown")
    playwright.expect(view).to_have_value("objects")
    page.tab.locator(f"{SEGMENTATION} .scroll").wait_for()  # a table in place of the picture
    assert focused("title") == "View"
    page.tab.keyboard.press("ArrowUp")
    playwright.expect(view).to_have_value("segmentation")
    page.tab.locator(f"{SEGMENTATION} button[title=Close]").focus()
    page.tab.keyboard.press("Enter")
    assert "/cam0/labels segmentation" not in page.panels() and focused("textContent") == "labels"
    page.tab.keyboard.press("Enter")
    page.tab.locator('[data-panel="/cam0/labels"]').wait_for()
