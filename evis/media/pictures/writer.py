"""Writes sequences of pictures: animations with Pillow, ffmpeg or PyAV, and sheets."""

from __future__ import annotations

import itertools
import os
import shutil
import subprocess
from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import numpy as np

from evis.files.whole_file import whole_file
from evis.media.ffmpeg import address

Pictures = Iterator[tuple[int, np.ndarray]]
"""(time [ns], uint8 [H, W, 3]) of each picture, all of one size."""

_COLUMNS, _ROWS = 4, 3
_KEPT_BYTES = 1 << 28
"""Pictures of a sheet that are chosen among, where they are large."""
_COLOURS = 64
"""More than any style of picture has, so that none changes."""
_LEAST_MS = 20
"""Browsers play shorter GIF frames at 100 ms."""


def _first(path: str, pictures: Pictures) -> tuple[int, np.ndarray]:
    first = next(pictures, None)
    if first is None:
        raise ValueError(f"{path}: nothing to draw: no events in this part of the recording")
    return first


def write_gif(path: str | os.PathLike[str], images: Iterator[Any], dt_ms: float, one_palette: bool) -> None:
    """Writes Pillow palette images as an endless GIF, one each dt_ms, at least 20 ms. Raises StopIteration for none.

    one_palette: all images have the same palette, which is kept whole; otherwise each keeps what it uses of its own.
    """
    # GIF counts time in hundredths of a second
    duration = max(_LEAST_MS, round(dt_ms / 10) * 10)
    with whole_file(path) as partial:
        next(images).save(
            partial, "GIF", save_all=True, append_images=images, duration=duration, loop=0, disposal=1,
            optimize=not one_palette,
        )  # fmt: skip


def save_gif(path: str, pictures: Pictures, dt_ms: float) -> None:
    """Writes an endless animation in real time, or slower where a picture is shorter than 20 ms."""
    from PIL import Image

    first = _first(path, pictures)
    images = (
        Image.fromarray(picture).quantize(_COLOURS, dither=Image.Dither.NONE)
        for _, picture in itertools.chain([first], pictures)
    )
    write_gif(path, images, dt_ms, one_palette=False)


def save_mp4(path: str, pictures: Pictures, dt_ms: float) -> None:
    """Writes H.264 by the ffmpeg program, or PyAV. Raises ValueError where neither is installed or ffmpeg fails."""
    rate = Fraction(min(1000 / dt_ms, 1000 / _LEAST_MS)).limit_denominator(1_000_000)
    program = shutil.which("ffmpeg")
    if program is None:
        _save_by_pyav(path, pictures, rate)
    else:
        _save_by_program(program, path, pictures, rate)


def _save_by_pyav(path: str, pictures: Pictures, rate: Fraction) -> None:
    try:
        import av
    except ImportError:
        raise ValueError(
            f"{path}: .mp4 needs the program ffmpeg or `pip install 'evis[video]'`; install one, or write .gif"
        ) from None

    _, first = _first(path, pictures)
    height, width = first.shape[:2]
    with whole_file(path) as partial, av.open(address(partial), "w", format="mp4") as film:
        stream = film.add_stream("libx264", rate=rate)
        # most players want even sizes and this pixel format
        stream.width, stream.height, stream.pix_fmt = width + width % 2, height + height % 2, "yuv420p"
        for _, picture in itertools.chain([(0, first)], pictures):
            even = np.full((stream.height, stream.width, 3), 255, np.uint8)
            even[:height, :width] = picture
            film.mux(stream.encode(av.VideoFrame.from_ndarray(even, format="rgb24")))
        film.mux(stream.encode())


def _save_by_program(program: str, path: str, pictures: Pictures, rate: Fraction) -> None:
    first = _first(path, pictures)
    height, width = first[1].shape[:2]
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", str(rate), "-i", "-"]
    # most players want even sizes and this pixel format
    target = ["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2:0:0:white", "-pix_fmt", "yuv420p", "-f", "mp4"]
    with whole_file(path) as partial:
        _feed([program, "-y", "-loglevel", "error", *source, *target, address(partial)], path, first, pictures)


def _feed(command: list[str], path: str, first: tuple[int, np.ndarray], pictures: Pictures) -> None:
    """Run a program on the pictures' bytes. Raises ValueError where it fails."""
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdin is not None and process.stderr is not None
    try:
        for _, picture in itertools.chain([first], pictures):
            process.stdin.write(picture.tobytes())
        process.stdin.close()
    except BrokenPipeError:
        pass  # ffmpeg says why on its stderr
    except BaseException:
        process.kill()
        raise
    finally:
        message = process.stderr.read().decode(errors="replace").strip()
        status = process.wait()
    if status:
        raise ValueError(f"{path}: ffmpeg failed: {message.splitlines()[-1] if message else status}")


def save_sheet(path: str, pictures: Pictures, dt_ms: float) -> None:
    """Writes up to 12 pictures, spread evenly over all, on one PNG, each with its time; one picture alone fills it."""
    from PIL import Image, ImageDraw

    # every 2nd is dropped when there are too many, so that memory stays bounded
    kept, step = [_first(path, pictures)], 1
    most = max(2 * _COLUMNS * _ROWS, min(8 * _COLUMNS * _ROWS, _KEPT_BYTES // kept[0][1].nbytes))
    for i, item in enumerate(pictures, 1):
        if i % step == 0:
            kept.append(item)
        if len(kept) > most:
            kept, step = kept[::2], 2 * step
    n = min(len(kept), _COLUMNS * _ROWS)
    chosen = [kept[i * (len(kept) - 1) // max(n - 1, 1)] for i in range(n)]
    height, width = chosen[0][1].shape[:2]
    columns = min(_COLUMNS, n)
    border = 4 if n > 1 else 0
    rows = -(-n // columns)
    sheet = Image.new("RGB", (columns * (width + border) - border, rows * (height + border) - border), (208, 208, 208))
    for i, (start, picture) in enumerate(chosen):
        tile = Image.fromarray(picture)
        if n > 1:
            ImageDraw.Draw(tile).text((4, 4), f"{start / 1e9:.3f} s", fill=(0, 0, 0))
        sheet.paste(tile, (i % columns * (width + border), i // columns * (height + border)))
    with whole_file(path) as partial:
        sheet.save(partial, "PNG")
