"""Exports single topics of a bag: chooses, by what is asked for and what the topic holds, what writes it."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

from evis.bag import BagError
from evis.bag.export import arrays, event_files, frames, keyframes, label_images, label_pngs, labels, png, trajectory
from evis.bag.export.source import Messages, Source, find, messages_of
from evis.bag.reader import BagReader
from evis.bag.ros import jsonform
from evis.files.whole_file import missing_folder, whole_file
from msgs.header import Message

ENDINGS = (".npz", ".jsonl", ".csv", ".txt", ".raw", ".dat", ".es", ".aedat4", ".h5", ".hdf5")
"""Endings of files that a topic can be written to; events to all of them."""

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
        source = find(reader, topic)
        kind = source.kind
        _check_format(topic, kind, out)
        if half and (kind != "Keyframe" or out.suffix):
            raise BagError(f"half is for EXR files of keyframes; {topic} to {out.name} has none")
        if as_png and (kind not in label_images.KINDS or out.suffix):
            raise BagError(
                f"PNG of whole numbers is of depth, ids and flow to a folder; {topic} to {out.name} has none"
            )
        result = _write_file(source, out) if out.suffix else _write_folder(source, out, half, as_png)
        if reader.problem:
            result["problem"] = reader.problem
        if reader.skipped:
            result |= {"damaged": reader.skipped, "damage": reader.first_problem}
        return {"topic": topic, "out": str(out), **result}


def _write_folder(source: Source, out: Path, half: bool, as_png: bool) -> dict[str, Any]:
    """Writes a topic as a folder of pictures, one of FOLDERS, and returns what was written."""
    if source.kind == "Keyframe":
        return keyframes.write_folder(source, out, half)
    if source.kind == "Image":
        source.check_one()
        return png.write_folder(source.messages(), source.topic, out)
    return (label_pngs.write_folders if as_png else label_images.write_folder)(source.messages(), source.topic, out)


def _write_file(source: Source, out: Path) -> dict[str, Any]:
    """Writes a topic as a file, which appears when it is complete, and returns what was written."""
    as_lines = out.suffix.lower() == ".jsonl"
    if source.kind == "EventPacket" and not as_lines:
        return event_files.write(source, out)
    with _open_whole(out) as file:
        if as_lines:
            return _write_lines(source.messages(), file)
        if source.kind == "Frames":
            return frames.write(source.messages, source.topic, file)
        if source.kind == "Labels":
            return labels.write(source.messages, source.topic, file, _events_beside(source))
        return (trajectory if source.kind == "WorldState" else arrays).write(source.messages(), source.topic, file)


def _events_beside(source: Source) -> Messages | None:
    """Returns what gives the packets of the camera whose labels are exported; None where the bag has none."""
    events = source.name.rpartition("/")[0] + "/events"
    return partial(messages_of, source.reader, events, source.env) if events in source.reader.topics else None


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


def _write_lines(messages: Iterator[Message], out: BinaryIO) -> dict[str, Any]:
    """Writes a message per line, in its JSON form."""
    count = 0
    for message in messages:
        out.write(jsonform.dump(message) + b"\n")
        count += 1
    return {"messages": count}
