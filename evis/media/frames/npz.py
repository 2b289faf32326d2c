"""Reads frames as a NumPy archive: luminance float32 [T, H, W] (or rgb [T, H, W, 3]), t int64 [T] ns, optionally
dlog_dt.

Arrays are read from inside the archive in blocks, compressed or not; nothing is ever unpickled.
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import numpy as np

from evis.events.files.numpy_files.npy import read_header
from evis.files.allowance import Allowance
from evis.files.damage import faults_as
from evis.files.zip_faults import UNREADABLE, ZIP_FAULTS
from evis.media.colour import luminance_of
from evis.media.frames.source import INT64_MAX, OF_SECONDS, FrameBlock, FrameOptions, FramesError, FrameSource

_DAMAGE = (*ZIP_FAULTS, ValueError)


class NpzFrames(FrameSource):
    """Reads an archive of frames. Only the current block and t are in memory."""

    kind = "npz"

    def __init__(self, path: Path, options: FrameOptions) -> None:
        options.refuse_tone(path, "an .npz of frames")
        self._path, self.about = path, {}
        try:
            self._zip = zipfile.ZipFile(path)
        except UNREADABLE as error:
            raise FramesError(f"{path}: not an .npz archive of frames, or a damaged one ({error})") from None
        try:
            self._open(options)
        except BaseException:
            self._zip.close()
            raise

    def _open(self, options: FrameOptions) -> None:
        names = {n.removesuffix(".npy") for n in self._zip.namelist()}
        # luminance can be had from rgb, colour not from luminance
        wanted = "rgb" if options.colour or ("luminance" not in names and "rgb" in names) else "luminance"
        missing = [n for n in (wanted, "t") if n not in names and not (n == "t" and options.fps)]
        if missing:
            hint = "; it holds events: use `evis events convert`" if {"x", "y", "p"} <= names else ""
            hint += "; grey frames are taken without --colour" if "rgb" in missing and "luminance" in names else ""
            there = ", ".join(sorted(names)) or "none"
            hint = hint or "; save it by np.savez(FILE, luminance=images, t=times_in_ns)"
            raise FramesError(f"{self._path}: no array {', '.join(missing)}; it has {there}{hint}")
        self._image = _Array(self._path, self._zip, wanted)
        shape = self._image.shape
        if shape[:1] == (0,):
            raise FramesError(f"{self._path}: {wanted} is {list(shape)}: it holds no frames")
        if wanted == "rgb":
            self._image.check(len(shape) == 4 and shape[3] == 3 and 0 not in shape, "[T, H, W, 3]")
        else:
            self._image.check(len(shape) == 3 and 0 not in shape, "[T, H, W]")
        self.count, self.height, self.width = shape[:3]
        if max(self.height, self.width) > 65536:
            raise FramesError(f"{self._path}: frames of {self.width}x{self.height}, the most is 65536 pixels a side")
        self.channels = 3 if options.colour else 1
        self._to_luminance = wanted == "rgb" and not options.colour
        self._slopes = _Array(self._path, self._zip, "dlog_dt") if options.slopes and "dlog_dt" in names else None
        self.has_slopes = self._slopes is not None
        if self._slopes is not None:
            expected = shape if options.colour else shape[:3]
            self._slopes.check(self._slopes.shape == expected, str(list(expected)))
        self._options = options
        self._t = None if options.fps else self._stamps(self.count)

    def _stamps(self, count: int) -> np.ndarray:
        array = _Array(self._path, self._zip, "t")
        if array.dtype.kind not in "iu" or array.shape != (count,):
            shape = list(array.shape)
            raise FramesError(
                f"{self._path}: t is {array.dtype} {shape}, must be int64 [{count}], in ns"
                f"{f'; {OF_SECONDS}' if array.dtype.kind == 'f' else ''}"
            )
        t = array.read(count)
        if len(t) and t.max() > INT64_MAX:
            raise FramesError(f"{self._path}: t reaches {t.max()}, more than int64 nanoseconds can hold")
        t = t.astype(np.int64)
        late = t[1:] > t[:-1]
        if not late.all():
            i = int(np.argmin(late))
            raise FramesError(
                f"{self._path}: t must go up from frame to frame; frame {i + 1} is at {t[i + 1]} ns after {t[i]} ns"
            )
        return t

    def blocks(self) -> Iterator[FrameBlock]:
        length, count = self.block_frames(), self._image.shape[0]
        for first in range(0, count, length):
            last = min(first + length, count)
            with faults_as(FramesError, self._path):
                if self._t is None:
                    t = np.array([self._options.stamp(i) for i in range(first, last)], np.int64)
                else:
                    t = self._t[first:last]
                image = _float32(self._image.read(last - first))
                if self._to_luminance:
                    image = luminance_of(image)
                slopes = None if self._slopes is None else _float32(self._slopes.read(last - first))
                block = FrameBlock(t, image, slopes)
            yield block

    def close(self) -> None:
        self._zip.close()


class _Array:
    """One array of the archive, read from its start on."""

    def __init__(self, path: Path, archive: zipfile.ZipFile, name: str) -> None:
        self._path, self._name, self._read = path, name, 0
        try:
            self._file: IO[bytes] = archive.open(name + ".npy")
            self.shape, columns, self.dtype = read_header(self._file)
        except (KeyError, *_DAMAGE) as error:
            raise FramesError(f"{path}: the array {name} is damaged ({str(error)[:100]})") from None
        if columns and len(self.shape) > 1:
            raise FramesError(f"{path}: {name} is stored column by column; save np.ascontiguousarray({name})")

    def check(self, fits: bool, expected: str) -> None:
        """Raises unless the array is of floats and its shape fits."""
        if not fits or self.dtype.kind != "f":
            hint = "; 8 or 16 bit images go into a folder of PNG" if self.dtype.kind in "iu" else ""
            got = f"{self.dtype} {list(self.shape)}"
            raise FramesError(f"{self._path}: {self._name} is {got}, must be float32 {expected}, linear{hint}")

    def read(self, n: int) -> np.ndarray:
        """Reads the next n entries of the first axis."""
        rest = self.shape[1:]
        want = n * self.dtype.itemsize * math.prod(rest)
        Allowance(self._path.stat().st_size).check(want)
        try:
            data = self._file.read(want)
        except _DAMAGE as error:
            # a wrong checksum shows only at the end
            where = "" if "CRC" in str(error) else f" from entry {self._read} on"
            raise FramesError(f"{self._path}: {self._name} is damaged{where} ({error})") from None
        if len(data) < want:
            raise FramesError(
                f"{self._path}: {self._name} is cut short at entry {self._read + n * len(data) // max(want, 1)} "
                f"of {self.shape[0]}; copy the file again"
            )
        self._read += n
        return np.frombuffer(data, self.dtype).reshape(n, *rest)


def _float32(array: np.ndarray) -> np.ndarray:
    with np.errstate(over="ignore"):  # what does not fit becomes infinite, which the sensor counts
        return np.ascontiguousarray(array, dtype=np.float32)
