"""Upsamples frames where they are too far apart, and says what there is to be said about it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from evis.media.frames.source import FrameBlock
from evis.runtime.clock import subframe_stamps
from nodes.interpolator.video.between import FrameInterpolator, SplatBetween
from nodes.interpolator.video.flow import DenseFlow, Flow

LADDER = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256)
"""Frames per gap are one of these, rounded up, so that few methods are made."""
GAP_BYTES = 128_000_000
"""The frames of one gap are fewer than this holds, so that large frames need little memory."""
NEAR_PX = 1.5
"""Up to this motion a gap gets no sub-frames by `auto`: the sensor's straight line in ln I is as near to the truth as
what the splat, which blurs by parts of a pixel, makes of it (bench.event_sensor.video)."""
CUT = 0.5
"""Where flow agrees for less than this share of the picture the gap is a cut, or its motion cannot be found."""
DOUBT = 0.9
"""Below this share of moving pixels the result is called doubtful."""


class Upsampler:
    """Makes sub-frames between frames; keeps two frames and the frames of one gap in memory.

    frames: per gap, the later frame included; None = as many as keep the motion below a pixel each. interpolator: in
    place of the splat along optical flow. Raises ValueError where optical flow is needed and not installed.
    """

    def __init__(self, frames: int | None = None, interpolator: FrameInterpolator | None = None) -> None:
        if frames is not None and not 1 <= frames <= LADDER[-1]:
            raise ValueError(f"upsample is {frames}; it must be 1 to {LADDER[-1]} frames per gap, auto or none")
        self._frames, self._own = frames, interpolator
        self._flow = DenseFlow() if frames is None or interpolator is None else None
        self._splat = SplatBetween()
        self.gaps = self.made = self.left = self.short = self._moving = self._agreeing = 0
        self._largest = self._step = 0.0

    def blocks(self, blocks: Iterator[FrameBlock]) -> Iterator[FrameBlock]:
        """Yields the first frame, then the frames of each gap, the later frame of which ends them as it is.

        What `blocks` raises is raised after the frames before. Raises ValueError for a bad result of an interpolator.
        """
        last: tuple[int, np.ndarray] | None = None
        for block in blocks:
            for stamp, image in zip(block.t.tolist(), block.image):
                if last is None:
                    yield FrameBlock(np.array([stamp]), image[None])
                else:
                    yield self._gap(*last, stamp, image)
                last = stamp, image

    def _gap(self, t_a: int, a: np.ndarray, t_b: int, b: np.ndarray) -> FrameBlock:
        flow = self._flow.between(a, b) if self._flow is not None else None
        count = min(self._count(flow, b), t_b - t_a)
        if count == 1:
            self.gaps += 1
            return FrameBlock(np.array([t_b]), b[None])
        at = np.arange(1, count) / count
        if self._own is not None:
            made = _fitting(self._own.between(a, b, at), (count - 1, *a.shape), self._own)
        else:
            assert flow is not None
            made = self._splat.along(flow, a, b, at)
        self.gaps, self.made = self.gaps + 1, self.made + count - 1
        return FrameBlock(subframe_stamps(t_a, t_b, count), np.concatenate([made, b[None]]))

    def _count(self, flow: Flow | None, image: np.ndarray) -> int:
        """Counts the frames of a gap, and notes what is known of its flow."""
        most = max(1, GAP_BYTES // image.nbytes)
        if flow is None:
            assert self._frames is not None
            return self._shortened(self._frames, most)
        if self._own is None and flow.agrees_a.mean() < CUT:
            self.left += 1
            return 1
        moving, agreeing = flow.moving()
        self._moving, self._agreeing = self._moving + moving, self._agreeing + agreeing
        motion = flow.largest_px
        self._largest = max(self._largest, motion)
        wanted = self._frames or self._enough(motion)
        count = self._shortened(wanted, most)
        self._step = max(self._step, motion / count)
        return count

    def _enough(self, motion: float) -> int:
        """Counts the frames of a gap that keep its motion below a pixel each."""
        if self._own is None and motion <= NEAR_PX:
            return 1
        return next((n for n in LADDER if n >= motion), LADDER[-1])

    def _shortened(self, wanted: int, most: int) -> int:
        self.short += wanted > most
        return min(wanted, most)

    @property
    def agreement(self) -> float | None:
        """Returns the share of the moving pixels whose flow forward and backward agree, over all gaps; None where
        nothing moved or no flow was looked for."""
        return self._agreeing / self._moving if self._moving else None

    def report(self) -> dict[str, Any]:
        """Reports the number of gaps and sub-frames, and figures of the motion, for a summary."""
        told: dict[str, Any] = {"gaps": self.gaps, "sub_frames": self.made}
        if self._flow is not None:
            agreement = None if self.agreement is None else round(self.agreement, 4)
            told |= {
                "largest_motion_px": round(self._largest, 2),
                "motion_per_frame_px": round(self._step, 2),
                "flow_agrees": agreement,
                "gaps_left": self.left,
            }
        return told | ({"gaps_shortened": self.short} if self.short else {})

    def warnings(self) -> list[str]:
        """Says how far the sub-frames can be trusted, in sentences."""
        said = []
        if self.made and self._own is not None:
            said.append("sub-frames come from your interpolator; how right they are is not known here")
        elif self.made:
            agreement = 1.0 if self.agreement is None else self.agreement
            doubt = " - doubtful; film at a higher rate" if agreement < DOUBT else ""
            said.append(
                f"sub-frames are made from optical flow, not seen: flow forward and backward agrees for "
                f"{100 * agreement:.1f} % of the moving pixels, the largest motion is {self._largest:.1f} px between "
                f"frames{doubt}; elsewhere, at edges that cover or uncover something, events are guessed"
            )
        if self._step > NEAR_PX:
            said.append(f"motion is up to {self._step:.1f} px per sub-frame; more than 1 px gives events in bursts")
        if self.left:
            said.append(
                f"{self.left} of {self.gaps} gaps have no sub-frames: flow agrees for less than half of the picture, "
                "as at a cut; their events come in one burst"
            )
        if self.short:
            said.append(f"{self.short} of {self.gaps} gaps have fewer sub-frames than wanted, to stay within memory")
        return said


def _fitting(made: Any, shape: tuple[int, ...], owner: object) -> np.ndarray:
    """Converts what a user's interpolator gave to float32. Raises ValueError where it is something else."""
    array = np.asarray(made)
    if array.shape != shape or array.dtype.kind != "f":
        raise ValueError(
            f"{type(owner).__name__}.between gave {array.dtype} {list(array.shape)}; it must be float32 {list(shape)}"
        )
    return np.ascontiguousarray(array, np.float32)
