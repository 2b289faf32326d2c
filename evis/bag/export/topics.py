"""Exports single topics of a bag: events, keyframes as EXR, everything else as arrays or lines of JSON."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from evis.bag import BagError, environments
from evis.bag.decoded import decoded_events
from evis.bag.export import exr, frames, label_images, label_pngs, labels, png, trajectory
from evis.bag.reader import BagReader
from evis.bag.ros import jsonform
from evis.events.files.rosbag.messages import TYPES, plain_type
from evis.files.whole_file import missing_folder, whole_file
from msgs.camera import Keyframe
from msgs.fields import array_specs
from msgs.header import Message

_ENV = re.compile(r"/env(\d+)(/.*)")
ENDINGS = (".npz", ".jsonl", ".csv", ".txt", ".raw", ".dat", ".es", ".aedat4", ".h5", ".hdf5")
"""Endings of files that a topic can be written to; events to all of them."""
BESIDE_KEYFRAME = ("depth", "motion", "ids")
SAMPLES = ("n", "w")
"""Axes, as messages name them, of which each message has a length of its own."""

FOLDERS = {"Keyframe": "EXR", "Image": "PNG", **dict.fromkeys(label_images.KINDS, "EXR")}
"""Messages that go to a folder, a file each, and its format."""


class FormatError(BagError):
    """Reports that the topic cannot be written in the format that the output's name asks for."""


def export(bag: str | Path, topic: str, out: str | Path, *, half: bool = False, as_png: bool = False) -> dict[str, Any]:
    """Writes a topic to `out` and returns what was written. `/env<k>/...` takes one environment of several.

    Events: .npz, .csv, .txt, .raw (by evis.events; times that a format rounds are counted). Keyframes to a folder:
    one EXR each (half: R, G, B as 16-bit floats, clamped and counted). Images to a folder: one PNG each, and times.txt.
    Depth, ids, motion and labels to a folder: one EXR each, or (as_png) 16 bit PNG, see `label_pngs.write_folders`.
    Frames: .npz that `evis events simulate` takes. Labels: .npz, see `labels.write`. /state: .npz with every body at
    every sub-step. Any other: .npz (arrays stacked over messages, samples joined). All: .jsonl (a message per line).
    Of a torn bag what is there is written, and `problem` says what is wrong with it. `other_files` counts the EXR or
    PNG files of another export that the folder still holds. Raises BagError.
    """
    out = Path(out)
    if out.suffix and (missing := missing_folder(out)):
        raise BagError(missing)
    with BagReader(bag) as reader:
        name, env = _resolve(reader, topic)
        kind = reader.topics[name]
        _check_format(topic, kind, out)
        if half and (kind != "Keyframe" or out.suffix):
            raise BagError(f"half is for EXR files of keyframes; {topic} to {out.name} has none")
        if as_png and (kind not in label_images.KINDS or out.suffix):
            raise BagError(
                f"PNG of whole numbers is of depth, ids and flow to a folder; {topic} to {out.name} has none"
            )
        suffix = out.suffix.lower()
        messages = partial(_messages, reader, name, env)
        if suffix == ".jsonl":
            result = _lines(messages(), out)
        elif kind == "EventPacket":
            result = _events(reader, name, env, out)
        elif kind == "Keyframe" and not suffix:
            result = _keyframes(reader, name, env, out, half)
        elif kind == "Image" and not suffix:
            _check_one(reader, name, env)
            result = png.write_folder(messages(), topic, out)
        elif kind in label_images.KINDS and not suffix:
            save = label_pngs.write_folders if as_png else label_images.write_folder
            result = save(messages(), topic, out)
        elif kind == "Frames":
            with _open_whole(out) as file:
                result = frames.write(messages, topic, file)
        elif kind == "Labels":
            beside = name.rpartition("/")[0] + "/events"
            packets = partial(_messages, reader, beside, env) if beside in reader.topics else None
            with _open_whole(out) as file:
                result = labels.write(messages, topic, file, packets)
        elif kind == "WorldState":
            result = _states(messages(), topic, out)
        else:
            result = _arrays(messages(), topic, out)
        if reader.problem:
            result["problem"] = reader.problem
        if reader.skipped:
            result |= {"damaged": reader.skipped, "damage": reader.first_problem}
        return {"topic": topic, "out": str(out), **result}


def _check_format(topic: str, kind: str, out: Path) -> None:
    """Raises BagError, which names the formats of this kind of message, unless `out` is one of them."""
    known = ENDINGS if kind == "EventPacket" else (".npz", ".jsonl")
    folder = f", or a folder for {FOLDERS[kind]} files" if kind in FOLDERS else ""
    if not out.suffix and not folder:
        raise BagError(f"{out}: no extension; name it {out.name}.npz (there are {', '.join(known)})")
    if out.suffix and out.suffix.lower() not in known:
        names = f"{', '.join(known[:-1])} or {known[-1]}"
        raise FormatError(f"cannot export {topic} ({kind}) to {out}: name it {names}{folder}")


@contextlib.contextmanager
def _open_whole(out: Path) -> Iterator[BinaryIO]:
    """Opens a file that appears under its name only when it is complete. Raises BagError where it cannot be written."""
    try:
        with whole_file(out) as part, part.open("wb") as file:
            yield file
    except OSError as error:
        raise BagError(str(error)) from None


def _resolve(reader: BagReader, topic: str) -> tuple[str, int | None]:
    if topic in reader.topics:
        return topic, None
    match = _ENV.fullmatch(topic)
    if match and match[2] in reader.topics:
        numbers = {s.env for s in reader.streams.values() if s.topic == match[2]}
        if int(match[1]) in numbers:
            return match[2], int(match[1])
    layout = reader.scanner.layout
    for schema in (layout.schemas.get(c.schema_id) for c in layout.channels.values() if c.topic == topic):
        kind = schema.name if schema else "of no type"
        events = f"; `evis events convert {reader.path} OUT --topic {topic}` writes its events"
        raise BagError(
            f"{reader.path}: {topic} is {kind}; no such message can be exported"
            + (events if plain_type(kind) in TYPES else "")
        )
    raise BagError(reader.lacks(topic))


def _check_one(reader: BagReader, topic: str, env: int | None) -> None:
    """Raises BagError for images of several environments, which would be one film."""
    numbers = {s.env for s in reader.streams.values() if s.topic == topic}
    if env is None:
        environments.check_one(topic, len(numbers))


def _messages(reader: BagReader, topic: str, env: int | None) -> Iterator[Message]:
    for _, message in reader.messages([topic]):
        found = message if env is None else environments.of_one(message, env)
        if found is not None:
            yield found


def _events(reader: BagReader, topic: str, env: int | None, out: Path) -> dict[str, Any]:
    from evis.events import open_writer
    from evis.events.recording import WHOLE_US

    packets = decoded_events(reader, topic, env)
    first = next(packets, None)
    size = (first[0].width, first[0].height) if first else (0, 0)
    count = lost = rounded = colourless = 0
    with open_writer(out, *size) as writer:
        for packet, events in _chain(first, packets):
            if env is None:
                environments.check_one(topic, environments.count(packet))
            writer.write(events)
            count, lost = count + len(events), lost + packet.lost
            rounded += int(np.count_nonzero(events.t % 1000)) if out.suffix.lower() in WHOLE_US else 0
            colourless += len(events) if events.c is not None and out.suffix.lower() != ".npz" else 0
    odd = {"times_rounded_to_us": rounded, "colour_left_out": colourless, "lost": lost}
    return {"events": count, "width": size[0], "height": size[1], **{name: n for name, n in odd.items() if n}}


def _chain(first: Any, rest: Iterator[Any]) -> Iterator[Any]:
    if first is not None:
        yield first
    yield from rest


def _keyframes(reader: BagReader, topic: str, env: int | None, out: Path, half: bool) -> dict[str, Any]:
    camera = topic.rsplit("/", 1)[0]
    topics = [topic, *(t for n in BESIDE_KEYFRAME if (t := f"{camera}/{n}") in reader.topics)]
    out.mkdir(parents=True, exist_ok=True)
    count = clamped = written = 0
    names: set[str] = set()
    for group in _by_stamp(reader, topics):
        keyframe = group.get(Keyframe)
        if not isinstance(keyframe, Keyframe):
            continue
        envs = range(len(keyframe.image)) if env is None else [env]
        for e in envs:
            arrays, high = exr.channels(group, e, half)
            folder = out / f"env{e}" if len(envs) > 1 else out
            folder.mkdir(exist_ok=True)
            try:
                exr.write(folder / f"{count:06d}.exr", arrays, keyframe.header.stamp_ns)
            except OSError as error:
                done = f"the {count} keyframes before it are whole" if count else "it is the first"
                raise BagError(f"{error}; {done}") from None
            clamped += high
            written += 1
            names |= {n for c in arrays for n in (("R", "G", "B") if c == "RGB" else (c,))}
        count += 1
    result = {"keyframes": count, "channels": sorted(names), **({"clamped": clamped} if half else {})}
    if others := len(list(out.rglob("*.exr"))) - written:
        result["other_files"] = others
    return result


def _by_stamp(reader: BagReader, topics: list[str]) -> Iterator[dict[type[Message], Message]]:
    group: dict[type[Message], Message] = {}
    at: tuple[int, int] | None = None
    for _, message in reader.messages(topics):
        key = (message.header.episode, message.header.stamp_ns)
        if key != at and group:
            yield group
            group = {}
        at = key
        group[type(message)] = message
    if group:
        yield group


def _arrays(messages: Iterator[Message], topic: str, out: Path) -> dict[str, Any]:
    columns: dict[str, list[np.ndarray]] = {"stamp_ns": [], "episode": []}
    rows: dict[str, list[int]] = {}
    for i, message in enumerate(messages):
        columns["stamp_ns"].append(np.array(message.header.stamp_ns, np.int64))
        columns["episode"].append(np.array(message.header.episode, np.int64))
        for name, array in message.arrays().items():
            columns.setdefault(name, [])
            joined = array_specs(type(message))[name].dims[0] in SAMPLES
            if joined:
                rows.setdefault(name, []).append(len(array))
            if len(columns[name]) != i or (i and columns[name][0].shape[joined:] != array.shape[joined:]):
                raise BagError(f"{topic}: {name} has another shape in every message; export to .jsonl")
            columns[name].append(np.asarray(array))
    if len({len(v) for v in columns.values()}) > 1:
        raise BagError(f"{topic}: not every message has the same arrays; export to .jsonl")
    stacked = {
        n: (np.concatenate if n in rows else np.stack)(v) if v else np.empty(0, np.int64) for n, v in columns.items()
    }
    if rows:  # of all arrays with such an axis alike
        stacked["offsets"] = np.cumsum([0, *next(iter(rows.values()))], dtype=np.int64)
    with _open_whole(out) as file:
        np.savez(file, **stacked)  # type: ignore[arg-type]
    return {"messages": len(stacked["stamp_ns"]), "arrays": {n: list(v.shape) for n, v in stacked.items()}}


def _states(messages: Iterator[Message], topic: str, out: Path) -> dict[str, Any]:
    try:
        columns, count = trajectory.table(messages)
    except ValueError as error:
        raise BagError(f"{topic}: {error}; export to .jsonl") from None
    with _open_whole(out) as file:
        np.savez(file, **columns)  # type: ignore[arg-type]
    return {"messages": count, "arrays": {n: list(v.shape) for n, v in columns.items()}}


def _lines(messages: Iterator[Message], out: Path) -> dict[str, Any]:
    count = 0
    with _open_whole(out) as file:
        for message in messages:
            file.write(jsonform.dump(message) + b"\n")
            count += 1
    return {"messages": count}
