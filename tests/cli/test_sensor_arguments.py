"""The event sensor's parameters on the launch files and the command line are those of the one table."""

from __future__ import annotations

from typing import Any

import pytest

from evis.config import paths
from evis.config.document import LaunchError
from evis.launch.files import load
from evis.launch.planner import Options, plan_launch
from evis.launch.target import read_target
from nodes.event_sensor.parameters import NEED_SLOPES, SENSOR, resolve_sensor

ARGUMENT = {name: "defocus" if name == "defocus_px" else name for name in SENSOR}


def sensor_params(name: str, **given: Any) -> dict[str, Any]:
    """Of a plan that is not held to what the arguments change."""
    target = read_target(name, given)
    made = plan_launch(target.launch, target.given, Options(), must_have_effect=())
    return made.nodes["event_sensor"].params


@pytest.mark.parametrize("name", ["simulator", "replay", "emulated_camera"])
def test_every_parameter_is_an_argument_with_its_range(name: str) -> None:
    """Not given unless the user gives it, so that the preset decides; help, unit and the ideal sensor's value told."""
    arguments = load(paths.find_launch(name)[0]).arguments
    for key, param in SENSOR.items():
        argument = arguments[ARGUMENT[key]].param
        assert argument.default is None and argument.type is param.type, key
        assert (argument.minimum, argument.maximum) == (param.minimum, param.maximum), key
        assert argument.choices == tuple(c for c in param.choices if c not in NEED_SLOPES), key
        assert param.help in argument.help and param.unit == argument.unit, key
        if param.default:
            assert f"ideal: {param.default}".removesuffix(".0") in argument.help, key


def test_what_is_not_given_is_the_presets() -> None:
    """The sensor of the plan is the preset's, and the ideal one's threshold is shown."""
    for preset in ("ideal", "dvs128", "imx636"):
        params = sensor_params("spinning_disk", preset=preset)
        given = {key: params[key] for key in SENSOR}
        assert resolve_sensor("it", preset, given) == resolve_sensor("it", preset, {})
    target = read_target("spinning_disk", {})
    plan = plan_launch(target.launch, target.given, Options(), must_have_effect=())
    assert plan.sensors["/cam0"]["threshold"] == 0.2


@pytest.mark.parametrize("key", SENSOR)
def test_every_argument_reaches_the_node(key: str) -> None:
    """By its own name; defocus in px. The photoreceptor's noise is refused without a bandwidth."""
    param, beside = SENSOR[key], {"photoreceptor_noise": {"bandwidth_hz": "300"}}
    value = (
        [c for c in param.choices if c not in NEED_SLOPES][-1]
        if param.choices
        else max(param.minimum or 0, min(param.maximum or 2, 2))
    )
    assert sensor_params("spinning_disk", **{ARGUMENT[key]: str(value)}, **beside.get(key, {}))[key] == value


def test_a_wrong_value_is_found_before_anything_starts() -> None:
    """Range and name."""
    with pytest.raises(LaunchError, match="the most is 10"):
        sensor_params("spinning_disk", threshold="11")
    with pytest.raises(LaunchError, match="did you mean 'monotone'"):
        sensor_params("spinning_disk", crossing="monoton")
    with pytest.raises(LaunchError, match="one of frame, linear, monotone, cubic"):
        sensor_params("spinning_disk", crossing="hermite")
    with pytest.raises(LaunchError, match="did you mean 'leak_rate'"):
        sensor_params("spinning_disk", leak_rat="1")
