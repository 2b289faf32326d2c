"""Chooses the layouts of data sets: a writer and a reader for each, which are imported when they are used.

    Writer = writer_of("dsec")
    writer = Writer(directory, about)      an empty folder
    writer.add(step)                       of a Simulation, one after the other
    writer.close()
    reader = reader_of("dsec")(directory)
    reader.events(0, 100_000_000)

docs/layouts.md tells what each writes, and what it cannot hold.
"""

from importlib import import_module
from typing import Any

from evis.config.suggestions import nearest
from evis.dataset.errors import DatasetError

_ROOM = "evis.dataset.layouts"
LAYOUTS = {
    "dsec": f"{_ROOM}.dsec.writer:DsecWriter",
    "npz": f"{_ROOM}.npz.writer:NpzWriter",
    "zarr": f"{_ROOM}.zarr.writer:ZarrWriter",
    "mvsec": f"{_ROOM}.mvsec.writer:MvsecWriter",
    "coco": f"{_ROOM}.coco.writer:CocoWriter",
    "webdataset": f"{_ROOM}.webdataset.writer:WebdatasetWriter",
    "mcap": f"{_ROOM}.mcap.writer:McapWriter",
}
"""Where the writer of each layout is."""
READERS = {
    "dsec": f"{_ROOM}.dsec.reader:DsecReader",
    "npz": f"{_ROOM}.npz.reader:NpzReader",
    "zarr": f"{_ROOM}.zarr.reader:ZarrReader",
    "mvsec": f"{_ROOM}.mvsec.reader:MvsecReader",
    "coco": f"{_ROOM}.coco.reader:CocoReader",
    "webdataset": f"{_ROOM}.webdataset.reader:WebdatasetReader",
    "mcap": f"{_ROOM}.mcap.reader:McapReader",
}
"""Where the reader of each layout is."""


class LayoutError(DatasetError):
    """Says that a sequence cannot be written or read in a layout; one line that names what, and what helps."""


def writer_of(layout: str) -> Any:
    """Returns the class that writes a layout. Raises LayoutError that names the nearest one."""
    return _load(LAYOUTS, layout)


def reader_of(layout: str) -> Any:
    """Returns the class that reads a layout. Raises LayoutError that names the nearest one."""
    return _load(READERS, layout)


def _load(table: dict[str, str], layout: str) -> Any:
    if layout not in table:
        raise LayoutError(f"there is no layout '{layout}'; {nearest(layout, table)}")
    module, _, name = table[layout].partition(":")
    return getattr(import_module(module), name)
