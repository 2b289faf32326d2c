"""Makes views that are numbers: labels, body states, actions, camera descriptions, inertial samples, triggers."""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np

from msgs.camera import CameraInfo, Imu, Labels, Trigger
from msgs.header import Message
from msgs.world import Action, WorldState
from nodes.visualizer.colour import id_colour
from nodes.visualizer.views.part import TopicView

MAX_ROWS = 200
MAX_SAMPLES = 300
MAX_LISTED = 32
MAX_BOXES = 5000
"""Boxes that are laid over a picture, of those the page leaves out what is small or static."""


def number(value: Any, digits: int = 5) -> float | str:
    """Returns a JSON number of `digits` significant digits; text for what JSON cannot hold (nan, inf)."""
    value = float(value)
    return float(f"{value:.{digits}g}") if math.isfinite(value) else str(value)


def row(values: Any) -> list[float | str]:
    """Returns `number` of each value."""
    return [number(v) for v in np.asarray(values).reshape(-1)]


def boxes(message: Labels, env: int) -> list[list[Any]]:
    """Returns [id, colour, x0, y0, x1, y1] of each bounding box of one environment."""
    if message.box is None or message.box_id is None:
        return []
    mine = np.ones(len(message.box), bool) if message.box_env is None else np.asarray(message.box_env) == env
    ids, corners = np.asarray(message.box_id)[mine], np.asarray(message.box)[mine]
    return [[int(i), id_colour(int(i)), *row(b)] for i, b in list(zip(ids, corners))[:MAX_BOXES]]


def _speeds(twist: np.ndarray) -> list[float | str]:
    """Returns linear and angular speed [m/s, rad/s] of a twist [6]; what only rounding makes is none."""
    speeds = [float(np.linalg.norm(part)) for part in (twist[:3], twist[3:])]
    return [number(0.0 if speed < 1e-9 else speed) for speed in speeds]


def _name(names: list[str], index: int) -> str:
    return names[index] if 0 <= index < len(names) else ("world" if index == -1 else f"#{index}")


class BoxView(TopicView):
    """Shows bounding boxes alone, to lay over an image or event panel."""

    def pick(self, message: Message) -> list[list[Any]]:
        assert isinstance(message, Labels)
        return boxes(message, self.env)

    def draw(self, picked: list[list[Any]]) -> tuple[dict[str, Any], bytes]:
        return {"boxes": picked}, b""


class MovingView(TopicView):
    """Names the bodies that have moved in this episode, so that a page can leave the others out."""

    def __init__(self, name: str, env: int) -> None:
        super().__init__(name, env)
        self._episode = -1
        self._moved: set[str] = set()

    def capture(self, message: Message) -> None:
        """Takes a message; only one with a body that is new here makes a part."""
        assert isinstance(message, WorldState)
        moved = {_name(message.names, int(n)) for n in np.asarray(message.moving)}
        if message.header.episode != self._episode:
            self._episode, self._moved = message.header.episode, set()
        elif moved <= self._moved:
            return
        self._moved |= moved
        super().capture(message)

    def pick(self, message: Message) -> list[str]:
        return sorted(self._moved)

    def draw(self, picked: list[str]) -> tuple[dict[str, Any], bytes]:
        return {"moving": picked}, b""


class TableView(TopicView):
    """Shows tables: [{"title", "columns", "rows"}]; made at once, being small. A camera's also tell its instances."""

    def pick(self, message: Message) -> dict[str, Any]:
        named = _instances(message) if isinstance(message, CameraInfo) else {}
        return {"tables": self._tables(message), **named}

    def draw(self, picked: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        return picked, b""

    def _tables(self, message: Message) -> list[dict[str, Any]]:
        match message:
            case Labels():
                return self._labels(message)
            case WorldState():
                return [self._bodies(message.names, message.end_pose, message.end_twist())]
            case Action():
                values = np.asarray(message.controls)
                chosen = values[min(self.env, len(values) - 1)] if len(values) else values
                return [_table("controls", ["actuator", "value"], [[i, number(v)] for i, v in enumerate(chosen)])]
            case CameraInfo():
                return [_camera(message)]
        raise TypeError(f"{type(message).__name__} is not a table")

    def _bodies(self, names: list[str], pose: np.ndarray, twist: np.ndarray | None) -> dict[str, Any]:
        """Makes the table of poses [E, N, 7] and twists [E, N, 6]."""
        columns = ["body", "x [m]", "y", "z", "qx", "qy", "qz", "qw", "speed [m/s]", "turn [rad/s]"]
        if len(pose) == 0:
            return _table("bodies", columns, [])
        env = min(self.env, len(pose) - 1)
        rows = [[_name(names, n), *row(p)] for n, p in enumerate(pose[env])]
        if twist is not None and len(twist):
            rows = [r + _speeds(twist[env][n]) for n, r in enumerate(rows)]
        return _table("bodies", columns if twist is not None else columns[:8], rows)

    def _labels(self, message: Labels) -> list[dict[str, Any]]:
        tables = []
        if message.box is not None:
            rows = [[b[0], *b[2:]] for b in boxes(message, self.env)]
            tables.append(_table("boxes [px]", ["id", "x0", "y0", "x1", "y1"], rows))
        if message.pose is not None:
            velocity = None if message.velocity is None else np.asarray(message.velocity)
            tables.append(self._bodies(message.names, np.asarray(message.pose), velocity))
        if message.contact_env is not None and message.contact_body is not None:
            mine = np.flatnonzero(np.asarray(message.contact_env) == self.env)[:MAX_ROWS]
            force = message.contact_force
            rows = [
                [*(_name(message.names, int(b)) for b in message.contact_body[i])]
                + ([] if force is None else [number(np.linalg.norm(force[i]))])
                for i in mine
            ]
            tables.append(_table("contacts", ["body", "body"] + ([] if force is None else ["force [N]"]), rows))
        return tables


def _table(title: str, columns: list[str], rows: list[list[Any]]) -> dict[str, Any]:
    return {"title": title, "columns": columns, "rows": rows[:MAX_ROWS], "more": max(0, len(rows) - MAX_ROWS)}


def _instances(info: CameraInfo) -> dict[str, Any]:
    """Lists by instance id name, body ("" of the static world) and class id; by class id name and colour."""
    return {
        "names": list(info.instances),
        "bodies": list(info.instance_bodies),
        "semantic": [] if info.semantic is None else np.asarray(info.semantic).tolist(),
        "classes": [[name, id_colour(number)] for number, name in enumerate(info.classes)],
    }


def _listed(names: list[str]) -> str:
    """Writes the first MAX_LISTED names, and how many more there are."""
    more = len(names) - MAX_LISTED
    return ", ".join(names[:MAX_LISTED]) + (f" ... and {more} more" if more > 0 else "")


def _camera(info: CameraInfo) -> dict[str, Any]:
    k = np.asarray(info.k)
    known, timed = bool(k[0, 0] or k[1, 1]), info.keyframe_rate > 0
    rows: list[list[Any]] = [
        ["size", f"{info.width} x {info.height} px, margin {info.margin}"],
        ["focal length", f"{k[0, 0]:.4g} {k[1, 1]:.4g} px" if known else "not known"],
        ["principal point", f"{k[0, 2]:.4g} {k[1, 2]:.4g} px" if known else "not known"],
        ["distortion", info.distortion_model],
        ["clock", info.clock],
        ["environments", str(info.envs)],
        ["keyframe rate", f"{info.keyframe_rate:g} Hz" if timed else "-"],
        ["instances", _listed(info.instances) or "-"],
    ]
    rows += [[str(key), str(value)[:120] or "-"] for key, value in info.sensor.items()]
    return _table(info.name, ["property", "value"], rows)


class SeriesView(TopicView):
    """Shows inertial samples over the last MAX_SAMPLES sample times, thinned evenly; the page plots them."""

    def __init__(self, name: str, env: int) -> None:
        super().__init__(name, env)
        self._samples: deque[list[float | str]] = deque(maxlen=MAX_SAMPLES)
        self._episode = -1

    def pick(self, message: Message) -> list[list[float | str]]:
        assert isinstance(message, Imu)
        if message.header.episode != self._episode:
            self._episode = message.header.episode
            self._samples.clear()
        t, a, w = (np.asarray(v) for v in (message.t, message.acceleration, message.angular_velocity))
        step = max(1, len(t) // 16)
        for i in range(0, len(t), step):
            self._samples.append([int(t[i]) / 1e9, *row(a[i]), *row(w[i])])
        return list(self._samples)

    def draw(self, picked: list[list[float | str]]) -> tuple[dict[str, Any], bytes]:
        groups = [["acceleration [m/s^2]", [1, 2, 3]], ["angular velocity [rad/s]", [4, 5, 6]]]
        return {"samples": picked, "groups": groups}, b""


class TriggerView(TopicView):
    """Shows the last 20 trigger edges of an episode, newest first."""

    def __init__(self, name: str, env: int) -> None:
        super().__init__(name, env)
        self._edges: deque[list[Any]] = deque(maxlen=20)
        self._episode = -1

    def pick(self, message: Message) -> list[list[Any]]:
        assert isinstance(message, Trigger)
        if message.header.episode != self._episode:
            self._episode = message.header.episode
            self._edges.clear()
        for t, channel, value in list(zip(message.t, message.id, message.value))[-20:]:
            self._edges.appendleft([int(t) / 1e9, int(channel), "rising" if value else "falling"])
        return list(self._edges)

    def draw(self, picked: list[list[Any]]) -> tuple[dict[str, Any], bytes]:
        return {"tables": [_table("edges", ["time [s]", "channel", "edge"], picked)]}, b""
