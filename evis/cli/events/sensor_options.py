"""Makes options for the sensor's parameters from the one table of them."""

from __future__ import annotations

import argparse
from typing import Any

from evis.config.params import describe
from nodes.event_sensor.parameters import SENSOR
from nodes.event_sensor.presets import PRESETS

ALIASES = {"defocus_px": ("--defocus",)}


def add_sensor_options(parser: argparse.ArgumentParser) -> None:
    """Adds --preset, --seed, --device and every parameter of SENSOR.

    Values stay texts: the table converts and checks.
    """
    group = parser.add_argument_group(
        "event sensor", "what is not given comes from the preset; docs/event_sensor.md explains every parameter"
    )
    presets = "; ".join(f"{key} ({preset.name})" for key, preset in PRESETS.items())
    group.add_argument(
        "--preset",
        default="ideal",
        metavar="NAME",
        help=f"sensor whose faults to have: {presets}; or a .yaml file, as `events fit` writes it",
    )
    group.add_argument(
        "--seed", type=int, default=0, metavar="N", help="of the faults that are random (0); the ideal sensor has none"
    )
    group.add_argument("--device", default="cpu", metavar="NAME", help="cpu, cuda or cuda:N (cpu)")
    for name, param in SENSOR.items():
        options = (option(name), *ALIASES.get(name, ()))
        metavar = "NAME" if param.choices else "N" if param.type is int else "X"
        group.add_argument(*options, dest=name, metavar=metavar, help=describe(param).replace("%", "%%"))


def sensor_values(args: argparse.Namespace) -> dict[str, Any]:
    """Returns the parameters that were given, by the names of SENSOR; None where one was not."""
    return {name: getattr(args, name) for name in SENSOR}


def check_sensor_options(args: argparse.Namespace) -> None:
    """Raises ValueError for an option that is wrong, or that was given and changes nothing."""
    from nodes.event_sensor.effects import check_given
    from nodes.event_sensor.parameters import resolve_sensor

    given = sensor_values(args)
    check_given(given, resolve_sensor("event sensor", args.preset, given), lambda name, text: f"{option(name)} {text}")


def option(name: str) -> str:
    """Names the option of a parameter: threshold_mismatch -> --threshold-mismatch."""
    return "--" + name.replace("_", "-")
