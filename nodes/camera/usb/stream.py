"""A camera's byte stream as readings: decoded, cut at whole intervals of the device's clock, losses marked."""

from __future__ import annotations

import time
from collections import Counter

import numpy as np

from evis.streams.decoder import Decoder
from evis.streams.events import Events
from nodes.camera.driver import Reading
from nodes.camera.usb.access import StreamEnd
from nodes.camera.usb.clock import ClockMap
from nodes.camera.usb.reader import Chunk, Reader

NS = 1_000_000_000
LONG_GAP = 100
"""A silence of more packets than this is one empty packet: a jump in device time must not become a flood."""
GRACE_NS = 20_000_000
"""A quiet interval is closed when the host's clock says that it ended this long ago."""


class Stream:
    """Takes chunks from a reader and gives readings of packet_ns each.

    Cuts lie before the first event later than the boundary, as in a recording played back: events whose time steps
    back stay in their place. After a gap the decoder waits for the next time word, and its time is carried to the turn
    of the counter nearest to where the device's clock must be. live: the host's clock may close a quiet interval; not
    for a source that runs faster or slower than its own clock. origin_ns is added to all times.
    """

    def __init__(
        self, reader: Reader, decoder: Decoder, packet_ns: int, raw: bool, live: bool, origin_ns: int = 0
    ) -> None:
        self.reader, self.decoder, self.packet_ns, self._raw, self._live = reader, decoder, packet_ns, raw, live
        self.clock = ClockMap()
        self.counts: Counter[str] = Counter()
        self.ended = False
        self.read_at_ns = 0
        """When the newest bulk read that is in the last reading returned [ns, monotonic clock]."""
        self._chunk: Chunk | None = None
        self._t0: int | None = None
        self._stamp = 0
        self._origin = self._offset = origin_ns
        self._newest: int | None = None
        self._fresh = False
        self._realign = False
        self._lost = 0
        self._parts: list[Events] = []
        self._bytes: list[np.ndarray] = []

    def read(self, timeout_s: float) -> Reading | None:
        """The next interval; None when it is not complete after timeout_s, and at the end. Raises OSError."""
        deadline = time.monotonic() + timeout_s
        while not self.ended:
            reading = self._cut()
            if reading is not None:
                return reading
            try:
                chunk = self.reader.get(max(deadline - time.monotonic(), 0))
            except OSError as error:  # what had arrived before it comes first
                reading = self._rest()
                if reading is not None:
                    return reading
                if not isinstance(error, StreamEnd):
                    raise
                self.ended = True
                return None
            if chunk is not None:
                self._take(chunk)
            elif time.monotonic() >= deadline:
                return self._quiet()
        return None

    def read_bytes(self, count: int, t0_ns: int, stamp_ns: int, timeout_s: float) -> Reading:
        """One reading (t0_ns, stamp_ns] from the next `count` bytes, whatever times are in them.

        For a source that knows how many bytes an interval has (the simulator behind an emulated camera). Raises OSError
        when they do not come in time.
        """
        deadline = time.monotonic() + timeout_s
        self._t0, self._stamp = t0_ns, stamp_ns
        while count > 0:
            chunk = self.reader.get(max(deadline - time.monotonic(), 0))
            if chunk is None and time.monotonic() >= deadline:
                raise OSError(f"{count} bytes of the stream did not arrive in {timeout_s:g} s")
            if chunk is not None:
                self._take(chunk)
                count -= len(chunk.data) + chunk.lost
                self._keep(self.decoder.decode())
        return self._finish()

    def _take(self, chunk: Chunk) -> None:
        """Feed a chunk; the one before is not needed any more (the decoder copies the part of a word it has left)."""
        before = self._chunk
        if chunk.gap:
            self._lost += max(chunk.lost, 1)  # a stall does not say how much
            self.counts["gaps"] += 1
            self.decoder.resync()
            self._realign = self._newest is not None
        self.decoder.feed(chunk.data)
        self._chunk = chunk
        if before is not None:
            self.reader.give_back(before)

    def _cut(self) -> Reading | None:
        """Decode what is there; a reading when its end was reached."""
        if self._chunk is None:
            return None
        if self._t0 is None or self._realign:
            self._keep(self.decoder.decode_until(-1))
            if self.decoder.next_t_ns is None:
                return None
            self._align(self.decoder.next_t_ns)
        self._keep(self.decoder.decode_until(self._stamp - self._offset))
        if self.decoder.at_cut:
            return self._finish()
        if self._fresh and self._newest is not None:  # this chunk had events
            self.clock.add(self._chunk.t_host_ns, self._newest)
            self._fresh = False
        return None

    def _align(self, t_ns: int) -> None:
        """The first event of the stream, or the first after a gap, has this time on the decoder's clock."""
        if self._realign and self._newest is not None:
            expected = self._newest
            if self._live and self._chunk is not None and self.clock.known:
                expected = self.clock.to_device(self._chunk.t_host_ns)
            turns = round((expected - t_ns - self._origin) / self.decoder.wrap_ns)
            self._offset = self._origin + turns * self.decoder.wrap_ns
            self._realign = False
        if self._t0 is None:
            self._t0 = self._boundary(t_ns + self._offset)
            self._stamp = self._t0 + self.packet_ns

    def _boundary(self, t_ns: int) -> int:
        """The last packet boundary before an event."""
        return (t_ns - 1) // self.packet_ns * self.packet_ns

    def _keep(self, events: Events) -> None:
        if self._raw:
            self._bytes.append(self.decoder.taken.copy())
        if self._offset:
            _shift(events, self._offset)
        if len(events):
            self._newest, self._fresh = int(events.t[-1]), True
        self._parts.append(events)

    def _finish(self) -> Reading:
        """Close the interval and begin the next one."""
        assert self._t0 is not None
        filled = [e for e in self._parts if len(e) or len(e.triggers) or len(e.imu) or e.frames]
        events = Events.concatenate(filled) if filled else Events.empty()
        raw = None
        if self._raw:
            raw = np.concatenate(self._bytes) if self._bytes else np.empty(0, np.uint8)
        reading = Reading(events, self._t0, self._stamp, raw, self._lost)
        if len(events) and (back := int((events.t <= self._t0).sum())):
            self.counts["events_stepped_back"] += back
        self._parts, self._bytes, self._lost = [], [], 0
        if self._chunk is not None:
            self.read_at_ns = self._chunk.t_host_ns
        self._t0 = self._stamp
        self._stamp = self._t0 + self.packet_ns
        following = self.decoder.next_t_ns
        if following is not None and following + self._offset > self._t0 + LONG_GAP * self.packet_ns:
            self._stamp = self._boundary(following + self._offset)
            self.counts["long_gaps"] += 1
        return reading

    def _quiet(self) -> Reading | None:
        """Nothing comes: close the interval once the device's clock must be past its end."""
        if not self._live or self._t0 is None or not self.clock.known or not self.reader.empty:
            return None
        now = self.clock.to_device(time.monotonic_ns())
        if now < self._stamp + GRACE_NS:
            return None
        if now > self._t0 + LONG_GAP * self.packet_ns:
            self._stamp = self._boundary(now - GRACE_NS)
            self.counts["long_gaps"] += 1
        return self._finish()

    def _rest(self) -> Reading | None:
        """What is left at the end of the stream."""
        if self._chunk is None or self._t0 is None:
            return None
        self._keep(self.decoder.decode())
        self._chunk = None
        if not any(len(e) or len(e.triggers) or len(e.frames) or len(e.imu) for e in self._parts):
            return None
        return self._finish()


def _shift(events: Events, offset_ns: int) -> None:
    """Move everything of a decoded block in time."""
    events.t += offset_ns
    for part in (events.triggers, events.imu):
        if len(part):
            part.t += offset_ns
    for frame in events.frames:
        frame.t_ns += offset_ns
        frame.end_ns += offset_ns
        frame.exposure_start_ns += offset_ns
        frame.exposure_end_ns += offset_ns
