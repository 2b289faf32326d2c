"""Runs the event sensor as a node: frames in, events out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from evis.config.params import EACH
from evis.runtime.node import Node
from msgs.camera import Frames, Keyframe, Samples
from msgs.header import Header, Message
from msgs.own_time import STAMP
from nodes.event_sensor.declaration import EventSensorDeclaration
from nodes.event_sensor.messages.images import Images
from nodes.event_sensor.messages.in_a_row import runs, stamps
from nodes.event_sensor.messages.packets import PacketPublisher
from nodes.event_sensor.parameters import is_own_model, source_of, unused_samples
from nodes.event_sensor.scene_parameters import resolve_with_scene

if TYPE_CHECKING:
    from nodes.event_sensor.environments.reset_groups import ResetGroups
    from nodes.event_sensor.environments.sensor_maker import SensorMaker
    from nodes.event_sensor.input.further import Further
    from nodes.event_sensor.messages.calls_in_flight import CallsInFlight
    from nodes.event_sensor.sensor import EventSensor

COUNTER_NAMES = {"nonfinite": "nonfinite_samples", "clipped": "clipped_samples", "dropped": "dropped_events"}
"""Names on /diagnostics of the sensor's counts, where they differ."""


class EventSensorNode(EventSensorDeclaration, Node):
    """Turns the frames of a camera, or its keyframes where nothing comes between, into events.

    One packet per message, with the message's stamp B. Its events lie in (t0_ns, B]. With crossing monotone or cubic a
    step needs the frame after it, and its last step is held back: the packet at B covers (t0_ns, the stamp of the last
    frame but one], t0_ns being where the packet before ended, and when the input ends a further packet with the stamp
    of the last one brings the rest, as it does what the readout still holds, whose events are later. Packets in a row
    always make up the events of one call on the whole sequence.
    """

    def computes_on(self) -> str:
        """Names its device."""
        return str(self.params["device"])

    def setup(self) -> None:
        from evis.gpu.building import begin_building
        from evis.gpu.devices import device_named

        self._resolved = resolve_with_scene(self.name, self.params)
        self._marked = self.wants("signal")
        self._maker = self._sensor_maker()
        self._maker.check()
        self._source = source_of(self.params["source"], lambda: self._resolved)
        for text in unused_samples(self.params["source"], self._resolved):
            self.warn(text)
        self._own_model = is_own_model(self._resolved["model"])
        self._sensor: Any = None
        self._reset_groups: ResetGroups | None = None
        """The sensors, once an environment was reset by itself."""
        self._episodes = np.zeros(0, np.int32)
        self._header = Header(0)
        self._device = device_named(self.params["device"])
        self._images = Images(self.name, self.params["colour"], self._device)
        self._packets = PacketPublisher(self, self._device)
        self._calls_in_flight: CallsInFlight | None = None
        if self.may_lag and self._device.is_cuda and self._own_model:
            from nodes.event_sensor.messages.calls_in_flight import CallsInFlight

            self._calls_in_flight = CallsInFlight()
        # One environment has other kernels than several.
        self._warm_up_envs = min(self.params["envs"], 2)
        self._warm_up_sensor: Any = self._maker.make(2, 2, slice(0, self._warm_up_envs))
        """A sensor to compile what all need, rather than at the first frame."""
        if self._own_model and EACH not in self.params:
            begin_building(self._device, self._warm_up_sensor.kernels())

    def _sensor_maker(self) -> SensorMaker:
        """Gives what makes sensors of the present parameters."""
        # What it takes to make a sensor is imported in the process that has one, not in the planner's.
        from nodes.event_sensor.environments.sensor_maker import SensorMaker

        return SensorMaker(self.name, self.params, self._resolved, self.below(self.params["camera"]), self._marked)

    def warm_up(self) -> None:
        """Compiles what is launched for every frame."""
        from evis.gpu.building import build_together
        from nodes.event_sensor.input.further import LONGEST, Further

        sensor, self._warm_up_sensor = self._warm_up_sensor, None
        if self._own_model and EACH not in self.params:
            build_together(self._device, sensor.kernels())
        episodes = np.zeros(self._warm_up_envs, np.int32)
        ones = np.ones((self._warm_up_envs, 2, 2, 3), np.float32)
        warm = self._images.read([Keyframe(Header(0), episodes, radiance=ones)])
        instants = [0, 10]
        if self._own_model and self._resolved["photoreceptor_noise"] > 0:
            # A step in which the noise has samples of its own, unless these are further apart than frames may be.
            instants.append(10 + min(max(1, round(1e9 / self._resolved["bandwidth_hz"])), LONGEST))
        for stamp in instants:
            sensor.process(warm, np.array([stamp]), episodes)
        if self._source == "samples":
            values = np.ones((1, 3) if self.params["colour"] else 1, np.float32)
            first = np.minimum(np.arange(4 * self._warm_up_envs + 1), 1)
            sensor.advance(warm, np.array([instants[-1] + 10]), episodes, further=Further(first, np.array([5]), values))

    def rewind(self, params: Mapping[str, Any]) -> bool:
        """Puts away the sensor, of which another is made at the first frame: its seed may differ."""
        if {**params, "seed": 0} != {**self.params, "seed": 0}:
            return False
        self.params = dict(params)
        self._resolved = resolve_with_scene(self.name, self.params)
        self._maker = self._sensor_maker()
        self._sensor, self._reset_groups, self._header = None, None, Header(0)
        self._episodes = np.zeros(0, np.int32)
        return True

    def state(self) -> dict[str, Any]:
        """Gives what the sensors go on from, and which they are."""
        kept = {"header": self._header, "episodes": self._episodes.copy(), "size": self._packets.size}
        if self._reset_groups is not None:
            return {**kept, "groups": self._reset_groups.state()}
        return kept if self._sensor is None else {**kept, "sensor": self._sensor.state()}

    def restore(self, state: dict[str, Any]) -> None:
        """Restores what `state` gave, with sensors that are made anew of the same parameters."""
        self._header, self._episodes = state["header"], state["episodes"].copy()
        height, width = self._packets.size = state["size"]
        self._sensor, self._reset_groups = None, None
        if "groups" in state:
            self._reset_groups = self._groups(height, width)
            self._reset_groups.restore(state["groups"])
        elif "sensor" in state:
            self._sensor = self._maker.make(height, width, slice(0, len(self._episodes)))
            self._sensor.restore(state["sensor"])

    def update(self, inputs: Mapping[str, Message]) -> None:
        message, further = inputs[self._source], None
        assert isinstance(message, Keyframe | Frames | Samples)
        image, t = self._images.read([message]), stamps(message)
        if isinstance(message, Samples):
            further = self._images.further_samples(message)
        envs, frames, height, width = image.shape[:4]
        apart = frames > 1 and self._some_begin(message.episodes)
        if not apart and self._may_lag_behind(message):
            self._header, self._episodes = message.header, np.array(message.episodes)
            self._begin_call([message], image, t, further if self._sensor.takes_further else None)
            return
        self._finish_calls()
        self._packets.size = (height, width)
        if apart or message.own is not None or self._reset_groups is not None:
            self._update_groups(message, image, t, further)
            return
        if self._sensor is None:
            self._sensor = self._maker.make(height, width, slice(0, envs))
        if message.header.stamp_ns <= self._header.stamp_ns:
            self._publish_held()  # time has gone back to begin an episode
        self._header, self._episodes = message.header, np.array(message.episodes)
        if self._own_model:
            between = further if self._sensor.takes_further else None
            self._publish(self._sensor, self._sensor.advance(image, t, message.episodes, further=between))
        else:
            events = self._sensor.process(image, t, message.episodes)
            columns = {name: getattr(events, name) for name in ("t", "x", "y", "p")}
            self._publish_columns(self._sensor, columns, events.env_offsets)

    def update_all(self, inputs: Sequence[Mapping[str, Message]]) -> None:
        """Senses the frames of several messages at once where that changes no packet; see `messages.in_a_row`."""
        messages = [one[self._source] for one in inputs]
        todo = list(inputs)
        while todo and (self._sensor is None or self._reset_groups is not None or not self._own_model):
            self.update(todo.pop(0))
        if not todo:
            return
        fits = partial(self._sensor.takes_at_once, further=self._source == "samples")
        for run in runs(messages[-len(todo) :], self._episodes, fits):
            if len(run) == 1:
                self.update({self._source: run[0]})
                continue
            self._header = run[-1].header
            t, images = np.concatenate([stamps(message) for message in run]), self._images.read(run)
            further = self._further(run)
            if self._calls_in_flight is not None:
                self._begin_call(run, images, t, further)
                continue
            count = self._sensor.advance(images, t, run[-1].episodes, further=further)
            columns = self._packets.memory(self._sensor.columns(), count)
            self._sensor.read(columns)
            ends = np.searchsorted(columns["t"], [message.header.stamp_ns for message in run], side="right").tolist()
            self._count(self._sensor)
            self._packets.publish_run(run, columns, ends, self._sensor.t_base)

    def take_singly(self) -> None:
        """Publishes the events of a message before the next one comes, from now on."""
        super().take_singly()
        self._finish_calls()
        self._calls_in_flight = None

    def _further(self, run: Sequence[Any]) -> Further | None:
        """Joins the samples between the frames of messages that are sensed in one call; None where they have none."""
        from nodes.event_sensor.input.further import Further

        if not isinstance(run[0], Samples) or not self._sensor.takes_further:
            return None
        begun = [self._sensor.stamp, *(message.header.stamp_ns for message in run[:-1])]
        parts = [self._images.further_samples(message) for message in run]
        return Further.in_a_row(parts, [stamp - begun[0] for stamp in begun], self._device)

    def _some_begin(self, episodes: np.ndarray) -> bool:
        """Tells whether some environments begin an episode while others go on, of sensors that fire in constant
        light: their first frame is the last of the message, and those before it only repeat it.
        """
        if not self._maker.fire_in_constant_light or EACH in self.params or len(episodes) != len(self._episodes):
            return False
        begun = np.asarray(episodes) != self._episodes
        return bool(begun.any() and not begun.all())

    def _may_lag_behind(self, message: Keyframe | Frames | Samples) -> bool:
        """Tells whether the events of a message may be published after the next one: where time goes on, and a GPU need
        not be waited for."""
        if self._calls_in_flight is None or self._sensor is None or self._reset_groups is not None:
            return False
        return self._own_model and message.own is None and message.header.stamp_ns > self._header.stamp_ns

    def _begin_call(self, messages: Sequence[Any], images: Any, t: np.ndarray, further: Further | None) -> None:
        """Begins to sense the frames of messages on the GPU, and publishes the events of the calls before."""
        assert self._calls_in_flight is not None
        call = self._sensor.process_async(images, t, messages[-1].episodes, further=further, defer=False)
        self._calls_in_flight.add(call, messages)
        while self._calls_in_flight.due():
            self._finish_call()

    def _finish_calls(self) -> None:
        """Publishes the events of all calls in flight."""
        while self._finish_call():
            pass

    def _finish_call(self) -> bool:
        """Publishes the events of the first call in flight; False where there is none."""
        finished = self._calls_in_flight.finish_first() if self._calls_in_flight is not None else None
        if finished is None:
            return False
        events, types = finished.events, self._sensor.columns()
        out: dict[str, Any] = {name: np.zeros(0, dtype) for name, dtype in types.items()}
        if len(events):
            out = self._packets.memory(types, len(events), self._device)
            self._sensor.read_call(events, out)
        self._count(self._sensor)
        if len(finished.messages) == 1:
            self._packets.publish_loaned(finished.messages[0].header, out, events.env_offsets, events.t_base)
        else:
            self._packets.publish_run(finished.messages, out, finished.ends, events.t_base)
        return True

    def _update_groups(
        self, message: Keyframe | Frames | Samples, image: Any, t: np.ndarray, further: Further | None
    ) -> None:
        """Publishes the events of environments that were reset at different times."""
        if self._reset_groups is None:
            self._reset_groups = self._groups(*self._packets.size)
            if self._sensor is not None:
                self._reset_groups.adopt(self._sensor, self._episodes, self._header.stamp_ns)
        self._header = message.header
        own_t = None if isinstance(message, Keyframe) else message.own_t
        if message.own is not None and own_t is None:
            own_t = message.own[:, [STAMP]]
        found = self._reset_groups.process(image, t, own_t, message.own, message.episodes, further)
        self._publish_columns(self._reset_groups, *found)

    def _groups(self, height: int, width: int) -> ResetGroups:
        """Makes what senses environments that were reset at different times."""
        from nodes.event_sensor.environments.reset_groups import ResetGroups

        return ResetGroups(partial(self._maker.make, height, width), self.params["seed"], self._own_model)

    def finish(self) -> None:
        self._finish_calls()
        if self._reset_groups is None:
            self._publish_held()
        elif held := self._reset_groups.finish():
            self._publish_columns(self._reset_groups, *held)

    def _publish_held(self) -> None:
        """Publishes the events that look-ahead or the readout still holds back, if there are any."""
        if self._sensor is not None and self._own_model:
            if count := self._sensor.finish():
                self._publish(self._sensor, count)

    def _publish(self, sensor: EventSensor, count: int) -> None:
        """Publishes the events of the last step of a sensor."""
        self._count(sensor)
        self._packets.publish_step(self._header, sensor, count)

    def _publish_columns(self, sensor: Any, columns: Mapping[str, np.ndarray], offsets: np.ndarray) -> None:
        """Publishes events that are on the host, of a model or of groups of sensors."""
        self._count(sensor)
        self._packets.publish_columns(self._header, columns, offsets, sensor.t_base)

    def _count(self, sensor: Any) -> None:
        """Counts, and at the first time warns of, what the sensor has set aside."""
        counts = sensor.counts()
        first = {name for name, total in counts.items() if self.count_total(COUNTER_NAMES.get(name, name), total)}
        if "nonfinite" in first:
            dark = self._resolved["dark_level"] > 0
            kinds = "or negative" if dark else "negative or black (ln 0; a light or a dark_level helps against those)"
            when = self._header.stamp_ns
            self.warn(f"{counts['nonfinite']} samples at {when} ns are NaN, infinite, {kinds}; they are skipped")
