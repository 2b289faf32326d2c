"""Converts a camera's byte stream to readings: decoded, cut at whole intervals of the device's clock, losses marked."""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass

import numpy as np

from evis.events.arrays import Events
from evis.events.codecs.buffer import Allocate, EventBuffer, plain
from evis.events.codecs.decoder import Decoder
from nodes.camera.interface.driver import LONG_GAP, Reading, packet_boundary
from nodes.camera.usb.access import StreamEnd
from nodes.camera.usb.clock import ClockMap
from nodes.camera.usb.imu_endpoint import ImuEndpointReader
from nodes.camera.usb.reader import Chunk, Reader

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


@dataclass(frozen=True)
class PacketRule:
    """Describes how a stream is cut into packets.

    packet_ns: length of a packet's interval on the device's clock. longest_ns: of a packet while the host is behind a
    live source. live: the source runs with the host's clock, which may close a quiet interval. origin_ns: added to all
    times. raw: packets carry the wire bytes too.
    """

    packet_ns: int
    longest_ns: int = 0
    live: bool = False
    origin_ns: int = 0
    raw: bool = False


class ReadingStream:
    """Decodes the chunks of a reader and cuts the events into readings of packet_ns each.

    Cuts lie before the first event later than the boundary, as in a recording played back: events whose time steps
    back stay in their place. After a gap the decoder waits for the next time word, and its time is carried to the turn
    of the counter nearest to where the device's clock must be.

    A live source is not made to wait. When its buffers wait for longer than half a packet, the packet at hand
    takes in the following intervals until the host has caught up, up to longest_ns and as far as its arrays (or
    ROOMY_EVENTS) have room: fewer, larger packets, whose ends still lie on whole intervals. What is too fast even then
    is lost in the reader, which counts it.

    allocate: gives the arrays of a packet, which is decoded in place. imu_reader: inertial samples beside the stream.
    """

    def __init__(
        self,
        reader: Reader,
        decoder: Decoder,
        rule: PacketRule,
        allocate: Allocate = plain,
        imu_reader: ImuEndpointReader | None = None,
    ) -> None:
        self.reader, self.decoder = reader, decoder
        self.packet_ns, self._raw, self._live = rule.packet_ns, rule.raw, rule.live
        self.imu_reader = imu_reader
        self.clock = ClockMap()
        self.counts: Counter[str] = Counter()
        self.ended = False
        self.read_at_ns = 0
        """When the newest bulk read that is in the last reading returned [ns, monotonic clock]."""
        self._chunk: Chunk | None = None
        self._t0: int | None = None
        self._stamp = 0
        self._origin = self._offset = rule.origin_ns
        self._newest: int | None = None
        self._clock_due = False
        self._realign = False
        self._lost = 0
        self._longest_ns = rule.longest_ns if rule.live else 0
        self._behind_ns = max(rule.packet_ns // 2, LEAST_BEHIND_NS)
        self._allocate = allocate
        self._buffer: EventBuffer | None = None
        self._largest = 0
        self._earliest = FAR_NS
        self._aside: list[Events] = []
        self._bytes: list[np.ndarray] = []

    def start(self) -> None:
        """Starts the threads."""
        self.reader.start()
        if self.imu_reader is not None:
            self.imu_reader.start()

    def close(self) -> None:
        """Ends the threads."""
        self.reader.close()
        if self.imu_reader is not None:
            self.imu_reader.close()

    def read(self, timeout_s: float) -> Reading | None:
        """Returns the next interval; None when it is not complete after timeout_s, and at the end. Raises OSError."""
        deadline = time.monotonic() + timeout_s
        while not self.ended:
            reading = self._decode_interval()
            if reading is not None:
                return reading
            try:
                # samples beside the stream are placed by when each read came
                chunk = self.reader.get(max(deadline - time.monotonic(), 0), joined=self.imu_reader is None)
            except OSError as error:  # what had arrived before it comes first
                reading = self._read_remainder()
                if reading is not None:
                    return reading
                if not isinstance(error, StreamEnd):
                    raise
                self.ended = True
                return None
            if chunk is not None:
                self._feed(chunk)
            elif time.monotonic() >= deadline:
                return self._close_quiet_interval()
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
                self._feed(chunk)
                count -= len(chunk.data) + chunk.lost
                self._decode(None)
        return self._close_interval()

    def _feed(self, chunk: Chunk) -> None:
        """Feeds a chunk to the decoder, and returns the one before to the reader (the decoder has copied a word begun
        in it)."""
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

    def _decode_interval(self) -> Reading | None:
        """Decodes up to the end of the interval; returns its reading, or None where more bytes are needed."""
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
                return self._close_interval()
            self._decode(self._stamp - self._offset)
        if self._clock_due and self._newest is not None:  # this chunk had events
            self.clock.add(self._chunk.t_host_ns, self._newest)
            if self.imu_reader is not None:
                self.imu_reader.note_arrival(self._chunk.t_host_ns, self._newest)
            self._clock_due = False
        return None

    def _align(self, t_ns: int) -> None:
        """Sets the offset of the decoder's clock, and the first interval, by the first event of the stream or after a
        gap.

        t_ns: its time on the decoder's clock.
        """
        if self._realign and self._newest is not None:
            expected = self._newest
            if self._live and self._chunk is not None and self.clock.known:
                expected = self.clock.to_device(self._chunk.t_host_ns)
            turns = round((expected - t_ns - self._origin) / self.decoder.wrap_ns)
            self._offset = self._origin + turns * self.decoder.wrap_ns
            self._realign = False
        if self._t0 is None:
            self._t0 = packet_boundary(t_ns + self._offset, self.packet_ns)
            self._stamp = self._t0 + self.packet_ns

    def _widen(self) -> bool:
        """Extends the packet by the next interval where the host is behind; False where it is not, or the packet is
        full."""
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
        """Decodes what was fed, up to a time of the decoder's clock (None: all), into the packet at hand."""
        buffer = self._buffer
        if buffer is None:
            buffer = self._buffer = EventBuffer(max(int(SPARE * self._largest), LEAST_EVENTS), self._allocate)
        before = buffer.n
        aside = self.decoder.decode_into(buffer, until_ns)
        if self._raw:
            self._bytes.append(self.decoder.taken.copy())
        t = buffer.columns[0]
        if self._offset:
            t[before : buffer.n] += self._offset
            aside = [part.shifted(self._offset) for part in aside]
        if buffer.n > before:
            # now, while the times are in the cache: a packet's whole is read from memory again
            earliest = int(t[before : buffer.n].min())
            if self._newest is not None and earliest < self._newest - FALL_NS:
                self.counts["time_fell"] += 1
            elif self._chunk is not None and self._chunk.reads > 1:
                if (np.diff(t[before : buffer.n]) < -FALL_NS).any():
                    self.counts["time_fell"] += 1
            self._newest, self._clock_due = int(t[buffer.n - 1]), True
            self._earliest = min(self._earliest, earliest)
        self._aside += aside

    def _close_interval(self, last: bool = False) -> Reading:
        """Makes the reading of the interval, and begins the next one. last: nothing will follow."""
        assert self._t0 is not None
        events = self._buffer.events() if self._buffer is not None else Events.empty()
        if self._aside:
            events = events.beside(Events.concatenate(self._aside))
        if self.imu_reader is not None:
            to_device = self.clock.to_device if self._live and self.clock.known else None
            events.imu = self.imu_reader.take(None if last else self._stamp, to_device)
        raw = None
        if self._raw:
            raw = np.concatenate(self._bytes) if self._bytes else np.empty(0, np.uint8)
        reading = Reading(events, self._t0, self._stamp, raw, self._lost)
        # devices count whole us: an event cut down to the us in which the interval begins did not step back
        begin = self._t0 - self._t0 % US
        if self._earliest < begin:
            self.counts["events_stepped_back"] += int(np.count_nonzero(events.t < begin))
        self._earliest = FAR_NS
        self._largest = max(self._largest, len(events))
        self._buffer, self._aside, self._bytes, self._lost = None, [], [], 0
        if self._chunk is not None:
            self.read_at_ns = self._chunk.t_host_ns
        self._t0 = self._stamp
        self._stamp = self._t0 + self.packet_ns
        following = self.decoder.next_t_ns
        if following is not None and following + self._offset > self._t0 + LONG_GAP * self.packet_ns:
            self._stamp = packet_boundary(following + self._offset, self.packet_ns)
            self.counts["long_gaps"] += 1
        return reading

    def _close_quiet_interval(self) -> Reading | None:
        """Closes an interval without further events, once the device's clock must be past its end; None before that."""
        if not self._live or self._t0 is None or not self.clock.known or not self.reader.empty:
            return None
        now = self.clock.to_device(time.monotonic_ns())
        if now < self._stamp + GRACE_NS:
            return None
        if now > self._t0 + LONG_GAP * self.packet_ns:
            self._stamp = packet_boundary(now - GRACE_NS, self.packet_ns)
            self.counts["long_gaps"] += 1
        return self._close_interval()

    def _read_remainder(self) -> Reading | None:
        """Decodes what is left at the end of the stream; None where there is nothing."""
        if self._chunk is None or self._t0 is None:
            return None
        self._decode(None)
        if self.imu_reader is not None:
            if self._newest is not None:
                self.imu_reader.note_arrival(self._chunk.t_host_ns, self._newest)
            self.imu_reader.wait_until_quiet()
        self._chunk = None
        reading = self._close_interval(last=True)
        return reading if len(reading.events) or reading.events.has_aside else None
