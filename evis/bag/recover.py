"""Makes a whole bag of a torn one: copies every chunk whose checksum is right, byte for byte, and indexes it anew."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mcap.opcode import Opcode

from evis.bag import BagError
from evis.bag.mcap import scan
from evis.bag.mcap.container import Container
from evis.bag.reader import BagReader


@dataclass
class Recovery:
    """Describes what was recovered. `problem`: what the torn bag lacked, "" where it was whole."""

    path: Path
    messages: int
    chunks: int
    damaged: int
    problem: str


def recover(source: str | Path, target: str | Path | None = None) -> Recovery:
    """Writes the readable part of `source` to `target` (default `<name>.recovered.mcap`). The source is not changed.

    Raises BagError where there is no bag to read or the target cannot be written: then what was there before stays.
    """
    source = Path(source)
    target = Path(target) if target else source.with_name(source.stem + ".recovered.mcap")
    if target.exists() and source.exists() and target.samefile(source):
        raise BagError(f"cannot recover {source} into itself; give another name")
    with BagReader(source) as reader:
        container = Container(target)
        try:
            result = _copied(reader, container)
            container.close()
        except BaseException as error:
            container.withdraw()  # what is missing here is still in the source
            if not isinstance(error, BagError) or container.cause is None:
                raise
            why = container.cause.strerror if isinstance(container.cause, OSError) else container.cause
            raise BagError(
                f"{target}: {why}; nothing is left of it; free some room or name a file on another disk"
            ) from None
        return result


def _copied(reader: BagReader, container: Container) -> Recovery:
    """Copies every chunk that is right to an open file."""
    saved, damaged, messages = 0, 0, 0
    layout = reader.scanner.layout
    for schema in layout.schemas.values():
        container.put(schema)
    for channel in layout.channels.values():
        container.put(channel)
    episodes = sorted(layout.episodes)
    for name, values in layout.metadata.items():
        if name != "episode":
            container.add_metadata(name, values)
    for chunk in layout.chunks:
        while episodes and chunk.at > episodes[0]:
            container.add_metadata("episode", {})
            episodes.pop(0)
        try:
            data = reader.scanner.chunk_data(chunk)
            indexes = _indexes(data, frozenset(layout.channels))
        except scan.TooLargeError:
            raise
        except BagError:
            damaged += 1
            continue
        if indexes:
            container.put_chunk(chunk.compression, chunk.unpacked, chunk.crc, [reader.scanner.stored(chunk)], indexes)
            saved += 1
            messages += sum(len(v) for v in indexes.values())
    return Recovery(container.path, messages, saved, damaged, reader.problem)


def _indexes(data: memoryview, known: frozenset[int]) -> dict[int, list[tuple[int, int]]]:
    result: dict[int, list[tuple[int, int]]] = {}
    for opcode, at, body in scan.records(data):
        if opcode == Opcode.MESSAGE:
            channel, _, log_time, _ = scan.message(body)
            if channel not in known:
                raise BagError("a message's channel is not described")
            result.setdefault(channel, []).append((log_time, at))
    return result
