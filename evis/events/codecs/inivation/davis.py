"""Decodes and encodes DAVIS346 over USB (iniVation FX3): events as row and column words, APS frames, inertial samples,
triggers.

Code 1 is a row, codes 2 and 3 a column with an OFF or ON event at the time in force; frames are put together in
`davis_frames`, inertial samples in `imu`.
"""

from __future__ import annotations

import numpy as np

from evis.events.arrays import Events
from evis.events.codecs.decoder import count_until
from evis.events.codecs.inivation import encoder
from evis.events.codecs.inivation import words as inivation
from evis.events.codecs.inivation.davis_frames import FrameReader, frame_blocks
from evis.events.codecs.inivation.imu import INVENSENSE, ImuReader
from evis.events.codecs.inivation.words import (
    ADDRESS,
    CODE_SHIFT,
    DATA_MASK,
    EVENT,
    FRAMES_DAMAGED,
    IGNORED,
    IMU_DAMAGED,
    IMU_END,
    IMU_START,
    OUTSIDE,
    SIDE,
    STATE,
)

ROW = STATE
"""Place in the state vector."""
ROW_CODE, OFF_CODE, ON_CODE, SAMPLE_CODE, IGNORED_CODE = 1, 2, 3, 4, 6
IMU_SPECIALS, APS_SPECIALS = (IMU_START, IMU_END), range(8, 16)
"""Special words that begin and end an inertial sample, and those of frames."""
SIDE_PIECES = 4
"""Sub-codes of 8-bit pieces below this one belong to samples, frames and regions of interest."""
_SPECIALS = dict.fromkeys([*IMU_SPECIALS, *APS_SPECIALS], SIDE)


class Decoder(inivation.Decoder):
    """Decodes DAVIS346 words to events, frames (uint16, 10 bits shifted up by 6), inertial samples and triggers.

    aps_orientation: the APS orientation register of the device (module 2, parameter 2), see `FrameReader`.
    """

    encoding = "davis346"
    geometry = (346, 260)
    state_size = STATE + 1
    kernel = "evis.events.codecs.inivation.davis_kernels:decode_davis"
    kinds = inivation.classes(
        {ROW_CODE: ADDRESS, OFF_CODE: EVENT, ON_CODE: EVENT, SAMPLE_CODE: SIDE, IGNORED_CODE: IGNORED},
        _SPECIALS,
        dict.fromkeys(range(SIDE_PIECES), SIDE),
    )
    aps_orientation = 0

    def _reset_context(self) -> None:
        self.state[ROW] = 0
        self._imu = ImuReader(INVENSENSE, self.imu_orientation)
        self._frames = FrameReader(self.width, self.height, self.aps_orientation)

    def _events(self, words: np.ndarray, kind: np.ndarray, at: np.ndarray, times: np.ndarray) -> Events:
        row = np.append(self.state[ROW], words[kind == ADDRESS].astype(np.int64) & DATA_MASK)
        self.state[ROW] = row[-1]
        y, x = row[count_until(kind == ADDRESS, at)], words[at] & DATA_MASK
        p = (words[at] >> CODE_SHIFT & 1).astype(np.uint8)
        columns, rows = self.readout
        keep = (y < rows) & (x < columns)
        if not keep.all():
            self.state[OUTSIDE] += np.count_nonzero(~keep)
            times, x, y, p = times[keep], x[keep], y[keep], p[keep]
        return Events(times * 1000, x.astype(np.uint16), y.astype(np.uint16), p)

    def _assemble(self, events: Events, t: np.ndarray, words: np.ndarray) -> None:
        self._frames.orientation = self.aps_orientation
        events.imu, damaged = self._imu.feed(t, words)
        self.state[IMU_DAMAGED] += damaged
        events.frames, damaged = self._frames.feed(t, words)
        self.state[FRAMES_DAMAGED] += damaged


class Encoder(encoder.Encoder):
    """Encodes events, frames, inertial samples and triggers as DAVIS346 words, in readout order (no flips)."""

    encoding = "davis346"
    columns, rows = 346, 260
    width, height = 346, 260
    imu = INVENSENSE

    def _forget_addresses(self) -> None:
        self._row = -1

    def _cells(self, events: Events, t_us: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        n = len(events)
        x, y = events.x.astype(np.int64), events.y.astype(np.int64)
        cells = np.stack([ROW_CODE << CODE_SHIFT | y, (OFF_CODE | events.p.astype(np.int64)) << CODE_SHIFT | x], axis=1)
        used = np.ones((n, 2), bool)
        used[:, 0] = y != np.append(self._row, y[:-1])[:n]
        if n:
            self._row = int(y[-1])
        return np.arange(n), cells, used

    def _blocks(self, events: Events) -> list[tuple[int, np.ndarray]]:
        blocks = super()._blocks(events)
        last = -1
        for frame in sorted(events.frames, key=lambda f: f.t_ns):
            if frame.t_ns < max(last, 0):
                raise ValueError(
                    "frames of a DAVIS follow one another: one starts before the end of the last, or before 0"
                )
            blocks += frame_blocks(frame, self.width, self.height)
            last = frame.end_ns
        return blocks

    def _check_samples(self, events: Events) -> None:
        """Accepts all kinds of samples."""
