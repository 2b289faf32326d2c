"""Turns a camera's byte stream into readings: decoded, cut at whole intervals of the device's clock, losses marked."""

from __future__ import annotations

import time
from collections import Counter

import numpy as np

from evis.events.arrays import Events
from evis.events.codecs.buffer import Allocate, EventBuffer, plain
from evis.events.codecs.decoder import Decoder
from nodes.camera.interface.driver import LONG_GAP, Reading
from nodes.camera.usb.access import StreamEnd
from nodes.camera.usb.clock import ClockMap
from nodes.camera.usb.reader import Chunk, Reader
from nodes.camera.usb.side import SideReader

FAR_NS = 2**63 - 1
US = 1000
GRACE_NS = 20_000_000
"""A quiet interval is closed when the host's clock says that it ended this long ago."""
LEAST_BEHIND_NS = 1_000_000
"""The host is behind when a buffer waited for half a packet's interval, and at least this long, and more wait."""
FALL_NS = 1_000_000
"""No sensor's times step back by so much: a word of the time's upper part was lost on the way."""
LEAST_EVENTS = 1024
"""Room of the first packet's arrays [events]."""
ROOMY_EVENTS = 1 << 17
"""In packets of so many events the work per packet no longer counts: a larger one would not be made sooner."""
SPARE = 1.25
"""Room of a packet's arrays against the largest packet so far."""


class ReadingStream:
    """Takes chunks from a reader and gives readings of packet_ns each.

    Cuts lie before the first event later than the boundary, as in a recording played back: events whose time steps
    back stay in their place. After a gap the decoder waits for the next time word, and its time is carried to the turn
    of the counter nearest to where the device's clock must be. live: the host's clock may close a quiet interval; not
    for a source that runs faster or slower than its own clock. origin_ns is added to all times.

    A live source is not made to wait. When its buffers wait for longer than half a packet, the packet at hand
    takes in the following intervals until the host has caught up, up to longest_ns and as far as its arrays (or
    ROOMY_EVENTS) have room: fewer, larger packets, whose ends still lie on whole intervals. What is too fast even then
    is lost in the reader, which counts it.

    allocate: gives the arrays of a packet, which is decoded in place. side: inertial samples beside the stream.
    """

    def __init__(
        self,
        reader: Reader,
        decoder: Decoder,
        packet_ns: int,
        raw: bool,
        live: bool,
        origin_ns: int = 0,
        longest_ns: int = 0,
        allocate: Allocate = plain,
        side: SideReader | None = None,
    ) -> None:
        self.reader, self.decoder, self.packet_ns, self._raw, self._live = reader, decoder, packet_ns, raw, live
        self.side = side
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
        self._longest_ns = longest_ns if live else 0
        self._behind_ns = max(packet_ns // 2, LEAST_BEHIND_NS)
        self._allocate = allocate
        self._buffer: EventBuffer | None = None
        self._most = 0
        self._earliest = FAR_NS
        self._others: list[Events] = []
        self._bytes: list[np.ndarray] = []

    def start(self) -> None:
        """Starts the threads."""
        self.reader.start()
        if self.side is not None:
            self.side.start()

    def close(self) -> None:
        """Ends the threads."""
        self.reader.close()
        if self.side is not None:
            self.side.close()

    def read(self, timeout_s: float) -> Reading | None:
        """Returns the next interval; None when it is not complete after timeout_s, and at the end. Raises OSError."""
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
        """Returns one reading (t0_ns, stamp_ns] from the next `count` bytes, whatever times are in them.

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
                self._decode(None)
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
            self._decode(-1)
            if self.decoder.next_t_ns is None:
                return None
            self._align(self.decoder.next_t_ns)
        self._decode(self._stamp - self._offset)
        while self.decoder.at_cut:
            if not self._widen():
                return self._finish()
            self._decode(self._stamp - self._offset)
        if self._fresh and self._newest is not None:  # this chunk had events
            self.clock.add(self._chunk.t_host_ns, self._newest)
            if self.side is not None:
                self.side.seen(self._chunk.t_host_ns, self._newest)
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

    def _widen(self) -> bool:
        """Let the packet take in the next interval too, because the host is behind."""
        assert self._chunk is not None and self._t0 is not None and self._buffer is not None
        wider = self._stamp + self.packet_ns
        filled, intervals = self._buffer.n, (self._stamp - self._t0) // self.packet_ns
        if filled + filled // intervals > max(self._buffer.capacity, ROOMY_EVENTS):
            return False
        waited_ns = time.monotonic_ns() - self._chunk.t_host_ns
        if wider - self._t0 > self._longest_ns or waited_ns < self._behind_ns or self.reader.empty:
            return False
        following = self.decoder.next_t_ns
        if following is None or following + self._offset > wider:  # a silence costs nothing to wait for
            return False
        self._stamp = wider
        self.counts["intervals_joined"] += 1
        return True

    def _decode(self, until_ns: int | None) -> None:
        """What was fed, up to a time of the decoder's clock (None: all), to the end of the packet at hand."""
        buffer = self._buffer
        if buffer is None:
            buffer = self._buffer = EventBuffer(max(int(SPARE * self._most), LEAST_EVENTS), self._allocate)
        before = buffer.n
        others = self.decoder.decode_into(buffer, until_ns)
        if self._raw:
            self._bytes.append(self.decoder.taken.copy())
        t = buffer.columns[0]
        if self._offset:
            t[before : buffer.n] += self._offset
            for part in others:
                _shift(part, self._offset)
        if buffer.n > before:
            # now, while the times are in the cache: a packet's whole is read from memory again
            earliest = int(t[before : buffer.n].min())
            if self._newest is not None and earliest < self._newest - FALL_NS:
                self.counts["time_fell"] += 1
            self._newest, self._fresh = int(t[buffer.n - 1]), True
            self._earliest = min(self._earliest, earliest)
        self._others += others

    def _finish(self, last: bool = False) -> Reading:
        """Close the interval and begin the next one. last: nothing will follow."""
        assert self._t0 is not None
        events = self._buffer.events() if self._buffer is not None else Events.empty()
        if self._others:
            others = Events.concatenate(self._others)
            events.triggers, events.imu, events.frames = others.triggers, others.imu, others.frames
        if self.side is not None:
            to_device = self.clock.to_device if self._live and self.clock.known else None
            events.imu = self.side.take(None if last else self._stamp, to_device)
        raw = None
        if self._raw:
            raw = np.concatenate(self._bytes) if self._bytes else np.empty(0, np.uint8)
        reading = Reading(events, self._t0, self._stamp, raw, self._lost)
        # devices count whole us: an event cut down to the us in which the interval begins did not step back
        begin = self._t0 - self._t0 % US
        if self._earliest < begin:
            self.counts["events_stepped_back"] += int(np.count_nonzero(events.t < begin))
        self._earliest = FAR_NS
        self._most = max(self._most, len(events))
        self._buffer, self._others, self._bytes, self._lost = None, [], [], 0
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
        self._decode(None)
        if self.side is not None:
            if self._newest is not None:
                self.side.seen(self._chunk.t_host_ns, self._newest)
            self.side.rest()
        self._chunk = None
        reading = self._finish(last=True)
        return reading if len(reading.events) or self._has_more(reading.events) else None

    @staticmethod
    def _has_more(events: Events) -> bool:
        return bool(len(events.triggers) or len(events.imu) or events.frames)


def _shift(events: Events, offset_ns: int) -> None:
    """Move in time what came besides events."""
    for part in (events.triggers, events.imu):
        if len(part):
            part.t += offset_ns
    for frame in events.frames:
        frame.t_ns += offset_ns
        frame.end_ns += offset_ns
        frame.exposure_start_ns += offset_ns
        frame.exposure_end_ns += offset_ns
