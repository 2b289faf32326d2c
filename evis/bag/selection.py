"""Selects the topics of a graph that a recording takes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase

from evis.config.params import ParamError
from msgs.topics import TOPICS, UnknownTopic, find_topic

SUB_FRAMES = ("frames", "samples")
FIRST_ENV = "/env0"
"""Prefix of the preview where there are several environments: the first stands for all."""


def select(available: Iterable[str], globs: Sequence[str] = ()) -> list[str]:
    """Selects the topics that are recorded: those that the topic table records by default, and those that match a glob.

    Sub-frames (1 GB/s, made again bit for bit by a lock-step replay), with further samples of single pixels or without,
    only match a glob whose last part names them.
    """
    return [name for name in available if _default(name) or any(_matches(name, g) for g in globs)]


def _default(name: str) -> bool:
    try:
        return find_topic(name).recorded
    except UnknownTopic:
        return False


def _matches(name: str, glob: str) -> bool:
    glob = glob if glob.startswith(("/", "*")) else "/" + glob
    last = name.rpartition("/")[2]
    if last in SUB_FRAMES and last not in glob.rpartition("/")[2]:
        return False
    return fnmatchcase(name, glob)


def unmatched(available: Iterable[str], globs: Sequence[str]) -> list[str]:
    """Returns the globs that match no topic of the table, most likely for a typing error."""
    examples = [*available, *(row.pattern.replace("<cam>", "cam0") for row in TOPICS)]
    return [g for g in globs if not any(_matches(name, g) for name in examples)]


def unpublished(published: Iterable[str], globs: Sequence[str]) -> list[str]:
    """Returns the globs that match no topic of a graph, so that they record nothing."""
    names = list(published)
    return [g for g in globs if not any(_matches(name, g) for name in names)]


def preview_sources(available: Iterable[str]) -> list[str]:
    """Returns the keyframe topics that a preview is made from: those of cameras that have no image of their own."""
    names = list(available)
    stems = [n.rsplit("/", 1)[0] for n in names if n.endswith("/keyframe")]
    return [f"{s}/keyframe" for s in stems if f"{s}/image" not in names and f"{FIRST_ENV}{s}/image" not in names]


def subscribed(available: Iterable[str], globs: Sequence[str], preview_hz: float) -> list[str]:
    """Returns the topics of `available` that a recorder reads: the recorded ones, and keyframes for the preview.

    Raises ParamError for a glob that no topic is like.
    """
    names = list(available)
    wrong = unmatched(names, globs)
    if wrong:
        raise ParamError(f"recorder: no topic is like '{wrong[0]}'; the graph has {', '.join(sorted(names))}")
    previews = preview_sources(names) if preview_hz else []
    return list(dict.fromkeys([*select(names, globs), *previews]))
