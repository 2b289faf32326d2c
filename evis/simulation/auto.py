"""Replaces `interpolator:=auto` and `upsampling:=auto`, of `evis launch` and of a Simulation, before the graph is
planned, by what measuring the scene chooses.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any

from evis.launch.arguments import ArgumentError, resolve
from evis.launch.files import LaunchFile
from evis.launch.planner import Options

Say = Callable[[str], None]
WISHES = ("wanted_error", "wanted_rtf")
"""Arguments that auto chooses by."""
CHOSEN_BY_AUTO = ("interpolator", "upsampling")
"""Arguments that may be auto."""


@dataclass(frozen=True)
class Chosen:
    """Holds arguments without auto. taken: names of those that are in its place. told: what was chosen and why, for
    people and the bag; empty without auto. must_have_effect: of the given arguments; None = all.
    """

    given: Mapping[str, Any]
    taken: tuple[str, ...] = ()
    told: dict[str, Any] = field(default_factory=dict)
    must_have_effect: Collection[str] | None = None


def without_auto(
    launch: LaunchFile,
    given: Mapping[str, Any],
    options: Options,
    telling: AbstractContextManager[Say],
    warn: Say,
) -> Chosen:
    """Replaces auto in the arguments of a launch file, where it stands there.

    Args:
        launch: the launch file.
        given: its arguments.
        options: as for planning it.
        telling: is entered while the scene is measured, and gives what is told, line by line, what is being measured.
        warn: told what went wrong beside the choice.

    Raises ArgumentError for a wish of auto's where it is not asked for, ValueError where the scene cannot be measured.
    """
    if "interpolator" not in launch.arguments or "wanted_error" not in launch.arguments:
        return Chosen(given)
    values = resolve(launch.path.name, launch.arguments, given)
    if values["time_tolerance"] > 0 and values["interpolator"] == "rigid" and "upsampling" not in given:
        # Nobody has to think of K beside samples that are as close as they need to be.
        given = {**given, "upsampling": "auto"}
        values = resolve(launch.path.name, launch.arguments, given)
    wished = [name for name in WISHES if values[name] is not None]
    if all(values[name] != "auto" for name in CHOSEN_BY_AUTO):
        if wished:
            raise ArgumentError(f"{wished[0]} is for interpolator:=auto and upsampling:=auto, which choose by it")
        return Chosen(given)
    if wished and values["time_tolerance"] > 0:
        raise ArgumentError(f"{wished[0]} is for frames alone; with time_tolerance it is this that decides the error")
    from nodes.interpolator.auto import launch as auto

    with telling as say:
        without, told = auto.replace_auto(launch, given, options, say, warn)
    taken = tuple(name for name in without if without[name] != given.get(name))
    # What is only for some methods was given for the case that one of them is chosen.
    return Chosen(without, taken, told, [key for key in without if key not in auto.WARP])
