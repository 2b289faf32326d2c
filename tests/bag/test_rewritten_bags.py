"""Bags that another tool has written anew: chunks of its own, and messages in the order of their log times."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from bag_messages import copied, same, scene
from mcap.reader import make_reader
from mcap.writer import Writer

from evis.bag.reader import BagReader
from evis.bag.writer import BagWriter
from msgs.camera import Imu

KEYFRAMES = 4


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("bag") / "a.mcap"
    with BagWriter(path) as writer:
        for k in range(KEYFRAMES):
            for topic, message in scene(k).items():
                if isinstance(message, Imu):  # of the time before the message, as a camera's
                    message = dataclasses.replace(message, t=message.t - 1)
                writer.write(topic, message)
    return path


def rewritten(source: Path, target: Path, *, ordered: bool = False, without: tuple[str, int] = ("", 0)) -> None:
    """As a filter of the MCAP library does it. A message in each chunk; without: a channel's message of that number."""
    with open(source, "rb") as given, open(target, "wb") as stream:
        writer = Writer(stream, chunk_size=1)
        writer.start(profile="ros2", library="another tool")
        schemas: dict[int, int] = {}
        channels: dict[int, int] = {}
        for schema, channel, message in make_reader(given).iter_messages(log_time_order=ordered):
            assert schema is not None
            if (channel.topic, message.sequence) == without:
                continue
            if schema.id not in schemas:
                schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
            if channel.id not in channels:
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, schemas[schema.id], dict(channel.metadata)
                )
            at = message.log_time, message.data, message.publish_time, message.sequence
            writer.add_message(channels[channel.id], *at)
        writer.finish()


@pytest.mark.parametrize("ordered", [False, True])
def test_every_message_is_what_it_was(bag, tmp_path, ordered):
    rewritten(bag, tmp_path / "b.mcap", ordered=ordered)
    with BagReader(bag) as before, BagReader(tmp_path / "b.mcap") as after:
        expected = [(topic, copied(message)) for topic, message in before.messages()]
        found = [(topic, copied(message)) for topic, message in after.messages()]
    assert [t for t, _ in found] == [t for t, _ in expected] and after.skipped == 0
    # what a node has told holds NaN, which is not equal to itself
    assert all(same(a, b) or topic == "/diagnostics" for (topic, a), (_, b) in zip(found, expected))


@pytest.mark.parametrize(("lost", "skipped"), [("/cam0/events", 1), ("/cam0/events/meta", 0)])
def test_a_packet_of_which_a_part_is_gone_is_left_out_alone(bag, tmp_path, lost, skipped):
    rewritten(bag, tmp_path / "b.mcap", without=(lost, 2))
    with BagReader(tmp_path / "b.mcap") as after:
        found = [copied(message) for _, message in after.messages(["/cam0/events"])]
    expected = [scene(k)["/cam0/events"] for k in range(KEYFRAMES) if k != 2]
    assert len(found) == len(expected) and all(same(a, b) for a, b in zip(found, expected))
    assert after.skipped == skipped
