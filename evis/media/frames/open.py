"""Opens frames of any kind: NumPy archives, folders of EXR or PNG, videos. One file per kind; this one finds which."""

from __future__ import annotations

import os
from pathlib import Path

from evis.config.suggestions import did_you_mean
from evis.files.damage import faults_as
from evis.media.frames.exr import ExrFrames
from evis.media.frames.npz import NpzFrames
from evis.media.frames.png import PngFrames
from evis.media.frames.source import FrameOptions, FramesError, FrameSource
from evis.media.frames.video import VideoFrames


def open_frames(path: str | os.PathLike[str], options: FrameOptions | None = None) -> FrameSource:
    """Opens frames: an .npz, a folder of EXR or PNG, or a video. Raises FramesError with one line naming the file."""
    path, options = Path(path), options or FrameOptions()
    options.check()
    options.make_tone()
    with faults_as(FramesError, path):
        return _open(path, options)


def _open(path: Path, options: FrameOptions) -> FrameSource:
    if not path.exists():
        names = [p.name for p in path.parent.iterdir()] if path.parent.is_dir() else []
        raise FramesError(f"{path}: no such file{did_you_mean(path.name, names)}")
    if path.is_dir():
        return _open_folder(path, options)
    try:
        with path.open("rb") as file:
            head = file.read(4)
    except OSError as error:
        raise FramesError(f"{path}: cannot be read: {error.strerror}") from None
    if not head:
        raise FramesError(f"{path}: the file is empty")
    if head.startswith(b"PK") or path.suffix.lower() == ".npz":
        return NpzFrames(path, options)
    if path.suffix.lower() in (".png", ".exr"):
        raise FramesError(f"{path}: one image makes no events; give the folder of all of them")
    return VideoFrames(path, options)


def _open_folder(path: Path, options: FrameOptions) -> FrameSource:
    names = [p.name for p in path.iterdir() if p.is_file() and not p.name.startswith(".")]
    kinds = {end: [n for n in names if n.lower().endswith(end)] for end in (".exr", ".png")}
    exr, png = kinds[".exr"], kinds[".png"]
    if exr and png:
        raise FramesError(f"{path}: holds {len(exr)} EXR and {len(png)} PNG files; keep one kind in the folder")
    if exr:
        return ExrFrames(path, exr, options)
    if png:
        return PngFrames(path, png, options)
    there = ", ".join(sorted({Path(n).suffix or n for n in names})[:5]) or "nothing"
    raise FramesError(f"{path}: no .exr or .png files in the folder; it has {there}")
