"""An argument that there once was is refused with what to do instead."""

import pytest

from evis.config.params import ParamError, resolve
from evis.config.paths import find_launch
from evis.config.removed import REMEDIES, instead
from evis.launch import arguments
from evis.launch.arguments import ArgumentError
from evis.launch.files import load
from nodes.interpolator.node import InterpolatorNode


@pytest.mark.parametrize("name", REMEDIES)
def test_the_remedy_is_named_and_there(name):
    """By a launch file and by a node; each names an argument that the launch file has."""
    launch = load(find_launch("simulator.yaml")[0])
    assert "time_tolerance" in launch.arguments
    with pytest.raises(ArgumentError, match=f"no argument '{name}'; it is gone, .*time_tolerance:=0.0001"):
        arguments.resolve("simulator.yaml", launch.arguments, {name: 1})
    with pytest.raises(ParamError, match=f"no parameter '{name}'; it is gone, .*time_tolerance:=0.0001"):
        resolve("interpolator", InterpolatorNode.PARAMS, {name: 1})


def test_nothing_that_is_there_is_called_gone():
    """Nor is another unknown name."""
    assert not REMEDIES.keys() & load(find_launch("simulator.yaml")[0]).arguments.keys()
    assert instead("tolerence", ["tolerance"]) == "did you mean 'tolerance'?"


@pytest.mark.parametrize(
    ("name", "value", "option"),
    [("duration", "0.2", "--duration 0.2"), ("view", "0", "--no-view"), ("record_topics", "/a", "--record-topics /a")],
)
def test_an_option_is_named_as_one(name, value, option):
    """Its name stands for it in launch files, and a user may take it for an argument."""
    with pytest.raises(ArgumentError, match=f"no argument '{name}'; it is an option of the command line: {option}$"):
        arguments.resolve("replay.yaml", load(find_launch("replay.yaml")[0]).arguments, {name: value})
