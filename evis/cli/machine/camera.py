"""Implements `evis camera`, which lists and plays cameras on USB, and recordings in their place, and changes settings
of one that streams in a graph."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from evis.cli.actions import adder, examples_of
from evis.cli.machine.camera_settings import add_set_arguments, run_set
from evis.cli.numbers import number_up_to
from evis.cli.parser import UsageError
from evis.console.printable import all_printable, printable

if TYPE_CHECKING:
    from nodes.camera.interface.driver import Driver

HELP = "list cameras, show what one is, watch its stream, change its settings, write udev rules"
EXAMPLES = {
    "list": "evis camera list --json",
    "info": "evis camera info --emulate evk4",
    "stream": "evis camera stream --emulate silkyevcam --file recording.raw --pace fast",
    "set": "evis camera set bias_fo=-10 roi_width=64",
    "udev": "evis camera udev | sudo tee /etc/udev/rules.d/65-event-cameras.rules",
}
EXAMPLE = examples_of(EXAMPLES)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    add = adder(parser, EXAMPLES)

    def action(name: str, text: str) -> argparse.ArgumentParser:
        result = add(name, text)
        result.add_argument("--json", action="store_true", help="print JSON")
        return result

    action("list", "cameras on USB that this version can drive")
    add_set_arguments(action("set", "change settings of a USB camera while it streams in a running graph"))
    add("udev", "rules that let every user of this machine open the cameras")
    info = action("info", "what a camera says about itself")
    stream = action("stream", "one line per packet")
    for one in (info, stream):
        one.add_argument("--serial", metavar="S", help="a camera on USB; any when nothing is given")
        one.add_argument("--file", metavar="REC", help="a recording")
        one.add_argument(
            "--emulate",
            metavar="MODEL",
            help="an emulated camera (evk4, davis346, ...) that sends --file; "
            "or a recording that stands in for a device, at real pace",
        )
        one.add_argument(
            "--topic", default="", metavar="NAME", help="of a --file with several event topics (the first)"
        )
        one.add_argument("--faults", default="", metavar="F", help="how it misbehaves: busy, stall_every=50, ...")
    info.add_argument("--settings", action="store_true", help="also the settings that it takes, with units and ranges")
    stream.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="one of the camera's settings")
    stream.add_argument("--pace", metavar="P", help="of a --file: realtime (default), fast or a speed such as 2.0")
    stream.add_argument(
        "--duration",
        type=number_up_to(1e9, "is no duration in seconds; 0 goes on to the end", zero=True),
        default=0.0,
        metavar="S",
        help="stop after so many seconds of the camera's clock (0: go on)",
    )
    stream.add_argument("--packet-ms", type=float, default=10.0, metavar="MS", help="interval of one packet (10)")
    stream.add_argument("--reconnect", action="store_true", help="wait for a camera that was unplugged to come back")


def run(args: argparse.Namespace) -> int:
    """Runs one action. Raises ValueError or OSError with one line for a person."""
    if args.action == "list":
        return _list(args)
    if args.action == "udev":
        from nodes.camera.usb.udev import rules

        print(rules(), end="")
        return 0
    if args.action == "set":
        return run_set(args)
    from evis.runtime.pacing import parse_pace
    from nodes.camera.emulated.faults import Faults
    from nodes.camera.find import check_choice, find_driver

    streams = args.action == "stream"
    with _usage():
        check_choice(args.file, args.emulate, args.serial, streams)
        Faults.of(args.faults)
    with _usage("--"):
        speed = parse_pace((args.pace if streams else None) or "realtime")
    duration = args.duration if streams else 0.0
    _check_effect(args)
    with find_driver(args.file, args.emulate, args.serial, speed, duration, args.faults, streams, args.topic) as driver:
        return _info(driver, args) if args.action == "info" else _stream(driver, args, speed)


@contextlib.contextmanager
def _usage(before: str = "") -> Iterator[None]:
    """Makes a ValueError of what was given a UsageError, with `before` in front of its text."""
    try:
        yield
    except ValueError as error:
        raise UsageError(f"{before}{error}") from None


def _check_effect(args: argparse.Namespace) -> None:
    """Raise UsageError for an option that changes nothing for what plays."""
    from nodes.camera.effects import without_effect

    idle = without_effect(args.file, args.emulate)
    options = {"settings": "set", **{name: name for name in ("reconnect", "faults", "pace", "topic")}}
    for name, option in options.items():
        if name in idle and getattr(args, option, None):
            raise UsageError(f"--{option} has no effect: {idle[name]}; leave it out")


def _list(args: argparse.Namespace) -> int:
    from nodes.camera.find import list_devices
    from nodes.camera.usb.models import MODELS

    devices = list_devices()
    if args.json:
        print(json.dumps([dataclasses.asdict(d) for d in devices]))
        return 0
    for d in devices:
        problem = d.details.get("problem")
        print(printable(problem or f"{d.serial}  {d.name}  {d.sensor}  {d.width}x{d.height}"))
    if not devices:
        print(f"no camera found (USB cameras supported: {', '.join(MODELS)})")
    return 0


def _info(driver: Driver, args: argparse.Namespace) -> int:
    from evis.config.params import in_full
    from nodes.camera.interface.settings import describe, shown

    about = dataclasses.asdict(driver.info())
    if args.settings:
        about["settings"] = describe(driver.settings_type())
    if args.json:
        print(json.dumps(about))
        return 0
    about = all_printable(about | about.pop("details"))
    settings = about.pop("settings", {})
    width = max(map(len, about))
    for name, value in about.items():
        text = ", ".join(map(str, value)) if isinstance(value, list) else value
        print(f"{name:{width}}  {text if text not in ('', {}) else '-'}")
    for name, facts in settings.items():
        low, high = facts["minimum"], facts["maximum"]
        span = (
            ""
            if low is None
            else f"{in_full(low)} to {in_full(high)}"
            if high is not None
            else f"at least {in_full(low)}"
        )
        when = "" if facts["live"] else "decided at the start"
        known = ", ".join(filter(None, (facts["unit"], span, when)))
        of = f" ({known})" if known else ""
        print(f"  {name}={shown(facts['default'])}".ljust(32) + f"  {facts['help']}{of}")
    return 0


def _stream(driver: Driver, args: argparse.Namespace, speed: float) -> int:
    from nodes.camera.file_source import FileSettings, FileSource
    from nodes.camera.interface.settings import parse_settings

    with _usage():
        if isinstance(driver, FileSource):
            driver.configure(FileSettings(args.packet_ms, 1.0 if args.emulate else speed, args.duration))
        else:
            kind = driver.settings_type()
            common = {"packet_ms": args.packet_ms, "reconnect": args.reconnect}
            driver.configure(kind.of({**common, **parse_settings(kind, args.set)}))
    driver.start()
    for warning in driver.info().details.get("warnings", ()):
        print(f"evis camera stream: {printable(warning)}", file=sys.stderr)
    total: dict[str, Any] = {"packets": 0, "events": 0, "triggers": 0, "imu": 0, "frames": 0, "late_packets": 0}
    try:
        _count(driver, args, total)
    finally:  # a live camera ends by Ctrl-C, or by its plug: what came, and what was lost, is told then too
        total |= driver.counters()
        print(json.dumps(total) if args.json else "  ".join(f"{k} {v}" for k, v in total.items()))
    return 0


def _count(driver: Driver, args: argparse.Namespace, total: dict[str, Any]) -> None:
    """Adds what comes to `total`, packet by packet, with a line for each, until there is no more."""
    from evis.console.outlet import strict_output
    from nodes.camera.interface.elapsed import Elapsed

    elapsed = Elapsed()
    waiting = False
    while not driver.ended:
        reading = driver.read(0.1)
        if reading is None:
            if args.reconnect and not waiting and driver.counters().get("unplugged", 0) > driver.episode:
                waiting = True
                print("evis camera stream: the camera was unplugged; waiting for it", file=sys.stderr)
            continue
        if waiting:
            waiting = False
            print("evis camera stream: the camera is back; its clock starts anew", file=sys.stderr)
        events = reading.events
        span = (reading.stamp_ns - reading.t0_ns) / 1e9
        total["packets"] += 1
        for name, amount in (
            ("events", len(events)), ("triggers", len(events.triggers)), ("imu", len(events.imu)),
            ("frames", len(events.frames)), ("late_packets", int(reading.late_ns > span * 1e9)),
        ):  # fmt: skip
            total[name] += amount
        if not args.json:
            on = int(events.p.sum(dtype=int))
            rate = len(events) / span / 1e6
            lost = f"  {reading.lost} bytes lost before" if reading.lost else ""
            with strict_output():
                print(f"{reading.stamp_ns / 1e9:.6f} s  {len(events)} events  {on} ON  {rate:.3f} Mev/s{lost}")
        if elapsed.add(driver.episode, reading.t0_ns, reading.stamp_ns) >= (args.duration * 1e9 or float("inf")):
            break
