"""Keeps a fast ball in view of a camera on a pan-tilt head, from events alone.

An alpha-beta tracker follows the ball, and the head aims at where it will be.

The head turns, so the room behind the ball makes events too; the ball's contrast is larger than any in the room, and it
alone changes a pixel by many thresholds at once. A ball that is followed perfectly makes no events at all: then the
tracker goes on as before.

    evis launch examples/tasks/pan_tilt.yaml
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from changed_pixels import midway

from evis.config.params import Param
from evis.runtime.node import Input, Node, Output
from msgs.camera import CameraInfo, EventPacket
from msgs.header import Header, Message
from msgs.world import Action

RATE = 8.0
"""Greatest rate of the head [rad/s]."""
LEAST = 5
"""Events of one sign that only the ball makes at a pixel."""
ALPHA, BETA = 0.85, 0.5


class BallFollower:
    """Turns events into rates of pan and tilt. Angles [2] are pan (to the left) and tilt (up) in rad."""

    def __init__(self, k: np.ndarray, size: tuple[int, int], dt: float) -> None:
        """k: intrinsics [3, 3] px. size: width and height [px]. dt: time from one action to the next [s]."""
        self.k, self.size, self.dt = k, size, dt
        self.restart()

    def restart(self) -> None:
        """Resets the estimate to a ball that hangs before the head."""
        self.ball, self.speed = np.zeros(2), np.zeros(2)
        self.head = np.zeros((2, 2))
        """The head's angles at the last stamp and at this one, as it was told to turn."""

    def act(self, x: np.ndarray, y: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Computes the rates of pan and tilt [rad/s] until the next call. x, y, p: the events since the last one."""
        found = midway(x, y, p, self.size, LEAST) if len(x) else None
        if found is not None:
            seen = -np.arctan((found - self.k[:2, 2]) / np.diag(self.k)[:2])
            error = seen - (self.ball - self.speed * self.dt / 2 - self.head.mean(axis=0))
            self.ball = self.ball + ALPHA * error
            self.speed = self.speed + BETA / self.dt * error
        self.ball = self.ball + self.speed * self.dt
        rates = np.clip((self.ball - self.head[1]) / self.dt, -RATE, RATE)
        self.head = np.stack((self.head[1], self.head[1] + rates * self.dt))
        return rates


class Follower(Node):
    """Publishes the rates on /action for every packet of events."""

    PARAMS: ClassVar[Mapping[str, Param]] = {"camera": Param(str, "cam0", "camera on the head")}
    INPUTS: ClassVar[Mapping[str, Input]] = {"events": Input("/{camera}/events"), "info": Input("/{camera}/info")}
    OUTPUTS: ClassVar[Mapping[str, Output]] = {"action": Output("/action")}

    def setup(self) -> None:
        """Starts without a controller, which needs the camera's intrinsics first."""
        self.follower: BallFollower | None = None
        self.episode = 0

    def receive(self, port: str, message: Message) -> None:
        """Makes the controller from the camera's description."""
        assert isinstance(message, CameraInfo)
        self.follower = BallFollower(np.array(message.k), (message.width, message.height), 1 / message.keyframe_rate)

    def update(self, inputs: Mapping[str, Message]) -> None:
        """Publishes the rates of pan and tilt for the next interval from the events of the last one."""
        events = inputs["events"]
        assert isinstance(events, EventPacket) and self.follower is not None
        if events.header.episode != self.episode:
            self.follower.restart()
            self.episode = events.header.episode
        rates = self.follower.act(events.x, events.y, events.p)
        self.publish("action", Action(Header(events.header.stamp_ns, episode=self.episode), rates[None]))
