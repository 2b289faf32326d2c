"""Reads inertial samples from an endpoint of their own; they carry no time, so that of their arrival is taken."""

from __future__ import annotations

import array
import errno
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from typing import Any

import numpy as np
import usb.core

from evis.events.arrays import Imu
from evis.events.codecs.inivation.dvxplorer_mini_imu import MiniImu, message_of
from nodes.camera.usb.reader import MAX_FAULTS, TIMEOUT_MS

SIZE = 64
"""Largest packet of the endpoint [bytes]."""
MAX_WAITING = 1 << 14
"""Samples that wait to be taken at most; older ones are dropped and counted."""
MAX_PAIRS = 1 << 10
QUIET_WAIT_S = 0.5
"""Longest wait for what is still under way at the end of the stream [s]."""


class ImuEndpointReader:
    """Reads inertial samples from their endpoint in a thread until `close`.

    read(buffer, timeout_ms) -> bytes; recover() clears a stalled endpoint.

    pause_s: time between two reads: a firmware that answers with its newest sample whenever it is asked must not take
    the bus from the events. A packet equal to the one before is that sample again, and no new one.
    """

    def __init__(
        self, read: Callable[[Any, int], int], recover: Callable[[], None], imu: MiniImu, pause_s: float
    ) -> None:
        self._read, self._recover, self._imu, self._pause_s = read, recover, imu, pause_s
        self._samples: deque[tuple[int, np.ndarray]] = deque()
        self._pairs: deque[tuple[int, int]] = deque(maxlen=MAX_PAIRS)
        self._quiet = threading.Event()
        self._stop = False
        self._last_ns = 0
        self._last_packet = b""
        self.counts: Counter[str] = Counter()
        self.message = ""
        """The last message of the firmware."""
        self._thread = threading.Thread(target=self._run, name="usb-side", daemon=True)

    def start(self) -> None:
        """Starts the thread."""
        self._thread.start()

    def close(self) -> None:
        """Ends the thread."""
        self._stop = True
        if self._thread.is_alive():
            self._thread.join(5.0)

    def note_arrival(self, t_host_ns: int, t_ns: int) -> None:
        """Notes that events up to device time t_ns had arrived at host time t_host_ns."""
        self._pairs.append((t_host_ns, t_ns))

    def wait_until_quiet(self) -> None:
        """Waits until no more samples come."""
        self._quiet.clear()
        if self._thread.is_alive():
            self._quiet.wait(QUIET_WAIT_S)

    def take(self, until_ns: int | None, to_device: Callable[[int], int] | None) -> Imu:
        """Returns, and removes, the samples up to a device time [ns] (None: all).

        to_device: the host's clock to the device's, where that is known; without it a sample lies between the events
        that arrived before and after it.
        """
        times: list[int] = []
        values: list[np.ndarray] = []
        while self._samples and (to_device is not None or self._pairs):
            t_host_ns, sample = self._samples[0]
            if to_device is None and until_ns is not None and t_host_ns > self._pairs[-1][0]:
                break
            t_ns = max(to_device(t_host_ns) if to_device else self._between(t_host_ns), self._last_ns)
            if until_ns is not None and t_ns > until_ns:
                break
            self._samples.popleft()
            self._last_ns = t_ns
            times.append(t_ns)
            values.append(sample)
        if not times:
            return Imu()
        v = np.array(values)
        return Imu(np.array(times, np.int64), v[:, :3].copy(), v[:, 3:6].copy(), v[:, 6].copy())

    def _between(self, t_host_ns: int) -> int:
        """Interpolates the device time [ns] of a host time between the arrivals that were noted."""
        host, device = np.array(self._pairs, np.int64).T
        return int(device[0]) + round(float(np.interp(t_host_ns - host[0], host - host[0], device - device[0])))

    # -- the thread ---------------------------------------------------------------------------------------------------

    def _run(self) -> None:
        buffer, faults = array.array("B", bytes(SIZE)), 0
        while not self._stop:
            try:
                size = self._read(buffer, TIMEOUT_MS)
            except usb.core.USBTimeoutError:
                self._quiet.set()
                continue
            except usb.core.USBError as error:
                faults += 1
                if error.errno != errno.EPIPE or faults > MAX_FAULTS:
                    self.counts["imu_endpoint_broken"] += 1  # the stream says whether the camera is gone
                    break
                self.counts["imu_stalls"] += 1
                self._recover()
                continue
            faults = 0
            self._put(bytes(buffer[:size]), time.monotonic_ns())
            if self._pause_s:
                time.sleep(self._pause_s)
        self._quiet.set()

    def _put(self, packet: bytes, t_host_ns: int) -> None:
        """Queues the sample of a packet, or keeps the firmware's message in it; counts damaged ones."""
        if packet == self._last_packet:
            return
        self._last_packet = packet
        sample = self._imu.sample(packet)
        if sample is not None:
            self._samples.append((t_host_ns, sample))
            if len(self._samples) > MAX_WAITING:
                self._samples.popleft()
                self.counts["imu_lost"] += 1
            return
        message = message_of(packet)
        self.counts["imu_damaged" if message is None else "device_messages"] += 1
        self.message = message or self.message
