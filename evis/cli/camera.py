"""`evis camera`: cameras on USB, and recordings in their place."""

from __future__ import annotations

import argparse
import dataclasses
import json
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from nodes.camera.driver import Driver

HELP = "list cameras, show what one is, watch its stream"
EXAMPLES = {
    "list": "evis camera list --json",
    "info": "evis camera info --file recording.raw",
    "stream": "evis camera stream --file recording.raw --pace fast",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = "examples:\n" + "\n".join(f"  {e}" for e in EXAMPLES.values())
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")

    def action(name: str, text: str) -> argparse.ArgumentParser:
        result = actions.add_parser(name, help=text, description=text, epilog=f"example: {EXAMPLES[name]}")
        result.add_argument("--json", action="store_true", help="print JSON")
        return result

    action("list", "cameras on USB that this version can drive")
    for name, text in (("info", "what a camera says about itself"), ("stream", "one line per packet")):
        one = action(name, text)
        one.add_argument("--serial", metavar="S", help="a camera on USB; any when nothing is given")
        one.add_argument("--file", metavar="REC", help="a recording")
        one.add_argument("--emulate", metavar="REC", help="a recording that stands in for a device, at real pace")
    stream = actions.choices["stream"]
    stream.add_argument("--pace", default="realtime", help="of a --file: realtime, fast or a speed such as 2.0")
    stream.add_argument("--duration", type=float, default=0.0, metavar="S", help="stop after this device time")
    stream.add_argument("--packet-ms", type=float, default=10.0, metavar="MS", help="interval of one packet (10)")


def run(args: argparse.Namespace) -> int:
    """Do it. Raises ValueError or OSError with one line for a person."""
    if args.action == "list":
        return _list(args)
    from nodes.camera.find import find_driver

    with find_driver(args.file, args.emulate, args.serial) as driver:
        return _info(driver, args) if args.action == "info" else _stream(driver, args)


def _list(args: argparse.Namespace) -> int:
    from nodes.camera.driver import FAMILIES
    from nodes.camera.find import list_devices

    devices = list_devices()
    if args.json:
        print(json.dumps([dataclasses.asdict(d) for d in devices]))
        return 0
    for d in devices:
        print(f"{d.serial}  {d.name}  {d.sensor}  {d.width}x{d.height}")
    if not devices:
        supported = ", ".join(FAMILIES) or "none in this version; recordings play with --file"
        print(f"no camera found (USB cameras supported: {supported})")
    return 0


def _info(driver: Driver, args: argparse.Namespace) -> int:
    about = dataclasses.asdict(driver.info())
    if args.json:
        print(json.dumps(about))
        return 0
    about |= about.pop("details")
    for name, value in about.items():
        print(f"{name:14}{value if value not in ('', [], {}) else '-'}")
    return 0


def _stream(driver: Driver, args: argparse.Namespace) -> int:
    from nodes.camera.file_source import FileSettings, FileSource, parse_pace

    if isinstance(driver, FileSource):
        speed = 1.0 if args.emulate else parse_pace(args.pace)
        driver.configure(FileSettings(args.packet_ms, speed, args.duration))
    driver.start()
    total: dict[str, Any] = {"packets": 0, "events": 0, "triggers": 0, "late_packets": 0}
    while not driver.ended:
        reading = driver.read(0.1)
        if reading is None:
            continue
        events = reading.events
        span = (reading.stamp_ns - reading.t0_ns) / 1e9
        total["packets"] += 1
        total["events"] += len(events)
        total["triggers"] += len(events.triggers)
        total["late_packets"] += reading.late_ns > span * 1e9
        if not args.json:
            on = int(events.p.sum(dtype=int))
            rate = len(events) / span / 1e6
            print(f"{reading.stamp_ns / 1e9:.6f} s  {len(events)} events  {on} ON  {rate:.3f} Mev/s", flush=True)
    total |= driver.counters()
    print(json.dumps(total) if args.json else "  ".join(f"{k} {v}" for k, v in total.items()))
    return 0
