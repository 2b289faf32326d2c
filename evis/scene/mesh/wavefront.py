"""Reads texts of OBJ and MTL: their encoding, and what stands before a picture: `map_Kd -s 2 2 1 -o 0.5 0 0
wood.png`."""

from __future__ import annotations

import re

import numpy as np

_MOST = {"-s": 3, "-o": 3, "-t": 3, "-mm": 2}
"""Most words after an option; the others have one."""

_BACK = re.compile(rb"^f [^\n]*-[^\n]*", re.MULTILINE)
_FACE = re.compile(rb"^f [^\n]*", re.MULTILINE)
_NUMBERS = rb"(v|vt|vn|f|usemtl|mtllib|o|g|s)"
_ODD = re.compile(rb"^(?:[ \t]+%s[ \t]|%s\t)" % (_NUMBERS, _NUMBERS), re.MULTILINE)
_KEY = re.compile(rb"^[ \t]*%s[ \t]+" % _NUMBERS, re.MULTILINE)
_REMARK = re.compile(rb"^((?:(?:v|vt|vn|f) [^\n#]*)?|[ \t]*)#[^\n]*", re.MULTILINE)
_ZERO = re.compile(rb"^f [^\n]*(?<=[ \t/])0+(?=[/\s]|\Z)", re.MULTILINE)
_USE = re.compile(rb"^(usemtl [^\n]*)$", re.MULTILINE)
_LIBRARY = re.compile(rb"^mtllib ([^\n]*)$", re.MULTILINE)
_LAID = re.compile(rb"^f [^\n]*\d/\d", re.MULTILINE)
_LAID_BY = re.compile(rb"[ \t]\d+/(\d+)")
_BARE_FACE = re.compile(rb"^f [^\n]*(?<=[ \t])\d+(?://|\s|\Z)", re.MULTILINE)
_BARE = re.compile(rb"(?<=[ \t])(\d+)(?:/(?=/)|(?=\s|\Z))")
_WITH_NORMAL = re.compile(rb"^f [^\n]*/\d*/", re.MULTILINE)
_WITHOUT_NORMAL = re.compile(rb"^f [^\n]*(?<=[ \t])\d+(?:/\d*)?(?=\s|\Z)", re.MULTILINE)
_CORNER = re.compile(rb"(?<=[ \t])(\d+)(?:/(\d*)(?:/\d*)?)?(?=\s|\Z)")
_COORDINATES = re.compile(rb"^vt [^\n]*", re.MULTILINE)


def spelled_plainly(content: bytes) -> bytes:
    """Returns an OBJ whose lines begin with a key and one space, none with a remark behind numbers, as trimesh needs
    them: it sees no faces behind blanks or tabs, and takes what is in remarks for what the file says.
    """
    content = content.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    content = content.replace(b"\\\n", b"")
    if _ODD.search(content):
        content = _KEY.sub(rb"\1 ", content)
    return _REMARK.sub(rb"\1", content) if b"#" in content else content


def without_libraries(content: bytes) -> tuple[bytes, list[str]]:
    """Returns an OBJ, as `spelled_plainly` gives it, that names no MTL, and what stood behind each `mtllib`."""
    return _LIBRARY.sub(b"", content), [name.decode().strip() for name in _LIBRARY.findall(content)]


def without_mixed_normals(content: bytes) -> bytes:
    """Returns an OBJ, as `absolute` gives it, in which all corners name normals, or none does.

    trimesh takes faces of as many numbers for faces of as many corners: of a quad of `v/vt/vn` and a hexagon of `v/vt`
    the hexagon would be a quad too, with texture coordinates for vertices. Normals of files are not used.
    """
    if not (_WITH_NORMAL.search(content) and _WITHOUT_NORMAL.search(content)):
        return content
    return _FACE.sub(
        lambda face: _CORNER.sub(lambda corner: b"/".join(filter(None, corner.groups())), face[0]), content
    )


def laid_throughout(content: bytes) -> bytes:
    """Returns an OBJ, as `absolute` gives it, in which all corners of a material have texture coordinates, or none.

    Those that have none beside others get 0, 0, as other programs show them; trimesh would leave out those of all, as
    it would for a number that is too large. Raises ValueError for such a one.
    """
    if not _LAID.search(content):
        return content
    known = _COORDINATES.findall(content)
    most = max(map(int, _LAID_BY.findall(b"\n".join(_FACE.findall(content)))), default=0)
    if most > len(known) > 0:
        raise ValueError(f"a face names texture coordinates {most}; there are {len(known)}")
    if not _BARE_FACE.search(content):
        return content
    pieces = _USE.split(content)
    names = [b"", *pieces[1::2]]
    laid = {name for name, text in zip(names, pieces[::2]) if _LAID.search(text)}
    place = rb"\1/%d" % (len(known) + 1)
    pieces[::2] = [
        _FACE.sub(lambda face: _BARE.sub(place, face[0]), text) if name in laid else text
        for name, text in zip(names, pieces[::2])
    ]
    numbers = len(known[0].split()) - 1 if known else 2
    return b"".join([*pieces, b"\nvt", b" 0" * numbers, b"\n"])


def absolute(content: bytes) -> bytes:
    """Returns an OBJ, as `spelled_plainly` gives it, whose faces count vertices, texture coordinates and normals from
    the start of the file.

    Numbers below 0 count back from the face, where trimesh counts from the end of the file. Raises ValueError for one
    that leads nowhere.
    """
    if _ZERO.search(content):
        raise ValueError("a face names number 0; vertices, texture coordinates and normals count from 1")
    faces = list(_BACK.finditer(content))
    if not faces:
        return content
    at = [face.start() for face in faces]
    before = [
        np.searchsorted([match.start() for match in re.finditer(rb"^%s " % kind, content, re.MULTILINE)], at)
        for kind in (b"v", b"vt", b"vn")
    ]
    pieces, last = [], 0
    for face, *counts in zip(faces, *before):
        corners = [_counted(corner, counts) for corner in face[0].split()[1:]]
        pieces += [content[last : face.start()], b" ".join((b"f", *corners))]
        last = face.end()
    return b"".join([*pieces, content[last:]])


def _counted(corner: bytes, counts: list[int]) -> bytes:
    """A corner of a face with numbers from the start. counts: how many there are before it."""
    numbers = corner.split(b"/")
    for k, (number, count) in enumerate(zip(numbers, counts)):
        if number.startswith(b"-"):
            numbers[k] = b"%d" % (count + 1 + int(number))
            if count + int(number) < 0:
                raise ValueError(f"a face counts back {-int(number)} places, where there are {count}")
    return b"/".join(numbers)


def file_of(text: str) -> str:
    """Returns the file's name of a text that may begin with options."""
    return _taken_apart(text)[0]


def layout_of(text: str) -> tuple[np.ndarray, np.ndarray]:
    """Returns by what texture coordinates are multiplied, and what is added then, float64 [2] each."""
    options = _taken_apart(text)[1]
    found = []
    for key, default in (("-s", 1.0), ("-o", 0.0)):
        numbers = [float(word) for word in options.get(key, ())][:2]
        found.append(np.array(numbers + [default] * (2 - len(numbers))))
    return found[0], found[1]


def in_utf8(content: bytes) -> bytes:
    """Returns a text that is UTF-8, from one that is that or Latin-1."""
    try:
        content.decode()
    except UnicodeDecodeError:
        return content.decode("latin-1").encode()
    return content


def _taken_apart(text: str) -> tuple[str, dict[str, list[str]]]:
    words, options = text.split(), dict[str, list[str]]()
    while len(words) > 2 and words[0].startswith("-"):
        key, count = words[0], 1
        if key in _MOST:
            count = next((n for n in range(_MOST[key]) if not _is_number(words[1 + n])), _MOST[key])
        count = min(count, len(words) - 2)
        options[key], words = words[1 : 1 + count], words[1 + count :]
    return (" ".join(words) if options else text), options


def _is_number(word: str) -> bool:
    try:
        return bool(np.isfinite(float(word)))
    except ValueError:
        return False
