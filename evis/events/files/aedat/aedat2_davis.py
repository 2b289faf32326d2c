"""Assembles frames and inertial samples of a DAVIS from the words between the events of AEDAT 2.0 (address bit
31 set)."""

from __future__ import annotations

import numpy as np

from evis.events.arrays import STANDARD_GRAVITY, Events, Frame, Imu

RESET, SIGNAL, IMU = 0, 1, 3
"""Bits 10-11 of the address."""
# full scales of jAER's default configuration (8 g, 1000 deg/s) and the temperature formula of the InvenSense MPU-6100
_ACCELERATION = STANDARD_GRAVITY / 4096
_ANGULAR_VELOCITY = np.radians(1 / 32.8)
_KINDS = 7
_ROWS, _COLUMNS = 512, 1024


class DavisSamples:
    """Assembles APS reads and IMU words; state is carried from block to block.

    A frame begins where the pixel that was reset first is reset again; a pixel is its reset read minus its signal read
    (0..1023), shifted to 16 bits. An IMU sample is seven words in a row: acceleration x y z, temperature, angular
    velocity x y z.
    """

    def __init__(self) -> None:
        self._reset = np.zeros((_ROWS, _COLUMNS), np.int32)
        self._signal = np.zeros((_ROWS, _COLUMNS), np.int32)
        self._first = -1
        self._counts = [0, 0]
        self._times = [0, 0, 0]
        self._box = [_COLUMNS, _ROWS, -1, -1]
        self._imu: list[tuple[int, int, int]] = []
        self._damaged = 0

    def take_damaged(self) -> int:
        """Returns the number of frames without a signal for each reset read since the last call."""
        n, self._damaged = self._damaged, 0
        return n

    def add(self, address: np.ndarray, t: np.ndarray, events: Events) -> None:
        """Takes words int64 [n] with bit 31 set, and their times [ns]; what becomes complete goes into `events`."""
        kind = address >> 10 & 3
        imu = kind == IMU
        if imu.any():
            self._add_imu(address[imu], t[imu], events)
        aps = kind <= SIGNAL
        if aps.any():
            self._add_reads(address[aps], kind[aps], t[aps], events)

    def _add_imu(self, address: np.ndarray, t: np.ndarray, events: Events) -> None:
        kind = address >> 28 & 7
        value = (address >> 12 & 0xFFFF).astype(np.uint16).view(np.int16)
        words = [*self._imu, *zip(t.tolist(), kind.tolist(), value.tolist())]
        rows, i = [], 0
        while i + _KINDS <= len(words):
            group = words[i : i + _KINDS]
            if [k for _, k, _ in group] == list(range(_KINDS)):
                rows.append([group[0][0], *(v for _, _, v in group)])
                i += _KINDS
            else:
                i += 1
        self._imu = words[i:]
        if rows:
            table = np.array(rows, np.int64)
            temperature = table[:, 4] / 340 + 35
            events.imu = Imu(table[:, 0], table[:, 1:4] * _ACCELERATION, table[:, 5:8] * _ANGULAR_VELOCITY, temperature)

    def _add_reads(self, address: np.ndarray, kind: np.ndarray, t: np.ndarray, events: Events) -> None:
        place = address >> 12 & 0x7FFFF
        resets = kind == RESET
        if self._first < 0:
            if not resets.any():
                return  # in the middle of a frame
            begin = int(np.argmax(resets))
            address, kind, t, place, resets = (a[begin:] for a in (address, kind, t, place, resets))
            self._first = int(place[0])
        borders = np.flatnonzero(resets & (place == self._first)).tolist()
        for start, end in zip([0, *borders], [*borders, len(place)]):
            if start in borders:
                self.finish(events)
            if end > start:
                part = slice(start, end)
                self._collect(kind[part], place[part], address[part] & 0x3FF, t[part])

    def _collect(self, kind: np.ndarray, place: np.ndarray, value: np.ndarray, t: np.ndarray) -> None:
        x, y = place & 0x3FF, place >> 10
        signal = kind == SIGNAL
        if not self._counts[RESET]:
            self._times[0] = int(t[0])
        if signal.any() and not self._counts[SIGNAL]:
            self._times[1] = int(t[np.argmax(signal)])
        self._times[2] = int(t[-1])
        self._reset[y[~signal], x[~signal]] = value[~signal]
        self._signal[y[signal], x[signal]] = value[signal]
        self._counts[RESET] += int(np.count_nonzero(~signal))
        self._counts[SIGNAL] += int(np.count_nonzero(signal))
        low, high = self._box[:2], self._box[2:]
        self._box = [
            min(low[0], int(x.min())),
            min(low[1], int(y.min())),
            max(high[0], int(x.max())),
            max(high[1], int(y.max())),
        ]

    def finish(self, events: Events) -> None:
        """Ends the frame that is open, if any, and puts it into `events` where it is whole."""
        (n_reset, n_signal), (x0, y0, x1, y1) = self._counts, self._box
        if n_reset and n_reset == n_signal:
            cut = np.s_[y0 : y1 + 1, x0 : x1 + 1]
            pixels = np.clip(self._reset[cut] - self._signal[cut], 0, 1023).astype(np.uint16) << 6
            begin, signal, end = self._times
            events.frames.append(Frame(begin, pixels, begin, signal, x0, y0, end))
        elif n_reset or n_signal:
            self._damaged += 1
        self._counts, self._box = [0, 0], [_COLUMNS, _ROWS, -1, -1]
