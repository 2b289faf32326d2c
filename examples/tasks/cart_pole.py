"""Keeps a pole upright that only an event camera sees: a Kalman filter on single events, and a linear regulator.

Every pixel that fired lies on an edge of the pole or the cart, so its column is a measurement of where these were at
the event's time. That is the idea of Conradt et al., "A pencil balancing robot using a pair of AER dynamic vision
sensors" (ISCAS 2009), whose line follows single events too; here the line is the state of the cart and pole itself.

    evis launch examples/tasks/cart_pole.yaml
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from evis.config.params import Param
from evis.runtime.node import Input, Node, Output
from msgs.camera import CameraInfo, EventPacket
from msgs.header import Header, Message
from msgs.world import Action

CART_KG, POLE_KG, HALF_M = 1.0, 0.1, 0.35
"""Masses, and from the hinge to the centre of the pole."""
DEPTH_M, HEIGHT_M = 2.52, 0.4
"""How far before the camera the pole swings, and how far below it the hinge is."""
CART_TOP_M = 0.07
FORCE_N = 10.0


class PoleBalancer:
    """Turns events into a force on the cart, by a Kalman filter and a linear regulator.

    State: cart's place [m] and speed, pole's angle [rad] and rate.
    """

    def __init__(self, k: np.ndarray, dt: float) -> None:
        """k: intrinsics [3, 3] px. dt: time from one action to the next [s]."""
        self.focal, self.column, self.row = k[0, 0], k[0, 2], k[1, 2] + k[1, 1] * HEIGHT_M / DEPTH_M
        self.step, self.push = cart_pole(dt)
        self.gain = regulator(self.step, self.push, np.diag([4.0, 1.0, 20.0, 1.0]), 0.02)
        self.restart()

    def restart(self) -> None:
        """Resets the estimate to a pole about upright and a cart about the middle."""
        self.mean = np.zeros(4)
        self.spread = np.diag([0.1, 0.05, 0.06, 0.1]) ** 2

    def act(self, stamp_ns: int, t: np.ndarray, x: np.ndarray, y: np.ndarray) -> float:
        """Computes the force [N] to hold from `stamp_ns` on. t [ns], x, y: the events since the last call."""
        if len(t):
            self._see(stamp_ns, t, x, y)
        force = float(np.clip(-self.gain @ self.mean, -FORCE_N, FORCE_N))
        self.mean = self.step @ self.mean + self.push * force
        self.spread = self.step @ self.spread @ self.step.T + np.diag([1e-4, 3e-3, 1e-4, 1e-2]) ** 2
        return force

    def _see(self, stamp_ns: int, t: np.ndarray, x: np.ndarray, y: np.ndarray) -> None:
        """One Kalman update with every pixel that fired: column = c (place + height angle), at the event's time."""
        _, last = np.unique(y[::-1].astype(np.int64) * 65536 + x[::-1], return_index=True)
        chosen = len(t) - 1 - last
        age = (stamp_ns - t[chosen]) * 1e-9
        scale = self.focal / DEPTH_M
        up = (self.row - y[chosen]) / scale
        on_pole = up > CART_TOP_M
        up = np.where(on_pole, up, 0.0)
        matrix = scale * np.stack((np.ones_like(up), -age, up, -up * age), axis=1)
        error = x[chosen] - self.column - matrix @ self.mean
        sigma = np.where(on_pole, 1.3, 3.5)
        near = np.abs(error) < 4 * sigma
        weighted = matrix[near] / sigma[near, None] ** 2
        self.spread = np.linalg.inv(np.linalg.inv(self.spread) + weighted.T @ matrix[near])
        self.mean = self.mean + self.spread @ (weighted.T @ error[near])


def cart_pole(dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Computes the linear motion near the upright state over dt [s]: next = A state + b force.

    Equations (1), (2) of Florian, "Correct equations for the dynamics of the cart-pole system" (2007), linearised.
    """
    whole = CART_KG + POLE_KG
    reach = HALF_M * (4 / 3 - POLE_KG / whole)
    rates = np.zeros((5, 5))
    rates[0, 1] = rates[2, 3] = 1.0
    rates[3, 2], rates[3, 4] = 9.81 / reach, -1 / (whole * reach)
    rates[1, 2] = -POLE_KG * HALF_M / whole * rates[3, 2]
    rates[1, 4] = 1 / whole - POLE_KG * HALF_M / whole * rates[3, 4]
    power, result = np.eye(5), np.eye(5)
    for n in range(1, 12):
        power = power @ rates * (dt / n)
        result += power
    return result[:4, :4], result[:4, 4]


def regulator(step: np.ndarray, push: np.ndarray, cost: np.ndarray, effort: float) -> np.ndarray:
    """Computes the gain of the linear-quadratic regulator by iterating the Riccati equation until it stands."""
    value = cost
    while True:
        gain = push @ value @ step / (effort + push @ value @ push)
        following = cost + step.T @ value @ (step - np.outer(push, gain))
        if np.allclose(following, value, rtol=1e-10):
            return gain
        value = following


class Balancer(Node):
    """Publishes the force on /action for every packet of events."""

    PARAMS: ClassVar[Mapping[str, Param]] = {"camera": Param(str, "cam0", "camera that it watches")}
    INPUTS: ClassVar[Mapping[str, Input]] = {"events": Input("/{camera}/events"), "info": Input("/{camera}/info")}
    OUTPUTS: ClassVar[Mapping[str, Output]] = {"action": Output("/action")}

    def setup(self) -> None:
        """Starts without a controller, which needs the camera's intrinsics first."""
        self.balancer: PoleBalancer | None = None
        self.episode = 0

    def receive(self, port: str, message: Message) -> None:
        """Makes the controller from the camera's description."""
        assert isinstance(message, CameraInfo)
        self.balancer = PoleBalancer(np.array(message.k), 1 / message.keyframe_rate)

    def update(self, inputs: Mapping[str, Message]) -> None:
        """Publishes the force for the next interval from the events of the last one."""
        events = inputs["events"]
        assert isinstance(events, EventPacket) and self.balancer is not None
        if events.header.episode != self.episode:
            self.balancer.restart()
            self.episode = events.header.episode
        force = self.balancer.act(events.header.stamp_ns, events.t, events.x, events.y)
        header = Header(events.header.stamp_ns, episode=self.episode)
        self.publish("action", Action(header, np.array([[force]])))
