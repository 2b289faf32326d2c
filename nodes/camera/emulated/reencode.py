"""Encodes events of any source as the wire words of a camera model."""

from __future__ import annotations

import contextlib
import dataclasses
from collections import Counter

import numpy as np

from evis.events.arrays import Events, Frame, Triggers
from evis.events.codecs.encoder import encoder_for
from evis.events.codecs.inivation.davis_frames import check_frame
from evis.events.codecs.inivation.dvxplorer_mini_imu import MiniImu
from nodes.camera.usb.models import Model

UNORDERED = ("evt2", "evt21", "evt3")
"""Encodings whose times may step back by a little; the others run forward only."""
ONE_READOUT = "dvxplorer_mini"
"""Two readouts of this wire cannot have the same time: a stretch that begins in the us of the last comes 1 us later."""
PULSE = 2
"""Trigger channel of iniVation cameras that has only the value 1."""
RISING_ONLY = "dvs128"
"""This wire has no falling edges at all."""
FRAME_MARKS = {"aedat4": (2, 3)}
"""Formats with triggers that are the readout and the exposure of frames, and their channels."""


class Reencoder:
    """Encodes what the model can send and counts what it cannot.

    Times become whole us, as sensors count. shift_ns is subtracted first. counts: triggers of channels that the model
    lacks, marks of a frame's readout and exposure (its own words say them), frames and inertial samples of models
    without them, frames in colour or during another, events and triggers put in order of time for wires that run
    forward. source: format of the recording.
    """

    def __init__(self, model: Model, shift_ns: int = 0, source: str = "") -> None:
        self.model, self._shift = model, shift_ns
        self._marks = FRAME_MARKS.get(source, ())
        self._encoder = encoder_for(model.encoding)
        self._last_us = self._readout_end = -1
        self._imu_packets: list[bytes] = []
        self._latest: dict[str, int] = {}
        self.counts: Counter[str] = Counter()

    def count_reordered(self, events: Events) -> None:
        """Counts events and triggers that come behind later ones of their kind, where the wire needs them in order of
        time.

        To be told of all that is to be encoded, in the order of its source: a stretch has lost it.
        """
        if self.model.encoding in UNORDERED:
            return
        for name, t in (("events_reordered", events.t), ("triggers_reordered", events.triggers.t)):
            latest = np.maximum(np.maximum.accumulate(t), self._latest.get(name, t[0])) if len(t) else t
            if (behind := int((latest > t).sum())) > 0:
                self.counts[name] += behind
            if len(t):
                self._latest[name] = int(latest[-1])

    def encode(self, events: Events) -> bytes:
        """Encodes a stretch of the stream as words. Raises ValueError for what the wire cannot hold at all."""
        return self._encoder.encode(self._sendable(events))

    def take_imu_packets(self) -> list[bytes]:
        """Returns, and removes, the packets of inertial samples that the last stretch sends beside its words."""
        packets, self._imu_packets = self._imu_packets, []
        return packets

    def advance(self, t_ns: int) -> bytes:
        """Encodes time words up to t_ns, as a sensor without events sends them."""
        return self._encoder.advance(t_ns - self._shift)

    def _sendable(self, events: Events) -> Events:
        """Selects what the model can send, in the order that its wire needs, and counts the rest."""
        events = events.shifted(-self._shift) if self._shift else events
        edges = events.triggers
        marks = np.isin(edges.id, self._marks)
        if marks.any():
            self.counts["frame_marks_left_out"] += int(marks.sum())
            edges = Triggers(edges.t[~marks], edges.id[~marks], edges.value[~marks])
        keep = edges.id < self._encoder.channels
        if self.model.encoding not in UNORDERED:
            rising_only = self.model.encoding == RISING_ONLY
            keep &= (edges.id != PULSE) & (not rising_only) | (edges.value == 1)
        frames, imu = events.frames, events.imu
        if not keep.all():
            self.counts["triggers_left_out"] += int((~keep).sum())
            edges = Triggers(edges.t[keep], edges.id[keep], edges.value[keep])
        if frames:
            kept = self._sendable_frames(frames) if self.model.encoding == "davis346" else []
            self.counts["frames_left_out"] += len(frames) - len(kept)
            frames = kept
        if len(imu) and self.model.encoding not in ("davis346", "dvxplorer"):
            if self.model.encoding == "dvxplorer_mini":
                columns = zip(imu.acceleration, imu.angular_velocity, imu.temperature.tolist())
                imu_of = MiniImu(straight=self.model.name == "dvxplorer_micro")
                self._imu_packets += [imu_of.packet(*sample) for sample in columns]
            else:
                self.counts["imu_left_out"] += len(imu)
            imu = type(imu)()
        events = dataclasses.replace(events, c=None, triggers=edges, frames=frames, imu=imu)
        return events if self.model.encoding in UNORDERED else self._in_time_order(events)

    def _sendable_frames(self, frames: list[Frame]) -> list[Frame]:
        """Selects the frames that the sensor could have read out one after the other: grey, inside of it, not during
        another."""
        kept = []
        for frame in frames:
            with contextlib.suppress(ValueError):
                check_frame(frame, self.model.width, self.model.height)
                if frame.t_ns > self._readout_end:
                    kept.append(frame)
                    self._readout_end = frame.end_ns or frame.exposure_end_ns
        return kept

    def _in_time_order(self, events: Events) -> Events:
        """Sorts events and triggers by time; those of equal times stay as they came."""
        if (np.diff(events.t) < 0).any():
            order = np.argsort(events.t, kind="stable")
            events = dataclasses.replace(
                events, t=events.t[order], x=events.x[order], y=events.y[order], p=events.p[order]
            )
        edges = events.triggers
        if (np.diff(edges.t) < 0).any():
            order = np.argsort(edges.t, kind="stable")
            events = dataclasses.replace(events, triggers=Triggers(edges.t[order], edges.id[order], edges.value[order]))
        if self.model.encoding == ONE_READOUT and len(events):
            # before the first readout nothing is shifted: a negative time is for the encoder to refuse
            late = self._last_us >= 0 and int(np.searchsorted(events.t, (self._last_us + 1) * 1000))
            if late:  # a readout has one time, and the next has another
                self.counts["events_delayed_us"] += late
                events = dataclasses.replace(events, t=np.maximum(events.t, (self._last_us + 1) * 1000))
            self._last_us = int(events.t[-1]) // 1000
        return events
