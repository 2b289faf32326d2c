"""The page in a real browser (headless Chromium, software rendering), on a made-up graph."""

from __future__ import annotations

import base64
import io
import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from synthetic_graph import HEIGHT, WIDTH, Player, make_node, make_plan

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync"
).split()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium with an empty profile; skipped where there is none."""
    chromium = shutil.which("chromium")
    if chromium is None:
        assert not os.environ.get("EVIS_REQUIRE_BROWSER"), "EVIS_REQUIRE_BROWSER is set and there is no chromium"
        pytest.skip("chromium is not installed (apt-get install chromium)")
    with tempfile.TemporaryDirectory() as profile, playwright.sync_playwright() as driver:
        context = driver.chromium.launch_persistent_context(
            profile, executable_path=chromium, headless=True, args=FLAGS, viewport={"width": 1280, "height": 900}
        )
        yield context
        context.close()


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
    tab.player = player
    yield tab
    tab.close()
    player.close()
    assert [p for p in problems if not p.startswith("blob:")] == []


def pixels(tab: Any, topic: str) -> np.ndarray:
    """The canvas of a panel as it is now, [H, W, 3]."""
    data = tab.locator(f'[data-panel="{topic}"] canvas').first.evaluate("c => c.toDataURL('image/png').split(',')[1]")
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")).astype(int)


def wait_for_picture(tab: Any, topic: str) -> None:
    """Until a panel has drawn something."""
    tab.locator(f'[data-panel="{topic}"] .waiting').wait_for(state="hidden", timeout=20000)


def test_image_and_events_move(page: Any, tmp_path: Path) -> None:
    """What is on the canvases has the sensor's size, is not empty, and changes between two moments."""
    for topic in ("/cam0/keyframe", "/cam0/events"):
        wait_for_picture(page, topic)
        first = pixels(page, topic)
        assert first.shape == (HEIGHT, WIDTH, 3) and first.std() > 10
        page.wait_for_timeout(400)
        assert (np.abs(pixels(page, topic) - first).max(axis=-1) > 40).mean() > 0.02
    page.screenshot(path=tmp_path / "page.png")
    assert (tmp_path / "page.png").stat().st_size > 20000


def test_events_are_drawn_where_they_are(page: Any) -> None:
    """ON is warm on the outer ring, OFF cool on the inner one (the made-up graph has them so), the corners are dark."""
    wait_for_picture(page, "/cam0/events")
    shown = pixels(page, "/cam0/events")
    warm = shown[..., 0] - shown[..., 2]
    rows, columns = np.nonzero(warm > 60)
    centre = rows.mean(), columns.mean()
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    radius = np.hypot(y - centre[0], x - centre[1])
    assert np.median(radius[warm > 60]) > np.median(radius[warm < -60]) + 3
    assert shown[:4, :4].max() < 40


def test_status_line_and_topic_list(page: Any) -> None:
    expect = playwright.expect
    expect(page.locator("#state")).to_have_text("live", timeout=20000)
    expect(page.locator("#gauges")).to_contain_text("ev/s", timeout=5000)
    assert page.locator("nav button").first.inner_text().startswith("events")
    expect(page.locator("[data-panel=rates]")).to_contain_text("event_sensor", timeout=5000)


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
    page.wait_for_timeout(300)
    assert "/cam0/labels" not in taps and "/cam0/events" in taps
    page.locator('[data-panel="/cam0/events"] input[type=checkbox]').check()
    page.wait_for_timeout(500)
    overlay = page.locator('[data-panel="/cam0/events"] canvas').nth(1)
    assert overlay.evaluate("c => c.getContext('2d').getImageData(0, 0, c.width, c.height).data.some(v => v > 0)")


def test_environment_and_reload_are_kept(page: Any) -> None:
    wait_for_picture(page, "/cam0/events")
    page.locator("nav select").select_option("1")
    page.locator('nav button[title="Run"]').click()
    page.reload()
    page.get_by_text("the scene has only prescribed motion").wait_for()
    wait_for_picture(page, "/cam0/events")
    selects = page.locator('[data-panel="/cam0/events"] select').first
    assert selects.input_value() == "1"


def test_end_of_the_run_is_said(page: Any) -> None:
    """The last pictures stay."""
    wait_for_picture(page, "/cam0/keyframe")
    page.player.node.finish()
    page.player.node._server.stop()
    playwright.expect(page.locator("#state")).to_have_text("run has ended", timeout=20000)
    assert pixels(page, "/cam0/keyframe").std() > 10


def test_small_screen(page: Any, tmp_path: Path) -> None:
    """A telephone's width: nothing sticks out sideways."""
    page.set_viewport_size({"width": 390, "height": 800})
    wait_for_picture(page, "/cam0/events")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    page.screenshot(path=tmp_path / "small.png")
