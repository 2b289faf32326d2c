"""Several clients, slow ones and hostile ones: taps open and close with them, and nobody else notices."""

from __future__ import annotations

import asyncio
import json
import re
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from foxglove_node import ENDED, LIMIT_S, Foxglove, Served, make_plan
from websockets.exceptions import ConnectionClosed

from msgs.camera import CameraInfo, Depth
from msgs.header import Header
from nodes.foxglove import session
from nodes.foxglove.channels import Channels, Frame
from nodes.foxglove.client import Client
from nodes.foxglove.relay import LEFT_OUT, MISSED, Relay
from nodes.foxglove.session import MOST_FAULTS


def depth(k: int, side: int = 4) -> Depth:
    """An image of which every pixel is k."""
    return Depth(Header(k * 1_000_000, k), np.full((1, side, side), k, np.float32))


def info(width: int) -> CameraInfo:
    return CameraInfo(Header(0), np.eye(3), np.zeros(0), width=width, height=4)


def first_pixel(client: Foxglove, payload: bytes) -> float:
    return float(np.frombuffer(client.decode("/cam0/depth", payload).data, "<f4")[0])


def test_nothing_is_tapped_until_somebody_subscribes(served: Served, client: Foxglove) -> None:
    for _ in range(3):
        served.node.idle()
        assert served.runtime.taps == {} and served.runtime.requested == []
    ids = client.subscribe("/cam0/depth", "/cam0/depth/meta")
    served.until_tapped("/cam0/depth")
    client.say("unsubscribe", subscriptionIds=ids[:1])
    served.send("/cam0/depth", depth(1))
    client.next("/cam0/depth/meta")
    assert served.runtime.taps.keys() == {"/cam0/depth"}
    client.say("unsubscribe", subscriptionIds=ids[1:])
    served.until_tapped()
    client.say("subscribe", subscriptions=[{"id": ids[0], "channelId": client.channels["/cam0/depth"]["id"]}])
    served.until_tapped("/cam0/depth")  # the id may be used again
    served.send("/cam0/depth", depth(2))
    assert first_pixel(client, client.next("/cam0/depth")[1]) == 2


def test_two_clients_share_a_tap_until_the_last_one_has_gone(served: Served, client: Foxglove) -> None:
    with Foxglove(served.address) as other:
        client.subscribe("/cam0/depth")
        other.subscribe("/cam0/depth", "/state")
        served.until_tapped("/cam0/depth", "/state")
        served.send("/cam0/depth", depth(3))
        assert [first_pixel(one, one.next("/cam0/depth")[1]) for one in (client, other)] == [3, 3]
    served.until_tapped("/cam0/depth")
    served.send("/cam0/depth", depth(4))
    assert first_pixel(client, client.next("/cam0/depth")[1]) == 4


def test_what_is_latched_comes_to_who_subscribes_later(served: Served, client: Foxglove) -> None:
    """Once the topic is read no more it may change, and the tap brings it anew."""
    client.subscribe("/cam0/info")
    served.until_tapped("/cam0/info")
    served.send("/cam0/info", info(5))
    assert client.read("/cam0/info").width == 5
    with Foxglove(served.address) as later:
        (both, _) = later.subscribe("/cam0/info", "/cam0/info/meta")
        assert later.read("/cam0/info").width == 5 and later.read("/cam0/info/meta")["width"] == 5
        later.say("unsubscribe", subscriptionIds=[both])
    client.say("unsubscribe", subscriptionIds=[0])
    served.until_tapped()
    client.subscribe("/cam0/info")
    served.until_tapped("/cam0/info")
    assert not client.hear(0.1)
    served.send("/cam0/info", info(6))
    assert client.read("/cam0/info").width == 6


def test_a_topic_that_cannot_be_read_is_told(served: Served, client: Foxglove) -> None:
    served.runtime.refuse = "/state"
    client.subscribe("/state", "/cam0/depth")
    status = client.status(served.node.idle)
    assert status == {
        "op": "status", "level": 2, "message": "/state cannot be shown: nobody publishes /state"
    }  # fmt: skip
    served.until(lambda: served.runtime.said == ["/state cannot be shown: nobody publishes /state"])
    assert served.runtime.taps.keys() == {"/cam0/depth"}
    client.say("unsubscribe", subscriptionIds=[0])
    served.runtime.refuse = ""
    client.subscribe("/state/meta")
    served.until_tapped("/state", "/cam0/depth")


def test_a_slow_client_loses_messages_and_slows_nobody(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that reads nothing, of 200 images of 1 MB; what it lost is counted, and told when it reads again. Of the
    other one, which reads each image before the next is made, nothing is left out.
    """
    monkeypatch.setattr(session, "TOLD_S", 0.5)
    count, side = 200, 512
    with Foxglove(served.address) as quick, Foxglove(served.address, max_queue=1) as slow:
        quick.subscribe("/cam0/depth")
        slow.subscribe("/cam0/depth")
        readers = served.node._relay._readers  # type: ignore[union-attr]
        served.until(lambda: any(len(clients) == 2 for clients in readers.values()))
        for k in range(1, count + 1):
            served.send("/cam0/depth", depth(k, side))
            assert first_pixel(quick, quick.next("/cam0/depth")[1]) == k
        served.node.idle()
        left_out = served.runtime.counted[LEFT_OUT]
        assert left_out > 0
        got = []
        while not got or got[-1] != count:
            got.append(first_pixel(slow, slow.next("/cam0/depth")[1]))
        assert got == sorted(got) and len(got) == count - left_out  # what came, and what was left out, is all
        text = slow.status()["message"]
        assert f"{left_out} messages were left out" in text
        assert quick.statuses == []


def test_who_is_always_behind_is_told_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """While one message is sent the next one takes the place of another, without end."""
    monkeypatch.setattr(session, "TOLD_S", 0.05)
    texts: list[str] = []

    class Behind:
        async def send_bytes(self, data: bytes) -> None:
            for k in range(3):
                one._client.offer(channel, [Frame(k, b"x")])
            await asyncio.sleep(0)

        async def send_str(self, text: str) -> None:
            texts.append(json.loads(text)["message"])

    async def serve_it() -> None:
        nonlocal one
        one = session.Session(relay, Behind())  # type: ignore[arg-type]
        one._client.subscribe(0, channel)
        one._client.offer(channel, [Frame(0, b"x")])
        writer = asyncio.create_task(one._write())
        async with asyncio.timeout(LIMIT_S):
            while not texts:
                await asyncio.sleep(0.01)
        writer.cancel()

    one: session.Session
    relay = Relay(make_plan())
    channel = relay._channels.all[1]
    asyncio.run(serve_it())
    assert "messages were left out, for this connection was not ready" in texts[0]


def test_a_fault_of_the_server_ends_the_connection_and_is_said(
    served: Served, client: Foxglove, monkeypatch: pytest.MonkeyPatch
) -> None:
    """None goes on as one on which nothing comes any more."""

    def broken(*_: object) -> bytes:
        raise KeyError("of ours")

    monkeypatch.setattr(session.protocol, "message_data", broken)
    client.subscribe("/cam0/depth")
    served.until_tapped("/cam0/depth")
    served.send("/cam0/depth", depth(1))
    ended(client)
    served.until_tapped()
    assert any("KeyError: 'of ours'" in line for line in served.until(lambda: served.runtime.said))


def test_what_the_tap_missed_is_counted_and_told(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "TOLD_S", 0.2)
    told = 0
    with Foxglove(served.address) as client, Foxglove(served.address) as other:
        client.subscribe("/cam0/depth", "/cam0/depth/meta")
        other.subscribe("/state")
        served.until_tapped("/cam0/depth", "/state")
        for lost in (7, 9):
            served.runtime.taps["/cam0/depth"].lost = lost
            served.node.idle()
        while told < 9:
            text = client.status()["message"]
            told += int(re.findall(r"s (\d+) came faster than they are read here", text)[0])
        served.node.idle()
        assert told == served.runtime.counted[MISSED] == 9 and not other.hear(0.5)


def test_of_each_subscription_the_newest_waits() -> None:
    """Whatever its size, that is all that a client costs."""
    channels = Channels(make_plan()).all
    client = Client(lambda: None)
    for number in (1, 2):
        client.subscribe(10 + number, channels[number])
    lost = [client.offer(channels[1 + k % 2], [Frame(k, b"x")]) for k in range(6)]
    assert lost == [False, False, True, True, True, True] and not client.offer(channels[3], [])
    client.miss(3)
    assert [client.take() for _ in range(3)] == [(11, [(4, b"x")]), (12, [(5, b"x")]), None]
    assert client.losses() == (4, 3) and client.losses() == (0, 0)


WRONG: dict[str, tuple[Any, str]] = {
    "no JSON": ("{", "not JSON"),
    "no text at all": ("", "not JSON"),
    "nested": ("[" * 60_000, "not JSON"),
    "no object": ("[1]", "not a JSON object"),
    "a number": ("7", "not a JSON object"),
    "too long": (json.dumps({"op": "subscribe", "subscriptions": [0] * 70_000}), "longer than 65536 bytes"),
    "no op": ("{}", "op None is not offered"),
    "an op that is no text": ('{"op": ["subscribe"]}', "is not offered"),
    "what is not offered": ('{"op": "getParameters", "parameterNames": []}', "op 'getParameters' is not offered"),
    "publishing": ('{"op": "advertise", "channels": []}', "op 'advertise' is not offered"),
    "no list": ('{"op": "subscribe", "subscriptions": {}}', "needs 'subscriptions', a list"),
    "no list of ids": ('{"op": "unsubscribe"}', "needs 'subscriptionIds', a list"),
    "no subscription": ('{"op": "subscribe", "subscriptions": [7]}', "not an object"),
    "no such channel": ('{"op": "subscribe", "subscriptions": [{"id": 0, "channelId": 99}]}', "no channel 99"),
    "negative": ('{"op": "subscribe", "subscriptions": [{"id": -1, "channelId": 1}]}', "id -1 is not a whole number"),
    "fraction": ('{"op": "subscribe", "subscriptions": [{"id": 1.5, "channelId": 1}]}', "id 1.5 is not a whole"),
    "truth": ('{"op": "subscribe", "subscriptions": [{"id": true, "channelId": 1}]}', "id True is not a whole"),
    "too large": ('{"op": "subscribe", "subscriptions": [{"id": 4294967296, "channelId": 1}]}', "id 4294967296 is"),
    "no subscription of it": ('{"op": "unsubscribe", "subscriptionIds": [5]}', "no subscription 5"),
    "an id of no kind": ('{"op": "unsubscribe", "subscriptionIds": ["5"]}', "subscription id '5' is not"),
    "binary": (b"\x01\x00\x00\x00\x00", "cannot publish"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_what_means_nothing_is_answered_with_one_status(served: Served, client: Foxglove, name: str) -> None:
    """And the client is served on."""
    sent, told = WRONG[name]
    client.ws.send(sent)
    status = client.status()
    assert status["level"] == 2 and told in status["message"] and len(status["message"]) <= 300
    client.subscribe("/cam0/depth")
    served.until_tapped("/cam0/depth")
    served.send("/cam0/depth", depth(1))
    assert first_pixel(client, client.next("/cam0/depth")[1]) == 1
    assert client.statuses == [] and served.runtime.counted["requests_refused"] == 1 and served.runtime.said == []


def test_ids_and_channels_are_taken_once(served: Served, client: Foxglove) -> None:
    client.say("subscribe", subscriptions=[{"id": 1, "channelId": 1}, {"id": 1, "channelId": 2}])
    assert client.status()["message"] == "subscription 1 is there already"
    client.say("subscribe", subscriptions=[{"id": 2, "channelId": 1}])
    assert client.status()["message"] == "channel 1 is subscribed to already"


def ended(client: Foxglove) -> tuple[int, int]:
    """Statuses until a client was cut off, and the code of that; 0 where it was cut off without a word."""
    try:
        while True:
            assert client.hear(LIMIT_S)
    except ConnectionClosed as closed:
        return len(client.statuses), closed.rcvd.code if closed.rcvd else 0


@pytest.mark.parametrize(
    "flood",
    [
        lambda client: [client.ws.send("{}") for _ in range(MOST_FAULTS)],
        lambda client: [
            client.say("subscribe", subscriptions=[{"id": i, "channelId": i} for i in range(k, k + 1000)])
            for k in range(0, 10_000, 1000)
        ],
    ],
    ids=["nonsense", "10000 subscriptions"],
)
def test_who_goes_on_with_it_is_cut_off(served: Served, client: Foxglove, flood: Callable[[Foxglove], Any]) -> None:
    with Foxglove(served.address) as hostile:
        try:
            flood(hostile)
        except ConnectionClosed:
            pass  # before it had sent all
        assert ended(hostile) == (MOST_FAULTS, 1008)
    served.node.idle()
    assert served.runtime.taps == {}
    assert served.runtime.counted["requests_refused"] == MOST_FAULTS and served.runtime.said == []
    client.subscribe("/cam0/depth")
    served.until_tapped("/cam0/depth")
    served.send("/cam0/depth", depth(1))
    assert first_pixel(client, client.next("/cam0/depth")[1]) == 1


def test_a_message_that_would_fill_memory_ends_it_at_once(served: Served, client: Foxglove) -> None:
    try:
        client.ws.send("x" * (8 << 20))
    except ConnectionClosed:
        pass
    assert ended(client)[1] in (0, 1009)  # what it has still to send may cut off what it is told
    with Foxglove(served.address) as other:
        assert other.channels
    assert served.runtime.said == []


@pytest.mark.parametrize(
    ("failure", "level", "text"),
    [("", 0, ENDED), ("renderer died", 2, "the run has failed: renderer died")],
)
def test_the_end_is_told(served: Served, client: Foxglove, failure: str, level: int, text: str) -> None:
    """After all that waited."""
    client.subscribe("/cam0/depth")
    served.until_tapped("/cam0/depth")
    served.send("/cam0/depth", depth(5))
    served.runtime.failure = failure
    served.node.finish()
    began = time.monotonic()
    served.node.close()
    assert time.monotonic() - began < LIMIT_S
    assert ended(client) == (1, 1001) and client.statuses == [{"op": "status", "level": level, "message": text}]
    assert first_pixel(client, client.next("/cam0/depth")[1]) == 5
    assert served.runtime.taps == {}
