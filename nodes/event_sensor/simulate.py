"""Runs the event sensor on frames from anywhere: a video, another simulator, a test signal.

`for events in simulate(frames, threshold=0.2, crossing="cubic"): ...` takes any iterable of (t, image).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from evis.media.frames.source import OF_SECONDS, FrameBlock
from nodes.event_sensor.effects import check_given
from nodes.event_sensor.make import make_sensor
from nodes.event_sensor.parameters import resolve_sensor
from nodes.event_sensor.sensor import Events

CHUNK_BYTES = 8_000_000
"""Frames per call are chosen to stay below this, so that a long video needs little memory."""
CHUNK_FRAMES = 32

Frames = Iterable[tuple[Any, ...]]
"""Items (t, image) or (t, image, dlog_dt): t int64 ns, image float, linear luminance [H, W] or RGB [H, W, 3], dlog_dt
of the same shape, d ln(image)/dt [1/s] or None. Or K frames at once: t [K], image [K, H, W] or [K, H, W, 3]; so are the
blocks of `evis.media.frames`."""


class Simulation:
    """Runs one sensor over a stream of frames.

    preset: sensor whose faults to have. seed: of all random numbers. device: `cpu`, `cuda`, `cuda:N`. parameters: those
    of nodes.event_sensor.parameters.SENSOR; what is not given (or None) is the preset's. Raises ValueError naming the
    parameter and the nearest valid one, or why it would change nothing.
    """

    def __init__(self, *, preset: str = "ideal", seed: int = 0, device: str = "cpu", **parameters: Any) -> None:
        self.parameters = resolve_sensor("event sensor", preset, parameters)
        check_given(parameters, self.parameters)
        self.frames = 0
        """Frames taken so far."""
        self.until_ns: int | None = None
        """Stamp of the last frame taken."""
        self._seed, self._device = seed, device
        self._sensor: Any = None
        self._shape: tuple[int, ...] = ()

    def events(self, frames: Frames) -> Iterator[Events]:
        """Returns the events of each item, sorted by t, y, x, and at the end those that look-ahead held back.

        The first frame is the reference and fires nothing. What `frames` raises is raised after the events of the
        frames before; ValueError for a frame that does not fit.
        """
        source = iter(frames)
        failure: Exception | None = None
        while failure is None:
            try:
                item = next(source, None)
                if item is None:
                    break
                made = self._take(*_item(item))
            except Exception as error:
                failure = error
            else:
                yield made
        if self._sensor is not None:
            yield self._sensor.flush()
        if failure is not None:
            raise failure

    def _take(self, t: np.ndarray, image: np.ndarray, dlog_dt: np.ndarray | None) -> Events:
        if self._sensor is None:
            self._start(image.shape[1:])
        if image.shape[1:] != self._shape:
            was, now = (" x ".join(map(str, s)) for s in (self._shape, image.shape[1:]))
            raise ValueError(f"a frame of {now} at {t[0]} ns, the frames before are {was}")
        slopes = None if dlog_dt is None or self.parameters["crossing"] != "hermite" else dlog_dt[None]
        more = {} if slopes is None else {"dlog_dt": slopes}
        made = self._sensor.process(image[None], t, np.zeros(1, np.int32), **more)
        self.frames, self.until_ns = self.frames + len(t), int(t[-1])
        return made

    def check(self, colour: bool = False) -> None:
        """Raises ValueError for parameters that do not go together, which the first frame would raise otherwise."""
        before = self._shape, self._sensor
        try:
            self._start((1, 1, 3) if colour else (1, 1))
        finally:
            self._shape, self._sensor = before

    def counts(self) -> dict[str, int]:
        """Counts the samples and events set aside so far, by reason: nonfinite, clipped, dropped, ..."""
        return dict(self._sensor.counts()) if self._sensor is not None else {}

    @property
    def longest_delay_ns(self) -> int:
        """Returns the longest time that an event has waited for the readout so far [ns]; 0 without one."""
        return int(getattr(self._sensor, "longest_delay_ns", 0))

    def _start(self, shape: tuple[int, ...]) -> None:
        self._shape = shape
        self._sensor = make_sensor(
            self.parameters, (shape[0], shape[1]), colour=len(shape) == 3, device=self._device, seed=self._seed
        )


def simulate(frames: Frames, **options: Any) -> Iterator[Events]:
    """Simulates events of a stream of frames, item by item. options: those of Simulation, which also has the counts."""
    return Simulation(**options).events(frames)


def simulate_frames(
    luminance: np.ndarray, t: np.ndarray, dlog_dt: np.ndarray | None = None, **options: Any
) -> dict[str, np.ndarray]:
    """Simulates events of a sequence of frames of one camera that is in memory as a whole.

    luminance: float [T, H, W] or, in colour, [T, H, W, 3], linear. t: int64 [T] ns, strictly ascending. dlog_dt: as
    luminance, d ln I / dt [1/s], for crossing=hermite. options: those of Simulation. Returns t (int64 ns), x, y
    (uint16), p (uint8, 1 = ON), in colour c (uint8), sorted by t, y, x, and the counts `nonfinite`, `clipped`, ... (0-d
    int64).
    The first frame is the reference and fires nothing. Raises ValueError.
    """
    luminance, t = np.asarray(luminance), np.asarray(t)
    if luminance.ndim not in (3, 4) or t.shape != luminance.shape[:1] or luminance.size == 0:
        raise ValueError(f"frames must be luminance [T, H, W] and t [T], got {luminance.shape} and {t.shape}")
    if dlog_dt is not None and np.shape(dlog_dt) != luminance.shape:
        raise ValueError(f"dlog_dt is {np.shape(dlog_dt)}, must be as luminance {luminance.shape}")
    step = max(1, min(CHUNK_FRAMES, CHUNK_BYTES // (4 * luminance[0].size)))
    parts = [slice(first, first + step) for first in range(0, len(t), step)]
    simulation = Simulation(**options)
    packets = list(
        simulation.events((t[p], luminance[p], None if dlog_dt is None else np.asarray(dlog_dt)[p]) for p in parts)
    )
    names = ("t", "x", "y", "p") + (("c",) if luminance.ndim == 4 else ())
    events = {name: np.concatenate([getattr(packet, name) for packet in packets]) for name in names}
    return {**events, **{name: np.array(value) for name, value in simulation.counts().items()}}


def _item(item: tuple[Any, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Unpacks one item: t [K], image [K, H, W(, 3)] float32, dlog_dt of that shape or None. Raises ValueError."""
    if isinstance(item, FrameBlock):
        item = item[:3]
    if not (isinstance(item, tuple) and len(item) in (2, 3)):
        raise ValueError("frames must be tuples (t, image) or (t, image, dlog_dt)")
    t, image, dlog_dt = np.asarray(item[0]), np.asarray(item[1]), item[2] if len(item) == 3 else None
    if t.dtype.kind not in "iu":
        raise ValueError(f"t is {t.dtype}, must be whole nanoseconds (int64); {OF_SECONDS}")
    if image.dtype.kind != "f":
        raise ValueError(f"a frame of {image.dtype}, must be float32 and linear")
    if t.ndim == 0:
        t, image = t[None], image[None]
        dlog_dt = None if dlog_dt is None else np.asarray(dlog_dt)[None]
    if image.ndim not in (3, 4) or t.shape != image.shape[:1] or image.size == 0 or image.shape[3:] not in ((), (3,)):
        raise ValueError(f"a frame must be [H, W] or [H, W, 3] at one t, got {image.shape} at {t.shape}")
    if dlog_dt is not None:
        dlog_dt = np.ascontiguousarray(dlog_dt, dtype=np.float32)
        if dlog_dt.shape != image.shape:
            raise ValueError(f"dlog_dt is {dlog_dt.shape}, the image {image.shape}; they must have the same shape")
    with np.errstate(over="ignore"):  # what does not fit float32 becomes infinite, which the sensor counts
        return t.astype(np.int64, copy=False), np.ascontiguousarray(image, dtype=np.float32), dlog_dt
