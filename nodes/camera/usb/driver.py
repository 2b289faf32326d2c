"""Implements what all USB drivers share: open, stream, counters, unplugging and reconnecting."""

from __future__ import annotations

import abc
import contextlib
import dataclasses
import errno
import time
from collections import Counter
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import usb.core

from evis.events.codecs.buffer import Allocate, plain
from nodes.camera.interface.driver import DeviceInfo, Driver, Reading, packet_boundary
from nodes.camera.interface.settings import Configuration
from nodes.camera.usb.access import Bus, StreamEnd, Unplugged, label, readable_error, release
from nodes.camera.usb.models import Model
from nodes.camera.usb.reader import Reader
from nodes.camera.usb.settings import UNKNOWN, UsbSettings, differing
from nodes.camera.usb.stream import PacketRule, ReadingStream

if TYPE_CHECKING:
    from evis.events.codecs.decoder import Decoder
    from nodes.camera.usb.imu_endpoint import ImuEndpointReader

RETRY_S = 0.5
"""Interval of the search for a camera that was unplugged [s]."""


class UsbDriver(Driver):
    """Drives a camera on USB: reads, decodes, counts, and waits for an unplugged one. A subclass has the maker's
    protocol.

    It is called `Camera`, in the module that the model's row in `models.py` names, and says how the device is asked who
    it is, configured, started and stopped: ENDPOINT, `_connect`, `_apply`, `_begin` and `_end`; its own settings are a
    dataclass on UsbSettings. What it raises of USB is worded for users here.
    """

    SETTINGS: ClassVar[type[Configuration]] = UsbSettings
    ENDPOINT: ClassVar[int]
    """Address of the bulk endpoint on which the events come."""

    def __init__(self, bus: Bus, device: Any, model: Model, live: bool = True, wait_when_full: bool = False) -> None:
        """Makes a driver, not opened yet, of a device.

        device: pyusb's, found on the bus. live: the stream runs with the device's clock (real devices, emulated ones at
        real pace). wait_when_full: see Reader.
        """
        self.bus, self.device, self.model = bus, device, model
        self._live, self.wait_when_full = live, wait_when_full
        self._settings: Any = None
        self._applied: Any = None
        """Settings that the registers hold; None: those after it was opened."""
        self._info: DeviceInfo | None = None
        self._stream: ReadingStream | None = None
        self._counts_before: Counter[str] = Counter()
        self._unplugged_at = 0.0
        self._retry_at = 0.0
        self._bytes_before = 0
        self.allocate: Allocate = plain
        """Where the arrays of readings come from; to be set before start. By default they belong to the reading."""
        self.emulated: Any = None
        """The emulated device behind it, for whoever feeds or inspects it; None for a real one."""

    # -- the maker's protocol ------------------------------------------------------------------------------------------

    @abc.abstractmethod
    def _connect(self) -> DeviceInfo:
        """Claims the device, checks that it is of this family, and reads its identity; changes nothing."""

    def _initialise(self) -> None:
        """Brings the sensor into the state from which it can be configured and started."""

    @abc.abstractmethod
    def _apply(self, settings: Any) -> None:
        """Writes the settings to the device."""

    @abc.abstractmethod
    def _change(self, settings: Any, before: Any) -> None:
        """Writes the settings that differ from `before` to the device while it streams.

        What of `before` is not known, because writing it failed, is UNKNOWN, which differs from everything.
        """

    def _check(self, settings: Any) -> None:
        """Raises ValueError for settings that this very device cannot take; writes nothing."""

    @abc.abstractmethod
    def _begin(self) -> None:
        """Switches the sensor's output on."""

    @abc.abstractmethod
    def _end(self) -> None:
        """Switches the sensor's output off."""

    def _prepare_decoder(self, decoder: Decoder) -> None:
        """Sets what the decoder must know of this device, such as its orientation."""

    def _disconnect(self) -> None:
        """Brings the device into the state in which it is to be left."""

    def temperature_c(self) -> float | None:
        """Returns the temperature of the sensor or the board [deg C]; None where the camera does not measure it."""
        return None

    # -- Driver --------------------------------------------------------------------------------------------------------

    @property
    def name(self) -> str:
        """Returns the camera's name in messages: its model, and its serial number once that is known."""
        serial = self._info.serial if self._info else ""
        return f"{self.model.title} {serial}".strip() if serial else f"{self.model.title} ({label(self.device)})"

    def open(self) -> None:
        self._open(self._initialise)

    def identify(self) -> DeviceInfo:
        """Reads the camera's identity without a change to the sensor, and closes the device at once. Raises OSError."""
        self._open(lambda: None)
        assert self._info is not None
        info, self._info = self._info, None
        release(self.device)
        return info

    def _open(self, then: Callable[[], None]) -> None:
        """Connects to the device and calls `then`; releases it and raises a readable error where either fails."""
        try:
            info = self._connect()
            then()
            self._info = info
        except usb.core.USBError as e:
            release(self.device)
            raise readable_error(e, self.name) from None
        except BaseException:
            release(self.device)
            raise
        self._applied = None
        if self._settings is None:
            self._settings = self.settings_type()()

    def info(self) -> DeviceInfo:
        if self._info is None:
            raise ValueError(f"{self.model.title}: not open")
        with contextlib.suppress(OSError):  # a reading that fails leaves the last one
            temperature = self.temperature_c()
            if temperature is not None:
                self._info.details["temperature_c"] = round(temperature, 1)
        if self._stream is not None and self._live and self._stream.clock.known:
            clock = self._stream.clock
            self._info.details["clock_offset_ns"] = clock.offset_ns
            self._info.details["clock_drift_ppm"] = round(clock.drift_ppm, 3)
        if self._stream is not None and self._stream.imu_reader is not None and self._stream.imu_reader.message:
            self._info.details["device_message"] = self._stream.imu_reader.message
        return self._info

    def configure(self, configuration: Configuration) -> None:
        if self._stream is not None:
            raise ValueError(f"{self.name}: settings can be changed only before start")
        if type(configuration) is not self.settings_type():
            wanted, given = self.settings_type().__name__, type(configuration).__name__
            raise ValueError(f"{self.name} takes {wanted}, not {given}")
        configuration.check()
        self._settings = dataclasses.replace(configuration)  # type: ignore[type-var]
        for name, choices in (("decoder", ("warp", "numpy")), ("transfers", ("queued", "single"))):
            if getattr(self._settings, name) not in choices:
                raise ValueError(f"{name} is '{getattr(self._settings, name)}', must be {' or '.join(choices)}")
        try:
            self._check(self._settings)
            self._apply(self._settings)
        except usb.core.USBError as e:
            raise readable_error(e, self.name) from None
        self._applied = self._settings
        self._warn_of_ignored()

    def _warn_of_ignored(self) -> None:
        """Puts among the warnings of its description which settings an emulated device does not follow."""
        ignored = self.emulated.ignored(self._settings) if self.emulated is not None else []
        assert self._info is not None
        self._info.details.pop("warnings", None)
        if ignored:
            self._info.details["warnings"] = [
                f"{', '.join(ignored)} {'change' if len(ignored) > 1 else 'changes'} nothing: "
                f"an emulated {self.model.title} sends what was recorded, whatever its biases and filters are"
            ]

    def changed_settings(self, values: Mapping[str, Any]) -> Configuration:
        if self._stream is None:
            state = "is unplugged" if self._unplugged_at else "does not stream"
            raise ValueError(f"{self.name} {state}; set it again when it streams")
        wanted: Configuration = self._settings.changed_by(values)
        try:
            self._check(wanted)
        except OSError as error:
            raise ValueError(f"{readable_error(error, self.name)}; nothing was written") from None
        return wanted

    def change(self, configuration: Configuration) -> list[str]:
        new = differing(configuration, self._applied)
        try:
            if new:
                self._change(configuration, self._applied)
        except OSError as error:
            self._applied = dataclasses.replace(self._applied, **dict.fromkeys(new, UNKNOWN))
            cause, names = readable_error(error, self.name), ", ".join(new)
            raise ValueError(f"{cause}; what the camera has of {names} is not known now: set it again") from None
        self._settings = self._applied = dataclasses.replace(configuration)  # type: ignore[type-var]
        self._warn_of_ignored()
        return new

    def device_now_ns(self) -> int | None:
        stream = self._stream
        if stream is None or not self._live or not stream.clock.known:
            return None
        return stream.clock.to_device(time.monotonic_ns())

    def held_settings(self) -> dict[str, Any]:
        return self._applied.of_the_camera() if self._applied is not None else {}

    def start(self) -> None:
        from evis.events.codecs.decoder import decoder_for

        s, model = self._settings, self.model
        if self._info is None:
            raise ValueError(f"{self.model.title}: not open")
        decoder = decoder_for(model.encoding, self._info.width, self._info.height, s.decoder)
        self._prepare_decoder(decoder)
        decoder.prepare()
        try:
            self._begin()
        except usb.core.USBError as e:
            raise readable_error(e, self.name) from None
        reader = self._make_reader()
        packet_ns = round(s.packet_ms * 1e6)
        feed = self.emulated.feed if self.emulated is not None else None
        # a recording behind an emulated device may come late, its quiet intervals close when the next event is there
        live = self._live and not self.wait_when_full
        shift_ns = feed.shift_ns if feed else 0
        rule = PacketRule(packet_ns, round(s.longest_ms * 1e6), live, shift_ns, s.raw)
        self._stream = ReadingStream(reader, decoder, rule, self.allocate, self._make_imu_reader())
        first = feed.first_ns if feed else None
        self.t0_ns = 0 if first is None else packet_boundary(first, packet_ns)
        self._stream.start()

    def _make_imu_reader(self) -> ImuEndpointReader | None:
        """Makes the reader of inertial samples, of a camera that sends them on an endpoint of their own."""
        return None

    def _make_reader(self) -> Reader:
        """Makes the reader of the data endpoint: with a queue of reads, unless the device is emulated or the settings
        say so."""
        from nodes.camera.usb.queue import QueuedReader, available

        s = self._settings
        if s.transfers == "queued" and available(self.device):
            return QueuedReader(self.device, self.ENDPOINT, self._recover, s.buffers, s.buffer_kib << 10)
        return Reader(self._bulk, self._recover, s.buffers, s.buffer_kib << 10, self.wait_when_full)

    def _bulk(self, buffer: Any, timeout_ms: int) -> int:
        try:
            size: int = self.device.read(self.ENDPOINT, buffer, timeout_ms)
        except usb.core.USBError as e:
            if e.errno == errno.ENODATA:
                raise StreamEnd(f"{self.name}: end of the recording") from None
            raise
        return size

    def _recover(self) -> None:
        self.device.clear_halt(self.ENDPOINT)

    def read(self, timeout_s: float) -> Reading | None:
        if self._unplugged_at:
            self._reconnect(timeout_s)
            return None
        try:
            return self._running().read(timeout_s)
        except OSError as error:
            self._handle_stream_error(error)
            return None

    def read_bytes(self, count: int, t0_ns: int, stamp_ns: int, timeout_s: float) -> Reading:
        """Reads the bytes of an interval as ReadingStream.read_bytes does."""
        return self._running().read_bytes(count, t0_ns, stamp_ns, timeout_s)

    def _running(self) -> ReadingStream:
        if self._stream is None:
            raise ValueError(f"{self.name}: read before start")
        return self._stream

    def _handle_stream_error(self, error: OSError) -> None:
        """Raises the error of a broken stream in readable form, or begins to wait for an unplugged camera."""
        cause = readable_error(error, self.name)
        if not isinstance(cause, Unplugged):
            raise cause
        if not self._settings.reconnect:
            raise OSError(
                f"{self.name}: unplugged in mid-stream after {self._running().reader.bytes} bytes; "
                "with reconnect:=true or --reconnect it is waited for"
            ) from None
        self._counts_before["unplugged"] += 1
        self._release_device()
        self._unplugged_at = time.monotonic()

    def _release_device(self) -> None:
        """Closes the stream, if there is one, and releases the device; the counters stay."""
        self._close_stream()
        release(self.device)

    def _close_stream(self) -> None:
        """Closes the stream, if there is one, and keeps what it has counted."""
        if self._stream is not None:
            self._stream.close()
            self._counts_before += Counter(self._stream_counts())
            self._bytes_before += self._stream.reader.bytes
            self._stream = None

    def _reconnect(self, timeout_s: float) -> None:
        """Looks for the camera by its serial number and starts its stream again, as a new episode of device time."""
        if time.monotonic() < self._retry_at:
            self.bus.sleep(min(timeout_s, RETRY_S))
            return
        self._retry_at = time.monotonic() + (0.0 if self.bus.emulated else RETRY_S)
        before = self._info
        assert before is not None
        for device in self.bus.devices(self.model.ids):
            self.device = device
            try:
                if self.identify().serial != before.serial:
                    continue
                self.open()
                self.configure(self._settings)
                self.start()
            except OSError:  # not ready yet: the next look may find it so
                self._release_device()
                continue
            finally:
                self._info = self._info or before
            self.episode += 1
            # what is 0 on the wire of an emulated camera, whose recording may be of today
            self.t0_ns = self.emulated.feed.shift_ns if self.emulated is not None else 0
            self._counts_before["reconnected"] += 1
            self._unplugged_at = 0.0
            return

    @property
    def ended(self) -> bool:
        return self._stream is not None and self._stream.ended

    @property
    def read_at_ns(self) -> int:
        """Returns when the newest bulk read of the last reading returned [ns, monotonic clock]."""
        return self._stream.read_at_ns if self._stream else 0

    @property
    def longest_pause_ns(self) -> int:
        """Returns the longest time without a read at the endpoint of the running stream [ns]."""
        return self._stream.reader.longest_pause_ns if self._stream else 0

    @property
    def stream_bytes(self) -> int:
        """Returns the bytes taken from the endpoint and handed to the decoder since the driver was made."""
        return self._bytes_before + (self._stream.reader.bytes if self._stream else 0)

    def _stream_counts(self) -> dict[str, int]:
        """Returns the counts of the running stream: of its readers, its cuts and its decoder."""
        assert self._stream is not None
        named = {"outside": "events_outside", "untimed": "words_before_time", "unknown": "words_unknown"}
        decoded = {named.get(k, k): v for k, v in self._stream.decoder.counts.items()}
        side = self._stream.imu_reader.counts if self._stream.imu_reader else {}
        return {**self._stream.reader.counts, **self._stream.counts, **decoded, **side}

    def counters(self) -> dict[str, int]:
        total = Counter(self._counts_before)
        if self._stream is not None:
            total.update(self._stream_counts())
        if self.emulated is not None:
            total.update(self.emulated.feed.counters())
            total.update(self.emulated.counts)
        return {k: v for k, v in total.items() if v}

    def stop(self) -> None:
        if self._stream is None:
            return
        try:
            with contextlib.suppress(OSError):  # a camera that is gone is silent
                self._end()
        finally:
            self._close_stream()

    def close(self) -> None:
        if self._info is None:
            return
        with contextlib.suppress(OSError):  # a camera that is gone needs no leave
            self._disconnect()
        release(self.device)
        self._info = None
        if self.emulated is not None:
            self.emulated.feed.close()
