"""Fits a sensor to recordings of a turning wheel, and measures how far it is from recordings that it was not fitted
to."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nodes.event_sensor.fit.clip import MANY_PIXELS, Clip, Light, simulate, simulate_motion
from nodes.event_sensor.fit.motion import (
    LEAST_CONTRAST,
    MOST_CONTRAST,
    UNKNOWN,
    MotionFit,
    fit_blur,
    fit_motion,
    least_interval_us,
)  # fmt: skip
from nodes.event_sensor.fit.statistics import CHANCE, SCALES, TEXTS
from nodes.event_sensor.fit.still import STILL_STEP_NS, NoiseFit, fit_noise, still_part
from nodes.event_sensor.parameters import FLOOR
from nodes.event_sensor.presets import radiance_of

CONTRAST = 2.1
"""ln of white over black that is assumed of the wheel."""
CONTRAST_DEVIATION = 0.4
CONTRAST_SOURCE = (
    "chosen such that the thresholds of a DAVIS346 come out at the mean of what its default biases set, 0.28 ON and "
    "0.26 OFF: C = kappa_n C2 / (kappa_p^2 C1) ln(I_on / I_d), Nozaki and Delbruck, IEEE TED 64(8), 2017, with kappa "
    "0.7 and C1 / C2 = 20; that the recording was made with them is a guess"
)
LUX = 500.0
"""Illuminance that is assumed of the wheel, of offices and laboratories in EN 12464-1."""


@dataclass(frozen=True)
class Compared:
    """Holds a recording beside its simulation by a fitted sensor. fitted: it was fitted to this one."""

    clip: Clip
    fitted: bool
    blur: float
    real: dict[str, float]
    simulated: dict[str, float]
    real_noise: float
    simulated_noise: float


@dataclass(frozen=True)
class Fit:
    """Holds a fitted sensor. values: parameters; motion, noise: where they come from; compared: every recording.

    laws: what is left, as MotionFit.cost, by how the corner goes with the light: constant, proportional, or a power of
    it that is fitted.
    """

    values: dict[str, float]
    motion: MotionFit
    noise: NoiseFit
    laws: dict[str, float]
    compared: list[Compared]


def light_of(contrast: float = CONTRAST, lux: float = LUX) -> Light:
    """Returns the light that is assumed: white paper in so many lux.

    Raises ValueError for a contrast before which no threshold of a sensor can be searched, and for a black that no
    sensor sees.
    """
    if not LEAST_CONTRAST <= contrast <= MOST_CONTRAST:
        raise ValueError(
            f"a contrast of {contrast:g} is a white exp({contrast:g}) times as bright as the black; it is "
            f"{LEAST_CONTRAST:g} to {MOST_CONTRAST:g}, being ln(white / black)"
        )
    light = Light(radiance_of(lux), contrast)
    if (black := light.white * math.exp(-contrast)) < FLOOR:
        raise ValueError(
            f"in {lux:g} lux the black has a radiance of {black:.2g} W/(sr m^2), below the least that sensors tell "
            f"apart, {FLOOR:.2g}; give the light on the scene in lux"
        )
    return light


def fit_sensor(
    clips: Sequence[Clip], others: Sequence[Clip], light: Light, say: Callable[[str], None] = lambda text: None
) -> Fit:
    """Fits a sensor to all `clips` together, and simulates them and `others` with it."""
    noise, least = fit_noise(clips, light), least_interval_us(clips)
    fits = {
        law: fit_motion(clips, light, noise.sensor, exponent, None, least, say)
        for law, exponent in (("constant", 0.0), ("proportional", 1.0))
    }
    likely = min(fits.values(), key=lambda fit: fit.cost)
    power = fits["power"] = fit_motion(clips, light, noise.sensor, None, likely, least, say)
    motion = power if _has_power(power) else fits["constant"]

    def precise(dead_us: float | None) -> MotionFit:
        law = None if _has_power(motion) else 0.0
        fit = fit_motion(clips, light, noise.sensor, law, motion, dead_us, say, precise=True)
        if law is None and not _has_power(fit):  # it was chance of the few pixels before
            fit = fit_motion(clips, light, noise.sensor, 0.0, fits["constant"], dead_us, say, precise=True)
        return fit

    shorter = precise(None)
    # What the model does not describe within chance does not tell of the dead time: it would make up for other faults.
    if shorter.cost <= CHANCE**2:
        motion = _with_dead_time(precise(least), shorter, len(SCALES) * len(clips))
    laws = {name: one.cost for name, one in fits.items()}
    values = {**motion.sensor, **noise.sensor}
    compared = []
    for clip, blur in zip(clips, motion.blur):
        say(f"simulating {clip.name}")
        compared.append(_compared(clip, light, blur, values, True))
    for clip in others:
        say(f"simulating {clip.name}, which was not fitted")
        compared.append(_compared(clip, light, fit_blur(clip, light, values), values, False))
    return Fit(values, motion, noise, laws, compared)


def _has_power(fit: MotionFit) -> bool:
    """Tells whether the power is told from 0; one that is not is none."""
    return fit.sensor.get("bandwidth_exponent", 0.0) > 2 * fit.deviation.get("bandwidth_exponent", 0.0)


def _with_dead_time(motion: MotionFit, shorter: MotionFit, differences: int) -> MotionFit:
    """Chooses between a dead time that is the least interval and one that was fitted, by so many differences.

    Where edges are slow the least interval is longer than the dead time, and thresholds that are too low make up for
    what the simulation then loses. Both fits are precise ones: costs of other pixels differ by chance.
    """
    if (motion.cost - shorter.cost) * differences > (2 * CHANCE) ** 2:  # told by two standard deviations
        return shorter
    # Either may be right, so values are as uncertain as the two differ.
    deviation = {
        name: math.hypot(value, math.log(shorter.sensor[name] / motion.sensor[name]))
        if name in UNKNOWN
        else math.hypot(value, shorter.sensor.get(name, 0.0) - motion.sensor[name])
        for name, value in motion.deviation.items()
    }
    return replace(motion, deviation=deviation)


def _compared(clip: Clip, light: Light, blur: float, values: dict[str, Any], fitted: bool) -> Compared:
    made = simulate_motion(clip, light, blur, values, most=MANY_PIXELS, seed=1)
    return Compared(
        clip, fitted, blur, clip.real, made, fit_noise([clip], light).rate, _still_rate(clip, light, blur, values)
    )


def _still_rate(clip: Clip, light: Light, blur: float, values: dict[str, Any]) -> float:
    """Computes the rate [Hz] of a simulated pixel where nothing moves, over as long as the recording has."""
    start, end, at = still_part(clip)
    x, y = clip.pixels
    times = np.arange(at, at + (end - start), STILL_STEP_NS, dtype=np.int64)
    held = np.full(len(times), at, np.int64)
    t, _, _ = simulate(clip, light, blur, values, times, x, y, 2, sees=held)
    return len(t) / (len(x) * max(end - start, 1) * 1e-9)


def relative_deviations(one: Compared) -> dict[str, float]:
    """Tells how far the simulation of a recording is off, relative, by statistic."""
    return {name: one.simulated[name] / one.real[name] - 1 for name in TEXTS if one.real[name] > 0}
