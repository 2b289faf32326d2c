"""Decodes and encodes DVXplorer over USB (iniVation FX3): columns of groups of eight rows, inertial samples, triggers.

Code 1 is a column (bit 11: start of a readout), code 4 the rows of two groups (the second relative to the first),
codes 3 and 2 a mask of eight pixels of the first and of the second group with one polarity (0 = ON). A whole readout
has one time.
"""

from __future__ import annotations

import numpy as np

from evis.events.arrays import Events
from evis.events.codecs.decoder import count_until
from evis.events.codecs.encoder import find_groups
from evis.events.codecs.inivation import encoder
from evis.events.codecs.inivation import words as inivation
from evis.events.codecs.inivation.imu import BOSCH, ImuReader
from evis.events.codecs.inivation.words import (
    ADDRESS,
    CODE_SHIFT,
    EVENT,
    IMU_DAMAGED,
    IMU_END,
    IMU_START,
    OUTSIDE,
    SIDE,
    STATE,
)

COLUMN, ROW1, ROW2, BINNED = range(STATE, STATE + 4)
"""Places in the state vector."""
COLUMN_CODE, MASK2_CODE, MASK1_CODE, GROUPS_CODE = 1, 2, 3, 4
COLUMN_MASK, GROUP_MASK, STEP_SHIFT, STEP_MASK, STEPS_BACK = 0x3FF, 0x3F, 6, 31, 0x800
"""Fields: a column; the first group of eight rows, how far the second is from it, and in which direction."""
OFF_BIT = 8
SIDE_PIECES = (0, 3)
"""Sub-codes of 8-bit pieces: of inertial samples, and of their ranges."""


def folded(address: np.ndarray, size: int) -> np.ndarray:
    """Maps the addresses of a binned sensor, whose far half stands for the near one."""
    return np.where(address >= size, address - size, address)


class Decoder(inivation.Decoder):
    """Decodes DVXplorer words to events, inertial samples and triggers.

    binned: the sensor makes one of two by two pixels. A readout that runs from the far edge then begins at half of the
    full sensor; width and height are those of the smaller image. Holds from the next reset on.
    """

    encoding = "dvxplorer"
    geometry = (640, 480)
    state_size = STATE + 4
    kernel = "evis.events.codecs.inivation.dvxplorer_kernels:decode_dvxplorer"
    kinds = inivation.classes(
        {COLUMN_CODE: ADDRESS, MASK1_CODE: EVENT, MASK2_CODE: EVENT, GROUPS_CODE: ADDRESS},
        dict.fromkeys([IMU_START, IMU_END], SIDE),
        dict.fromkeys(SIDE_PIECES, SIDE),
    )

    binned = False

    def _reset_context(self) -> None:
        self.state[[COLUMN, ROW1, ROW2]] = 0
        self.state[BINNED] = self.binned
        self._imu = ImuReader(BOSCH, self.imu_orientation)

    def _events(self, words: np.ndarray, kind: np.ndarray, at: np.ndarray, times: np.ndarray) -> Events:
        state = self.state
        is_column, is_group = words >> CODE_SHIFT == COLUMN_CODE, words >> CODE_SHIFT == GROUPS_CODE
        column = np.append(state[COLUMN], words[is_column].astype(np.int64) & COLUMN_MASK)
        data = words[is_group].astype(np.int64)
        first, step = data & GROUP_MASK, data >> STEP_SHIFT & STEP_MASK
        second = np.where(data & STEPS_BACK, first - step, first + step)
        first, second = first * 8, second * 8
        columns, rows = self.readout
        if state[BINNED]:
            column, first, second = folded(column, columns), folded(first, rows), folded(second, rows)
        row1, row2 = np.append(state[ROW1], first), np.append(state[ROW2], second)
        state[COLUMN], state[ROW1], state[ROW2] = column[-1], row1[-1], row2[-1]
        g = count_until(is_group, at)
        row = np.where(words[at] >> CODE_SHIFT == MASK1_CODE, row1[g], row2[g])
        bits = np.unpackbits((words[at] & 0xFF).astype(np.uint8), bitorder="little")
        flat = np.flatnonzero(bits.view(bool))
        of = flat >> 3
        x, y = column[count_until(is_column, at)][of], row[of] + (flat & 7)
        keep = (y >= 0) & (y < rows) & (x < columns)
        if not keep.all():
            state[OUTSIDE] += np.count_nonzero(~keep)
            x, y, of = x[keep], y[keep], of[keep]
        p = (words[at] >> OFF_BIT & 1 == 0).astype(np.uint8)
        return Events(times[of] * 1000, x.astype(np.uint16), y.astype(np.uint16), p[of])

    def _assemble(self, events: Events, t: np.ndarray, words: np.ndarray) -> None:
        events.imu, damaged = self._imu.feed(t, words)
        self.state[IMU_DAMAGED] += damaged


class Encoder(encoder.Encoder):
    """Encodes events, inertial samples and triggers as DVXplorer words.

    Neighbours of one time, column and polarity whose rows rise within a group of eight share a mask.
    """

    encoding = "dvxplorer"
    columns, rows = 640, 480
    width, height = 640, 480
    imu = BOSCH

    def _forget_addresses(self) -> None:
        self._column = self._group = -1

    def _cells(self, events: Events, t_us: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        heads, masks = find_groups(t_us, events)
        x, group = events.x[heads].astype(np.int64), events.y[heads].astype(np.int64) >> 3
        starts = t_us[heads] != np.append(-1 if self._t_us is None else self._t_us, t_us[heads][:-1])[: len(heads)]
        off = 1 - events.p[heads].astype(np.int64)
        cells = np.stack([0x1000 | starts << 11 | x, 0x4000 | group, 0x3000 | off << 8 | masks], axis=1)
        used = np.ones((len(heads), 3), bool)
        used[:, 0] = starts | (x != np.append(self._column, x[:-1])[: len(x)])
        used[:, 1] = group != np.append(self._group, group[:-1])[: len(x)]
        if len(heads):
            self._column, self._group = int(x[-1]), int(group[-1])
        return heads, cells, used
