"""Makes batches of the messages that a sensor is given: frames checked, seen through the optics, and joined with the
frame that look-ahead holds back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp

from evis.gpu.saved_arrays import joined, part_of, saved, write_back
from nodes.event_sensor.input.arrays import on_device, shape_of
from nodes.event_sensor.input.batch import Batch, SampleLists, Size
from nodes.event_sensor.input.further import LONGEST, Further
from nodes.event_sensor.input.limit import MOST_NUMBERED, check_background_rate
from nodes.event_sensor.input.look_ahead import LookAhead
from nodes.event_sensor.input.sample_lists import SampleInput
from nodes.event_sensor.input.timeline import Timeline
from nodes.event_sensor.model.features import background_rate
from nodes.event_sensor.model.keys import KeyLayout
from nodes.event_sensor.optics.optics import Optics
from nodes.event_sensor.parameters import LOOK_AHEAD, frames_only
from nodes.event_sensor.readout.device_events import CALLS


class BatchMaker:
    """Makes batches of messages, and keeps the time up to which a sensor has given events.

    looks_ahead: the last frame of a message is held back until the next one. hermite: the curve between frames needs
    their slopes. t_base, settled: the last batch's events lie in (t_base, settled] [ns].
    """

    def __init__(self, size: Size, parameters: Mapping[str, Any], layout: KeyLayout, device: Any) -> None:
        """Takes what is known of a sensor. parameters: all of SENSOR, resolved, and `marked`. layout: of its keys."""
        p = parameters
        self._size, self._layout, self._device = size, layout, device
        self.looks_ahead = p["model"] == "evis" and p["crossing"] in LOOK_AHEAD
        self.hermite = p["model"] == "evis" and p["crossing"] == "hermite"
        self._background_rate = background_rate(p) * size.envs * size.pixels
        """Of all pixels [Hz]."""
        self._optics = Optics(size.height, size.width, size.envs, size.channels, p, self.hermite, device)
        self._sample_input = SampleInput(size, device, frames_only(p), CALLS)
        self._timeline = Timeline(size)
        self._look_ahead = LookAhead(size.envs, size.pixels, device)
        self._no_slopes: wp.array = wp.zeros(0, dtype=wp.float32, device=device)
        self.t_base = self.settled = self._settled_before = 0

    def state(self) -> dict[str, Any]:
        """Gives what the next batches depend on, as plain arrays and numbers."""
        parts: dict[str, dict[str, Any]] = {
            "optics": saved(self._optics.present()),
            "time": self._timeline.state(),
            "held": self._look_ahead.state(),
        }
        stamps = {"settled": self.settled, "settled_before": self._settled_before, "t_base": self.t_base}
        return {**joined(parts), **stamps}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restores what `state` gave. Raises ValueError for a state whose arrays are others."""
        write_back(self._optics.present(), part_of(state, "optics"))
        self._timeline.restore(part_of(state, "time"))
        self._look_ahead.restore(part_of(state, "held"))
        self.settled, self._settled_before = int(state["settled"]), int(state["settled_before"])
        self.t_base = int(state["t_base"])

    @property
    def clear(self) -> bool:
        """Tells whether frames pass the optics unchanged."""
        return self._optics.clear

    def fits_one_call(self, t: np.ndarray, further: bool) -> bool:
        """Tells whether frames of several messages, at times int64 [K] ns, are few and close enough for one call.

        further: with samples between them.
        """
        if len(t) * self._size.pixels > MOST_NUMBERED or (further and t[-1] - self.settled > LONGEST):
            return False
        try:
            self._layout.check_span(self.settled, t)
            check_background_rate(self._background_rate, "", self.settled, t)
        except ValueError:
            return False
        return True

    def take(
        self,
        luminance: Any,
        t: np.ndarray,
        episodes: np.ndarray,
        dlog_dt: Any,
        further: Further | None,
        waits: bool = True,
    ) -> tuple[Batch, np.ndarray]:
        """Makes the batch of a message, with arguments as of EventSensor.advance; gives also bool [E], environments
        whose episode begins with it.

        waits: for what is found of further samples; else they are not read where they are wrong. Raises ValueError.
        """
        t = np.ascontiguousarray(t, dtype=np.int64)
        episodes = np.asarray(episodes, dtype=np.int32)
        timeline, optics = self._timeline, self._optics
        fresh = timeline.fresh(shape_of(luminance), t, episodes)
        again = fresh is not timeline.going_on and bool(fresh.all())
        if self.hermite and (dlog_dt is None or shape_of(dlog_dt) != shape_of(luminance)):
            raise ValueError("crossing=hermite needs dlog_dt of the luminance's shape; without it take crossing=cubic")
        if self._look_ahead.held is not None and again and t[0] <= timeline.last_stamp:
            raise ValueError(f"time goes back to {t[0]} ns; flush() first gives the events that are held back")
        begun = self._look_ahead.held is not None or not again
        t_base = self.settled if begun else int(t[0])
        self._layout.check_span(t_base, t)
        check_background_rate(self._background_rate, f"{self._size.envs} x {self._size.pixels}", t_base, t)
        lists = None if further is None else self._sample_input.take(further, t, t_base, fresh, waits)
        images, slopes = on_device(luminance, self._device), self._no_slopes
        since = int(t[0]) if again else timeline.last_stamp
        if further is not None and optics.traces:
            images, lists = optics.traced(images, lists, t, since, fresh)
        elif not optics.clear:
            sharp = images
            images = optics.seen(sharp, t, since, fresh)
        if self.hermite:
            slopes = on_device(dlog_dt, self._device)
            if not optics.clear:
                slopes = optics.slopes(slopes, sharp, images)
        if not begun:
            self._settled_before = t_base
        episodes = timeline.follow(fresh, t, episodes)
        if not self.looks_ahead:
            return self._batch(images, slopes, t, len(t), t_base, [fresh], [episodes], lists), fresh
        images, t, begins, of = self._look_ahead.join(images, t, fresh, episodes)
        return self._batch(images, slopes, t, len(t) - 1, t_base, begins, of), begins[0]

    def finish(self) -> tuple[Batch, np.ndarray] | None:
        """Makes the batch of the frame that is held back, as `take` does; None without one."""
        held = self._look_ahead.release()
        if held is None:
            self.t_base = self.settled
            return None
        stamp = np.array([held.stamp], np.int64)
        begins, of = [held.begins], [held.episodes]
        return self._batch(held.images, self._no_slopes, stamp, 1, self.settled, begins, of), held.begins

    def _batch(
        self,
        images: wp.array,
        slopes: wp.array,
        t: np.ndarray,
        count: int,
        t_base: int,
        begins: list[np.ndarray],
        episodes: list[np.ndarray],
        lists: SampleLists | None = None,
    ) -> Batch:
        """Makes a batch whose first `count` frames settle, and moves the sensor's time on; later ones give slopes."""
        self.t_base = t_base
        flags = begins[0]
        for k, more in enumerate(begins[1:], 1):
            flags = flags | (more.astype(np.int64) << k)
        of = (episodes[0], episodes[-1])
        batch = Batch(images, slopes, t, len(t), count, t_base, self._settled_before, flags, of, lists)
        if count:
            self._settled_before, self.settled = int(t[count - 2]) if count > 1 else t_base, int(t[count - 1])
        else:
            self.settled = t_base
        return batch
