"""A preset fitted to recordings of a real wheel foretells recordings that it was not fitted to."""

import csv
import os
from pathlib import Path

import numpy as np
import pytest

from evis.events import open_recording
from nodes.event_sensor.fit.clip import read_clip, simulate_motion
from nodes.event_sensor.fit.fit import fit_sensor, light_of, relative_deviations
from nodes.event_sensor.fit.motion import fit_blur
from nodes.event_sensor.fit.wheel import NoWheel
from nodes.event_sensor.parameters import SENSOR, resolve_sensor

DATA = Path(os.environ.get("EVIS_TEST_DATA", Path(__file__).parents[4] / "shared" / "data"))
CLIPS = ("11_34_19", "11_34_58", "11_35_33", "11_35_50", "11_36_31", "11_36_46")
LEAST_NOISE, MOST_BACKGROUND = 0.04, 0.25
"""Noise [Hz a pixel] of the six clips where nothing moves; it depends on how much of the black is in view."""


def clip_of(name):
    path = DATA / "wheel" / f"wheel_2024_11_26_{name}_crop100.aedat4"
    if not path.exists():
        pytest.skip(f"no recordings at {DATA} (set EVIS_TEST_DATA)")
    with open_recording(path) as recording:
        events = recording.read()
    return read_clip(name, events.t, events.x, events.y, events.p)


@pytest.mark.parametrize("name", CLIPS)
def test_the_wheel_turns_as_fast_as_the_line_through_its_edge(name):
    """The reference was made from the same events in another way, and is good to 3 to 7 %."""
    clip = clip_of(name)
    rows = [r for r in csv.DictReader((DATA / "wheel" / "reference_speed.csv").open()) if name in r["file"]]
    keys = ("t_us_rel_first_event", "omega_rad_s", "cx_px", "cy_px")
    at, omega, x, y = np.array([[float(row[key]) for key in keys] for row in rows]).T
    speed = np.interp(clip.t[0] + at * 1e3, clip.wheel.at, clip.wheel.speed)
    assert np.median(np.abs(speed / omega - 1)) < 0.05
    assert np.hypot(clip.wheel.hub[0] - x[0], clip.wheel.hub[1] - y[0]) < 2


def test_a_recording_of_something_else_is_refused():
    path = DATA / "aedat4" / "aestream_davis.aedat4"
    if not path.exists():
        pytest.skip(f"no recording {path} (set EVIS_TEST_DATA)")
    with open_recording(path) as recording:
        events = recording.read()
    with pytest.raises(NoWheel):
        read_clip("else", events.t, events.x, events.y, events.p)


@pytest.mark.parametrize("name", CLIPS)
def test_the_preset_that_comes_with_evis_foretells_every_clip(name):
    """The clip's blur is a matter of the scene, and found from the intervals between events."""
    clip, light = clip_of(name), light_of()
    sensor = {key: value for key, value in resolve_sensor("", "davis346", {}).items() if value != SENSOR[key].default}
    made = simulate_motion(clip, light, fit_blur(clip, light, sensor), sensor)
    for key in ("on_per_turn", "off_per_turn", "on_share", "burst_on_ms", "burst_off_ms"):
        assert abs(made[key] / clip.real[key] - 1) < 0.2, key


@pytest.mark.slow
@pytest.mark.parametrize("left_out", CLIPS)
def test_a_fit_foretells_the_clip_that_was_left_out(left_out):
    clips = {name: clip_of(name) for name in CLIPS}
    other = clips.pop(left_out)
    fit = fit_sensor(list(clips.values()), [other], light_of())
    for one in fit.compared:
        assert all(abs(value) < 0.2 for value in relative_deviations(one).values()), one.clip.name
        assert LEAST_NOISE < one.simulated_noise < MOST_BACKGROUND
    assert 440 < fit.values["refractory_us"] < 540
    assert fit.laws["proportional"] > 3 * fit.laws["constant"]
