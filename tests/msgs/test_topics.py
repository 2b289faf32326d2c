"""The topic table against the design's list, and the error for a name it does not have."""

import pytest

from msgs.camera import EventPacket, Keyframe
from msgs.header import Message
from msgs.topics import TOPICS, UnknownTopic, find_topic
from msgs.world import WorldState


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("/state", WorldState),
        ("/cam0/events", EventPacket),
        ("/robot/left/events", EventPacket),
        ("/front.cam-1/keyframe", Keyframe),
    ],
)
def test_find(name: str, kind: type[Message]) -> None:
    assert find_topic(name).type is kind


@pytest.mark.parametrize("name", ["events", "/events", "/cam0/event", "/cam0/events/", "", "/ca m/events", "//events"])
def test_unknown(name: str) -> None:
    with pytest.raises(UnknownTopic):
        find_topic(name)


def test_unknown_names_the_nearest() -> None:
    with pytest.raises(UnknownTopic, match="nearest is /<cam>/keyframe"):
        find_topic("/cam0/keyfrane")


def test_every_row_is_a_message_and_unique() -> None:
    assert len({t.pattern for t in TOPICS}) == len(TOPICS)
    assert {t.type for t in TOPICS} == set(Message.TYPES.values())
    assert all(t.queue > 0 and t.help for t in TOPICS)
