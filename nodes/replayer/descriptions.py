"""Keeps the descriptions of cameras (CameraInfo) that hold where a replay, or another round of it, begins.

A description is recorded once, and again where it changes. A replay that begins later in the bag, or plays it again,
needs the one that held there.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import islice, takewhile
from typing import TYPE_CHECKING

from msgs.camera import CameraInfo, Keyframe
from msgs.header import Message

if TYPE_CHECKING:
    from evis.bag.reader import BagReader


def _order_of(message: Message) -> tuple[int, int, int]:
    """Returns the key that sorts a topic's messages in the order of recording."""
    return *message.header.instant, message.header.seq


def descriptions_until(reader: BagReader, topic: str, start: int, episode: int) -> list[Message]:
    """Lists the descriptions of a camera from before a replay begins, the last of which holds there; the first of all
    where there is none.

    start: stamp [ns], and episode, of the first message that is played.
    """
    until = (info for _, info in reader.messages([topic], None, start))
    earlier = list(takewhile(lambda info: info.header.episode <= episode, until))
    return earlier or [info for _, info in islice(reader.messages([topic]), 1)]


def check_pixels(reader: BagReader, described: Mapping[str, Message]) -> None:
    """Checks that the keyframes of cameras are of whole pixels, with described: topic -> CameraInfo.

    Raises ValueError where a keyframe holds the samples of each pixel apart.
    """
    for topic, info in described.items():
        camera = topic.rpartition("/")[0]
        of_keyframes = f"{camera}/keyframe"
        if of_keyframes not in reader.topics or not isinstance(info, CameraInfo):
            continue
        _, key = next(reader.messages([of_keyframes]), ("", None))
        if isinstance(key, Keyframe) and (n := (key.image.shape[1] - 2 * key.margin) // info.height) > 1:
            raise ValueError(
                f"{of_keyframes} of {reader.path} has {n}x{n} samples of each pixel apart, which interpolator rigid "
                "alone takes; leave out interpolator:= and upsampling:=, or record a run that has these"
            )


class Descriptions:
    """Keeps, by topic, the descriptions that hold where a round begins, and which of them were replaced since."""

    def __init__(self, at_start: Mapping[str, Message]) -> None:
        """Takes topic -> the description that holds where a round begins."""
        self.at_start = dict(at_start)
        self._orders = {topic: _order_of(message) for topic, message in self.at_start.items()}
        self._replaced: set[str] = set()

    def covers(self, topic: str, message: Message) -> bool:
        """Tells whether a message is a description from before the round, where the last of these was published
        already."""
        return topic in self._orders and _order_of(message) <= self._orders[topic]

    def published(self, topic: str) -> None:
        """Notes that a message of a topic was published; a description replaces the one that held before."""
        if topic in self._orders:
            self._replaced.add(topic)

    def restart(self) -> list[str]:
        """Begins another round, and returns the topics whose descriptions must be published again."""
        replaced, self._replaced = sorted(self._replaced), set()
        return replaced
