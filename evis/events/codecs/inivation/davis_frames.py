"""Assembles APS frames of a DAVIS: columns of reset and of signal samples, subtracted, with the place of the region
read out."""

from __future__ import annotations

import numpy as np

from evis.events.arrays import Frame

START_GLOBAL, START_ROLLING, END, RESET_COLUMN, SIGNAL_COLUMN, COLUMN_END, EXPOSURE_START, EXPOSURE_END = range(8, 16)
_BRIGHT_RESET = 384

_MARK, _PART = 1, 2
_KIND = np.zeros(1 << 16, np.uint8)
"""Kind of each word for a frame: it begins or ends one, or is a part of it."""
_KIND[[1, START_GLOBAL, START_ROLLING, END]] = _MARK
_KIND[RESET_COLUMN : EXPOSURE_END + 1] = _PART
_KIND[0x4000:0x5000] = _KIND[0x5100:0x5300] = _PART


class FrameReader:
    """Assembles frames from words that come in pieces.

    orientation: the APS orientation register: bit 0 flips y, bit 1 flips x, bit 2: columns are read out as rows.
    """

    def __init__(self, width: int, height: int, orientation: int = 0) -> None:
        self.width, self.height, self.orientation = width, height, orientation
        self._parts: list[tuple[np.ndarray, np.ndarray]] | None = None
        self._size = 0
        # two samples a pixel, two words around each column, nine before the first, and some room
        self._limit = 2 * width * height + 4 * max(width, height) + 64

    def feed(self, t_us: np.ndarray, words: np.ndarray) -> tuple[list[Frame], int]:
        """Takes words and returns (frames completed, number of frames damaged). t_us int64 [n]; words uint16 [n],
        others than of frames are skipped.
        """
        kind = _KIND[words]
        if not kind.all():
            mine = np.flatnonzero(kind)
            t_us, words, kind = t_us[mine], words[mine], kind[mine]
        frames, damaged, begin = [], 0, 0
        for i in np.flatnonzero(kind == _MARK):
            if self._parts is not None:
                self._parts.append((t_us[begin:i], words[begin:i]))
                frame = self._frame(int(t_us[i])) if words[i] == END else None
                damaged += frame is None
                frames += [frame] if frame else []
            else:
                damaged += int(words[i] == END)
            self._parts = [(t_us[i : i + 1], words[i : i + 1])] if words[i] in (START_GLOBAL, START_ROLLING) else None
            begin, self._size = int(i) + 1, 0
        if self._parts is not None:
            self._parts.append((t_us[begin:], words[begin:]))
            self._size += len(words) - begin
            if self._size > self._limit:
                self._parts, damaged = None, damaged + 1
        return frames, damaged

    def _frame(self, end_us: int) -> Frame | None:
        """Assembles the frame of the words since its start; None where columns or samples are missing or too many."""
        assert self._parts is not None
        t_us, words = (np.concatenate([part[k] for part in self._parts]) for k in (0, 1))
        region = _region(words, self.width, self.height)
        columns = np.flatnonzero((words == RESET_COLUMN) | (words == SIGNAL_COLUMN))
        is_signal = words[columns] == SIGNAL_COLUMN
        if region is None:
            return None
        x0, y0, w, h = region
        across, along = (h, w) if self.orientation & 4 else (w, h)
        if np.count_nonzero(is_signal) != across or len(columns) != 2 * across:
            return None
        is_sample = words >= 0x4000
        is_sample &= words < 0x5000
        before = np.append(np.cumsum(is_sample, dtype=np.int32)[columns], np.count_nonzero(is_sample))
        if before[0] or (np.diff(before) != along).any():
            return None
        values = (words[is_sample] & 0xFFF).astype(np.int16).reshape(len(columns), along)
        reset, signal = values[~is_signal], values[is_signal]
        # light so strong that the reset level does not recover, or that the signal is 0, would come out black
        value = np.where((reset < _BRIGHT_RESET) | (signal == 0), 1023, np.clip(reset - signal, 0, 1023))
        pixels = value if self.orientation & 4 else value.T
        # flips are those of the readout, before columns become rows
        down, right = (2, 1) if self.orientation & 4 else (1, 2)
        flips = tuple(slice(None, None, -1 if self.orientation & bit else 1) for bit in (down, right))
        start = t_us[words == EXPOSURE_START]
        end = t_us[words == EXPOSURE_END]
        return Frame(
            int(t_us[0]) * 1000,
            np.ascontiguousarray(pixels[flips] << 6).astype(np.uint16),
            int(start[-1] if len(start) else t_us[0]) * 1000,
            int(end[-1] if len(end) else end_us) * 1000,
            x0,
            y0,
            end_us * 1000,
        )


def _region(words: np.ndarray, width: int, height: int) -> tuple[int, int, int, int] | None:
    """Reads x0, y0, width, height from the pieces (first column, first row, last column, last row); all without
    them."""
    pieces = words[(words >> 8 == 0x51) | (words >> 8 == 0x52)]
    if not len(pieces):
        return 0, 0, width, height
    if len(pieces) != 8 or (pieces >> 8 != np.tile([0x51, 0x52], 4)).any():
        return None
    data = (pieces & 0xFF).astype(int)
    x0, y0, x1, y1 = (int(v) for v in data[0::2] << 8 | data[1::2])
    return (x0, y0, x1 + 1 - x0, y1 + 1 - y0) if x0 <= x1 < width and y0 <= y1 < height else None


def check_frame(frame: Frame, width: int, height: int) -> None:
    """Raises ValueError for a frame that a DAVIS of this size cannot send."""
    if frame.pixels.ndim != 2 or frame.pixels.dtype not in (np.uint8, np.uint16):
        raise ValueError("a DAVIS frame must be grey, uint8 or uint16 [h, w]")
    h, w = frame.pixels.shape
    if not (h and w and 0 <= frame.x0 <= width - w and 0 <= frame.y0 <= height - h):
        raise ValueError(f"a frame of {w}x{h} at {frame.x0}, {frame.y0} is not inside the sensor's {width}x{height}")
    times = _times(frame)
    if sorted(times) != times:
        raise ValueError("a frame's times must not run back: start, exposure's start, exposure's end, end of readout")


def _times(frame: Frame) -> list[int]:
    return [frame.t_ns, frame.exposure_start_ns, frame.exposure_end_ns, frame.end_ns or frame.exposure_end_ns]


def frame_blocks(frame: Frame, width: int, height: int) -> list[tuple[int, np.ndarray]]:
    """Encodes a frame as (time [us], words): start and region, exposure, then all columns at its end. Raises
    ValueError.

    The reset level is 1023 everywhere; pixels are cut to 10 bits.
    """
    check_frame(frame, width, height)
    h, w = frame.pixels.shape
    times = _times(frame)
    corners = np.array([frame.x0, frame.y0, frame.x0 + w - 1, frame.y0 + h - 1])
    region = np.stack([0x5100 | corners >> 8, 0x5200 | corners & 0xFF], axis=1).reshape(-1)
    value = (
        frame.pixels.astype(np.int64) >> 6 if frame.pixels.dtype == np.uint16 else frame.pixels.astype(np.int64) << 2
    )
    columns = np.empty((w, 2, h + 2), np.int64)
    columns[:, :, 0] = RESET_COLUMN, SIGNAL_COLUMN
    columns[:, 0, 1:-1] = 0x4000 | 1023
    columns[:, 1, 1:-1] = 0x4000 | (1023 - value.T)
    columns[:, :, -1] = COLUMN_END
    parts = [np.append(START_ROLLING, region), [EXPOSURE_START], [EXPOSURE_END], np.append(columns.reshape(-1), END)]
    return [(t // 1000, np.asarray(words, np.int64)) for t, words in zip(times, parts)]
