"""Reads zip archives, also those without their list of members, which is at the end: each member has a header of its
own.

Local headers as in PKWARE's APPNOTE 4.3.7, with the extra field 0x0001 of Zip64 (4.5.3).
"""

from __future__ import annotations

import io
import os
import struct
import zipfile
import zlib
from pathlib import Path
from typing import IO, Any, NamedTuple

from evis.files.magic import ZIP

_LOCAL = struct.Struct("<4sHHHHHIIIHH")
_ZIP64 = 0xFFFFFFFF
_STEP = 1 << 16
_MOST_MEMBERS = 100_000
RECORDINGS = (
    ".raw", ".dat", ".aedat", ".aedat4", ".es", ".bag", ".db3", ".mcap", ".h5", ".hdf5", ".npz", ".npy", ".bin",
)  # fmt: skip
"""Names that make a file of an archive a recording of another format; which one, its content says."""


class Member(NamedTuple):
    """Describes a member of a cut archive: where its data begin, how many bytes of them are there, and how it is
    packed.
    """

    filename: str
    at: int
    stored: int
    deflated: bool
    file_size: int


class CutArchive:
    """Reads an archive without its list of members, with the interface of `zipfile.ZipFile`."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._members: dict[str, Member] = {}
        size, at = path.stat().st_size, 0
        with path.open("rb") as file:
            while at < size and len(self._members) < _MOST_MEMBERS:
                file.seek(at)
                head = file.read(_LOCAL.size)
                if len(head) < _LOCAL.size or head[:4] != ZIP:
                    return
                _, _, flags, method, _, _, _, packed, whole, name_length, extra_length = _LOCAL.unpack(head)
                name, extra = file.read(name_length), file.read(extra_length)
                at = file.tell()
                if len(extra) < extra_length or method not in (0, 8) or flags & 1:
                    return
                packed, whole = _sizes(packed, whole, extra)
                if not packed and flags & 8:  # they are told behind the data, which nobody can find
                    packed = size - at
                there = max(min(packed, size - at), 0)
                text = name.decode("utf-8" if flags & 0x800 else "cp437", errors="replace")
                self._members[text] = Member(text, at, there, method == 8, whole)
                at += packed

    def namelist(self) -> list[str]:
        """Returns the names of the members."""
        return list(self._members)

    def infolist(self) -> list[Member]:
        """Returns the members in the order of the file."""
        return list(self._members.values())

    def open(self, member: str | Member) -> IO[bytes]:
        """Opens a member as far as it is there. Raises KeyError."""
        found = self._members[member] if isinstance(member, str) else member
        return io.BufferedReader(_MemberReader(self._path, found))

    def close(self) -> None:
        """Does nothing: no file is open between calls."""


Archive = zipfile.ZipFile | CutArchive


def open_archive(path: Path) -> Archive:
    """Opens an archive, whole or cut. Raises zipfile.BadZipFile and OSError where there is no member at all."""
    try:
        return zipfile.ZipFile(path)
    except (zipfile.BadZipFile, ValueError):
        cut = CutArchive(path)
        if not cut.namelist():
            raise zipfile.BadZipFile("it has no member") from None
        return cut


def salvaged(path: Path, member: zipfile.ZipInfo) -> IO[bytes]:
    """Opens the readable part of a damaged member of an archive that has its list. Raises zipfile.BadZipFile."""
    with path.open("rb") as file:
        file.seek(member.header_offset)
        head = file.read(_LOCAL.size)
    if len(head) < _LOCAL.size or head[:4] != ZIP or member.compress_type not in (0, 8):
        raise zipfile.BadZipFile("a member without a header")
    *_, name_length, extra_length = _LOCAL.unpack(head)
    at = member.header_offset + _LOCAL.size + name_length + extra_length
    there = Member(member.filename, at, member.compress_size, member.compress_type == 8, member.file_size)
    return io.BufferedReader(_MemberReader(path, there))


def _sizes(packed: int, whole: int, extra: bytes) -> tuple[int, int]:
    at = 0
    while at + 4 <= len(extra):
        kind, length = struct.unpack_from("<HH", extra, at)
        if kind == 1 and length >= 16 and at + 20 <= len(extra) and packed == whole == _ZIP64:
            whole, packed = struct.unpack_from("<QQ", extra, at + 4)
        at += 4 + length
    return packed, whole


class _MemberReader(io.RawIOBase):
    """Reads the bytes of a member up to the cut; seeking back begins anew."""

    def __init__(self, path: Path, member: Member) -> None:
        self._descriptor, self._member = os.open(path, os.O_RDONLY | os.O_CLOEXEC), member
        self._begin()

    def _begin(self) -> None:
        self._used, self._at, self._ready = 0, 0, b""
        self._unpacker = zlib.decompressobj(-zlib.MAX_WBITS) if self._member.deflated else None

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._at

    def seek(self, offset: int, whence: int = 0) -> int:
        if whence == 1:
            offset += self._at
        if whence == 2:
            raise OSError("the end of a cut member is not known")
        if offset < self._at:
            self._begin()
        while self._at < offset and self._fill():
            n = min(offset - self._at, len(self._ready))
            self._ready, self._at = self._ready[n:], self._at + n
        return self._at

    def _fill(self) -> bool:
        """Unpacks until some bytes are ready; False at the cut. Damaged data end there too."""
        while not self._ready:
            data = os.pread(
                self._descriptor, min(_STEP, self._member.stored - self._used), self._member.at + self._used
            )
            self._used += len(data)
            if not data:
                return False
            if self._unpacker is None:
                self._ready = data
                continue
            before = self._unpacker.copy()
            try:
                self._ready = self._unpacker.decompress(data)
            except zlib.error:
                self._used = self._member.stored
                self._ready = _up_to_damage(before, data)
                return bool(self._ready)
            if self._unpacker.eof:
                self._used = self._member.stored
        return True

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        if not self._fill():
            return 0
        n = min(len(buffer), len(self._ready))
        buffer[:n] = self._ready[:n]
        self._ready, self._at = self._ready[n:], self._at + n
        return n

    def close(self) -> None:
        if not self.closed:
            os.close(self._descriptor)
        super().close()


def _up_to_damage(unpacker: Any, data: bytes) -> bytes:
    """Returns what comes out before the damage shows, byte by byte."""
    ready = b""
    try:
        for i in range(len(data)):
            ready += unpacker.decompress(data[i : i + 1])
    except zlib.error:
        pass
    return ready


def files_in(archive: Archive) -> list[str]:
    """Lists the names of the files of an archive, without folders and what macOS puts beside the files."""
    return [name for name in archive.namelist() if not name.startswith("__MACOSX/") and not name.endswith("/")]
