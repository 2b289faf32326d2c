"""Returns a fast ball with a paddle, from events alone: a tracker of the ball on its table, which knows the walls.

The paddle hides the ball when it is close, and events of the paddle itself are told from the ball's by where they are.

    evis launch examples/tasks/pong.yaml
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from changed_pixels import midway

from evis.config.params import Param
from evis.geometry import se3
from evis.runtime.node import Input, Node, Output
from msgs.camera import CameraInfo, EventPacket
from msgs.header import Header, Message
from msgs.world import Action

EYE = se3.look_at(np.array([-0.75, 0, 1.0]), np.array([0.8, 0, -0.05]), np.array([0, 0, 1.0]))
"""Pose of the camera."""
PADDLE_X, FAR_X, SIDE_Y = 0.07, 1.95, 0.7
"""Where the ball's centre turns round [m]."""
HIDDEN_X = 0.2
"""Events on this side of it may be the paddle's [m]."""
REACH = 0.62
LEAST = 2
ALPHA, BETA = 0.6, 0.25


class BallReturner:
    """Turns events into the paddle's place. The ball's place and speed [2]: along the table and across it."""

    def __init__(self, k: np.ndarray, size: tuple[int, int], dt: float) -> None:
        """k: intrinsics [3, 3] px. size: width and height [px]. dt: time from one action to the next [s]."""
        self.size, self.dt = size, dt
        rays = np.linalg.inv(k) @ np.stack(
            (*np.meshgrid(np.arange(size[0]), np.arange(size[1])), np.ones(size[::-1]))
        ).reshape(3, -1)
        self.k_inverse = np.linalg.inv(k)
        self.on_table = self._ground(rays.T)[:, 0] > HIDDEN_X
        self.restart()

    def restart(self) -> None:
        """Resets the estimate to a ball that comes from the middle of the table."""
        self.place, self.speed = np.array([1.3, 0.0]), np.array([-2.8, 0.0])
        self.seen = 0

    def act(self, x: np.ndarray, y: np.ndarray, p: np.ndarray) -> float:
        """Computes where the paddle should go [m]. x, y, p: the events since the last call."""
        behind = self.on_table[y.astype(np.int64) * self.size[0] + x]
        found = midway(x[behind], y[behind], p[behind], self.size, LEAST) if behind.any() else None
        if found is not None:
            place = self._ground(self.k_inverse @ np.array([*found, 1.0]))
            if not self.seen:
                self.place = place + self.speed * self.dt / 2
            error = place - (self.place - self.speed * self.dt / 2)
            self.seen += 1
            self.place = self.place + max(ALPHA, 1 / self.seen) * error
            self.speed = self.speed + max(BETA, 1 / self.seen if self.seen > 1 else 0) / self.dt * error
        else:
            self.seen += bool(self.seen)
        landing = self._landing()
        self._fly()
        return float(np.clip(landing, -REACH, REACH))

    def _ground(self, ray: np.ndarray) -> np.ndarray:
        """Where rays of the camera [..., 3] meet the plane of the ball's centre, (x, y) [..., 2]."""
        direction = se3.rotate(EYE[3:], ray)
        scale = -EYE[2] / np.minimum(direction[..., 2:], -1e-6)
        return EYE[:2] + scale * direction[..., :2]

    def _fly(self) -> None:
        """One interval on, reflected by walls and paddle."""
        self.place = self.place + self.speed * self.dt
        for axis, (low, high) in enumerate(((PADDLE_X, FAR_X), (-SIDE_Y, SIDE_Y))):
            if not low <= self.place[axis] <= high:
                wall = low if self.place[axis] < low else high
                self.place[axis] = 2 * wall - self.place[axis]
                self.speed[axis] = abs(self.speed[axis]) * (1 if wall == low else -1)

    def _landing(self) -> float:
        """Where across the table the ball reaches the paddle's line."""
        along, across = self.speed
        if abs(along) < 0.1:
            return float(self.place[1])
        way = self.place[0] - PADDLE_X if along < 0 else 2 * FAR_X - self.place[0] - PADDLE_X
        y = (self.place[1] + across * way / abs(along) + SIDE_Y) % (4 * SIDE_Y)
        return (y if y <= 2 * SIDE_Y else 4 * SIDE_Y - y) - SIDE_Y


class Returner(Node):
    """Publishes the paddle's place on /action for every packet of events."""

    PARAMS: ClassVar[Mapping[str, Param]] = {"camera": Param(str, "cam0", "camera that it watches")}
    INPUTS: ClassVar[Mapping[str, Input]] = {"events": Input("/{camera}/events"), "info": Input("/{camera}/info")}
    OUTPUTS: ClassVar[Mapping[str, Output]] = {"action": Output("/action")}

    def setup(self) -> None:
        """Starts without a controller, which needs the camera's intrinsics first."""
        self.returner: BallReturner | None = None
        self.episode = 0

    def receive(self, port: str, message: Message) -> None:
        """Makes the controller from the camera's description."""
        assert isinstance(message, CameraInfo)
        self.returner = BallReturner(np.array(message.k), (message.width, message.height), 1 / message.keyframe_rate)

    def update(self, inputs: Mapping[str, Message]) -> None:
        """Publishes the paddle's place for the next interval from the events of the last one."""
        events = inputs["events"]
        assert isinstance(events, EventPacket) and self.returner is not None
        if events.header.episode != self.episode:
            self.returner.restart()
            self.episode = events.header.episode
        place = self.returner.act(events.x, events.y, events.p)
        self.publish("action", Action(Header(events.header.stamp_ns, episode=self.episode), np.array([[place]])))
