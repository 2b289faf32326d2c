"""Cuts the faces of a PLY into triangles where trimesh would not: in binary files whose faces differ in their numbers
of corners, and where faces have colours, of which it would keep one for each face and not for each triangle.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

INDICES = ("vertex_indices", "vertex_index")
TRIANGLE = 3
"""Corners of a triangle."""
_TYPES = {
    "char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "float": "f", "double": "d",
    "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "float32": "f", "float64": "d",
}  # fmt: skip
_END = re.compile(rb"^end_header[ \t]*\r?\n", re.MULTILINE)
_FACES = re.compile(rb"^(element[ \t]+face[ \t]+)\d+", re.MULTILINE)

Field = list[bytes]
"""The numbers of one property of a face, as the file has them."""


@dataclass(frozen=True)
class _Property:
    """Describes a property. kind: of its numbers, as `struct` names it. counted: kind of the count before a list."""

    name: str
    kind: str
    counted: str = ""


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    properties: list[_Property]

    @property
    def size(self) -> int | None:
        """Bytes of a row; None where it has lists."""
        if any(p.counted for p in self.properties):
            return None
        return sum(struct.calcsize(f"<{p.kind}") for p in self.properties)


def cut_faces(content: bytes) -> bytes:
    """Returns a PLY whose faces are triangles, fans of those that it has, where trimesh cannot cut them right; any
    other as it is.

    Raises ValueError for a file that is cut.
    """
    end = _END.search(content)
    if end is None:
        return content
    head = content[: end.end()]
    order, elements = _elements(head.decode("latin-1"))
    names = [element.name for element in elements]
    if not order:
        _check_lines(content[end.end() :], sum(element.count for element in elements))
    if names.count("face") != 1:
        return content
    before, faces = elements[: names.index("face")], elements[names.index("face")]
    place = next((k for k, p in enumerate(faces.properties) if p.name in INDICES and p.counted), None)
    if place is None or not faces.count:
        return content
    coloured = any(p.name == "red" for p in faces.properties)
    if order:
        sizes = [element.size for element in before]
        if None in sizes:
            return content
        start = end.end() + sum((size or 0) * element.count for size, element in zip(sizes, before))
        alike = _alike(content, start, faces, order)
        if alike and (alike[place] == TRIANGLE or not coloured):
            return content
        cut, rest = _binary_cut(content, start, faces, order, place)
        whole = content[end.end() : start]
    else:
        if not coloured:
            return content
        lines = [line for line in content[end.end() :].splitlines() if line.strip()]
        start = sum(element.count for element in before)
        rows = [list(_words(line.split(), faces)) for line in lines[start : start + faces.count]]
        if all(len(row[place]) == TRIANGLE for row in rows):
            return content
        rest = b"".join(line + b"\n" for line in lines[start + faces.count :])
        cut = [_line(triangle, faces) for row in rows for triangle in _fan(row, len(row[place]))]
        whole = b"".join(line + b"\n" for line in lines[:start])
    head = _FACES.sub(rb"\g<1>%d" % len(cut), head)
    return b"".join((head, whole, *cut, rest))


def _elements(head: str) -> tuple[str, list[_Element]]:
    """The order of bytes, as `struct` names it, "" of a text; and the elements of a header."""
    order, elements = "", list[_Element]()
    for line in head.splitlines():
        words = line.split()
        if words[:1] == ["format"]:
            order = {"binary_little_endian": "<", "binary_big_endian": ">"}.get(words[1], "")
        elif words[:1] == ["element"]:
            elements.append(_Element(words[1], int(words[2]), []))
        elif words[:1] == ["property"] and words[1] == "list":
            elements[-1].properties.append(_Property(words[4], _TYPES[words[3]], _TYPES[words[2]]))
        elif words[:1] == ["property"]:
            elements[-1].properties.append(_Property(words[2], _TYPES[words[1]]))
    return order, elements


def _check_lines(body: bytes, told: int) -> None:
    """Raises ValueError for a text with fewer lines than its header tells of, of which trimesh reads what is there."""
    found = sum(1 for line in body.splitlines() if line.strip())
    if found < told:
        raise ValueError(f"it is cut: its header tells of {told} lines, and {found} are there")


def _alike(content: bytes, at: int, faces: _Element, order: str) -> list[int]:
    """How many numbers each property has if that is the same in all faces; empty where they differ, or are cut."""
    first, places = [], []
    row = at
    for p in faces.properties:
        size = struct.calcsize("<" + p.kind)
        count = 1
        if p.counted:
            width = struct.calcsize("<" + p.counted)
            if row + width > len(content):
                return []
            count = int(struct.unpack_from(order + p.counted, content, row)[0])
            places.append((row, order + p.counted, count))
            row += width
        if count < 0:
            return []
        first.append(count)
        row += count * size
    if len(content) - at < (row - at) * faces.count:
        return []
    for place, kind, count in places:
        found: np.ndarray = np.ndarray((faces.count,), kind, content, place, (row - at,))
        if (found != count).any():
            return []
    return first


def _binary_cut(content: bytes, at: int, faces: _Element, order: str, place: int) -> tuple[list[bytes], bytes]:
    """The triangles, and what is behind the faces. place: of the property that names the vertices."""
    plan = [
        (struct.Struct(order + p.counted) if p.counted else None, struct.calcsize("<" + p.kind))
        for p in faces.properties
    ]
    cut = []
    for number in range(faces.count):
        begin, parts = at, []
        for counted, size in plan:
            count = 1
            if counted is not None:
                count = counted.unpack_from(content, at)[0] if at + counted.size <= len(content) else -1
                at += counted.size
            if not 0 <= count * size <= len(content) - at:
                raise ValueError(f"it is cut, or damaged: face {number} of {faces.count} is not there")
            parts.append((at, count, size))
            at += count * size
        corners = parts[place][1]
        if corners == TRIANGLE:
            cut.append(content[begin:at])
            continue
        row = [[content[k : k + size] for k in range(a, a + count * size, size)] for a, count, size in parts]
        cut += [_packed(triangle, faces, order) for triangle in _fan(row, corners)]
    return cut, content[at:]


def _words(words: list[bytes], faces: _Element) -> Iterator[Field]:
    at = 0
    for p in faces.properties:
        count = 1
        if p.counted:
            count, at = int(words[at]), at + 1
        if not 0 <= count <= len(words) - at:
            raise ValueError("it is cut, or damaged: a face is shorter than it says")
        yield words[at : at + count]
        at += count


def _fan(row: list[Field], n: int) -> Iterator[list[Field]]:
    """The triangles of a convex face of n corners; lists with numbers for each corner are cut likewise."""
    for k in range(1, n - 1):
        yield [
            field if len(field) == 1 or len(field) % n else _corners(field, len(field) // n, (0, k, k + 1))
            for field in row
        ]


def _corners(field: Field, each: int, which: tuple[int, ...]) -> Field:
    return [number for k in which for number in field[k * each : (k + 1) * each]]


def _packed(row: list[Field], faces: _Element, order: str) -> bytes:
    counts = (struct.pack(order + p.counted, len(f)) if p.counted else b"" for p, f in zip(faces.properties, row))
    return b"".join(count + b"".join(field) for count, field in zip(counts, row))


def _line(row: list[Field], faces: _Element) -> bytes:
    counts = ([b"%d" % len(f)] if p.counted else [] for p, f in zip(faces.properties, row))
    return b" ".join(word for count, field in zip(counts, row) for word in (*count, *field)) + b"\n"
