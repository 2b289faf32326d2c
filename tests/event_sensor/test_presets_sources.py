"""Presets: every value is a parameter in its range, has a source, and reaches the sensor; published figures hold."""

import math

import pytest

from evis.config.params import ParamError
from nodes.event_sensor.parameters import SENSOR, resolve_sensor
from nodes.event_sensor.presets import PRESETS, corner_of, radiance_of

REAL = [name for name in PRESETS if name != "ideal"]


def test_the_ideal_sensor_has_no_fault():
    values = resolve_sensor("sensor", "ideal", {})
    faults = (
        "threshold_mismatch", "dark_level", "refractory_us", "leak_rate", "shot_rate", "hot_pixel_fraction",
        "defocus_px", "bandwidth_hz", "readout_rate", "timestamp_jitter_us", "event_cap",
    )  # fmt: skip
    assert all(values[name] == 0 for name in faults)
    assert not PRESETS["ideal"].values and set(values) == set(SENSOR)


@pytest.mark.parametrize("name", REAL)
def test_every_value_is_a_parameter_in_range_and_has_a_source(name):
    preset = PRESETS[name]
    assert set(preset.sources) == {*preset.values, "size"}
    for key, value in preset.values.items():
        assert SENSOR[key].convert(name, key, value) == value
        assert value != SENSOR[key].default, f"{key} says nothing that the default does not"
    for key, source in preset.sources.items():
        named = any(ch.isdigit() for ch in source) and ("," in source or ":" in source)
        assert source.startswith("guess") or named, f"{key}: {source}"


@pytest.mark.parametrize("name", REAL)
def test_resolving_gives_the_preset_and_given_values_win(name):
    values = resolve_sensor("sensor", name, {"threshold": 0.4, "leak_rate": None})
    assert set(values) == set(SENSOR) and values["threshold"] == 0.4
    assert values["threshold_on"] is None and values["threshold_off"] is None, "a threshold that is given is of both"
    for key, value in PRESETS[name].values.items():
        if key not in ("threshold", "threshold_off"):
            assert values[key] == value


def test_published_figures():
    """Resolution, least contrast and readout of the data sheets, in their own units."""
    sizes = {"dvs128": (128, 128), "davis346": (346, 260), "gen31_vga": (640, 480), "imx636": (1280, 720)}
    for name, size in {**sizes, "genx320": (320, 320)}.items():
        assert (PRESETS[name].width, PRESETS[name].height) == size
    dvs = PRESETS["dvs128"].values
    assert math.exp(dvs["threshold"]) == pytest.approx(1.15) and dvs["threshold_mismatch"] == 0.021
    assert dvs["bandwidth_hz"] == 3000 and dvs["readout_rate"] == 1e6
    gen4 = PRESETS["imx636"].values
    assert 1 - math.exp(-gen4["threshold"]) == pytest.approx(0.25) and gen4["readout_rate"] == 1.066e9
    assert 1 / (2 * math.pi * gen4["bandwidth_hz"]) == pytest.approx(100e-6)


def test_light_levels_are_those_of_a_white_surface():
    """1 klux on white paper is 318 cd/m^2, which is 1.78 W/(sr m^2) at 179 lm/W."""
    assert radiance_of(1000) * 179 == pytest.approx(318.31, rel=1e-4)
    assert corner_of(1e6 / (2 * math.pi)) == pytest.approx(1)


@pytest.mark.parametrize("name", REAL)
def test_the_working_range_is_that_of_a_sensor(name):
    """From dark level to 100 klux at least 100 dB; the corner falls to less than 1 Hz in the dark."""
    values = PRESETS[name].values
    assert 20 * math.log10(radiance_of(100_000) / values["dark_level"]) > 100
    in_the_dark = values["bandwidth_hz"] * values["dark_level"] / values["bandwidth_level"]
    assert 0 < in_the_dark < 1


def test_a_wrong_name_is_answered_with_the_nearest():
    with pytest.raises(ParamError, match="did you mean 'imx636'"):
        resolve_sensor("sensor", "imx63", {})


@pytest.mark.parametrize("name", REAL)
def test_a_doubling_of_the_light_fires_every_pixel(name):
    """In 10 klux, where shot noise has ended and the corner is at its highest; the refractory period may swallow more.

    Leak and mismatch allow a pixel one event more than ln 2 / C; nothing fires OFF. Before it there is leak alone.
    """
    import numpy as np

    from nodes.event_sensor.sensor import EventSensor

    sensor = EventSensor(16, 20, preset=name, seed=1, hot_pixel_fraction=0)  # these fire whatever the light does
    light = np.full((1, 40, 16, 20), radiance_of(10_000), np.float32)
    light[:, 10:] *= 2
    packet = sensor.process(light, np.arange(40, dtype=np.int64) * 1_000_000, np.zeros(1, np.int32))
    counts = np.zeros((16, 20), int)
    np.add.at(counts, (packet.y, packet.x), 1)
    values = PRESETS[name].values
    least = values["threshold"] - 4 * values["threshold_mismatch"]  # of 320 pixels
    assert least > SENSOR["threshold_floor"].default
    assert packet.p.all() and counts.min() >= 1 and counts.max() <= math.log(2) / least + 1
    leaked = values.get("leak_rate", 0) * 320 * 9e-3
    assert (packet.t <= 9_000_000).sum() <= leaked + 4.5 * math.sqrt(leaked)
