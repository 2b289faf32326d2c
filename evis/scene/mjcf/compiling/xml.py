"""Parses XML of models as the reader of MuJoCo does, which is more lenient than the standard: with line numbers."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from evis.scene.errors import SceneError
from evis.scene.sources import note

MAX_DEPTH = 500
"""Most elements within each other, as of MuJoCo's reader."""
_SPANS = (("<!--", "-->"), ("<![CDATA[", "]]>"), ("<?", "?>"), ("<!", ">"))
"""What begins and ends text that has no elements."""
_STOP = re.compile("[>\"']")
_NAME = re.compile(r"[^\s/>=]+")
_ENTITY = re.compile(r"&(?:#([0-9]{1,8})|#x([0-9A-Fa-f]{1,8})|(quot|amp|apos|lt|gt));")
_NAMED = {"quot": '"', "amp": "&", "apos": "'", "lt": "<", "gt": ">"}
"""All names that XML and MuJoCo's reader know; with one of HTML's, such as &sol;, a file would be another here."""
_ATTRIBUTE = re.compile(r"([^\s=/\"']+)(?:\s*=\s*(?:\"([^\"]*)\"|'([^']*)'))?")


@dataclass
class Element:
    """Holds one element, with the file and line where it begins. tag: in small letters, as MuJoCo compares some of
    them.
    """

    tag: str
    attributes: dict[str, str]
    file: Path
    line: int
    children: list[Element] = field(default_factory=list)

    @property
    def where(self) -> str:
        """Names `file:line` for errors."""
        return f"{self.file.name}:{self.line}"


def read_xml(path: Path) -> Element:
    """Reads all of a file below one element without a tag. What is not well formed is for MuJoCo to say.

    Raises SceneError for elements deeper than MAX_DEPTH, and for entities, which only serve to make a text grow.
    """
    text = note(path).read_text(encoding="utf-8", errors="surrogateescape")
    root = Element("", {}, path, 1)
    open_ones = [root]
    for line, piece in _pieces(text):
        if piece.startswith("<!"):
            if "<!ENTITY" in piece.upper():
                raise SceneError(f"{path.name}:{line}: defines entities, which models have no use for")
            continue
        inside = piece[1:-1].strip()
        name = _NAME.match(inside)
        if name is None:
            if inside.startswith("/") and len(open_ones) > 1:
                open_ones.pop()
            continue
        attributes = {key: _ENTITY.sub(_character, a or b) for key, a, b in _ATTRIBUTE.findall(inside, name.end())}
        element = Element(name[0].lower(), attributes, path, line)
        open_ones[-1].children.append(element)
        if not inside.endswith("/"):
            open_ones.append(element)
            if len(open_ones) > MAX_DEPTH:
                raise SceneError(f"{path.name}:{line}: elements nested deeper than {MAX_DEPTH} levels")
    return root


def _character(entity: re.Match[str]) -> str:
    """What an entity stands for; itself where that is no character."""
    decimal, sixteenths, name = entity.groups()
    if name:
        return _NAMED[name]
    code = int(decimal) if decimal else int(sixteenths, 16)
    return chr(code) if 0 < code < 0x110000 else entity[0]


def _pieces(text: str) -> Iterator[tuple[int, str]]:
    """The tags and declarations of a text, each with its line; up to the first that does not end."""
    line, counted, at = 1, 0, 0
    while (start := text.find("<", at)) >= 0:
        line, counted = line + text.count("\n", counted, start), start
        span = next(((begin, end) for begin, end in _SPANS if text.startswith(begin, start)), None)
        if span is None:
            at = _end_of_tag(text, start + 1)
        else:
            found = text.find(span[1], start + len(span[0]))
            at = found + len(span[1]) if found >= 0 else 0
            if span[0] == "<!" and "[" in text[start:at]:  # a document type with declarations of its own
                found = text.find("]", start)
                at = text.find(">", found) + 1 if found >= 0 else 0
        if not at:
            return
        if span is None or span[0] == "<!":
            yield line, text[start:at]


def _end_of_tag(text: str, at: int) -> int:
    """Where the tag ends that holds `at`, a > in quotes left aside; 0 if it does not."""
    while stop := _STOP.search(text, at):
        if stop[0] == ">":
            return stop.end()
        at = text.find(stop[0], stop.end()) + 1
        if not at:
            break
    return 0
