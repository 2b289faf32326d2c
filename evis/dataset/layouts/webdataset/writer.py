"""Writes WebDataset: tar shards whose samples are the steps of a camera, in order of time, for reading as a stream.

A sample `<camera>/<number>` has `.json` (stamp_ns, t0_ns, camera, number and times of the events), `.events.npz` with
t, x, y, p and the labels of events, `.<kind>.npz` for each kind of label, and `.image.png`.
"""

from __future__ import annotations

import io
import json
import tarfile
import zipfile
from typing import Any

import numpy as np
from numpy.lib import format as npy

from evis.bag.export.png import encoded
from evis.dataset.layouts.columns import EVENT_TYPES
from evis.dataset.layouts.sample import EVENTS, Sample
from evis.dataset.layouts.writer import SequenceWriter

SHARD_BYTES = 256 << 20
"""A shard ends with the sample that makes it longer."""


class WebdatasetWriter(SequenceWriter):
    """Writes shard after shard, and each sample as it comes."""

    LAYOUT = "webdataset"

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self._shards = 0
        self._tar: tarfile.TarFile | None = None
        self._numbers = dict.fromkeys(self.about.cameras, 0)

    def _add(self, camera: str, sample: Sample) -> None:
        key = f"{camera}/{self._numbers[camera]:08d}"
        self._numbers[camera] += 1
        events = sample.events
        arrays = {name: np.asarray(getattr(events, name), dtype) for name, dtype in EVENT_TYPES.items()}
        arrays |= {name: sample.labels[name] for name in EVENTS if name in sample.labels}
        kinds = dict(sample.kinds())
        told: dict[str, Any] = {"camera": camera, "stamp_ns": sample.stamp_ns, "t0_ns": sample.t0_ns}
        told |= {"events": len(events), "first_ns": int(events.t[0]) if len(events) else None}
        told |= {"last_ns": int(events.t[-1]) if len(events) else None, "event_labels": EVENTS[0] in arrays}
        if sample.image is not None:
            told["image"] = {"stamp_ns": sample.image.header.stamp_ns, "exposure_ns": sample.image.exposure_ns}
        self._member(f"{key}.json", json.dumps(told, sort_keys=True).encode())
        self._member(f"{key}.events.npz", _packed(arrays))
        for kind, labels in kinds.items():
            self._member(f"{key}.{kind}.npz", _packed(labels))
        if sample.image is not None:
            self._member(f"{key}.image.png", encoded(np.asarray(sample.image.data), sample.image.encoding))
        if self._tar is not None and self._tar.offset > SHARD_BYTES:
            self._tar.close()
            self._tar = None

    def _member(self, name: str, data: bytes) -> None:
        if self._tar is None:
            self._tar = tarfile.open(self.directory / f"{self._shards:06d}.tar", "w", format=tarfile.USTAR_FORMAT)
            self._shards += 1
        info = tarfile.TarInfo(name)
        info.size = len(data)
        self._tar.addfile(info, io.BytesIO(data))
        self._tar.members.clear()  # type: ignore[attr-defined] # of which it would keep a list as long as the sequence

    def _finish(self) -> None:
        if self._tar is not None:
            self._tar.close()


def _packed(arrays: dict[str, np.ndarray]) -> bytes:
    """A compressed archive for np.load; level 1 takes a sixth of the time of zlib's own, for a tenth more."""
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                npy.write_array(entry, np.ascontiguousarray(array), allow_pickle=False)
    return data.getvalue()
