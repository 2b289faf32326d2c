"""Reads ROS 2 bags in SQLite (.db3)."""

from __future__ import annotations

import contextlib
import sqlite3
import urllib.parse
from collections.abc import Iterator
from pathlib import Path

from evis.events.files.reading.unpacked_file import with_name
from evis.events.files.rosbag.messages import plain_type
from evis.events.files.rosbag.recording import BagMessage, RosRecording
from evis.events.recording import OpenOptions, RecordingError, RecordingInfo

NAME = "ROS 2 .db3 bag"

MAGIC = b"SQLite format 3\0"
_LEAST_LENGTH = 1 << 20
"""Longest value that is read of any file [bytes]: SQLite's own statements count too."""


def matches(head: bytes, path: Path, name: str) -> bool:
    """Tells whether a file begins with the signature of SQLite."""
    return head.startswith(MAGIC)


class Db3Recording(RosRecording):
    """Reads a .db3 bag row by row in the order of recording.

    Of a file that is cut, the rows on the pages that are there.
    """

    def __init__(self, path: Path, options: OpenOptions) -> None:
        self._path, self._row, self._rows = path, 0, 0
        size = path.stat().st_size
        self.info = RecordingInfo(str(path), "rosbag2-db3", "", 0, 0, "", size)
        with path.open("rb") as file:
            head = file.read(100)
        page, pages = int.from_bytes(head[16:18], "big"), int.from_bytes(head[28:32], "big")
        if len(head) < 100 or size < (65536 if page == 1 else page) * pages:
            self.info.truncated = True
            self.info.warn("cut: the file is shorter than its table of pages says")
        try:
            with with_name(path) as named:
                uri = f"file:{urllib.parse.quote(str(named.absolute()))}?mode=ro&immutable=1"
                self._connection = sqlite3.connect(uri, uri=True, check_same_thread=False)
            # columns can be computed, and so be larger than the whole file: a stored one cannot
            self._connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, max(size, _LEAST_LENGTH))
        except sqlite3.Error as error:
            raise RecordingError(f"{path}: {error}") from None
        try:
            # a file that is cut opens only so; nothing is written
            self._connection.execute("PRAGMA writable_schema=ON")
            self._connection.execute("PRAGMA trusted_schema=OFF")
            self._begin(options)
        except (sqlite3.Error, OverflowError) as error:
            self.close()
            what = "cut before its tables" if self.info.truncated else f"damaged SQLite file ({error})"
            raise RecordingError(f"{path}: {what}; there is no event to be had") from None
        except BaseException:
            self.close()
            raise
        super().__init__()

    def _topics(self) -> dict[str, str]:
        query = self._connection.execute("SELECT name FROM sqlite_master WHERE type='table'")
        tables = {str(name) for (name,) in query}
        if not {"topics", "messages"} <= tables:
            raise RecordingError(f"{self._path}: an SQLite file that is no ROS 2 bag: it has no topics and messages")
        rows = self._connection.execute("SELECT id, name, type, serialization_format FROM topics").fetchmany(10_000)
        with contextlib.suppress(sqlite3.Error):  # the last row of a cut file is not there
            self._rows = self._connection.execute("SELECT max(id) FROM messages").fetchone()[0] or 0
        self._ids: dict[str, tuple[int, str]] = {}
        for number, name, kind, form in rows:
            if form == "cdr" and isinstance(number, int) and self._is_events(plain_type(str(kind))):
                self._ids[str(name)] = number, plain_type(str(kind))
        return {name: kind for name, (_, kind) in self._ids.items()}

    def _messages(self) -> Iterator[BagMessage]:
        number, kind = self._ids.get(self.topic, (-1, ""))
        try:
            query = "SELECT id, data FROM messages WHERE topic_id=? ORDER BY id"
            for row, data in self._connection.execute(query, (number,)):
                self._row = row
                message = self._message(kind, data)
                if message is not None:
                    yield message
        except sqlite3.Error as error:
            if not self.info.truncated:
                self.count("rows_damaged")
                self.info.warn(f"damaged: what follows row {self._row} cannot be read ({error})")

    def _message(self, kind: str, data: object) -> BagMessage | None:
        if not isinstance(data, bytes):
            self.count("messages_damaged")
            return None
        return BagMessage(kind, data, True)

    @property
    def position(self) -> float:
        return min(1.0, self._row / self._rows) if self._rows else 1.0

    def close(self) -> None:
        self._connection.close()


def open_file(path: Path, options: OpenOptions) -> Db3Recording:
    """Opens a .db3 bag. Raises RecordingError."""
    return Db3Recording(path, options)
