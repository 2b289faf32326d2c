"""The page in a real browser (headless Chromium, software rendering), on a made-up graph."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser_panels import pixels, until, wait_for_picture
from synthetic_graph import HEIGHT, WIDTH, Player, make_node, make_plan

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")


@pytest.fixture
def page(browser: Any, tmp_path: Path) -> Iterator[Any]:
    """The page of a playing graph of two environments; fails on any script error or foreign request."""
    node = make_node(make_plan(tmp_path, envs=2))
    player = Player(node, envs=2)
    url = json.loads((tmp_path / "viewer.json").read_text())["url"]
    tab = browser.new_page()
    problems: list[str] = []
    tab.on("pageerror", lambda error: problems.append(str(error)))
    tab.on("console", lambda line: problems.append(line.text) if line.type == "error" else None)
    tab.on("request", lambda request: problems.append(request.url) if "127.0.0.1" not in request.url else None)
    tab.goto(url)
    tab.player, tab.ended = player, False
    yield tab
    tab.close()
    player.close()
    known = ["blob:"] + ["WebSocket connection to"] * tab.ended  # a page looks whether the node is back
    assert [p for p in problems if not p.startswith(tuple(known))] == []


def test_image_and_events_move(page: Any, tmp_path: Path) -> None:
    """What is on the canvases has the sensor's size, is not empty, and changes between two moments."""
    for topic in ("/cam0/keyframe", "/cam0/events"):
        wait_for_picture(page, topic)
        until(page, lambda topic=topic: pixels(page, topic).std() > 10, f"a picture of {topic}")
        first = pixels(page, topic)
        assert first.shape == (HEIGHT, WIDTH, 3)
        changed = lambda topic=topic, first=first: (np.abs(pixels(page, topic) - first).max(axis=-1) > 40).mean() > 0.02
        until(page, changed, f"another picture of {topic}")
    page.screenshot(path=tmp_path / "page.png")
    assert (tmp_path / "page.png").stat().st_size > 20000


def test_events_are_drawn_where_they_are(page: Any) -> None:
    """ON is warm on the outer ring, OFF cool on the inner one (the made-up graph has them so), the corners are dark."""
    wait_for_picture(page, "/cam0/events")
    y, x = np.mgrid[:HEIGHT, :WIDTH]

    def rings() -> bool:
        shown = pixels(page, "/cam0/events")
        assert shown[:4, :4].max() < 40
        warm = shown[..., 0] - shown[..., 2]
        on, off = warm > 60, warm < -60
        if min(on.sum(), off.sum()) < 100:
            return False
        radius = np.hypot(y - y[on].mean(), x - x[on].mean())
        return bool(np.median(radius[on]) > np.median(radius[off]) + 3)

    until(page, rings, "a ring of OFF events inside one of ON events")  # packets of a held-up page lie over each other


def test_status_line_and_topic_list(page: Any) -> None:
    expect = playwright.expect
    expect(page.locator("#state")).to_have_text("live")
    expect(page.locator("#gauges")).to_contain_text("ev/s")
    assert page.locator("nav button").first.inner_text().startswith("events")
    expect(page.locator("[data-panel=rates]")).to_contain_text("event_sensor")


def test_panels_open_change_and_close(page: Any) -> None:
    """Opening subscribes, choosing another view replaces it, closing unsubscribes."""
    taps = page.player.node.runtime.taps
    page.locator('nav button[title^="/cam0/labels"]').click()
    wait_for_picture(page, "/cam0/labels")
    assert "/cam0/labels" in taps and page.player.node.runtime.requested == ["/cam0/labels"]
    page.locator('[data-panel="/cam0/labels"] .instances').get_by_text("disk").wait_for()
    panel = page.locator('[data-panel="/cam0/labels"]')
    panel.locator("select").first.select_option("objects")
    panel.get_by_text("turn [rad/s]").wait_for()
    panel.locator('button[title="Close"]').click()
    until(page, lambda: "/cam0/labels" not in taps, "the tap of a closed panel is closed")
    assert "/cam0/events" in taps
    page.locator('[data-panel="/cam0/events"]').get_by_label("boxes").check()
    overlay = page.locator('[data-panel="/cam0/events"] canvas').nth(1)
    drawn = "c => c.getContext('2d').getImageData(0, 0, c.width, c.height).data.some(v => v > 0)"
    until(page, lambda: overlay.evaluate(drawn), "boxes over the events")


def test_environment_and_reload_are_kept(page: Any) -> None:
    wait_for_picture(page, "/cam0/events")
    page.locator("nav select").select_option("1")
    page.locator('nav button[title="Run"]').click()
    page.reload()
    page.get_by_text("the scene has only prescribed motion").wait_for()
    wait_for_picture(page, "/cam0/events")
    playwright.expect(page.locator('[data-panel="/cam0/events"] select').first).to_have_value("1")
    playwright.expect(page.locator("nav select")).to_have_value("1")  # for panels that are opened from now on


def test_end_of_the_run_is_said(page: Any) -> None:
    """The last pictures stay."""
    wait_for_picture(page, "/cam0/keyframe")
    page.ended = True
    page.player.node.finish()
    page.player.node._server.stop()
    playwright.expect(page.locator("#state")).to_have_text("run has ended")
    assert pixels(page, "/cam0/keyframe").std() > 10


def test_a_picture_that_is_drawn_after_the_end_does_not_revive_the_run(page: Any) -> None:
    """A busy browser draws what it was sent when it gets a frame, which may be when all is over."""
    wait_for_picture(page, "/cam0/keyframe")
    page.evaluate("""() => {
      const real = window.requestAnimationFrame.bind(window);
      window.held = [];
      window.requestAnimationFrame = (callback) => window.held.push(callback);
      window.release = () => {
        window.requestAnimationFrame = real;
        window.held.forEach((callback) => real(callback));
      };
    }""")
    until(page, lambda: page.evaluate("window.held.length"), "something to draw")
    page.ended = True
    page.player.node.finish()
    page.player.node._server.stop()
    playwright.expect(page.locator("#state")).to_have_text("run has ended")
    page.evaluate("window.release()")
    page.wait_for_timeout(300)  # a few frames
    assert page.locator("#state").inner_text() == "run has ended"


def test_a_long_name_leaves_what_tells_its_panels_apart(page: Any) -> None:
    """Of a camera's name the end is cut, not that of its topic."""
    wait_for_picture(page, "/cam0/events")
    title = page.locator('[data-panel="/cam0/events"] .bar b')
    assert title.text_content() == "/cam0/events" == title.get_attribute("title")
    title.locator("span").first.evaluate("e => { e.textContent = '/' + 'long'.repeat(60) }")
    box, panel = title.locator("span").last.bounding_box(), page.locator('[data-panel="/cam0/events"]').bounding_box()
    assert title.locator("span").last.text_content() == "/events"
    assert panel["x"] < box["x"] and box["x"] + box["width"] < panel["x"] + panel["width"] and box["width"] > 30


def test_small_screen(page: Any, tmp_path: Path) -> None:
    """A telephone's width: nothing sticks out sideways."""
    page.set_viewport_size({"width": 390, "height": 800})
    wait_for_picture(page, "/cam0/events")
    until(page, lambda: page.evaluate("document.documentElement.scrollWidth") <= 390, "nothing sticks out")
    page.locator('[data-panel="/cam0/events"]').get_by_label("boxes").check()  # the bar with the most in it
    page.set_viewport_size({"width": 320, "height": 800})
    outside = """() => [...document.querySelectorAll(".bar > *")].filter(e => {
      const own = e.getBoundingClientRect(), panel = e.closest(".panel").getBoundingClientRect();
      return own.width && (own.right > panel.right || own.left < panel.left || own.bottom > panel.bottom) }).length"""
    assert page.evaluate(outside) == 0
    page.screenshot(path=tmp_path / "small.png")
