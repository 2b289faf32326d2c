"""Publishes the events of a sensor as packets, in memory loaned from the node's ports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from evis.gpu.host_copies import host_array
from evis.gpu.in_a_row import parted
from msgs.camera import EventPacket, EventSignal
from msgs.header import Header, Message

if TYPE_CHECKING:
    from evis.runtime.node import Node


class PacketPublisher:
    """Publishes on the ports `events` and, of a sensor that marks its events, `signal` of a node.

    size: (height, width) [px] of the sensor, to be set before the first packet.
    """

    def __init__(self, node: Node, device: Any) -> None:
        """Takes the node that publishes. device: of the sensor, a Warp device."""
        self._node, self._device = node, device
        self.size = (0, 0)

    def memory(self, types: Mapping[str, Any], count: int, device: Any = None) -> dict[str, Any]:
        """Gives arrays [count] for the columns of the next packet.

        types: dtype of each column. device: GPU that they come from, on which they lie unless all who read the port
        read them on the host; None = the host. Marks (`signal`) travel on a topic of their own, and a loan is for one
        topic, so that they get memory of their own.
        """
        loaned = {name: dtype for name, dtype in types.items() if name != "signal"}
        out: dict[str, Any]
        if device is not None and count:
            import warp as wp

            on_gpu = {name: ((count,), wp.dtype_from_numpy(dtype)) for name, dtype in loaned.items()}
            out = {**self._node.loan_for_readers("events", device, **on_gpu)}
            if "signal" in types and not isinstance(out["t"], np.ndarray):
                out["signal"] = wp.empty(count, dtype=wp.uint8, device=device)
        else:
            out = {**self._node.loan("events", **{name: ((count,), dtype) for name, dtype in loaned.items()})}
        if "signal" in types and "signal" not in out:
            out["signal"] = np.empty(count, np.uint8)
        return out

    def publish_step(self, header: Header, sensor: Any, count: int) -> None:
        """Publishes the `count` events of the last step of an EventSensor."""
        out = self.memory(sensor.columns(), count, sensor.on_gpu)
        sensor.read(out)
        self.publish_loaned(header, out, sensor.env_offsets(), sensor.t_base)

    def publish_loaned(self, header: Header, columns: dict[str, Any], offsets: np.ndarray, t0_ns: int) -> None:
        """Publishes events that are in memory of the node's ports; arguments as of `publish_columns`."""
        signal = columns.pop("signal", None)
        self._node.publish("events", self._packet(header, offsets, columns, t0_ns))
        if signal is not None:
            self._node.publish("signal", EventSignal(copy_of(header), offsets, host_array(signal)))

    def publish_columns(
        self, header: Header, columns: Mapping[str, np.ndarray], offsets: np.ndarray, t0_ns: int
    ) -> None:
        """Publishes events that are on the host, copied to the sensor's device where that is a GPU.

        columns: t, x, y, p, [c], [signal], each [n]. offsets: int64 [E + 1]. t0_ns: stamp after which events lie.
        """
        types = {name: values.dtype for name, values in columns.items() if name != "signal"}
        out = self.memory(types, int(offsets[-1]), self._device if self._device.is_cuda else None)
        for name, to in out.items():
            if isinstance(to, np.ndarray):
                to[...] = columns[name]
            else:
                to.assign(columns[name])
        if "signal" in columns:
            out["signal"] = columns["signal"]
        self.publish_loaned(header, out, offsets, t0_ns)

    def publish_run(
        self, messages: Sequence[Message], columns: Mapping[str, Any], ends: Sequence[int], t0_ns: int
    ) -> None:
        """Publishes a packet for each of several messages of one environment that were sensed in one call.

        columns: of the events of all. ends: number of events up to the stamp of each message. t0_ns: stamp before the
        first one.
        """
        offsets = [np.array([0, end - start]) for start, end in pairwise([0, *ends])]
        parts = {name: parted(column, ends) for name, column in columns.items()}
        signals, packets = parts.pop("signal", None), []
        for message, each, *own in zip(messages, offsets, *parts.values()):
            packets.append(self._packet(message.header, each, dict(zip(parts, own)), t0_ns))
            t0_ns = message.header.stamp_ns
        self._node.publish_all("events", packets)
        if signals is not None:
            for message, each, signal in zip(messages, offsets, signals):
                self._node.publish("signal", EventSignal(copy_of(message.header), each, signal))

    def _packet(self, header: Header, offsets: np.ndarray, columns: Mapping[str, Any], t0_ns: int) -> EventPacket:
        height, width = self.size
        return EventPacket(copy_of(header), offsets, **columns, width=width, height=height, t0_ns=t0_ns)


def copy_of(header: Header) -> Header:
    """Gives a header of the same time and stream, to be numbered anew."""
    return Header(header.stamp_ns, clock=header.clock, episode=header.episode)
