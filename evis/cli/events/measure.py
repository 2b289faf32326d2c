"""Implements `evis events measure`: rate, rotation speed, noise and sharpness of a recording, a bag's topic or a
running graph."""

from __future__ import annotations

import argparse
from contextlib import suppress
from typing import Any

from evis.cli.events.files import add_part, add_stream, blocks_of, open_input
from evis.cli.events.progress import PassProgress
from evis.cli.graph.attach import add_run_option
from evis.cli.numbers import number_up_to
from evis.cli.parser import UsageError

_SECONDS = number_up_to(1e6, "is no time in seconds above 0")
LISTEN_S = 3.0
HELP = "event rate, rotation speed, noise and sharpness of a recording or of a topic of a running graph"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the action's arguments."""
    parser.add_argument(
        "recording", nargs="?", metavar="REC",
        help="a recording in any format, or a bag; without one --topic is listened to in the running graph",
    )  # fmt: skip
    add_stream(parser, "of a file with several event streams (the first); without a file, of the running graph")
    add_part(parser)
    parser.add_argument("--window", type=_window, default=10.0, metavar="MS", help="of rate, noise and sharpness (10)")
    parser.add_argument(
        "--listen",
        type=_SECONDS,
        metavar="S",
        help=f"to a running graph for so long ({LISTEN_S:g})",
    )
    parser.add_argument(
        "--no-rotation", action="store_true", help="leave the rotation out, which takes most of the time"
    )
    parser.add_argument("--png", metavar="OUT", help="draw speed and rate over time into a file")
    add_run_option(parser)


def _window(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.001 <= value <= 1e6:
        raise argparse.ArgumentTypeError(f"'{text}' is no window; give milliseconds, 0.001 to 1000000")
    return value


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Measures a recording in one pass."""
    if args.recording is None and not args.topic:
        raise UsageError("nothing to measure; name a recording, or --topic of a running graph, as /cam0/events")
    _check_source(args)
    if args.png:
        from evis.cli.events.measure_plot import check

        check(args.png)
    result = _file(args) if args.recording is not None else _topic(args)
    if args.png:
        from evis.cli.events.measure_plot import draw

        draw(result, args.png)
        result["png"] = args.png
    return result


def _check_source(args: argparse.Namespace) -> None:
    """Raises UsageError for an option that the other kind of source has: it would change nothing."""
    running, files = "running graphs, it does not go with a file", "files, it does not go with a running graph"
    if args.recording is not None:
        given = [("--listen", args.listen is not None, running), ("--run", bool(args.run), running)]
    else:
        given = [("--from", args.start != 0, files), ("--to", args.stop is not None, files)]
        given.append(("--size", args.size is not None, files))
    for name, is_given, of in given:
        if is_given:
            raise UsageError(f"{name} is for {of}")


def _file(args: argparse.Namespace) -> dict[str, Any]:
    from evis.events import RecordingError
    from evis.events.measure import Measurement
    from evis.files.damage import faults_as

    with open_input(args, args.recording) as recording, PassProgress("measuring") as progress:
        about = recording.info
        # a file may hold no event and say nothing of a sensor
        size = max(about.width, 1), max(about.height, 1)
        with faults_as(RecordingError, args.recording):
            measurement = Measurement(*size, round(args.window * 1e6), not args.no_rotation, progress.say)
        for events in blocks_of(recording, args):
            measurement.add(events.t, events.x, events.y, events.p)
            progress.at(recording.position)
        lost, report = recording.counters(), measurement.report()
    head = {"source": args.recording, "format": about.format, "width": about.width, "height": about.height}
    result = head | report | lost
    if about.truncated:
        result["truncated"] = True
    return result | ({"warnings": about.warnings} if about.warnings else {})


def _topic(args: argparse.Namespace) -> dict[str, Any]:
    from evis.cli.graph.attach import find_run, listen
    from evis.client.running import check_topic
    from evis.events.codecs.decoder import decoder_for
    from evis.events.measure import Measurement
    from msgs.events import EventPacket
    from msgs.header import missed_between

    plan = find_run(args.run)
    check_topic(plan, args.topic)
    listen_s = LISTEN_S if args.listen is None else args.listen
    measurement, decoder, seen, lost, last = None, None, 0, 0, None
    width = height = 0
    with PassProgress(f"listening for {listen_s:g} s") as progress:
        with suppress(KeyboardInterrupt):
            for _, message, _ in listen(plan, args.topic, listen_s):
                progress.say(f"{seen} packets")
                if not isinstance(message, EventPacket):
                    raise ValueError(f"{args.topic} carries {type(message).__name__}, no events")
                if measurement is None:
                    width, height = message.width, message.height
                    measurement = Measurement(
                        width, height, round(args.window * 1e6), not args.no_rotation, progress.say
                    )
                lost += message.lost + (missed_between(last, message.header.seq) if last is not None else 0)
                last, seen = message.header.seq, seen + 1
                if message.t is not None and message.x is not None and message.y is not None and message.p is not None:
                    end = int(message.env_offsets[1]) if len(message.env_offsets) > 1 else len(message.t)
                    measurement.add(message.t[:end], message.x[:end], message.y[:end], message.p[:end])
                elif message.raw is not None:
                    decoder = decoder or decoder_for(message.encoding, width, height)
                    events = decoder.decode(bytes(message.raw))
                    measurement.add(events.t, events.x, events.y, events.p)
        if measurement is None:
            raise ValueError(f"{args.topic}: no packet came in {listen_s:g} s")
        head = {"source": args.topic, "run": plan.run_id, "width": width, "height": height}
        return head | {"packets": seen, "packets_missed": lost} | measurement.report()


def for_people(result: dict[str, Any]) -> dict[str, Any]:
    """Writes series and candidates in a few words."""
    result = dict(result)
    rate, rotation, noise = result.pop("rate"), result.pop("rotation"), result.pop("noise")
    if rate:
        result["rate over time"] = f"median {rate['median_hz']:.4g} /s, peak {rate['peak_hz']:.4g} /s"
    if rotation:
        result["omega_rad_s"] = rotation["omega_rad_s"]
        result["confidence"] = rotation["confidence"]
        if rotation["omega_rad_s"] is None:
            result["rotation"] = f"none: {rotation['why']}"
        else:
            result["rotation"] = (
                f"{rotation['direction']}, {'steady' if rotation['steady'] else 'changing'}, by {rotation['method']}, "
                f"{rotation['revolutions']:g} revolutions about {rotation['pivot_px']}"
            )
            speeds = [w for _, w in rotation["series"]]
            result["speeds"] = f"{min(speeds):.4g} to {max(speeds):.4g} rad/s in {len(speeds)} points"
            result["ambiguity"] = rotation["ambiguity"]
        result["peaks"] = [
            f"{c['frequency_hz']:.4g} Hz ({c['power']:.0%}" + (f", x{c['order']})" if c["order"] else ")")
            for c in rotation["candidates"]
        ]
    hot = noise.pop("hot_pixels")
    result["noise"] = {name: value for name, value in noise.items()}
    result["hot_pixels"] = hot["count"] if hot else None
    result["sharpness"] = result["sharpness"]["dispersion"]
    return result
