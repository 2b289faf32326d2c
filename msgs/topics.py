"""Lists all topics in one table: name pattern -> type, delivery, queue length, recorded by default or not."""

from __future__ import annotations

import difflib
import re
from dataclasses import dataclass

from msgs.audit import Audit
from msgs.camera import (
    CameraInfo,
    CameraSettings,
    Depth,
    EventPacket,
    EventSignal,
    Frames,
    Ids,
    Image,
    Imu,
    Keyframe,
    Labels,
    Motion,
    Normal,
    Samples,
    Trigger,
)
from msgs.diagnostics import Diagnostics
from msgs.header import Message
from msgs.physics_error import PhysicsError
from msgs.world import Action, Clock, Reset, WorldState


@dataclass(frozen=True)
class Topic:
    """Describes one topic. `lockstep`: declared consumers get every message; otherwise the topic is only ever tapped.

    `latched`: late joiners get the last message. `queue`: messages that a tap may lag behind before it loses some.
    `recorded`: in a bag unless asked otherwise. `help`: one line for `evis topic info`.
    """

    pattern: str
    type: type[Message]
    lockstep: bool
    latched: bool
    queue: int
    recorded: bool
    help: str

    @property
    def regex(self) -> re.Pattern[str]:
        """Matches concrete names; `<cam>` stands for one path segment, a namespace may precede any name."""
        return re.compile(r"(?:/[\w.-]+)*" + re.escape(self.pattern).replace("<cam>", r"[\w.-]+") + r"\Z")


TOPICS: tuple[Topic, ...] = (
    #     pattern           type         lockstep latched queue recorded
    Topic("/clock", Clock, False, False, 2, False, "current time and real-time factor"),
    Topic("/action", Action, True, False, 2, True, "controls for the step at its stamp"),
    Topic("/reset", Reset, True, False, 2, True, "environments to begin anew, with which seeds"),
    Topic("/state", WorldState, True, False, 8, True, "poses and twists of all bodies at sub-step times"),
    Topic("/physics_error", PhysicsError, True, False, 2, True, "how far the run's bodies were off, at its end"),
    Topic("/diagnostics", Diagnostics, False, False, 64, True, "rates, lag, drops and warnings of every node"),
    Topic("/<cam>/info", CameraInfo, True, True, 1, True, "what the camera is"),
    Topic("/<cam>/settings", CameraSettings, True, False, 2, True, "settings that the camera is to have from now on"),
    Topic("/<cam>/keyframe", Keyframe, True, False, 2, False, "linear HDR radiance, or only luminance"),
    Topic("/<cam>/depth", Depth, True, False, 2, False, "z-depth of the keyframe"),
    Topic("/<cam>/motion", Motion, True, False, 2, False, "backward motion of the keyframe"),
    Topic("/<cam>/ids", Ids, True, False, 2, False, "instance ids of the keyframe"),
    Topic("/<cam>/normal", Normal, True, False, 2, False, "surface normals of the keyframe"),
    Topic("/<cam>/frames", Frames, True, False, 2, False, "luminance between keyframes"),
    Topic("/<cam>/samples", Samples, True, False, 2, False, "frames, and samples of single pixels between them"),
    Topic("/<cam>/events", EventPacket, True, False, 16, True, "events of one interval"),
    Topic("/<cam>/signal", EventSignal, True, False, 16, False, "which events light made, and which noise"),
    Topic("/<cam>/labels", Labels, True, False, 2, True, "ground truth at the event packet's stamp"),
    Topic("/<cam>/audit", Audit, True, False, 16, True, "error of the events so far, by an audit of some pixels"),
    Topic("/<cam>/imu", Imu, True, False, 16, True, "inertial samples"),
    Topic("/<cam>/trigger", Trigger, True, False, 16, True, "external trigger edges"),
    Topic("/<cam>/image", Image, True, False, 2, True, "frame of a real or simulated sensor, or a preview"),
)

SYSTEM_TOPICS = tuple(row.pattern for row in TOPICS if not row.lockstep)
"""Every process publishes its share of these, so their sequence numbers tell nothing; they are only ever tapped."""


class UnknownTopic(KeyError):
    """Reports a name that no row of the table matches; the text names the nearest pattern."""

    def __str__(self) -> str:
        return str(self.args[0])


def find_topic(name: str) -> Topic:
    """Returns the row for a concrete topic name such as `/cam0/events`. Raises UnknownTopic."""
    for topic in TOPICS:
        if topic.regex.match(name):
            return topic
    parts = name.rsplit("/", 1)
    known = [t.pattern for t in TOPICS]
    tails = {p.rsplit("/", 1)[1]: p for p in known}
    near = difflib.get_close_matches(parts[-1], list(tails), n=1, cutoff=0.5)
    hint = f"; the nearest is {tails[near[0]]}" if near else f"; topics are {', '.join(known)}"
    raise UnknownTopic(f"no topic '{name}'{hint}")
