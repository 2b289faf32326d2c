"""Declares every parameter of the sensor: type, default, unit and range, for the node, for Python and for the command
line.

A value that is not given comes from the preset, and from the ideal sensor where the preset says nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from evis.config.document import read
from evis.config.params import Param, ParamError, describe_value, resolve
from nodes.event_sensor.presets import PRESETS

MODELS = ("evis", "evis-paper", "esim", "v2e", "dvs_voltmeter")
CROSSINGS = ("frame", "linear", "monotone", "cubic", "hermite")
LOOK_AHEAD = ("monotone", "cubic")
"""Those whose curve needs the frame after the step."""
FLOOR = 2.0**-24
"""Least I + I_dark [radiance]: the smallest positive half-precision radiance. An ideal sensor without dark current
would otherwise answer a black pixel with infinitely many events."""
OWN_MODELS = ("evis", "evis-paper")
"""Event models of EventSensor, in which FLOOR counts; the others are in nodes.event_sensor.peers."""
LARGEST_SIDE = 1 << 16
"""Most rows and columns: coordinates are uint16."""
NEED_SLOPES = ("hermite",)
"""Crossings for frames with dL/dt, which no node makes: `evis events simulate` takes them from a file."""

SENSOR: dict[str, Param] = {
    "model": Param(str, "evis", "event model; the others are for comparison", choices=MODELS),
    "crossing": Param(str, "linear", "how the time of a crossing inside a step is found", choices=CROSSINGS),
    "threshold": Param(float, 0.2, "contrast threshold, ON and OFF", "ln I", 0.001, 10),
    "threshold_on": Param(float, None, "contrast threshold ON, if it differs", "ln I", 0.001, 10, optional=True),
    "threshold_off": Param(float, None, "contrast threshold OFF, if it differs", "ln I", 0.001, 10, optional=True),
    "threshold_mismatch": Param(float, 0.0, "standard deviation of a pixel's thresholds", "ln I", 0, 1),
    "threshold_floor": Param(float, 0.01, "least threshold that mismatch leaves a pixel", "ln I", 0.001, 1),
    "dark_level": Param(float, 0.0, "dark current, in radiance units: L = ln(I + dark_level)", "W/(sr m^2)", 0),
    "refractory_us": Param(float, 0.0, "dead time after an event, the pixel held in reset", "us", 0, 1e9),
    "leak_rate": Param(float, 0.0, "ON events of a pixel in constant light", "Hz", 0, 1e6),
    "leak_jitter": Param(float, 0.0, "spread of the leak rate over pixels, relative", "", 0, 1),
    "leak_model": Param(str, "drift", "drift of the reference, or the paper's coin", choices=("drift", "bernoulli")),
    "shot_rate": Param(float, 0.0, "noise events of a pixel in the dark", "Hz", 0, 1e6),
    "shot_white": Param(float, 1.0, "intensity at which shot noise ends", "W/(sr m^2)", 1e-30),
    "shot_on_share": Param(float, 0.5, "share of ON in shot noise", "", 0, 1),
    "hot_pixel_fraction": Param(float, 0.0, "share of pixels that fire all the time", "", 0, 1),
    "hot_pixel_rate": Param(float, 0.0, "their mean rate", "Hz", 0, 1e6),
    "hot_pixel_spread": Param(float, 0.0, "standard deviation of ln of their rates", "", 0, 3),
    "defocus_px": Param(float, 0.0, "standard deviation of the lens's blur, 0 = sharp", "px", 0, 50),
    "bandwidth_hz": Param(float, 0.0, "photoreceptor's corner at bandwidth_level, 0 = infinite", "Hz", 0, 1e9),
    "bandwidth_level": Param(float, 0.0, "its intensity; below, it falls with I; 0 = constant", "W/(sr m^2)", 0),
    "bandwidth_exponent": Param(float, 1.0, "power of I by which it falls there; 0 = constant", "", 0, 2),
    "bandwidth_poles": Param(int, 1, "order of the photoreceptor's low pass", "", 1, 2),
    "photoreceptor_noise": Param(float, 0.0, "standard deviation of the photoreceptor's noise", "ln I", 0, 1),
    "photoreceptor_noise_level": Param(
        float, 0.0, "intensity at which it is that; 0 = the same in any light", "W/(sr m^2)", 0
    ),
    "readout_rate": Param(
        float, 0.0, "events per second that the readout carries, at least 1; 0 = all", "1/s", 0, 1e12
    ),
    "timestamp_jitter_us": Param(float, 0.0, "standard deviation of the readout's delay", "us", 0, 1e6),
    "event_cap": Param(int, 0, "most events per pixel and step, the rest counted as dropped; 0 = no cap", "", 0),
}


OF_MODEL: dict[str, Mapping[str, Param]] = {
    "v2e": {
        "linlog": Param(bool, False, "lin-log of 8-bit numbers instead of ln(I + dark_level)"),
        "rate_spread_decades": Param(float, 0.0, "spread of the leak rate over pixels, log-normal", "decades", 0, 3),
    },
    "dvs_voltmeter": {
        "k1": Param(float, None, "events per nat", "1/ln I", 0, optional=True),
        "k2": Param(float, 20.0, "dark level", "DN", 0),
        "k3": Param(float, 1e-4, "photon noise", "DN^0.5 us^-0.5", 0),
        "k4": Param(float, 1e-7, "leak", "1/us"),
        "k5": Param(float, 5e-9, "leak that grows with light", "1/(DN us)"),
        "k6": Param(float, 1e-5, "noise that does not depend on light", "us^-0.5", 0),
    },
}
"""What other published event models have beside SENSOR, by model: the parameters of their papers."""


def _of_preset(name: str, param: Param) -> Param:
    """Makes the parameter as a node has it: not given means the preset's value."""
    ideal = "" if param.default in (None, 0, 0.0) else f"; ideal: {describe_value(param.default)}"
    choices = tuple(c for c in param.choices if c not in NEED_SLOPES) if name == "crossing" else param.choices
    return replace(param, default=None, optional=True, help=param.help + ideal, choices=choices)


PRESET = Param(
    str, "ideal", "sensor whose faults to have; ideal has none", choices=tuple(PRESETS), files=(".yaml", ".yml")
)
"""A preset by its name, or a file of parameters."""


def resolve_sensor(owner: str, preset: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """Resolves all of SENSOR: given values over the preset's over the defaults; None counts as not given.

    preset: a name, or a YAML file of parameters. A `threshold` that is given is that of both sides, whatever the
    preset has for one of them. Parameters that only the chosen model has are in the result where they are given, by
    the caller or by the file. Raises ParamError naming `owner`, or the file, the key and the nearest valid one.
    """
    explicit = {key: value for key, value in given.items() if value is not None}
    values = preset_values(owner, preset, explicit.get("model"))
    if "threshold" in explicit:
        values = {key: value for key, value in values.items() if key not in ("threshold_on", "threshold_off")}
    chosen = {**values, **explicit}
    resolved = resolve(owner, _declared(chosen.get("model")), chosen)
    if 0 < (rate := resolved["readout_rate"]) < 1:
        raise ParamError(f"{owner}: readout_rate is {rate:g} 1/s; it is 0 (no limit) or at least 1 event per second")
    if is_own_model(resolved["model"]) and 0 < (dark := resolved["dark_level"]) < FLOOR:
        raise ParamError(
            f"{owner}: dark_level is {dark:g}, below {FLOOR:.3g} W/(sr m^2), the least light that a pixel sees, which "
            "would take its place; give 0 or more than that, or the light and dark_level in larger units"
        )
    if resolved["photoreceptor_noise"] > 0 and is_own_model(resolved["model"]):
        _check_photoreceptor_noise(owner, resolved)
    floor, least = resolved["threshold_floor"], min(thresholds_of(resolved))
    if resolved["threshold_mismatch"] > 0 and floor > least:
        raise ParamError(
            f"{owner}: with threshold_mismatch no pixel's threshold is below threshold_floor, {floor:g}, but the "
            f"threshold is {least:g}; give a threshold_floor below it, or threshold_mismatch 0"
        )
    return {name: value for name, value in resolved.items() if name in SENSOR or name in chosen}


def _check_photoreceptor_noise(owner: str, resolved: Mapping[str, Any]) -> None:
    """Raises ParamError where the photoreceptor's noise has no spectrum, or nothing that takes its samples."""
    noise = f"{owner}: photoreceptor_noise is {resolved['photoreceptor_noise']:g}"
    if resolved["bandwidth_hz"] <= 0:
        raise ParamError(
            f"{noise} and bandwidth_hz 0: it has the photoreceptor's bandwidth; give one, as bandwidth_hz 300"
        )
    if resolved["model"] != "evis":
        raise ParamError(
            f"{noise}, which event model {resolved['model']} has none of; take model evis, or leave the noise out"
        )
    if resolved["crossing"] != "linear":
        raise ParamError(
            f"{noise} and crossing {resolved['crossing']}: it has samples of its own between the frames, with lines "
            "between them; take crossing linear, or leave the noise out"
        )


def is_own_model(model: str) -> bool:
    """Tells whether an event model is of this project, made by EventSensor, and no other published one."""
    return model in OWN_MODELS


def thresholds_of(values: Mapping[str, Any]) -> tuple[float, float]:
    """Gives the contrast thresholds ON and OFF [ln I]: of a side that has none of its own it is `threshold`."""
    on, off = (values["threshold"] if values[k] is None else values[k] for k in ("threshold_on", "threshold_off"))
    return on, off


def preset_values(owner: str, preset: str, model: Any = None) -> dict[str, Any]:
    """Gives the values of a preset, by parameter. Raises ParamError, or LaunchError for a file that is no map.

    model: the event model that is chosen beside the preset, None where the preset chooses; a file may have its own
    parameters.
    """
    preset = PRESET.convert(owner, "preset", preset)
    if preset in PRESETS:
        return dict(PRESETS[preset].values)
    of_file = dict(read(Path(preset), "preset"))
    declared = _declared(of_file.get("model") if model is None else model)
    resolve(preset, declared, of_file)  # so that what is wrong there names the file
    return of_file


def _declared(model: Any) -> Mapping[str, Param]:
    """Gives SENSOR and what the event model has besides, if it is one of the other published ones."""
    return {**SENSOR, **OF_MODEL.get(model, {})} if isinstance(model, str) else SENSOR


def preset_name(preset: str) -> str:
    """Returns the name of a preset's sensor; of a file, the file's."""
    return PRESETS[preset].name if preset in PRESETS else Path(preset).name


def frames_only(p: Mapping[str, Any]) -> str:
    """Tells why a sensor takes whole frames alone; empty where it does not. p: all of SENSOR, resolved."""
    if p["model"] != "evis":
        return f"event model {p['model']} takes frames alone; event model evis takes both"
    if p["crossing"] != "linear":
        return f"crossing={p['crossing']} is for frames alone; between further samples ln I is a line, crossing=linear"
    if p["defocus_px"] > 0:
        return "defocus (defocus_px) blurs whole frames; leave it out, or give frames at all of the instants"
    return ""


def source_of(source: str, resolved: Callable[[], Mapping[str, Any]]) -> str:
    """Gives the port that is read: frames in place of samples where the sensor takes frames alone.

    resolved: gives all of SENSOR, resolved; it is asked only where it matters.
    """
    return "frames" if source == "samples" and frames_only(resolved()) else source


NODE: dict[str, Param] = {name: _of_preset(name, param) for name, param in SENSOR.items()}
"""SENSOR for a node of the graph, where a value that is not given is the preset's."""


def unused_samples(source: str, resolved: Mapping[str, Any]) -> tuple[str, ...]:
    """Says why samples between frames that are asked for come to nothing; resolved: all of SENSOR."""
    why = frames_only(resolved) if source == "samples" else ""
    return (f"time_tolerance is for samples between frames, and {why}: events come of frames alone",) if why else ()


def why_unmarked(camera: str, each: Sequence[Mapping[str, Any]]) -> str:
    """Tells why events cannot be marked as of light or of noise, and what to do; "" where they can.

    each: all of SENSOR, resolved, of the environments.
    """
    leave = f"leave out labels:=events and the topic /{camera}/signal, or"
    for p in each:
        if not is_own_model(p["model"]):
            return f"event model {p['model']} does not say which events noise made; {leave} take evis or evis-paper"
        if p["photoreceptor_noise"] > 0:
            # Some environment's will do: all have the same outputs.
            return (
                "with photoreceptor_noise light and noise make each crossing together, so that no event is of one of "
                f"them; {leave} the noise"
            )
    return ""
