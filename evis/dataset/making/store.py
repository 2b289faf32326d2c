"""Stores a data set in a folder here, or in one that fsspec reaches. A sequence is there in full or not at all."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import json
import os
import shutil
import socket
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from evis.dataset.errors import DatasetError
from evis.dataset.making.finished import ENTRY, Entry
from evis.dataset.names import below
from evis.files.folder_sync import sync_folder
from evis.files.json_text import parsed
from evis.files.regular import check_file
from evis.files.whole_file import whole_file

INDEX = "dataset.json"
INDEX_FORMAT = 1
"""Number of the form that it has, which readers ask for."""
PART = ".part"
"""Ending of the folder of a sequence that is being written."""


class Store(ABC):
    """Keeps the sequences and the index of one data set."""

    @abstractmethod
    def place(self, path: str) -> contextlib.AbstractContextManager[Path]:
        """Gives an empty local folder to write a sequence into; what is left in it at the end is removed."""

    @abstractmethod
    def publish(self, folder: Path, entry: Entry) -> None:
        """Makes what lies in a folder of `place` the finished sequence, all at once."""

    @abstractmethod
    def entries(self) -> list[dict[str, Any]]:
        """Lists the entries of the finished sequences, by index."""

    @abstractmethod
    def index(self) -> dict[str, Any] | None:
        """Reads dataset.json; None where there is none. Raises DatasetError for one that cannot be read."""

    @abstractmethod
    def write_index(self, index: dict[str, Any]) -> None:
        """Writes dataset.json, all at once."""

    @abstractmethod
    def is_empty(self) -> bool:
        """Tells whether the place holds nothing yet."""

    @abstractmethod
    def alone(self) -> contextlib.AbstractContextManager[None]:
        """Keeps others from making the same data set, and clears what a killed run has left half-written."""

    @abstractmethod
    def local(self, path: str) -> contextlib.AbstractContextManager[Path]:
        """Gives a sequence's folder to read from, copied here where it lies elsewhere."""


class LocalStore(Store):
    """Keeps a data set in a folder of this machine, or of one that all machines see."""

    def __init__(self, out: str) -> None:
        self.folder = Path(out)

    @contextlib.contextmanager
    def place(self, path: str) -> Iterator[Path]:
        """Implements `Store.place`; the folder is beside the finished one, so that it only needs a name."""
        final = self.folder / path
        part = final.with_name(f".{final.name}.{socket.gethostname()}.{os.getpid()}{PART}")
        part.mkdir(parents=True)
        try:
            yield part
        finally:
            shutil.rmtree(part, ignore_errors=True)

    def publish(self, folder: Path, entry: Entry) -> None:
        """Implements `Store.publish`."""
        final = self.folder / entry.plan.path
        with (folder / ENTRY).open("w") as file:
            file.write(text_of(entry.as_dict()))
            file.flush()
            os.fsync(file.fileno())
        for place in [*(p for p in folder.rglob("*") if p.is_dir()), folder]:
            sync_folder(place)
        try:
            folder.rename(final)
        except OSError as error:
            # A worker that was given up as dead may finish all the same, with the same bytes.
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST) or not (final / ENTRY).is_file():
                raise
        sync_folder(final.parent)

    def entries(self) -> list[dict[str, Any]]:
        """Implements `Store.entries`."""
        files = [*self.folder.glob(f"*/{ENTRY}"), *self.folder.glob(f"*/*/{ENTRY}")]
        # Of the parts within it: the folder of the data set itself may have any name.
        whole = [file for file in files if not any(p.endswith(PART) for p in file.relative_to(self.folder).parts)]
        for file in whole:
            check_file(file)
        return sorted((_parsed(file.read_text(), str(file)) for file in whole), key=lambda entry: entry["index"])

    def index(self) -> dict[str, Any] | None:
        """Implements `Store.index`."""
        check_file(self.folder / INDEX)
        try:
            return _parsed((self.folder / INDEX).read_text(), str(self.folder / INDEX))
        except (FileNotFoundError, NotADirectoryError):
            return None

    def write_index(self, index: dict[str, Any]) -> None:
        """Implements `Store.write_index`."""
        with whole_file(self.folder / INDEX) as partial, partial.open("w") as file:
            file.write(text_of(index))
            file.flush()
            os.fsync(file.fileno())

    def is_empty(self) -> bool:
        """Implements `Store.is_empty`; a file in place of the folder, or a link that leads nowhere, is not nothing."""
        return not any(self.folder.iterdir()) if self.folder.is_dir() else not os.path.lexists(self.folder)

    @contextlib.contextmanager
    def alone(self) -> Iterator[None]:
        """Implements `Store.alone` by a lock on the folder, which ends with the process, however it ends."""
        self.folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(self.folder, os.O_RDONLY)
        try:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise DatasetError(f"another `evis dataset make` writes into {self.folder}; wait for its end") from None
            self._clear()
            try:
                yield
            finally:
                self._clear()
        finally:
            os.close(descriptor)

    def _clear(self) -> None:
        """Removes what workers that were killed have left."""
        for part in [*self.folder.glob(f".*{PART}"), *self.folder.glob(f"*/.*{PART}")]:
            shutil.rmtree(part, ignore_errors=True)

    @contextlib.contextmanager
    def local(self, path: str) -> Iterator[Path]:
        """Implements `Store.local`."""
        yield self.folder / path


class RemoteStore(Store):
    """Keeps a data set where fsspec reaches, as s3://bucket/folder; a sequence is finished when its entry is there."""

    def __init__(self, out: str) -> None:
        try:
            import fsspec
        except ModuleNotFoundError:
            raise DatasetError(f"{out} needs fsspec: pip install 'evis[cluster]'") from None
        self._out = out
        try:
            self._files, self._root = fsspec.core.url_to_fs(out)
        except (ValueError, ImportError) as error:
            raise DatasetError(f"{out}: {error}") from None

    @contextlib.contextmanager
    def place(self, path: str) -> Iterator[Path]:
        """Implements `Store.place`."""
        with tempfile.TemporaryDirectory(prefix="evis-dataset-") as folder:
            yield Path(folder)

    def publish(self, folder: Path, entry: Entry) -> None:
        """Implements `Store.publish`."""
        place = f"{self._root}/{entry.plan.path}"
        for name in entry.files:
            self._files.makedirs(f"{place}/{name}".rpartition("/")[0], exist_ok=True)
            self._files.put_file(str(folder / name), f"{place}/{name}")
        self._files.pipe_file(f"{place}/{ENTRY}", text_of(entry.as_dict()).encode())

    def entries(self) -> list[dict[str, Any]]:
        """Implements `Store.entries`."""
        self._files.invalidate_cache()
        found = [name for name in self._files.find(self._root) if name.endswith(f"/{ENTRY}")]
        texts = self._files.cat(found) if found else {}
        return sorted((_parsed(text.decode(), name) for name, text in texts.items()), key=lambda entry: entry["index"])

    def index(self) -> dict[str, Any] | None:
        """Implements `Store.index`."""
        name = f"{self._root}/{INDEX}"
        try:
            return _parsed(self._files.cat_file(name).decode(), f"{self._out}/{INDEX}")
        except FileNotFoundError:
            return None

    def write_index(self, index: dict[str, Any]) -> None:
        """Implements `Store.write_index`."""
        self._files.makedirs(self._root, exist_ok=True)
        self._files.pipe_file(f"{self._root}/{INDEX}", text_of(index).encode())

    def is_empty(self) -> bool:
        """Implements `Store.is_empty`."""
        self._files.invalidate_cache()
        return not self._files.exists(self._root) or not self._files.find(self._root)

    @contextlib.contextmanager
    def alone(self) -> Iterator[None]:
        """Does nothing: an unfinished sequence there has no entry, and is written over."""
        yield

    @contextlib.contextmanager
    def local(self, path: str) -> Iterator[Path]:
        """Implements `Store.local`."""
        with tempfile.TemporaryDirectory(prefix="evis-dataset-") as folder:
            place = f"{self._root}/{path}"
            for name in self._files.find(place):
                try:
                    here = Path(folder, below(name.removeprefix(f"{place}/")))
                except ValueError as error:  # a name there may have .. in it, and here would be another folder
                    raise DatasetError(f"{self._out}/{path}: {error}; it is not fetched") from None
                here.parent.mkdir(parents=True, exist_ok=True)
                self._files.get_file(name, str(here))
            yield Path(folder)


def is_remote(out: str) -> bool:
    """Says whether a place is one for fsspec."""
    return "://" in out


def store_of(out: str) -> Store:
    """Returns the store of a place. Raises DatasetError where fsspec is wanted and lacks."""
    return RemoteStore(out.rstrip("/")) if is_remote(out) else LocalStore(out)


def text_of(value: dict[str, Any]) -> str:
    """Writes JSON the same way every time."""
    return json.dumps(value, indent=1) + "\n"


def _parsed(text: str, name: str) -> dict[str, Any]:
    try:
        value = parsed(text)
        if isinstance(value, dict):
            return value
    except ValueError:
        pass
    raise DatasetError(f"{name} is damaged; remove it, and make the data set with --resume")
