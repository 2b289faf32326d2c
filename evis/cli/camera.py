"""`evis camera`: cameras on USB, and recordings in their place."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from nodes.camera.driver import Driver

HELP = "list cameras, show what one is, watch its stream, write udev rules"
EXAMPLES = {
    "list": "evis camera list --json",
    "info": "evis camera info --emulate evk4",
    "stream": "evis camera stream --emulate silkyevcam --file recording.raw --pace fast",
    "udev": "evis camera udev | sudo tee /etc/udev/rules.d/65-event-cameras.rules",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = "examples:\n" + "\n".join(f"  {e}" for e in EXAMPLES.values())
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")

    def action(name: str, text: str) -> argparse.ArgumentParser:
        result = actions.add_parser(name, help=text, description=text, epilog=f"example: {EXAMPLES[name]}")
        if name != "udev":
            result.add_argument("--json", action="store_true", help="print JSON")
        return result

    action("list", "cameras on USB that this version can drive")
    action("udev", "rules that let every user of this machine open the cameras")
    for name, text in (("info", "what a camera says about itself"), ("stream", "one line per packet")):
        one = action(name, text)
        one.add_argument("--serial", metavar="S", help="a camera on USB; any when nothing is given")
        one.add_argument("--file", metavar="REC", help="a recording")
        one.add_argument(
            "--emulate",
            metavar="MODEL",
            help="an emulated camera (evk4, davis346, ...) that sends --file; "
            "or a recording that stands in for a device, at real pace",
        )
        one.add_argument("--faults", default="", metavar="F", help="how it misbehaves: busy, stall_every=50, ...")
    info, stream = actions.choices["info"], actions.choices["stream"]
    info.add_argument("--settings", action="store_true", help="also the settings that it takes, with units and ranges")
    stream.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="one of the camera's settings")
    stream.add_argument("--pace", default="realtime", help="of a --file: realtime, fast or a speed such as 2.0")
    stream.add_argument("--duration", type=float, default=0.0, metavar="S", help="stop after this device time")
    stream.add_argument("--packet-ms", type=float, default=10.0, metavar="MS", help="interval of one packet (10)")
    stream.add_argument("--reconnect", action="store_true", help="wait for a camera that was unplugged to come back")


def run(args: argparse.Namespace) -> int:
    """Do it. Raises ValueError or OSError with one line for a person."""
    if args.action == "list":
        return _list(args)
    if args.action == "udev":
        from nodes.camera.usb.udev import rules

        print(rules(), end="")
        return 0
    from nodes.camera.file_source import parse_pace
    from nodes.camera.find import find_driver

    speed, duration = 1.0, 0.0
    if args.action == "stream":
        speed, duration = parse_pace(args.pace), args.duration
    streams = args.action == "stream"
    with find_driver(args.file, args.emulate, args.serial, speed, duration, args.faults, streams) as driver:
        return _info(driver, args) if args.action == "info" else _stream(driver, args, speed)


def _list(args: argparse.Namespace) -> int:
    from nodes.camera.find import list_devices
    from nodes.camera.usb.models import MODELS

    try:
        devices = list_devices()
    except OSError as error:  # without libusb there is nothing to be seen
        print(f"evis camera list: {error}", file=sys.stderr)
        devices = []
    if args.json:
        print(json.dumps([dataclasses.asdict(d) for d in devices]))
        return 0
    for d in devices:
        problem = d.details.get("problem")
        print(problem or f"{d.serial}  {d.name}  {d.sensor}  {d.width}x{d.height}")
    if not devices:
        print(f"no camera found (USB cameras supported: {', '.join(MODELS)})")
    return 0


def _info(driver: Driver, args: argparse.Namespace) -> int:
    from nodes.camera.driver import describe

    about = dataclasses.asdict(driver.info())
    if args.settings:
        about["settings"] = describe(driver.settings_type())
    if args.json:
        print(json.dumps(about))
        return 0
    about |= about.pop("details")
    settings = about.pop("settings", {})
    width = max(map(len, about))
    for name, value in about.items():
        print(f"{name:{width}}  {value if value not in ('', [], {}) else '-'}")
    for name, facts in settings.items():
        low, high = facts["minimum"], facts["maximum"]
        span = "" if low is None else f", {low:g} to {high:g}" if high is not None else f", at least {low:g}"
        print(f"  {name:22}{facts['default']} {facts['unit']}{span}: {facts['help']}")
    return 0


def _stream(driver: Driver, args: argparse.Namespace, speed: float) -> int:
    from nodes.camera.driver import parse_settings
    from nodes.camera.file_source import FileSettings, FileSource

    if isinstance(driver, FileSource):
        driver.configure(FileSettings(args.packet_ms, 1.0 if args.emulate else speed, args.duration))
    else:
        kind = driver.settings_type()
        common = {"packet_ms": args.packet_ms, "reconnect": args.reconnect}
        driver.configure(kind.of({**common, **parse_settings(kind, args.set)}))
    driver.start()
    total: dict[str, Any] = {"packets": 0, "events": 0, "triggers": 0, "imu": 0, "frames": 0, "late_packets": 0}
    first: int | None = None
    while not driver.ended:
        reading = driver.read(0.1)
        if reading is None:
            continue
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
            print(f"{reading.stamp_ns / 1e9:.6f} s  {len(events)} events  {on} ON  {rate:.3f} Mev/s{lost}", flush=True)
        first = reading.t0_ns if first is None else first
        if args.duration and reading.stamp_ns - first >= args.duration * 1e9:
            break
    total |= driver.counters()
    print(json.dumps(total) if args.json else "  ".join(f"{k} {v}" for k, v in total.items()))
    return 0
