"""Reads a sequence in DSEC's layout."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from evis.bag.export.flow_codes import codes_to_flow
from evis.dataset.layouts import LayoutError
from evis.dataset.layouts.dsec.disparity import codes_to_disparity
from evis.dataset.layouts.dsec.tracks import boxes_of
from evis.dataset.layouts.hdf5_reading import dataset, opened
from evis.dataset.layouts.reader import ANEW, EventArrays, SequenceReader, framed, spans, within
from evis.dataset.layouts.stereo_sides import SIDES, sides
from evis.events.files.hdf5.millisecond_index import NAME
from evis.files.damage import error_text
from evis.files.regular import check_file
from evis.media.frames.images import codes
from msgs.camera import INTERVAL_FLOWS

_LAST_US = (1 << 32) - 1


class DsecReader(SequenceReader):
    """Reads events by ms_to_idx, and labels as DSEC has them: `disparity` [T, H, W] px is NaN where it is unknown.

    Times are whole us, in ns.
    """

    LAYOUT = "dsec"

    def __init__(self, directory: Path) -> None:
        super().__init__(directory)
        self._indices: dict[str, np.ndarray] = {}
        self._sides = sides(dict(self.cameras), self.about.name)

    def _kinds(self, camera: str) -> tuple[str, ...]:
        side = self._sides[camera]
        places = {f"{way}_flow": f"flow/{way}_timestamps.txt" for way in ("forward", "backward") if side == "left"}
        places |= {"disparity": "disparity/timestamps.txt"} if side == "left" else {}
        places |= {"boxes": f"object_detections/{side}/tracks.npy"}
        places |= {"image": f"images/{side}/exposure_timestamps.txt"}
        return tuple(kind for kind, place in places.items() if (self.directory / place).exists())

    def _file(self, camera: str) -> h5py.File:
        return opened(self.directory / "events" / self._sides[camera] / "events.h5")

    def _count_of(self, camera: str) -> int:
        return int(dataset(self._file(camera), "events/t").shape[0])

    def _index(self, camera: str) -> np.ndarray:
        """ms_to_idx, kept."""
        if camera not in self._indices:
            self._indices[camera] = dataset(self._file(camera), NAME)[:]
        return self._indices[camera]

    def _events(self, t0: int, t1: int, camera: str) -> EventArrays:
        file, index = self._file(camera), self._index(camera)
        offset, t = int(dataset(file, "t_offset")[()]), dataset(file, "events/t")
        count, marks = t.shape[0], len(index)
        first, end = (-(-limit // 1000) - offset for limit in (t0, t1))  # us from the start, rounded up
        low = 0 if first < 0 else int(index[first // 1000]) if first // 1000 < marks else count
        high = 0 if end < 0 else int(index[-(-end // 1000)]) if -(-end // 1000) < marks else count
        times = t[low : max(low, high)]
        limits = np.array([first, end]).clip(0, _LAST_US).astype(times.dtype)
        part = slice(*np.searchsorted(times, limits).tolist())
        rows = slice(low + part.start, low + max(part.start, part.stop))
        found: list[Any] = [dataset(file, f"events/{name}")[rows] for name in "xyp"]
        return EventArrays(_ns(times[part], offset), *found)

    def _rows(self, first: int, end: int, camera: str) -> EventArrays:
        file = self._file(camera)
        found: list[Any] = [dataset(file, f"events/{name}")[first:end] for name in "xyp"]
        return EventArrays(_ns(dataset(file, "events/t")[first:end], int(dataset(file, "t_offset")[()])), *found)

    def _intervals(self, kind: str, camera: str) -> np.ndarray:
        if kind in INTERVAL_FLOWS:
            return np.sort(self._times_of(f"flow/{kind.removesuffix('_flow')}_timestamps.txt", 2), 1)
        if kind == "disparity":
            return spans(self._times_of("disparity/timestamps.txt", 1)[:, 0], None)
        if kind == "image":
            return spans(self._exposed(self._sides[camera])[0], None)
        return super()._intervals(kind, camera)

    def _labels(self, kind: str, t0: int, t1: int, camera: str) -> dict[str, np.ndarray]:
        side = self._sides[camera]
        if kind == "boxes":
            tracks = self.directory / "object_detections" / side / "tracks.npy"
            check_file(tracks)
            rows = np.load(tracks, mmap_mode="r")
            return boxes_of(rows[within(rows["t"].astype(np.int64) * 1000, t0, t1)])
        if kind in INTERVAL_FLOWS:
            way = kind.removesuffix("_flow")
            times = self._times_of(f"flow/{way}_timestamps.txt", 2)
            part, images = self._images(f"flow/{way}", times.max(1), t0, t1)
            pairs = [codes_to_flow(image) for image in images]
            ends = np.sort(times[part], 1)
            flow, valid = (_stack([pair[i] for pair in pairs], part) for i in range(2))
            return {"t": ends[:, 1], "flow_t": ends, kind: flow, f"{way}_valid": valid}
        if kind == "disparity":
            stamps = self._times_of("disparity/timestamps.txt", 1)[:, 0]
            part, images = self._images("disparity/event", stamps, t0, t1)
            return {"t": stamps[part], kind: _stack([codes_to_disparity(image) for image in images], part)}
        stamps, exposures = self._exposed(side)
        part, images = self._images(f"images/{side}/rectified", stamps, t0, t1)
        return {"t": stamps[part], kind: framed(_stack(images, part)), "exposure_ns": exposures[part]}

    def _exposed(self, side: str) -> tuple[np.ndarray, np.ndarray]:
        """The stamps of a side's frames and their exposures, ns. Those of images/timestamps.txt are of the left
        camera: the right one exposes for itself, and is stamped with the middle of it."""
        spans_ns = self._times_of(f"images/{side}/exposure_timestamps.txt", 2)
        exposures = spans_ns[:, 1] - spans_ns[:, 0]
        if side != SIDES[0]:
            return spans_ns.sum(1) // 2000 * 1000, exposures
        stamps = self._times_of("images/timestamps.txt", 1)[:, 0]
        if len(exposures) != len(stamps):
            raise LayoutError(
                f"{self.directory}/images has {len(stamps)} times, and {len(exposures)} exposures; {ANEW}"
            )
        return stamps, exposures

    def _times_of(self, name: str, columns: int) -> np.ndarray:
        """The times of a text [T, columns], ns. Raises LayoutError unless all its lines are there."""
        check_file(self.directory / name)
        text = (self.directory / name).read_text()
        rows = [line.split(",") for line in text.splitlines() if not line.startswith("#")]
        if not text.endswith("\n") or any(len(row) != columns for row in rows):
            raise LayoutError(f"{self.directory / name} ends early; {ANEW}")
        return np.array(rows, np.int64).reshape(-1, columns) * 1000

    def _images(self, folder: str, stamps: np.ndarray, t0: int, t1: int) -> tuple[slice, list[np.ndarray]]:
        """Which images are of [t0, t1), and these; where none are, the first, which tells the shape of none."""
        part = within(stamps, t0, t1)
        if (self.directory / folder / f"{len(stamps):06d}.png").exists():
            raise LayoutError(f"{self.directory / folder} has more images than there are times of them; {ANEW}")
        numbers = range(part.start, part.stop) or range(min(1, len(stamps)))
        return part, [picture(self.directory / folder / f"{k:06d}.png") for k in numbers]


def picture(path: Path) -> np.ndarray:
    """Reads a PNG file, uint8 or uint16 [H, W] or [H, W, 3]. Raises LayoutError."""
    check_file(path)
    try:
        return codes(path.read_bytes())
    except Exception as error:  # Pillow has errors of many kinds for damaged files
        raise LayoutError(f"{path} cannot be read ({error_text(error, 150)}); {ANEW}") from error


def _ns(t: np.ndarray, offset_us: int) -> np.ndarray:
    """Times of uint32 us in ns."""
    found = t.astype(np.int64)
    found += offset_us
    found *= 1000
    return found


def _stack(images: list[np.ndarray], part: slice) -> np.ndarray:
    return np.stack(images)[: part.stop - part.start] if images else np.empty((0, 0, 0), np.float32)
