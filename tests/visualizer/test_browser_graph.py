"""The page on a running graph: `evis launch spinning_disk`, `evis view`, and a browser that looks."""

from __future__ import annotations

import json
import re
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser_panels import LIMIT_S, pixels, until, wait_for_picture
from run_with_page import EVIS, START_S, start, stop, viewer_url

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")


@pytest.fixture
def graph(private_runs: Path) -> Iterator[subprocess.Popen[str]]:
    """A spinning disk, for longer than any test."""
    process = start("launch", "spinning_disk", "--duration", "100000")
    yield process
    _, errors = stop(process)
    assert process.returncode == 0, errors


def assert_moves(tab: Any, topic: str) -> None:
    """A panel shows something, and then something else.

    The first packet that reaches a page which joins may hold hardly any events, so the picture is waited for as well.
    """
    wait_for_picture(tab, topic)
    until(tab, lambda: pixels(tab, topic).std() > 5, f"a picture of {topic}")
    first = pixels(tab, topic)
    changed = lambda: (np.abs(pixels(tab, topic) - first).max(axis=-1) > 40).mean() >= 0.005
    until(tab, changed, f"another picture of {topic}")


def test_running_graph_in_a_browser(
    browser: Any, private_runs: Path, graph: subprocess.Popen[str], tmp_path: Path
) -> None:
    """Keyframes and events of the default launch move on the page, and the rates are there."""
    url = viewer_url(private_runs, graph)
    found = subprocess.run([*EVIS, "view", "--json"], capture_output=True, text=True, timeout=LIMIT_S, check=True)
    assert json.loads(found.stdout) == {"url": url}
    tab = browser.new_page()
    problems: list[str] = []
    tab.on("pageerror", lambda error: problems.append(str(error)))
    tab.goto(url)
    playwright.expect(tab.locator("#state")).to_have_text("live", timeout=START_S * 1000)
    assert_moves(tab, "/cam0/keyframe")
    assert_moves(tab, "/cam0/events")
    playwright.expect(tab.locator("[data-panel=rates]")).to_contain_text("event_sensor")
    playwright.expect(tab.locator('[data-panel="/cam0/events"] .foot')).to_contain_text("ev/s")
    tab.screenshot(path=tmp_path / "graph.png")
    tab.close()
    assert problems == []


def test_view_joins_a_graph_without_a_page(browser: Any, private_runs: Path) -> None:
    """A graph that was started with --no-view gets a page beside it; leaving the page does not end the graph."""
    process = start("launch", "spinning_disk", "--no-view")
    try:
        deadline = time.monotonic() + START_S
        while not list(private_runs.glob("evis/*/plan.json")):
            assert process.poll() is None and time.monotonic() < deadline, process.communicate()
            time.sleep(0.1)
        viewer = start("view", "--port", "0")
        assert viewer.stdout is not None
        tab = browser.new_page()
        tab.goto(viewer.stdout.readline().strip(), timeout=1000 * LIMIT_S)
        try:
            playwright.expect(tab.locator("#state")).to_have_text("live", timeout=START_S * 1000)
            assert_moves(tab, "/cam0/events")
        finally:
            tab.close()
            _, errors = stop(viewer)
        assert viewer.returncode == 0, errors
        assert process.poll() is None
    finally:
        _, errors = stop(process)
    assert process.returncode == 0, errors


def test_view_plays_a_recording(browser: Any, private_runs: Path, tmp_path: Path) -> None:
    """An event file plays in the browser at its own pace; Ctrl-C ends it with status 0."""
    n = 200_000
    t = np.linspace(0, 20e9, n).astype(np.int64)
    x = (t // 10_000_000 % 64).astype(np.uint16)
    file = tmp_path / "line.npz"
    np.savez(file, t=t, x=x, y=(np.arange(n) % 48).astype(np.uint16), p=(np.arange(n) % 2).astype(np.uint8))
    process = start("view", str(file), "--port", "0")
    assert process.stdout is not None
    url = process.stdout.readline().strip()
    tab = browser.new_page()
    tab.goto(url, timeout=1000 * LIMIT_S)
    try:
        assert_moves(tab, "/cam0/events")
        # The position follows when the recording's beginning is known.
        playwright.expect(tab.locator("#state")).to_have_text(re.compile("^recording [0-9]"), timeout=START_S * 1000)
        assert tab.locator("#run").inner_text() == "line.npz"
        panels = tab.locator("main > section").evaluate_all("all => all.map(p => p.dataset.panel)")
        assert panels == ["/cam0/events", "rates", "graph"]  # the file has no frames
    finally:
        tab.close()
        _, errors = stop(process)
    assert process.returncode == 0, errors


@pytest.mark.parametrize(
    ("words", "status", "text"),
    [
        (["nothing.mcap"], 1, "nothing.mcap: no such file"),
        (["."], 1, "is a folder"),
        (["--port", "99999"], 2, "it must be 0 to 65535"),
        (["--once"], 2, "--once is for files"),
        ([], 1, "no graph is running"),
    ],
)
def test_wrong_use_is_one_line(private_runs: Path, words: list[str], status: int, text: str) -> None:
    done = subprocess.run([*EVIS, "view", *words], capture_output=True, text=True, timeout=LIMIT_S)
    assert done.returncode == status and text in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
