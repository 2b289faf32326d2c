"""The visualizer's server as a browser sees it: token, credits, panels, several clients, shutdown."""

from __future__ import annotations

import asyncio
import json
import socket
import stat
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import aiohttp
import pytest
from synthetic_graph import HEIGHT, WIDTH, Player, events_at, images_at, info, labels_at, make_node, make_plan

from evis.config.params import ParamError
from evis.web import address
from nodes.visualizer import application
from nodes.visualizer.hub import MAX_PANELS, PanelKey
from nodes.visualizer.views.events import EventView

EVENTS = ("e", "/cam0/events", "events", 0)


def fetch(url: str) -> tuple[int, str]:
    """Status and text of a GET."""
    try:
        with urllib.request.urlopen(url, timeout=60) as response:
            return response.status, response.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()


async def until(condition: Callable[[], bool], step: Callable[[], None] = lambda: None) -> None:
    """Wait, calling `step` in between."""
    deadline = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < deadline, "it did not happen within 60 s"
        step()
        await asyncio.sleep(0.01)


def test_page_needs_the_token(url: str) -> None:
    page, _, token = url.partition("?token=")
    status, text = fetch(url)
    assert status == 200 and f'<base href="/{token}/">' in text
    assert fetch(f"{page}{token}/main.js")[0] == 200
    for wrong in ("", "?token=", "?token=" + token[:-1], "ws", "x/main.js", "x/ws", "static/../main.js", "a/b/c"):
        status, text = fetch(page + wrong)
        assert status == 403, wrong
        assert "token" in text and token not in text
    assert fetch(f"{page}{token}/nothing.js")[0] == 404
    assert fetch(f"{page}{token}/..%2fserver.py")[0] == 404


def test_page_loads_nothing_from_elsewhere() -> None:
    """No address of another host in any file of the page (the SVG namespace is a name, not an address)."""
    folder = Path(application.__file__).parent / "page"
    for file in folder.iterdir():
        text = file.read_text().replace("http://www.w3.org/2000/svg", "")
        assert "//" not in "".join(line for line in text.splitlines() if "http" in line and "url.protocol" not in line)


def test_websocket_refuses_other_sites(url: str) -> None:
    page, _, token = url.partition("?token=")

    async def connect() -> None:
        async with aiohttp.ClientSession() as http:
            with pytest.raises(aiohttp.WSServerHandshakeError, match="403"):
                await http.ws_connect(f"{page}{token}/ws", headers={"Origin": "http://example.org"})
            with pytest.raises(aiohttp.WSServerHandshakeError, match="403"):
                await http.ws_connect(f"{page}wrong-token/ws")

    asyncio.run(connect())


def test_address_is_private_and_loopback(node: Any, url: str, tmp_path: Path) -> None:
    assert url.startswith("http://127.0.0.1:")
    assert stat.S_IMODE((tmp_path / "viewer.json").stat().st_mode) == 0o600
    assert node.runtime.told == [f"open {url}"] and not node.runtime.said
    node.close()
    assert not (tmp_path / "viewer.json").exists()


def test_chosen_token_stays_out_of_the_log(tmp_path: Path) -> None:
    node = make_node(make_plan(tmp_path), token="correct-horse")
    node.close()
    assert node.runtime.hidden == ["correct-horse"]
    assert "open http" in node.runtime.told[0] and "correct-horse" not in node.runtime.told[0]


@pytest.mark.parametrize(
    ("host", "token", "text"),
    [
        ("0.0.0.0", None, "reachable from other machines: give a token"),
        ("10.1.2.3", None, "reachable from other machines"),
        ("127.0.0.1", "short", "8 to 128"),
        ("127.0.0.1", "with/slash", "8 to 128"),
    ],
)
def test_unsafe_addresses_are_refused(host: str, token: str | None, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        address.choose_token(host, token)


def test_other_hosts_with_a_token_are_allowed() -> None:
    assert address.choose_token("0.0.0.0", "long-enough") == "long-enough"
    assert len({address.choose_token("127.0.0.1", None) for _ in range(10)}) == 10


def test_taken_port(tmp_path: Path) -> None:
    """An explicit port that is taken is one clear error; the default moves on to the next free one."""
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(OSError, match=f"port {port} is taken; choose another .port:=0 is any free one"):
            make_node(make_plan(tmp_path), port=port)
    first, _ = address.bind("127.0.0.1", None)
    second, note = address.bind("127.0.0.1", None)
    with first, second:
        assert second.getsockname()[1] != first.getsockname()[1]
        assert note == f"port {address.DEFAULT_PORT} is taken"


def test_unknown_parameter_names_the_nearest(tmp_path: Path) -> None:
    with pytest.raises(ParamError, match="did you mean 'port'"):
        make_node(make_plan(tmp_path), prot=1)


def test_nothing_is_tapped_until_somebody_looks(node: Any, client: Any) -> None:
    """Opening a panel subscribes, closing it or leaving unsubscribes; a dormant node is asked for."""
    taps = node.runtime.taps

    async def look() -> None:
        node.idle()
        assert not taps
        async with client() as page:
            await until(lambda: set(taps) == {"/clock", "/diagnostics"}, node.idle)
            await page.show(EVENTS, ("l", "/cam0/labels", "objects", 0))
            await until(lambda: {"/cam0/events", "/cam0/labels"} <= set(taps), node.idle)
            assert node.runtime.requested == ["/cam0/labels"]
            await page.show(EVENTS)
            await until(lambda: "/cam0/labels" not in taps, node.idle)
            assert "/cam0/events" in taps
        await until(lambda: not taps, node.idle)

    asyncio.run(look())


def test_one_credit(node: Any, client: Any) -> None:
    """Without an acknowledgement exactly one bundle comes; after it, the newest image and all events in between."""

    async def look() -> None:
        async with client() as page:
            await page.show(EVENTS, ("k", "/cam0/keyframe", "radiance", 0))
            await until(lambda: "/cam0/keyframe" in node.runtime.taps, node.idle)
            # The status bundle takes the first credit.
            parts = await page.bundle()
            assert [p["kind"] for p in parts] == ["status"]
            for k in range(1, 8):
                node.runtime.send("/cam0/events", events_at(k, n=50))
                node.runtime.send("/cam0/keyframe", images_at(k)["/cam0/keyframe"])
            with pytest.raises(TimeoutError):
                await page.bundle(0.7)
        await until(lambda: not node.runtime.taps, node.idle)
        async with client() as page:
            await page.show(EVENTS, ("k", "/cam0/keyframe", "radiance", 0))
            await until(lambda: "/cam0/keyframe" in node.runtime.taps, node.idle)
            node.runtime.send("/cam0/events", events_at(1, n=50))
            while "e" not in page.seen:
                await page.bundle()
                if "e" not in page.seen:
                    await page.ack()
            for k in range(2, 8):
                node.runtime.send("/cam0/events", events_at(k, n=50))
                node.runtime.send("/cam0/keyframe", images_at(k)["/cam0/keyframe"])
            await page.ack()
            page.seen.clear()
            while "e" not in page.seen or "k" not in page.seen:
                await page.bundle()
                await page.ack()
            assert page.seen["k"]["seq"] == 7
            assert page.seen["e"]["events"] == 6 * 50 and page.seen["e"]["undrawn"] == 0

    asyncio.run(look())


def test_several_clients_and_a_stuck_one(node: Any, client: Any) -> None:
    """Two pages share a tap; one that never acknowledges changes nothing for the other, and holds no memory."""

    async def look() -> None:
        async with client() as page, client() as stuck:
            await page.show(EVENTS)
            await stuck.show(EVENTS)
            await until(lambda: "/cam0/events" in node.runtime.taps, node.idle)
            k = 0

            def play() -> None:
                nonlocal k
                k += 1
                node.runtime.send("/cam0/events", events_at(k, n=50))

            for _ in range(5):
                assert (await page.part("e", play))["events"] > 0
            for _ in range(500):
                play()
            view = node._hub.view(next(iter(node._hub._views)))
            assert len(view._packets) <= 64
            on_its_way = await page.part("e", play)
            newest = await page.part("e", play)
            assert on_its_way["seq"] < newest["seq"] and newest["seq"] >= 500
        await until(lambda: not node.runtime.taps, node.idle)

    asyncio.run(look())


def test_a_panel_that_is_closed_and_opened_while_it_is_drawn(
    node: Any, client: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As by a look at another tab: its new view was taken for older than what it had, and the panel stood still."""
    drawing, go_on = threading.Event(), threading.Event()
    go_on.set()
    render = EventView.render

    def slowly(view: EventView, since: int) -> Any:
        drawing.set()
        go_on.wait(60)
        return render(view, since)

    monkeypatch.setattr(EventView, "render", slowly)

    async def look() -> None:
        hub, key = node._hub, PanelKey(*EVENTS[1:])

        def send(k: int) -> None:
            node.runtime.send("/cam0/events", events_at(k))

        async with client() as page:
            await page.show(EVENTS)
            await until(lambda: "/cam0/events" in node.runtime.taps, node.idle)
            for k in range(1, 1000):
                send(k)
            await page.part("e", lambda: send(1000))
            before = hub.view(key)
            go_on.clear()
            drawing.clear()
            await until(drawing.is_set, lambda: send(1001))
            await page.show()
            await page.show(EVENTS)
            await until(lambda: hub.view(key) not in (before, None))
            go_on.set()
            seen = [0]
            while seen[-1] < 1002:
                seen.append((await page.part("e", lambda: send(1002)))["seq"])

    asyncio.run(look())


def test_bad_requests_are_answered(node: Any, client: Any) -> None:
    """A page that asks nonsense gets a text that names it, and keeps what it had."""

    async def look() -> None:
        async with client() as page:
            await page.show(EVENTS)

            async def answer(text: str) -> str:
                await page.ws.send_str(text)
                while True:
                    message = await page.ws.receive(60)
                    if message.type is aiohttp.WSMsgType.TEXT:
                        return message.json()["text"]

            assert "unknown op" in await answer('{"op": "shutdown"}')
            assert "no topic '/cam9/events'" in await answer(
                '{"op":"panels","panels":[{"id":"a","topic":"/cam9/events","view":"events"}]}'
            )
            assert "has no view 'depth'; it has events" in await answer(
                '{"op":"panels","panels":[{"id":"a","topic":"/cam0/events","view":"depth"}]}'
            )
            assert "environment -1" in await answer(
                '{"op":"panels","panels":[{"id":"a","topic":"/cam0/events","view":"events","env":-1}]}'
            )
            many = [{"id": str(i), "topic": "/cam0/events", "view": "events", "env": i} for i in range(MAX_PANELS + 1)]
            await page.ws.send_json({"op": "panels", "panels": many})
            assert f"the most is {MAX_PANELS}" in await answer("{")
            await until(lambda: "/cam0/events" in node.runtime.taps, node.idle)

    asyncio.run(look())


def test_a_topic_that_cannot_be_tapped_is_said_so(node: Any, client: Any) -> None:
    node.runtime.refuse = "/davis/imu"

    async def look() -> None:
        async with client() as page:
            await page.show(("i", "/davis/imu", "samples", 0))
            await until(lambda: bool(node._hub.status()["refused"]), node.idle)
            node.idle()
            warning = "/davis/imu cannot be shown: visualizer: nobody publishes /davis/imu"
            assert ("warning", warning) in node.runtime.said
            node.idle()
            assert len(node.runtime.said) == 1
            status = {}
            while "/davis/imu" not in status.get("refused", {}):
                status = (await page.bundle())[0]
                await page.ack()

    asyncio.run(look())


def test_hello_describes_the_graph(node: Any, client: Any) -> None:
    async def look() -> None:
        async with client() as page:
            hello = page.hello
            assert [t["name"] for t in hello["topics"]][:2] == ["/cam0/events", "/cam0/keyframe"]
            edge = {"from": "renderer", "to": "interpolator", "topic": "/cam0/depth", "kind": "lockstep"}
            assert edge in hello["edges"]
            assert {"what": "MuJoCo", "why": "the scene has only prescribed motion"} in hello["left_out"]
            labels = next(t for t in hello["topics"] if t["type"] == "Labels")
            assert labels["dormant"] and next(iter(labels["views"])) == "segmentation"

    asyncio.run(look())


def test_latched_camera_info_reaches_late_panels(node: Any, client: Any) -> None:
    """A latched message comes once; a panel that opens on the same tap later still gets it."""

    async def look() -> None:
        async with client() as page:
            await page.show(("a", "/cam0/info", "camera", 0))
            await until(lambda: "/cam0/info" in node.runtime.taps, node.idle)
            node.runtime.send("/cam0/info", info())
            assert (await page.part("a", lambda: None))["names"] == ["background", "disk", "wall"]
            await page.show(("a", "/cam0/info", "camera", 0), ("b", "/cam0/info", "camera", 1))
            assert (await page.part("b", lambda: None))["names"] == ["background", "disk", "wall"]

    asyncio.run(look())


def test_images_labels_and_rates_arrive(node: Any, client: Any) -> None:
    """Every kind of part on one page, from a playing graph."""
    from PIL import Image

    panels = [
        EVENTS, ("k", "/cam0/keyframe", "radiance", 0), ("d", "/cam0/depth", "depth", 0),
        ("m", "/cam0/motion", "motion", 0), ("i", "/cam0/ids", "ids", 0),
        ("f", "/cam0/labels", "flow", 0), ("o", "/cam0/labels", "objects", 0),
        ("b", "/cam0/labels", "boxes", 0), ("s", "/state", "bodies", 0), ("u", "/davis/imu", "samples", 0),
    ]  # fmt: skip

    async def look() -> dict[str, Any]:
        async with client() as page:
            await page.show(*panels)
            while not {p[0] for p in panels} <= set(page.seen) or not page.seen.get("", {}).get("nodes"):
                await page.bundle()
                await page.ack()
            return page.seen

    player = Player(node)
    seen = asyncio.run(look())
    player.close()
    import io

    for panel in "kdmif":
        picture = Image.open(io.BytesIO(seen[panel]["payload"]))
        assert picture.format == ("JPEG" if panel == "k" else "PNG") and picture.size == (WIDTH, HEIGHT)
        assert seen[panel]["format"] == picture.format.lower()
    assert seen["d"]["note"] == "1 px not a number" and seen["k"]["note"] == "1 px not finite"
    box = labels_at(seen["b"]["seq"]).box[0]
    assert seen["b"]["boxes"] == [[1, seen["b"]["boxes"][0][1], *box.tolist()]]
    bodies = next(t for t in seen["o"]["tables"] if t["title"] == "bodies")
    assert bodies["rows"] == [["disk", 0, 0, 1.5, 0, 0, 0, 1, 5.0, 2.0]]  # |(3, 4, 0)| and |(0, 0, 2)|
    status = seen[""]
    assert status["nodes"]["event_sensor"]["counters"] == {"clipped": 2, "lost": 0}
    assert status["clock"]["t"] > 0


def test_shutdown_with_open_pages_is_quick(node: Any, client: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages are told that the graph has ended, by a message and the close code; the node waits for less than a second.

    That is the bound that the supervisor's escalation relies on: the node asks for no more, and a page that answers
    nothing does not hold the server up.
    """
    thread, asked = node._server._thread, []
    end = thread.join
    monkeypatch.setattr(thread, "join", lambda timeout=None: asked.append(timeout) or end(60))

    async def look() -> list[Any]:
        async with client() as page, client() as stuck:
            await page.show(EVENTS)
            await stuck.show(EVENTS)
            await page.bundle()
            node.finish()
            closing = asyncio.get_running_loop().run_in_executor(None, node.close)
            last = [await page.ws.receive(60)]
            while last[-1].type in (aiohttp.WSMsgType.TEXT, aiohttp.WSMsgType.BINARY):
                last.append(await page.ws.receive(60))
            await closing
            assert not thread.is_alive()  # while the stuck page is still open
            return last[-2:]

    said, message = asyncio.run(look())
    assert json.loads(said.data) == {"op": "end", "failure": ""}
    assert message.type is aiohttp.WSMsgType.CLOSE and message.data == 1001
    assert sum(asked) < 1.0


def test_a_slow_network_does_not_lose_its_page(node: Any, client: Any) -> None:
    """A sign of life can only come after the bundle that is on its way: 16 s for one are no reason to hang up."""

    async def look() -> dict[str, Any]:
        async with client() as page:
            await page.show(EVENTS)
            await page.bundle()
            await asyncio.sleep(16)  # this client answers nothing, as one whose bundle is still on its way
            await page.ack()
            return await page.part("e", lambda: (node.idle(), node.runtime.send("/cam0/events", events_at(1))))

    assert asyncio.run(look())["kind"] == "events"


def test_a_page_that_speaks_while_the_run_ends_is_told_of_it(
    node: Any, client: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What it sends is read until it has answered: a socket closed before that would take the last messages with it."""
    answers, goodbye = [], application._goodbye

    async def asked(ws: Any, failure: str) -> None:
        await goodbye(ws, failure)
        answers.append(ws.close_code)  # 1000 where the server has not waited

    monkeypatch.setattr(application, "_goodbye", asked)

    async def look() -> list[Any]:
        async with client() as page:
            page.ws._autoclose = False  # it answers below, with a code of its own
            await page.show(EVENTS)
            await page.bundle()

            async def speak() -> None:
                while not page.ws.closed:
                    await page.ws.send_json({"op": "ack"})
                    await asyncio.sleep(0.0005)

            speaking = asyncio.create_task(speak())
            await asyncio.sleep(0.05)
            closing = asyncio.get_running_loop().run_in_executor(None, node.close)
            last = [await page.ws.receive(60)]
            while last[-1].type in (aiohttp.WSMsgType.TEXT, aiohttp.WSMsgType.BINARY):
                last.append(await page.ws.receive(60))
            await page.ws.close(code=4321)
            speaking.cancel()
            await asyncio.gather(speaking, return_exceptions=True)
            await closing
            return last[-2:]

    said, message = asyncio.run(look())
    assert json.loads(said.data) == {"op": "end", "failure": ""}
    assert message.type is aiohttp.WSMsgType.CLOSE and message.data == 1001
    assert answers == [4321]
