"""Runs the interpolator as a node: keyframes with depth and motion in, frames at K times their rate out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from evis.runtime.node import Node
from evis.scene.digest import shown
from evis.scene.parameters import camera_of, seeds_of, worlds_of
from evis.scene.worlds import Worlds
from msgs.camera import Depth, Frames, Keyframe, Motion, Samples
from msgs.header import Message
from msgs.own_time import STAMP
from msgs.world import WorldState
from nodes.interpolator.declaration import InterpolatorDeclaration, usable
from nodes.interpolator.messages import frames_of, samples_of
from nodes.interpolator.methods import reads
from nodes.interpolator.samples import by_frames_alone

if TYPE_CHECKING:
    from nodes.interpolator.keyframe import Report, States
    from nodes.interpolator.making import Made
    from nodes.interpolator.many_gaps import MadeGaps

COUNTS = "reshaded"
"""What a message of frames counts, which is there last: of several gaps at once only their sum is known."""


class InterpolatorNode(InterpolatorDeclaration, Node):
    """Makes K frames of every gap between two keyframes, the last being the keyframe itself."""

    interpolator: Made

    def computes_on(self) -> str:
        """Names its device."""
        return str(self.params["device"])

    def setup(self) -> None:
        from evis.gpu.devices import device_named
        from nodes.interpolator.making import InterpolatorMaker, KeyframeSize, check_memory, gaps_at_once

        p = self.params
        self._method = method = usable(p)
        # Nobody would read what lies between the frames, which are the same bytes for whoever reads them.
        self._sampled = p["time_tolerance"] > 0 and self.wants("samples")
        if self.wants("samples") and not self._sampled:
            raise ValueError(
                f"{self.name}: /{p['camera']}/samples is read, and without a time_tolerance there are none: give "
                f"one, as time_tolerance:=0.0003, or read /{p['camera']}/frames"
            )
        if method != p["method"]:
            self.warn(f"method {p['method']} needs the scene that was rendered (scene:=NAME); {method} is used instead")
        worlds = self.worlds = worlds_of(self.name, p) if "state" in reads(method) else None
        scenes = worlds.scenes if worlds else []
        self._names = [body.name for body in scenes[0].bodies] if scenes else []
        camera = camera_of(scenes[0], p["camera"]) if scenes else None
        size = KeyframeSize.expected(p, camera)
        check_memory(self.name, p, method, size, self._sampled)
        told = by_frames_alone(camera, p) if self._sampled and camera else ""
        self._frames_alone = bool(told)
        self._device = device_named(p["device"])
        # Several are made for nobody who reads what single gaps count.
        several = method == "rigid" and p["upsampling"] > 1 and self.may_gather and not self._counts_are_read()
        gaps = 1
        if several:
            gaps = gaps_at_once(self.name, p, size.pixels, scenes, self._sampled, self.run_s, self.recorded)
        # Where nobody reads what a gap counts, nobody waits for it.
        late = self._device.is_cuda and self.may_lag and p["time_tolerance"] == 0 and not self._counts_are_read()
        self._maker = InterpolatorMaker(p, method, size, self._sampled, gaps, late)
        self.interpolator = self._maker.make(worlds)
        if told:
            self.warn(told)
        self._maker.begin(self.interpolator)
        self._field = "rgb" if p["colour"] else "luminance"
        self._kept: list[Message] = []
        self._singly = False
        """Whether every gap is made by itself from now on."""

    def warm_up(self) -> None:
        """Compiles what gaps need."""
        self._maker.warm_up(self.interpolator, self.params["envs"])

    def _counts_are_read(self) -> bool:
        """Tells whether somebody reads what the messages of single gaps count."""
        return any(self.wants(port, COUNTS) for port in ("frames", "samples"))

    def rewind(self, params: Mapping[str, Any]) -> bool:
        """Forgets the last keyframe; what another seed draws no differently is as it was."""
        if {**params, "seed": 0} != {**self.params, "seed": 0}:
            return False
        self.params = dict(params)
        self._release()
        self.interpolator.forget()
        if self.worlds is not None:
            self._follow(self.worlds.from_seeds(seeds_of(params)))
        return True

    def state(self) -> None:
        """Gives nothing: a gap is made of the keyframes at its ends, and of those that it `looks_back` to."""

    def _follow(self, worlds: Worlds) -> None:
        """Replaces the worlds; environments whose world looks otherwise then begin with the next keyframe."""
        assert self.worlds is not None
        changed, self.worlds = worlds.changed(self.worlds, shown), worlds
        if not len(changed):
            return
        self._count_report(self.interpolator.last_report())
        self.interpolator = self._maker.replace(self.interpolator, worlds, changed)

    def update(self, inputs: Mapping[str, Message]) -> None:
        key = inputs["keyframe"]
        assert isinstance(key, Keyframe)
        if self.worlds is not None and (worlds := self.worlds.follow(key.own)) is not self.worlds:
            self._follow(worlds)
        depth, motion = inputs.get("depth"), inputs.get("motion")
        t, frames = self.interpolator.push(
            key.header.stamp_ns,
            key.episodes,
            key.image,
            depth.depth if isinstance(depth, Depth) else None,
            motion.motion if isinstance(motion, Motion) else None,
            key.margin,
            self._allocate,
            self._states(inputs.get("state")),
            None if key.own is None else np.array(key.own[:, STAMP]),
        )
        self._hold(inputs)
        report = self.interpolator.report
        self._count_report(report)
        if self.interpolator.late and self._counts_are_read():
            # A viewer has come since: what this gap counts, and not the one before.
            self._count_report(report := self.interpolator.last_report())
        if self._frames_alone and len(t) > 1:
            self.count("pixels_by_frames_alone", len(frames) * frames.shape[2] * frames.shape[3])
        colour, own_t = self.params["colour"], self.interpolator.own_t
        made: dict[str, Frames | Samples] = {}
        if self._sampled:
            made["samples"] = samples_of(key, t, frames, self.interpolator.further, colour, own_t)
        if not self._sampled or self.wants("frames"):
            made["frames"] = frames_of(key, t, frames, colour, own_t)
        with self.lending(self._port):
            for port, message in made.items():
                message.filled, message.reshaded = report.filled, report.reshaded
                self.publish(port, message)

    def update_all(self, inputs: Sequence[Mapping[str, Message]]) -> None:
        """Makes the frames of several gaps at once, until an environment was reset by itself, and unless somebody reads
        the counts of each, as a viewer may that comes during the run."""
        from nodes.interpolator.many_gaps import Arrived, ManyGaps

        keys = [key for one in inputs if isinstance(key := one["keyframe"], Keyframe)]
        many, apart = self.interpolator, any(key.own is not None for key in keys)
        singly = self._singly or apart or self._counts_are_read()
        if not isinstance(many, ManyGaps) or singly:
            super().update_all(inputs)
            return
        arrived = [
            Arrived(key.header.stamp_ns, key.episodes, key.image, self._states(one["state"]))
            for key, one in zip(keys, inputs)
        ]
        begun, colour = iter(keys), self.params["colour"]

        def deliver(made: MadeGaps) -> None:
            self._count_report(made.report)
            of_these = list(islice(begun, len(made.frames)))
            if self._frames_alone:
                pixels = sum(frames.shape[2] * frames.shape[3] for t, frames in made.frames if len(t) > 1)
                self.count("pixels_by_frames_alone", pixels)
            with self.lending(self._port):
                if self._sampled:
                    each = zip(of_these, made.frames, made.further)
                    self.publish_all("samples", [samples_of(key, *one, found, colour) for key, one, found in each])
                if not self._sampled or self.wants("frames"):
                    pairs = zip(of_these, made.frames)
                    self.publish_all("frames", [frames_of(key, *one, colour) for key, one in pairs])

        many.push_all(arrived, deliver, keys[0].margin, self._allocate)
        self._hold(inputs[-1])

    def take_singly(self) -> None:
        """Makes one gap at a time from now on, without the room for several."""
        super().take_singly()
        self._singly = True

    def _hold(self, inputs: Mapping[str, Message]) -> None:
        """Keeps the arrays of a keyframe: they are those of A in the next gap."""
        for message in inputs.values():
            message.keep()
        self._release()
        self._kept = list(inputs.values())

    def _count_report(self, report: Report) -> None:
        counts = {"filled_pixels": report.filled, "reshaded_pixels": report.reshaded}
        counts |= {"further_samples": report.refined, "gaps_above_time_tolerance": report.unreached}
        counts["gaps_passed_unseen"] = report.unseen
        counts["nonfinite_pixels" if self._method == "rigid" else "nonfinite_motion"] = report.nonfinite
        for name, amount in counts.items():
            if amount:
                self.count(name, amount)

    def _states(self, state: Message | None) -> States | None:
        """Converts a /state message into what the method gets. Raises ValueError where that is of another scene."""
        if not isinstance(state, WorldState):
            return None
        from nodes.interpolator.keyframe import States

        if self._names and state.names != self._names:
            raise ValueError(
                f"{self.name}: /state has bodies {', '.join(state.names)}, the scene has {', '.join(self._names)}; "
                "give both nodes the same scene and scene_args"
            )
        return States(state.t, state.moving_pose, state.moving_twist, state.moving, state.end_pose, state.own_t)

    def _allocate(self, shape: tuple[int, ...]) -> Any:
        device, field = self._device, self._field
        if device.is_cuda:
            import warp as wp

            pixel = wp.vec3 if self.params["colour"] else wp.float32
            return self.loan_on(self._port, device, **{field: (shape[:4], pixel)})[field]
        return self.loan(self._port, **{field: (shape, np.float32)})[field]

    @property
    def _port(self) -> str:
        """Names the output whose memory frames are written into."""
        return "samples" if self._sampled else "frames"

    def _release(self) -> None:
        for message in self._kept:
            message.release()
        self._kept = []

    def finish(self) -> None:
        """Adds the counts of the last gap."""
        self._count_report(self.interpolator.last_report())

    def close(self) -> None:
        """Releases keyframes, also where another node's setup failed before its own."""
        if hasattr(self, "_kept"):
            self._release()
