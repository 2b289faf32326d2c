"""The event sensor node: frames in, events out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from evis.config.params import EACH, Param
from evis.runtime.node import Input, Node, Output
from evis.scene.parameters import SCENE, seeds_of
from msgs.camera import EventPacket, EventSignal, Frames, Keyframe, Samples
from msgs.header import Header, Message
from msgs.own_time import STAMP
from nodes.event_sensor.messages.images import Images
from nodes.event_sensor.messages.in_a_row import runs, stamps
from nodes.event_sensor.parameters import NODE, PRESET, preset_name, source_of
from nodes.event_sensor.presets import PRESETS
from nodes.event_sensor.scene_parameters import SHARED, resolve_each, resolve_with_scene

if TYPE_CHECKING:
    from nodes.event_sensor.apart import Apart
    from nodes.event_sensor.further import Further
    from nodes.event_sensor.messages.flights import Flights
    from nodes.event_sensor.sensor import Events, EventSensor

COUNTER_NAMES = {"nonfinite": "nonfinite_samples", "clipped": "clipped_samples", "dropped": "dropped_events"}
"""Names on /diagnostics of the sensor's counts, where they differ."""


class EventSensorNode(Node):
    """Turns the frames of a camera, or its keyframes where nothing comes between, into events.

    One packet per message, with the message's stamp B. Its events lie in (t0_ns, B]. With crossing monotone or cubic a
    step needs the frame after it, and its last step is held back: the packet at B covers (t0_ns, the stamp of the last
    frame but one], t0_ns being where the packet before ended, and when the input ends a further packet with the stamp
    of the last one brings the rest. Packets in a row always make up the events of one call on the whole sequence.
    """

    PARAMS = {
        "camera": Param(str, "cam0", "which camera of the scene"),
        "source": Param(
            str,
            "frames",
            "samples or frames (interpolator), or keyframe (renderer, K = 1); a sensor that cannot take "
            "further samples between the frames reads frames instead",
            choices=("frames", "samples", "keyframe"),
        ),
        "preset": PRESET,
        "seed": Param(int, 0, "seed of the sensor's random streams; environment k has seed + k", "", 0, 2**63 - 1),
        "device": Param(str, "cpu", "where kernels run: cpu, cuda, cuda:1"),
        "colour": Param(bool, False, "colour events: three sensors, for R, G and B, instead of one for luminance"),
        "scene": replace(SCENE["scene"], help="world that is seen, whose `sensor:` gives parameters"),
        "scene_args": SCENE["scene_args"],
        **NODE,
    }
    BRINGS = {"preset": {name: {"width": p.width, "height": p.height} for name, p in PRESETS.items() if p.width}}
    PER_ENVIRONMENT = True
    INPUTS = {
        "frames": Input("/{camera}/frames", on_device=True),
        "samples": Input("/{camera}/samples", on_device=True),
        "keyframe": Input("/{camera}/keyframe", on_device=True),
    }
    OUTPUTS = {"events": Output("/{camera}/events"), "signal": Output("/{camera}/signal")}

    @classmethod
    def without_effect(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """What the event model lacks, or another parameter turns off."""
        from nodes.event_sensor.effects import without_effect

        return without_effect(resolve_with_scene("event sensor", params))

    @classmethod
    def random(cls, params: Mapping[str, Any]) -> tuple[str, ...]:
        """The faults that are drawn."""
        from nodes.event_sensor import effects

        resolved = resolve_with_scene("event sensor", params)
        return effects.random(resolved)

    @classmethod
    def sensor(cls, params: Mapping[str, Any]) -> Mapping[str, Any]:
        """The sensor's name, the preset, the seed, and every parameter that has a value, those of the preset too."""
        preset = params["preset"]
        resolved = resolve_with_scene("event sensor", params)
        about = {"sensor": preset_name(preset), "preset": preset, "seed": params["seed"], "colour": params["colour"]}
        return {**about, **{name: value for name, value in resolved.items() if value is not None}}

    @classmethod
    def needs(cls, params: Mapping[str, Any], wanted: frozenset[str]) -> frozenset[str]:
        """One of the three: samples or frames where an interpolator runs, keyframes where it is left out."""
        return frozenset({source_of(params["source"], lambda: resolve_with_scene("event sensor", params))})

    @classmethod
    def reads(cls, params: Mapping[str, Any], port: str) -> frozenset[str] | None:
        """Of keyframes luminance will do, unless there are sensors for each colour; of frames nobody needs counts."""
        if port == "frames":
            return frozenset({"rgb" if params["colour"] else "luminance"})
        return frozenset({"radiance" if params["colour"] else "luminance"}) if port == "keyframe" else None

    def setup(self) -> None:
        from evis.gpu.devices import device_named

        self._resolved = resolve_with_scene(self.name, self.params)
        self._source = source_of(self.params["source"], lambda: self._resolved)
        self._marked = self.wants("signal")
        if self._marked and not self._resolved["model"].startswith("evis"):
            raise ValueError(
                f"{self.name}: event model {self._resolved['model']} does not say which events noise made; "
                "labels:=events takes evis or evis-paper"
            )
        self._sensor: Any = None
        self._apart: Apart | None = None
        """The sensors, once environments were reset by themselves."""
        self._episodes = np.zeros(0, np.int32)
        self._header = Header(0)
        self._size = (0, 0)
        self._device = device_named(self.params["device"])
        self._images = Images(self.name, self.params["colour"], self._device)
        self._own_model = self._resolved["model"].startswith("evis")
        self._flights: Flights | None = None
        if self.may_gather and self._device.is_cuda and self._own_model:
            from nodes.event_sensor.messages.flights import Flights

            self._flights = Flights(self._device)
        # Compile now rather than at the first frame.
        sensor = self._make(2, 2, 1)
        one = np.ones((1, 2, 2, 3), np.float32)
        warm = self._images.of([Keyframe(Header(0), np.zeros(1, np.int32), radiance=one)])
        for k in range(2):
            sensor.process(warm, np.array([10 * k]), np.zeros(1, np.int32))
        if self._source == "samples":
            from nodes.event_sensor.further import Further

            values = np.ones((1, 3) if self.params["colour"] else 1, np.float32)
            one_more = Further(np.array([0, 1, 1, 1, 1]), np.array([5]), values)
            sensor.process(warm, np.array([20]), np.zeros(1, np.int32), further=one_more)

    def _make(self, height: int, width: int, envs: int, seed: int | None = None, number: int = 0) -> Any:
        """The sensor, or one for each environment where the scene draws them different parameters.

        seed: of the first environment, None = the node's. number: of the reset at which its time begins.
        """
        if EACH in self.params and seed is not None:
            raise ValueError(f"{self.name}: environments with parameters of their own begin anew together only")
        params = self.params if seed is None else {**self.params, "seed": seed}
        seed, each = params["seed"], resolve_each(self.name, params, envs)
        for name in SHARED:
            if each[0][name] != self._resolved[name]:
                raise ValueError(
                    f"{self.name}: {name} is {each[0][name]} with seed {seed}, and was {self._resolved[name]}; "
                    "environments side by side need the same"
                )
        seeds = seeds_of({**params, "envs": envs})
        if len(each) == 1 and seeds == list(range(seeds[0], seeds[0] + envs)):
            return self._one(height, width, envs, each[0], seeds[0], number)
        from nodes.event_sensor.separate import SeparateSensors

        made = [self._one(height, width, 1, each[env % len(each)], own, number) for env, own in enumerate(seeds)]
        return SeparateSensors(made)

    def _one(self, height: int, width: int, envs: int, p: Mapping[str, Any], seed: int, number: int) -> Any:
        """A sensor, or another event model behind the same interface."""
        from nodes.event_sensor.apart import seed_of_time

        colour, time_seed = self.params["colour"], seed_of_time(seed, number)
        if p["model"].startswith("evis"):
            from nodes.event_sensor.sensor import EventSensor

            device, channels = self.params["device"], 3 if colour else 1
            return EventSensor(
                height,
                width,
                envs,
                channels=channels,
                device=device,
                seed=seed,
                time_seed=time_seed,
                marked=self._marked,
                **p,
            )
        if colour or self.params["device"] != "cpu":
            raise ValueError(
                f"{self.name}: event model {p['model']} takes luminance on the cpu; evis does colour and cuda"
            )
        from nodes.event_sensor.peers import make_model

        return make_model(p["model"], height, width, envs, seed=time_seed, **p)

    def rewind(self, params: Mapping[str, Any]) -> bool:
        """Puts away the sensor, of which another is made at the first frame: its seed may differ."""
        if {**params, "seed": 0} != {**self.params, "seed": 0}:
            return False
        self.params = dict(params)
        self._resolved = resolve_with_scene(self.name, self.params)
        self._sensor, self._apart, self._header, self._size = None, None, Header(0), (0, 0)
        self._episodes = np.zeros(0, np.int32)
        return True

    def update(self, inputs: Mapping[str, Message]) -> None:
        while self._land():
            pass
        message, further = inputs[self._source], None
        assert isinstance(message, Keyframe | Frames | Samples)
        image, t = self._images.of([message]), stamps(message)
        if isinstance(message, Samples):
            further = self._images.further(message)
        envs, _, height, width = image.shape[:4]
        self._size = (height, width)
        if message.own is not None or self._apart is not None:
            self._update_apart(message, image, t, further)
            return
        if self._sensor is None:
            self._sensor = self._make(height, width, envs)
        if message.header.stamp_ns <= self._header.stamp_ns:
            self._publish_held()  # time has gone back to begin an episode
        self._header, self._episodes = message.header, np.array(message.episodes)
        if self._own_model:
            between = further if self._sensor.takes_further else None
            self._publish(self._sensor, self._sensor.advance(image, t, message.episodes, further=between))
        else:
            self._publish_events(self._sensor.process(image, t, message.episodes))

    def update_all(self, inputs: Sequence[Mapping[str, Message]]) -> None:
        """Senses the frames of several messages at once where that changes no packet; see `messages.in_a_row`."""
        messages = [one[self._source] for one in inputs]
        todo = list(inputs)
        while todo and (self._sensor is None or self._apart is not None or not self._own_model):
            self.update(todo.pop(0))
        if not todo:
            return
        for run in runs(messages[-len(todo) :], self._episodes, self._sensor.takes_at_once):
            if len(run) == 1:
                self.update({self._source: run[0]})
                continue
            self._header = run[-1].header
            t, images = np.concatenate([stamps(message) for message in run]), self._images.of(run)
            if self._flights is not None:
                call = self._sensor.process_async(images, t, run[-1].episodes, defer=False)
                self._flights.begin(call, run)
                while self._flights.due():
                    self._land()
                continue
            count = self._sensor.advance(images, t, run[-1].episodes)
            out = self.loan("events", **{n: ((count,), d) for n, d in self._sensor.columns().items() if n != "signal"})
            read = {**out, "signal": np.empty(count, np.uint8)} if self._marked else {**out}
            self._sensor.read(read)
            ends = [int(n) for n in np.searchsorted(out["t"], [m.header.stamp_ns for m in run], side="right")]
            self._send_parts(read, run, ends, self._sensor.t_base)

    def _land(self) -> bool:
        """Publishes the events of the first call that is on its way; False where there is none."""
        landed = self._flights.land() if self._flights is not None else None
        if landed is None:
            return False
        import warp as wp

        out: dict[str, Any] = {}
        events, types = landed.events, self._sensor.columns()
        if count := len(events):
            on_gpu = {name: ((count,), wp.dtype_from_numpy(dtype)) for name, dtype in types.items()}
            out = self.loan_on("events", self._device, **on_gpu)
            events.read(out)
        else:
            out = {name: np.zeros(0, dtype) for name, dtype in types.items()}
        self._send_parts(out, landed.messages, landed.ends, events.t_base)
        return True

    def _send_parts(self, columns: Mapping[str, Any], run: Sequence[Message], ends: Sequence[int], t0_ns: int) -> None:
        """Publishes the events of several messages, up to these counts, a packet for each."""
        self._count(self._sensor)
        # Warp has no slice that begins at an array's end.
        parts = [slice(start, end) if end > start else slice(0) for start, end in pairwise([0, *ends])]
        offsets = [np.array([0, end - start]) for start, end in pairwise([0, *ends])]
        packets = []
        for message, each, part in zip(run, offsets, parts):
            own = {name: column[part] for name, column in columns.items() if name != "signal"}
            packets.append(self._packet(message.header, each, own, t0_ns))
            t0_ns = message.header.stamp_ns
        self.publish_all("events", packets)
        if "signal" in columns:
            for message, each, part in zip(run, offsets, parts):
                self.publish("signal", EventSignal(copy_of(message.header), each, columns["signal"][part]))

    def _update_apart(
        self, message: Keyframe | Frames | Samples, image: Any, t: np.ndarray, further: Further | None
    ) -> None:
        """Events of environments that do not share their time."""
        if self._apart is None:
            from nodes.event_sensor.apart import Apart

            height, width = self._size
            self._apart = Apart(partial(self._make, height, width), self.params["seed"])
            if self._sensor is not None:
                self._apart.adopt(self._sensor, self._episodes, self._header.stamp_ns)
        self._header = message.header
        own_t = None if isinstance(message, Keyframe) else message.own_t
        if message.own is not None and own_t is None:
            own_t = message.own[:, [STAMP]]
        found = self._apart.process(image, t, own_t, message.own, message.episodes, further)
        self._publish_columns(*found)

    def _publish_columns(self, columns: Mapping[str, np.ndarray], offsets: np.ndarray) -> None:
        """Publishes events that are on the host, on a GPU where the sensor's are on one."""
        signal = columns.get("signal")
        columns = {name: values for name, values in columns.items() if name != "signal"}
        shapes = {name: (values.shape, values.dtype) for name, values in columns.items()}
        if self._device.is_cuda and offsets[-1]:
            import warp as wp

            on_gpu = {name: (shape, wp.dtype_from_numpy(dtype)) for name, (shape, dtype) in shapes.items()}
            out: dict[str, Any] = self.loan_on("events", self._device, **on_gpu)
            for name, values in columns.items():
                out[name].assign(values)
        else:
            out = {**self.loan("events", **shapes)}
            for name, values in columns.items():
                out[name][...] = values
        self._send(out, offsets, self._apart or self._sensor)
        if signal is not None:
            self.publish("signal", EventSignal(self._stamped(), offsets, signal))

    def finish(self) -> None:
        while self._land():
            pass
        if self._apart is None:
            self._publish_held()
        elif held := self._apart.finish():
            self._publish_columns(*held)

    def _publish_held(self) -> None:
        """The events of what look-ahead or the readout still holds, if there are any."""
        if self._sensor is not None and self._resolved["model"].startswith("evis"):
            if count := self._sensor.finish():
                self._publish(self._sensor, count)

    def _publish(self, sensor: EventSensor, count: int) -> None:
        columns = sensor.columns()
        loaned = {name: dtype for name, dtype in columns.items() if name != "signal"}
        out: dict[str, Any]
        if sensor.on_gpu and count:
            import warp as wp

            types = {name: wp.dtype_from_numpy(dtype) for name, dtype in loaned.items()}
            out = {**self.loan_on("events", sensor.on_gpu, **{n: ((count,), d) for n, d in types.items()})}
        else:
            out = {**self.loan("events", **{n: ((count,), d) for n, d in loaned.items()})}
        if "signal" in columns:
            # These travel on another topic, and a loan is for one.
            out["signal"] = np.empty(count, np.uint8) if isinstance(out["t"], np.ndarray) else self._beside(count)
        sensor.read(out)
        signal = out.pop("signal", None)
        self._send(out, sensor.env_offsets(), sensor)
        if signal is not None:
            signal = signal if isinstance(signal, np.ndarray) else signal.numpy()
            self.publish("signal", EventSignal(self._stamped(), sensor.env_offsets(), signal))

    def _stamped(self) -> Header:
        """A header like that of the message taken last."""
        return copy_of(self._header)

    def _beside(self, count: int) -> Any:
        import warp as wp

        return wp.empty(count, dtype=wp.uint8, device=self._device)

    def _publish_events(self, events: Events) -> None:
        self._publish_columns({name: getattr(events, name) for name in ("t", "x", "y", "p")}, events.env_offsets)

    def _send(self, columns: Mapping[str, Any], offsets: np.ndarray, sensor: Any) -> None:
        self._count(sensor)
        self.publish("events", self._packet(self._header, offsets, columns, sensor.t_base))

    def _packet(self, header: Header, offsets: np.ndarray, columns: Mapping[str, Any], t0_ns: int) -> EventPacket:
        height, width = self._size
        return EventPacket(copy_of(header), offsets, **columns, width=width, height=height, t0_ns=t0_ns)

    def _count(self, sensor: Any) -> None:
        """Counts, and at the first time warns of, what the sensor has set aside."""
        counts = sensor.counts()
        first = {name for name, total in counts.items() if self.count_total(COUNTER_NAMES.get(name, name), total)}
        if "nonfinite" in first:
            dark = self._resolved["dark_level"] > 0
            kinds = "or negative" if dark else "negative or black (ln 0; a light or a dark_level helps against those)"
            when = self._header.stamp_ns
            self.warn(f"{counts['nonfinite']} samples at {when} ns are NaN, infinite, {kinds}; they are skipped")


def copy_of(header: Header) -> Header:
    """Gives a header of the same time and stream, to be numbered anew."""
    return Header(header.stamp_ns, clock=header.clock, episode=header.episode)
