"""Senses environments whose sensors have different parameters: a sensor for each, their events in one packet."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from nodes.event_sensor.readout.packet import Events

if TYPE_CHECKING:
    from nodes.event_sensor.input.further import Further


class SeparateSensors:
    """Senses environment k by sensor k, a sensor of one environment, with the methods of EventSensor and of Model."""

    def __init__(self, sensors: Sequence[Any]) -> None:
        """Takes the sensors. sensors: of one environment each, all of one size and device."""
        self._sensors = list(sensors)
        self._counts = np.zeros(len(self._sensors), np.int64)
        self._episodes: np.ndarray | None = None
        self.t_base = 0

    def state(self) -> dict[str, Any]:
        """Gives the states of all sensors, as plain arrays and numbers."""
        episodes = None if self._episodes is None else self._episodes.copy()
        sensors = [sensor.state() for sensor in self._sensors]
        return {"sensors": sensors, "counts": self._counts.copy(), "episodes": episodes, "t_base": self.t_base}

    def restore(self, state: dict[str, Any]) -> None:
        """Restores what `state` gave for sensors of the same parameters."""
        for sensor, own in zip(self._sensors, state["sensors"], strict=True):
            sensor.restore(own)
        self._counts, self.t_base = state["counts"].copy(), state["t_base"]
        self._episodes = None if state["episodes"] is None else state["episodes"].copy()

    def kernels(self) -> list[Any]:
        """Gives the kernels that take long to compile, as EventSensor.kernels does."""
        return [kernel for sensor in self._sensors for kernel in sensor.kernels()]

    def process(self, luminance: Any, stamps: np.ndarray, episodes: np.ndarray) -> Events:
        """Takes frames and gives their events, as Model.process does."""
        last, parts = self._begun(episodes), []
        for k, sensor in enumerate(self._sensors):
            first = len(stamps) - 1 if last[k] else 0
            parts.append(sensor.process(luminance[k : k + 1, first:], stamps[first:], episodes[k : k + 1]))
        t, x, y, p = (np.concatenate([getattr(part, name) for part in parts]) for name in ("t", "x", "y", "p"))
        self._told([len(part.t) for part in parts])
        return Events(t, x, y, p, None, self.env_offsets())

    def advance(self, luminance: Any, t: np.ndarray, episodes: np.ndarray, *, further: Further | None = None) -> int:
        """Takes frames and returns how many events they make, as EventSensor.advance does.

        Of samples between the frames a sensor that takes frames alone gets none.
        """
        last, counts = self._begun(episodes), []
        for k, sensor in enumerate(self._sensors):
            one, first = slice(k, k + 1), len(t) - 1 if last[k] else 0
            between = None if further is None or not sensor.takes_further else further.of(one, len(self._sensors))
            between = between.none() if between is not None and last[k] else between
            counts.append(sensor.advance(luminance[one, first:], t[first:], episodes[one], further=between))
        return self._told(counts)

    def _begun(self, episodes: np.ndarray) -> np.ndarray:
        """Gives the environments that begin an episode while others go on, bool [E]: with the last of the frames."""
        before, self._episodes = self._episodes, np.array(episodes)
        begun = np.zeros(len(episodes), bool) if before is None else self._episodes != before
        return begun & (not begun.all())

    def finish(self) -> int:
        """Takes no more frames; returns how many events were held back."""
        return self._told([sensor.finish() for sensor in self._sensors])

    def _told(self, counts: list[int]) -> int:
        self._counts = np.array(counts, np.int64)
        self.t_base = min(getattr(sensor, "t_base", 0) for sensor in self._sensors)
        return int(self._counts.sum())

    @property
    def takes_further(self) -> bool:
        """Tells whether any of its sensors takes further samples between the frames."""
        return any(getattr(sensor, "takes_further", False) for sensor in self._sensors)

    def takes_at_once(self, _t: np.ndarray, further: bool = False) -> bool:
        """Tells that the frames of several messages never come in one call, as EventSensor.takes_at_once tells:
        messages of several environments are taken one by one."""
        return False

    @property
    def begins_again(self) -> bool:
        """Tells whether its environments may begin anew together, as EventSensor.begins_again tells."""
        return all(getattr(sensor, "begins_again", False) for sensor in self._sensors)

    def columns(self) -> dict[str, type]:
        """Gives the types of the columns, as EventSensor.columns does."""
        columns: dict[str, type] = self._sensors[0].columns()
        return columns

    def counts(self) -> dict[str, int]:
        """Counts the samples and events set aside so far, of all environments."""
        found: dict[str, int] = {}
        for sensor in self._sensors:
            for name, count in sensor.counts().items():
                found[name] = found.get(name, 0) + count
        return found

    @property
    def on_gpu(self) -> Any:
        """Returns the GPU that the events are on; None where those of an environment are on the host."""
        devices = [sensor.on_gpu for sensor in self._sensors]
        return devices[0] if all(devices) else None

    def read(self, out: Any) -> None:
        """Writes the events to arrays of `columns()`, name -> array, environment after environment."""
        offsets = self.env_offsets()
        for sensor, first, end in zip(self._sensors, offsets[:-1].tolist(), offsets[1:].tolist()):
            if end > first:
                sensor.read({name: column[first:end] for name, column in out.items()})

    def env_offsets(self) -> np.ndarray:
        """Gives int64 [E + 1], where the events of each environment begin and end."""
        return np.concatenate(([0], np.cumsum(self._counts)))
