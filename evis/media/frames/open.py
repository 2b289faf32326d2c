"""Opens frames of any kind: NumPy archives, folders of images, videos. One file per kind; this one finds which."""

from __future__ import annotations

import glob
import os
from pathlib import Path

from evis.config.suggestions import did_you_mean
from evis.files.damage import faults_as
from evis.files.regular import other_than_file
from evis.media.frames.exr import ExrFrames
from evis.media.frames.images import KINDS, ImageFrames
from evis.media.frames.npz import NpzFrames
from evis.media.frames.source import FrameOptions, FramesError, FrameSource
from evis.media.frames.video import VideoFrames


def open_frames(path: str | os.PathLike[str], options: FrameOptions | None = None) -> FrameSource:
    """Opens frames: an .npz, a folder or a pattern of EXR, PNG, JPEG, TIFF, BMP or PGM files, or a video.

    Raises FramesError with one line naming the file.
    """
    path, options = Path(path), options or FrameOptions()
    options.check()
    options.make_tone()
    with faults_as(FramesError, path):
        return _open(path, options)


def _open(path: Path, options: FrameOptions) -> FrameSource:
    if not path.exists():
        if any(c in str(path) for c in "*?["):
            return _open_pattern(path, options)
        names = [p.name for p in path.parent.iterdir()] if path.parent.is_dir() else []
        raise FramesError(f"{path}: no such file or folder{did_you_mean(path.name, names)}")
    if path.is_dir():
        names = [p.name for p in path.iterdir() if p.is_file() and not p.name.startswith(".")]
        return _open_images(path, names, options, str(path))
    if what := other_than_file(path):
        raise FramesError(f"{path}: it is {what}; frames are read at more than one place: save them to a file first")
    try:
        with path.open("rb") as file:
            head = file.read(4)
    except OSError as error:
        raise FramesError(f"{path}: cannot be read: {error.strerror}") from None
    if not head:
        raise FramesError(f"{path}: the file is empty")
    if head.startswith(b"PK") or path.suffix.lower() == ".npz":
        return NpzFrames(path, options)
    if path.suffix.lower() in (*KINDS, ".exr"):
        raise FramesError(
            f"{path}: one image makes no events; give the folder of all of them, or a pattern as 'f*.png'"
        )
    if path.suffix.lower() == ".npy":
        raise FramesError(
            f"{path}: an array alone has no times; save it by np.savez(FILE, luminance=images, t=times_in_ns)"
        )
    return VideoFrames(path, options)


def _open_pattern(pattern: Path, options: FrameOptions) -> FrameSource:
    """Opens the images of a pattern with *, ? or [], as a shell knows them; it may reach into several folders."""
    folder = pattern
    while any(c in str(folder) for c in "*?["):
        folder = folder.parent
    found = sorted(p for p in glob.glob(str(pattern)) if os.path.isfile(p))
    if not found:
        raise FramesError(f"{pattern}: no file matches the pattern")
    return _open_images(folder, [os.path.relpath(p, folder) for p in found], options, str(pattern))


def _open_images(folder: Path, names: list[str], options: FrameOptions, given: str) -> FrameSource:
    kinds: dict[str, list[str]] = {}
    for name in names:
        end = Path(name).suffix.lower()
        kind = "EXR" if end == ".exr" else KINDS.get(end)
        if kind is not None:
            kinds.setdefault(kind, []).append(name)
    if len(kinds) > 1:
        counts = " and ".join(f"{len(kinds[kind])} {kind}" for kind in sorted(kinds))
        raise FramesError(f"{given}: holds {counts} files; keep one kind in the folder, or give a pattern as 'f*.png'")
    for kind, images in kinds.items():
        return ExrFrames(folder, images, options) if kind == "EXR" else ImageFrames(folder, images, options, kind)
    there = ", ".join(sorted({Path(n).suffix or n for n in names})[:5]) or "nothing"
    raise FramesError(f"{given}: no .exr, .png, .jpg, .tif, .bmp or .pgm files in the folder; it has {there}")
