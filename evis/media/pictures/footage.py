"""Shows frames beside the events between them: an animated GIF in slow motion, and one picture of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from evis.files.whole_file import whole_file
from evis.media.pictures.event_pictures import faded_events
from evis.media.pictures.side_by_side import beside, palette
from evis.media.pictures.writer import write_gif

MAX_PICTURES = 1000


@dataclass
class Footage:
    """Holds the frames and events that one camera recorded.

    frames: uint8 [n, H, W, 3]; frame_t: int64 [n] ns, ascending. t, x, y, p: events, t int64 ns ascending. width,
    height: of the event sensor [px].
    """

    frames: np.ndarray
    frame_t: np.ndarray
    t: np.ndarray
    x: np.ndarray
    y: np.ndarray
    p: np.ndarray
    width: int
    height: int

    def frame_at(self, time_ns: int) -> np.ndarray:
        """Returns the newest frame at a time, as a camera would show it; the first one before that."""
        return self.frames[max(0, int(np.searchsorted(self.frame_t, time_ns, side="right")) - 1)]

    @property
    def span_ns(self) -> tuple[int, int]:
        """Returns the first and last time of frames and events."""
        times = [v for a in (self.frame_t, self.t) if len(a) for v in (int(a[0]), int(a[-1]))]
        return min(times), max(times)

    @property
    def captions(self) -> tuple[str, str]:
        """Returns the texts under the two pictures."""
        gaps = np.diff(self.frame_t)
        rate = f"frames, {1e9 / float(np.median(gaps)):.0f} per second" if len(gaps) else "frame"
        first, last = self.span_ns
        seconds = (last - first) / 1e9
        return rate, f"events, {len(self.t) / seconds / 1e6:.2f} million per second" if seconds > 0 else "events"


def _sheets(footage: Footage, times: np.ndarray, tau_ns: int, note: str, scale: int) -> Iterator[Any]:
    captions, first = footage.captions, footage.span_ns[0]
    for at in times.tolist():
        events = faded_events(footage.t, footage.x, footage.y, footage.p, footage.width, footage.height, at, tau_ns)
        yield beside(footage.frame_at(at), events, captions, f"{(at - first) / 1e6:.1f} ms{note}", scale)


def _check(footage: Footage) -> None:
    if len(footage.frames) == 0:
        raise ValueError("there are no frames to show beside the events: record /cam0/image or /cam0/keyframe")
    if len(footage.frames) != len(footage.frame_t):
        raise ValueError(f"{len(footage.frames)} frames but {len(footage.frame_t)} frame times")


def make_animation(
    footage: Footage,
    out: Path,
    *,
    fps: float = 20.0,
    slow_motion: float = 10.0,
    from_ns: int | None = None,
    to_ns: int | None = None,
) -> int:
    """Writes a GIF and returns the number of its pictures.

    Every picture stands for 1 / (fps * slow_motion) seconds of the recording, and events fade with twice that.
    from_ns, to_ns: part of the recording, everything by default. Raises ValueError where there is nothing to show or
    the animation would have more than MAX_PICTURES.
    """
    from PIL import Image

    _check(footage)
    first, last = footage.span_ns
    first, last = first if from_ns is None else from_ns, last if to_ns is None else min(to_ns, last)
    step_ns = max(1, round(1e9 / (fps * slow_motion)))
    count = (last - first) // step_ns + 1
    if not 0 < count <= MAX_PICTURES:
        raise ValueError(
            f"the animation would have {count} pictures, it must be 1 to {MAX_PICTURES}: "
            "choose another part, fewer frames per second or less slow motion"
        )
    times = first + step_ns * np.arange(count, dtype=np.int64)
    note = f"   {slow_motion:g} times slower" if slow_motion != 1 else ""
    colours = palette(footage.frames)
    pictures = (
        sheet.quantize(palette=colours, dither=Image.Dither.NONE)
        for sheet in _sheets(footage, times, 2 * step_ns, note, 1)
    )
    write_gif(out, pictures, 1000 / fps, one_palette=True)
    return int(count)


def make_still(footage: Footage, out: Path, *, at_ns: int | None = None, tau_ms: float = 4.0, scale: int = 2) -> None:
    """Writes one PNG: the newest frame and the events at `at_ns`, the middle of the recording by default."""
    _check(footage)
    first, last = footage.span_ns
    at = (first + last) // 2 if at_ns is None else at_ns
    (sheet,) = _sheets(footage, np.array([at]), round(tau_ms * 1e6), "", scale)
    with whole_file(out) as partial:
        sheet.save(partial, "PNG", optimize=True)
