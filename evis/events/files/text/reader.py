"""Reads events as text, one a line: `t x y p` of the RPG data sets and E2VID, Prophesee's `x,y,p,t`, or as a header
says."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

from evis.events.arrays import Events
from evis.events.files.reading.bisection import place_before
from evis.events.files.reading.block_recording import BlockRecording, take_size
from evis.events.files.reading.zero_tail import data_end
from evis.events.files.reading.zip_archive import RECORDINGS, Archive, CutArchive, files_in, open_archive
from evis.events.files.text.columns import Format, find_format
from evis.events.files.text.numbers import parse_lines
from evis.events.recording import HEAD, OpenOptions, RecordingError, RecordingInfo
from evis.files.allowance import Allowance
from evis.files.magic import ZIP
from evis.files.zip_faults import ZIP_FAULTS

NAME = "text (t x y p)"

_BLOCK = 1 << 20
_MOST_TRIED = 32
"""Members of an archive that are looked into."""


def matches(head: bytes, path: Path, name: str) -> bool:
    """Tells whether a file holds lines of four numbers, perhaps behind a line with the size or the names of the
    columns.
    """
    return find_format(head) is not None


class TextRecording(BlockRecording):
    """Reads a text file, or the one of a zip archive.

    Times exactly as written; lines that hold no event are counted.
    """

    def __init__(self, path: Path, options: OpenOptions) -> None:
        self._path, self._read = path, 0
        self._zip: Archive | None = None
        try:
            try:
                with path.open("rb") as file:
                    packed = file.read(4) == ZIP
                self._zip = open_archive(path) if packed else None
                self._file, size = self._open(options.topic)
                head = self._file.read(HEAD)
            except ZIP_FAULTS as error:
                raise RecordingError(f"{path}: cannot be read ({error})") from None
            form = find_format(head)
            if form is None:
                raise RecordingError(f"{path}: not events as text: lines of t x y p, perhaps behind a line of the size")
            self._form: Format = form
            kind = "text.zip" if self._zip else "text"
            self.info = RecordingInfo(str(path), kind, form.name, 0, 0, "header", path.stat().st_size)
            self._total = size if self._zip else data_end(self._file.fileno(), 0, self.info)
            if isinstance(self._zip, CutArchive):
                self.info.truncated = True
                self.info.warn("cut: the archive has no list of its files; what lies before the cut is read")
            if form.assumed:
                self.info.warn(form.assumed)
            if not take_size(self.info, options):
                self.info.width, self.info.height = form.size
                if not (form.size[0] and form.size[1]):
                    self._size_from_events()
        except BaseException:
            self.close()
            raise
        super().__init__()

    def _open(self, topic: str) -> tuple[IO[bytes], int]:
        """Opens the file, or the text file of the archive: the one that is asked for, or the one that holds events."""
        if self._zip is None:
            file: IO[bytes] = self._path.open("rb")
            return file, self._path.stat().st_size
        there = text_members(self._zip)
        members: dict[str, Any] = {m.filename: m for m in self._zip.infolist() if m.filename in there}
        if topic and topic not in members:
            raise RecordingError(f"{self._path}: no text file '{topic}' in the archive; it has {', '.join(members)}")
        names = [topic] if topic else list(members)
        if len(names) > 1:
            names = [name for name in names if _holds_events(self._zip, name)]
        if len(names) != 1:
            raise RecordingError(
                f"{self._path}: an archive of {len(members)} text files, {len(names)} of them events; name one of "
                f"{', '.join(members)} as the topic"
            )
        return self._zip.open(members[names[0]]), members[names[0]].file_size

    def _load(self) -> Iterator[Events]:
        yield from self._load_at(self._form.begin)

    def _load_at(self, at: int) -> Iterator[Events]:
        allowance = Allowance(self.info.size_bytes)
        try:
            self._file.seek(at)
            rest = b""
            while data := self._file.read(_BLOCK if self._zip else min(_BLOCK, max(self._total - at, 0))):
                at += len(data)
                allowance.take(len(data) if self._zip else 0)
                self._read = self._file.tell()
                # a carriage return alone ends no line
                cut = data.rfind(b"\n") + 1
                lines, rest = rest + data[:cut], (rest if not cut else b"") + data[cut:]
                if len(rest) > _BLOCK:
                    raise RecordingError(f"{self._path}: a line of more than {_BLOCK} characters is no event")
                if cut:
                    yield self._events(lines)
            if rest:
                yield self._last(rest)
        except ZIP_FAULTS as error:
            self.info.truncated = True
            self.info.warn(f"cut or damaged: what follows cannot be read ({error})")

    def _last(self, line: bytes) -> Events:
        """Parses the last line of a file that does not end with a new line, which may be cut inside a number."""
        events = self._events(line + b"\n", count=False)
        if len(events) and not self._form.time_last:
            return events  # the last character is the polarity's, which has only one
        self.info.truncated = True
        self.info.warn("the last line is cut and was left out")
        return Events.empty()

    def _events(self, lines: bytes, count: bool = True) -> Events:
        t, x, y, p, bad = parse_lines(lines, self._form)
        if bad and count:
            self.count("lines_left_out", bad)
            self.info.warn("lines that are no event were left out")
        return Events(t, x, y, p)

    def _load_from(self, t_ns: int) -> Iterator[Events]:
        """Yields blocks from a byte of the file found by bisection, whose times are taken to go up; an archive is read
        from its start."""

        def is_earlier(byte: int) -> bool:
            self._file.seek(byte)
            self._file.readline()
            t, *_ = parse_lines(self._file.readline(), self._form)
            return bool(len(t)) and int(t[0]) < t_ns

        begin = self._form.begin
        found = place_before(begin, self._total, _BLOCK, is_earlier) if self._zip is None else begin
        if found > begin:
            self._file.seek(found)
            self._file.readline()
            found = self._file.tell()
        return self._load_at(found)

    @property
    def position(self) -> float:
        return min(1.0, self._read / self._total) if self._total else 1.0

    def close(self) -> None:
        for file in (getattr(self, "_file", io.BytesIO()), self._zip):
            if file is not None:
                file.close()


def open_file(path: Path, options: OpenOptions) -> TextRecording:
    """Opens a text file. Raises RecordingError."""
    return TextRecording(path, options)


def is_text_archive(path: Path) -> bool:
    """Tells whether a file is a zip archive with a text file and no arrays."""
    try:
        archive = open_archive(path)
        found = text_members(archive)
        archive.close()
    except (*ZIP_FAULTS, ValueError):
        return False
    return bool(found)


def text_members(archive: Archive) -> list[str]:
    """Lists the members named as text; where there is none and no other recording, those with events as text."""
    names = files_in(archive)
    if any(n.lower().endswith(".npy") for n in names):
        return []
    found = [n for n in names if n.lower().endswith((".txt", ".csv"))]
    if found or any(n.lower().endswith(RECORDINGS) for n in names) or len(names) > _MOST_TRIED:
        return found
    return [n for n in names if _holds_events(archive, n)]


def _holds_events(archive: Archive, name: str) -> bool:
    with archive.open(name) as member:
        return find_format(member.read(HEAD)) is not None
