"""Reads frames and events out of a bag."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from evis.media.pictures.footage import Footage
from msgs.camera import EventPacket, Image, Keyframe

MAX_FRAMES = 2000


def from_bag(path: Path, camera: str = "cam0") -> Footage:
    """Reads what one camera of a bag saw: keyframes where the bag has them, or else the preview.

    First environment, first episode.

    Raises ValueError naming what the bag lacks.
    """
    from evis.bag.preview import exposure, tone_map
    from evis.bag.reader import BagReader

    events: list[EventPacket] = []
    frames: list[np.ndarray] = []
    times: list[int] = []
    gain: float | None = None
    with BagReader(path) as bag:
        pictures = next((t for t in (f"/{camera}/keyframe", f"/{camera}/image") if t in bag.topics), None)
        if pictures is None or f"/{camera}/events" not in bag.topics:
            raise ValueError(
                f"{path} has no frames and events of {camera}; its topics are {', '.join(sorted(bag.topics)) or 'none'}"
            )
        for _, message in bag.messages([pictures, f"/{camera}/events"]):
            if message.header.episode != 0:
                break
            if isinstance(message, EventPacket):
                if message.t is not None:
                    events.append(message)
                continue
            if isinstance(message, Keyframe):
                m = message.margin
                radiance = message.rgb[0]
                radiance = radiance[m : radiance.shape[0] - m, m : radiance.shape[1] - m]
                # One exposure for all frames: the picture must not pump.
                gain = exposure(radiance) if gain is None else gain
                picture = tone_map(radiance, gain)
            else:
                assert isinstance(message, Image)
                picture = np.broadcast_to(message.data, (*message.data.shape[:2], 3))
            frames.append(np.ascontiguousarray(picture, np.uint8))
            times.append(message.header.stamp_ns)
            if len(frames) > MAX_FRAMES:
                raise ValueError(f"{path} has more than {MAX_FRAMES} frames; record a shorter part")
    if not frames or not events:
        raise ValueError(f"{path}: {camera} has {len(frames)} frames and {len(events)} event packets, nothing to show")
    parts = [slice(int(e.env_offsets[0]), int(e.env_offsets[1])) for e in events]

    def joined(name: str) -> np.ndarray:
        return np.concatenate([getattr(e, name)[part] for e, part in zip(events, parts)])

    return Footage(
        np.stack(frames), np.array(times, np.int64), joined("t"), joined("x"), joined("y"), joined("p"),
        events[0].width, events[0].height,
    )  # fmt: skip
