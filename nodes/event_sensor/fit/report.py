"""Reports a fit: values with their uncertainties and sources, and how far simulations are from the recordings."""

from __future__ import annotations

import math
from typing import Any

from nodes.event_sensor.fit.clip import Light
from nodes.event_sensor.fit.fit import Compared, Fit, relative_deviations

MUCH = 0.2
"""Deviation of a statistic from which on a fit is warned of."""


def report(fit: Fit, light: Light, contrast_deviation: float, contrast_source: str, lux: float) -> dict[str, Any]:
    """Reports a fit as numbers and texts."""
    relative = contrast_deviation / light.contrast
    assumed = {
        "contrast": light.contrast, "contrast_deviation": contrast_deviation, "contrast_source": contrast_source,
        "white_lux": lux, "white_radiance": light.white,
    }  # fmt: skip
    warnings = [] if fit.noise.sensor else ["nothing stands still for 0.1 s, so noise was not fitted"]
    for one in fit.compared:
        name, worst = max(relative_deviations(one).items(), key=lambda item: abs(item[1]), default=("", 0.0))
        if not abs(worst) < MUCH:
            warnings.append(
                f"{one.clip.name}: {name} of the simulation is off by {worst:+.0%}; the fit does not hold for it"
            )
    return {
        "values": dict(fit.values),
        "deviation": _deviations(fit, relative),
        "assumed": assumed,
        "laws": dict(fit.laws),
        "noise": {
            "white": {"on_hz": fit.noise.white.rates[0], "off_hz": fit.noise.white.rates[1]},
            "black": {"on_hz": fit.noise.black.rates[0], "off_hz": fit.noise.black.rates[1]},
            "hot_pixels": len(fit.noise.white.hot) + len(fit.noise.black.hot),
        },
        "recordings": [_recording(one) for one in fit.compared],
        **({"warnings": warnings} if warnings else {}),
    }


def _deviations(fit: Fit, contrast: float) -> dict[str, float]:
    """Computes the standard deviation of each fitted value, in its unit: that of the fit, and with thresholds that of
    the assumed contrast too."""
    out = {}
    for name, relative in fit.motion.deviation.items():
        if name == "bandwidth_exponent":
            out[name] = relative
            continue
        both = math.hypot(relative, contrast) if name.startswith("threshold") else relative
        out[name] = fit.values[name] * both
    return out


def _recording(one: Compared) -> dict[str, Any]:
    wheel = one.clip.wheel
    return {
        "name": one.clip.name,
        "fitted": one.fitted,
        "scene": {
            "hub_px": [round(v, 2) for v in wheel.hub], "turning": wheel.turning, "turns": wheel.turns,
            "speed_rad_s": [float(wheel.speed.min()), float(wheel.speed.max())], "blur_px": one.blur,
            "pixels": int(wheel.mask.sum()), "start_ns": wheel.start_ns, "end_ns": wheel.end_ns,
            "agreement": wheel.gathered,
        },
        "recorded": {**one.real, "noise_hz": one.real_noise, "least_interval_ms": one.clip.least_interval_us * 1e-3},
        "simulated": {**one.simulated, "noise_hz": one.simulated_noise},
        "off_by": relative_deviations(one),
    }  # fmt: skip


def assumption(light: Light, deviation: float, source: str, lux: float) -> str:
    """Words what was assumed of the light."""
    return (
        f"Assumed: a contrast ln(white / black) of {light.contrast:g} +- {deviation:g}, which events cannot tell from "
        f"the thresholds ({source}); white paper in {lux:g} lux, by which levels of light are in radiance."
    )


def sources(fit: Fit, contrast: float) -> dict[str, str]:
    """Names for each value where it is from. contrast: relative deviation of the assumed one."""
    spread = _deviations(fit, contrast)
    own = {name: f"Fitted: +- {value:.2g}" for name, value in spread.items()}
    for name in ("threshold_on", "threshold_off", "threshold_mismatch"):
        own[name] += f", of which the fit alone is {fit.values[name] * fit.motion.deviation[name]:.2g}"
    black, white = fit.noise.black, fit.noise.white
    still = "Where nothing moves"
    own |= {
        "refractory_us": own.get("refractory_us", "The least interval between two events of a pixel"),
        "leak_rate": f"{still}: what the white has more of ON than of OFF ({white.on} events ON, {white.off} OFF)",
        "shot_rate": f"{still}: {black.on + black.off} events in the black, {white.on + white.off} in the white",
        "shot_white": f"{still}: a line through the rates of black and white ends there, in the assumed light",
        "shot_on_share": f"{still}: of {black.on} events ON and {black.off} OFF in the black",
        "hot_pixel_fraction": f"{still}: {len(black.hot) + len(white.hot)} pixels",
        "hot_pixel_rate": f"{still}: their mean",
        "hot_pixel_spread": f"{still}: of their rates",
        "bandwidth_level": "The scene's white, in the assumed light",
    }
    return {name: own[name] for name in fit.values}
