"""Chooses which topics of a bag are replayed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase

from evis.bag import BagError
from msgs.topics import SYSTEM_TOPICS, UnknownTopic, find_topic

REGENERATED = ("frames", "samples", "events", "signal", "labels")
"""Outputs that interpolator, event sensor and labeler make again from keyframes."""


def topics_to_play(
    topics: Mapping[str, str], include: Sequence[str], exclude: Sequence[str], regenerate: bool, bag: str
) -> list[str]:
    """Returns the names of the topics to publish. `topics`: topic -> message type of the bag. Raises BagError."""
    if not topics:
        raise BagError(
            f"{bag} holds no topics of EVIS; the events of another recorder's bag are played by "
            f"`evis launch camera.yaml file:={bag}`"
        )
    cameras = {name.rsplit("/", 1)[0] for name in topics if name.endswith("/keyframe")}
    if regenerate and not cameras:
        raise BagError(
            f"{bag} holds no keyframes to regenerate from; record them with "
            "--record-topics '/*/keyframe,/*/depth,/*/motion,/*/ids'"
        )
    chosen = []
    for name, kind in sorted(topics.items()):
        camera, _, last = name.rpartition("/")
        if name in SYSTEM_TOPICS or not _is_of_evis(name, kind):  # the running graph has its own of the former
            continue
        if include and not any(fnmatchcase(name, g) for g in include):
            continue
        if any(fnmatchcase(name, g) for g in exclude) or (regenerate and camera in cameras and last in REGENERATED):
            continue
        chosen.append(name)
    if (include or exclude) and not chosen:
        like = f" that is like {', '.join(include)}" if include else ""
        unlike = f"{' and' if include else ' that is'} not like {', '.join(exclude)}" if exclude else ""
        raise BagError(f"{bag} has no topic to play{like}{unlike}; it has {', '.join(sorted(topics))}")
    return chosen


def unknown_topics(topics: Mapping[str, str], include: Sequence[str], exclude: Sequence[str]) -> list[str]:
    """Lists the topics that are not published because EVIS has no topic of their name and type, as bags of other
    recorders have them.

    Topics that `include` and `exclude` leave out anyway are not among them.
    """
    wanted = [name for name in sorted(topics) if not include or any(fnmatchcase(name, g) for g in include)]
    return [
        name
        for name in wanted
        if name not in SYSTEM_TOPICS
        and not _is_of_evis(name, topics[name])
        and not any(fnmatchcase(name, g) for g in exclude)
    ]


def _is_of_evis(name: str, kind: str) -> bool:
    try:
        return find_topic(name).type.__name__ == kind
    except UnknownTopic:
        return False
