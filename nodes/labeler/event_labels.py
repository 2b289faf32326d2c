"""Labels each event with what made it: the surface at its pixel and its time, and how that surface moves in the image.

Where a contour passes over a pixel, one surface comes and another goes, and the sensor places the events of that
change anywhere within its step. The contour is that of the nearer surface, whether it comes or goes: so an event
belongs to the nearest of the surfaces that the pixel's centre sees at the event's time and at the sub-frames about it.
Where single pixels are sampled between sub-frames, steps are as short as their samples: what is thin comes and goes
within a sub-frame, with the first of its events before it is there and the last after it has gone, so the surfaces
just before and after the event count too. Everywhere else these are one surface. Distance is that at the event's time,
or, where the surface is not there then, that of the look that found it; flow is that of the surface's point there, at
the event's time. A shadow belongs to the surface that it falls on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nodes.labeler.rays.motion_history import MotionHistory
from nodes.labeler.rays.ray_caster import RayCaster

LOOKS = (1 / 8, 2.0)
"""How far from an event's time is looked, in tolerances of the samples' times: the interpolator has two samples a
sixteenth of an instant apart about a change of surfaces that a ray finds, an instant about others, and instants are two
tolerances apart at most (nodes/interpolator/refine)."""

ROUNDED_NS = 2.0
"""By how much a sub-frame's stamp may be off the grid, and more: half a nanosecond each by its own rounding, by that of
the keyframes about it and by that of the time at which its environment began anew."""


@dataclass
class EventLabels:
    """Holds of each event of a packet: env int32 [n], instance int32 [n] id, flow float32 [n, 2] px/s."""

    env: np.ndarray
    instance: np.ndarray
    flow: np.ndarray


class EventLabeler:
    """Labels the events of one camera."""

    def __init__(self, caster: RayCaster, step_ns: float, tolerance_ns: float = 0.0) -> None:
        """Takes what finds the surfaces, and the grid of times. step_ns: between sub-frames [ns], which lie at whole
        multiples of it. tolerance_ns: of the times of samples between them, 0 = there are none."""
        self._caster, self._step = caster, step_ns
        # Instants as far apart as sub-frames are these.
        self._looks = [round(look * tolerance_ns) for look in LOOKS if 0 < 2 * tolerance_ns < step_ns]
        self._directions, self._image = caster.pixels()

    def __call__(
        self, history: MotionHistory, t: np.ndarray, x: np.ndarray, y: np.ndarray, env_offsets: np.ndarray
    ) -> EventLabels:
        """Labels events.

        Args:
            history: the states that their time lies in.
            t: int64 [n] ns.
            x, y: [n] px.
            env_offsets: int64 [E + 1], events of environment e are [offsets[e], offsets[e + 1]).
        """
        env = np.repeat(np.arange(len(env_offsets) - 1, dtype=np.int32), np.diff(env_offsets))
        n = len(t)
        if not n:
            return EventLabels(env, np.zeros(0, np.int32), np.zeros((0, 2), np.float32))
        caster, motion = self._caster, self._caster.motion(history)
        first, last = history.span
        t = np.asarray(t, np.int64)
        # An event at a sub-frame belongs to the step that it ends.
        step = np.ceil((t - min(ROUNDED_NS, 0.5 * self._step)) / self._step).astype(np.int64)
        pixel = np.asarray(y, np.int64) * caster.size[0] + np.asarray(x, np.int64)
        directions, count = self._directions[pixel], len(self._directions)
        ids, distances = caster.find_surfaces(motion, env, t, directions)
        # A step ends where the next one of the pixel begins, and many events share one.
        base, envs = int(step.min()) - 1, len(env_offsets) - 1
        number = ((step - base) * envs + env) * count + pixel
        ends, of = np.unique(np.concatenate((number - envs * count, number)), return_inverse=True)
        rest, pixels = np.divmod(ends, count)
        steps, in_env = np.divmod(rest, envs)
        at = np.clip(np.rint(self._step * (steps + base)).astype(np.int64), first, last)
        looked = caster.find_surfaces(motion, in_env.astype(np.int32), at, self._directions[pixels])
        seen = [[values[of[side]] for values in looked] for side in (slice(0, n), slice(n, None))]
        for look in self._looks:
            for when in (t - look, t + look):
                seen.append([*caster.find_surfaces(motion, env, np.clip(when, first, last), directions)])
        for other, distance in seen:
            nearer = (other != ids) & (distance < distances)
            ids, distances = np.where(nearer, other, ids), np.where(nearer, distance, distances)
        flow = caster.flow(motion, env, t, directions, self._image[pixel], (ids, distances))
        return EventLabels(env, ids.astype(np.int32), flow)
