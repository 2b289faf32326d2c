"""Lists a folder of images: which files, in which order, at which times."""

from __future__ import annotations

import abc
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from evis.files.damage import faults_as
from evis.files.regular import check_file
from evis.media.frames.source import FrameOptions, FramesError, ImageSource, NamedImage

TIMES = "times.txt"
"""Lists the images of a folder, a line `name t_ns` for each."""


class FolderFrames(ImageSource):
    """Reads images in the order of their names (numbers by value), or as times.txt lists them."""

    def __init__(self, path: Path, names: list[str], options: FrameOptions) -> None:
        self._folder, self._options, self.about = path, options, {}
        listed = None if options.fps else _listed(path, set(names))
        self._times: list[int | None]
        if listed is None:
            self._names = sorted(names, key=_natural)
            self._times = [options.stamp(i) if options.fps else None for i in range(len(names))]
        else:
            self._names, self._times = [n for n, _ in listed], [t for _, t in listed]
            if len(listed) < len(names):
                self.about["files_left_out"] = len(names) - len(listed)
        self.count, self.channels = len(self._names), 3 if options.colour else 1
        first, *_ = self._load(path / self._names[0], self._times[0])
        self.height, self.width = first.shape[:2]

    @abc.abstractmethod
    def _read(self, path: Path) -> tuple[np.ndarray, int | None, np.ndarray | None]:
        """(float32 [H, W] or, with colour, [H, W, 3], the file's own time [ns] or None, flags of `ends_of` or None).
        Raises FramesError.
        """

    def _load(self, path: Path, known: int | None) -> tuple[np.ndarray, int, np.ndarray | None]:
        with faults_as(FramesError, path):
            image, own, ends = self._read(path)
        t = own if known is None else known
        if t is None:
            raise FramesError(f"{path}: no time; give --fps, or a {TIMES} with a line `name t_ns` for each file")
        return image, t, ends

    def _images(self) -> Iterator[NamedImage]:
        for name, known in zip(self._names, self._times):
            path = self._folder / name
            image, t, ends = self._load(path, known)
            yield NamedImage(str(path), t, image, ends)


def _natural(name: str) -> list[tuple[int, str]]:
    """f2 comes before f10."""
    return [(int(part), "") if part.isdecimal() else (0, part) for part in re.split(r"([0-9]+)", name)]


def _listed(folder: Path, there: set[str]) -> list[tuple[str, int | None]] | None:
    """(name, t) of each line of times.txt, None where the folder has none. Raises FramesError with its line."""
    path = folder / TIMES
    if not path.exists():
        return None
    result: list[tuple[str, int | None]] = []
    last: int | None = None
    check_file(path)
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise FramesError(f"{path}: cannot be read as text ({error})") from None
    for number, line in enumerate(lines, 1):
        text = line.partition("#")[0].strip()
        if not text:
            continue
        found = re.fullmatch(r"(.+?)[\s,]+([+-]?[0-9]{1,19})", text)
        if found is None:
            raise FramesError(f"{path}:{number}: '{text[:60]}' must be a file name and its time in whole ns")
        name, t = found[1], int(found[2])
        if name not in there:
            raise FramesError(f"{path}:{number}: there is no file '{name}' in {folder}")
        if last is not None and t <= last:
            raise FramesError(f"{path}:{number}: {name} is at {t} ns, not after {last} ns of the line before")
        last = t
        result.append((name, t))
    if not result:
        raise FramesError(f"{path}: names no files")
    return result
