"""Writes DSEC's layout, with DSEC-Det's object detections: a folder as one of DSEC's sequences, for its loaders.

Names and places are those of uzh-rpg/DSEC (scripts/dataset/sequence.py), of https://dsec.ifi.uzh.ch/data-format and of
uzh-rpg/dsec-det (src/dsec_det/directory.py), which looks for frames in the sensor's own pixels in `distorted/`.
"""

from __future__ import annotations

from pathlib import Path
from typing import IO, Any

import numpy as np
import yaml

from evis.bag.export.flow_codes import flow_to_codes
from evis.bag.export.png import encoded
from evis.dataset.layouts import LayoutError
from evis.dataset.layouts.dsec.calibration import calibration
from evis.dataset.layouts.dsec.disparity import disparity_to_codes
from evis.dataset.layouts.dsec.tracks import TRACK, keep_stamps, tracks
from evis.dataset.layouts.npz.growing_npy import GrowingNpy
from evis.dataset.layouts.rectification import Rectification
from evis.dataset.layouts.sample import Sample
from evis.dataset.layouts.stereo_sides import SIDES, sides
from evis.dataset.layouts.writer import SequenceWriter
from evis.events.files.hdf5.dsec_events import EventFile, TooLongError
from evis.files.hdf5_rows import NO_BLOSC, blosc
from evis.files.hdf5_writing import NewFile
from msgs.camera import INTERVAL_FLOWS, Image

FLOW_HEAD = "# from_timestamp_us, to_timestamp_us\n"
EXPOSURE_HEAD = "# exposure_start_timestamp_us, exposure_end_timestamp_us\n"
_HELD = {*INTERVAL_FLOWS, "boxes", "depth"}


class DsecWriter(SequenceWriter):
    """Writes a sequence as DSEC has them.

    Flow, disparity and frames are rectified, as DSEC's are; events and boxes are in the sensor's own pixels.
    """

    LAYOUT = "dsec"

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        about = self.about
        self.sides = sides(dict(about.cameras), about.name)
        self._rectified = {camera: Rectification(info) for camera, info in about.cameras.items()}
        self._files: dict[str, EventFile] = {}
        self._texts: dict[str, IO[str]] = {}
        self._tracks: dict[str, GrowingNpy] = {}
        self._numbers: dict[str, int] = {}
        self._frames_us: list[int] = []
        """Stamps of the left camera's frames."""
        if not blosc():
            self.note(NO_BLOSC)
        for camera, side in self.sides.items():
            (self.directory / "events" / side).mkdir(parents=True, exist_ok=True)
            self._files[camera] = EventFile(self.directory / "events" / side / "events.h5", about.start_ns // 1000)
            with NewFile(self.directory / "events" / side / "rectify_map.h5") as file:
                packed = blosc() or {"compression": "gzip"}
                file.create_dataset("rectify_map", data=self._rectified[camera].map, **packed)
        infos = list(about.cameras.values())
        if any(np.any(np.asarray(info.distortion)[4:]) for info in infos):
            self.note("DSEC's calibration has 4 coefficients of distortion, the lens more: go by rectify_map.h5")
        path = self.directory / "calibration" / "cam_to_cam.yaml"
        path.parent.mkdir()
        path.write_text(yaml.safe_dump(calibration(infos[0], infos[1] if len(infos) > 1 else None)))

    def _add(self, camera: str, sample: Sample) -> None:
        try:
            self._files[camera].add(sample.events)
        except TooLongError as error:
            raise LayoutError(f"{error}; make shorter sequences, or take the layout npz") from None
        first = camera == next(iter(self.about.cameras))
        for kind, arrays in sample.kinds():
            if kind in INTERVAL_FLOWS and first:
                self._flow(kind.removesuffix("_flow"), camera, arrays)
            elif kind == "boxes":
                self._boxes(camera, sample.stamp_ns, arrays["box"], arrays["box_id"])
            elif kind == "depth" and first and len(self.sides) > 1:
                self._disparity(camera, sample.stamp_ns, arrays["depth"])
            elif kind == "depth" and first:
                self.note("DSEC has disparity for depth, which needs a stereo pair: depth is left out")
            elif kind == "flow":
                self.note("DSEC's flow is over an interval, labels forward_flow; flow, in px/s, is left out")
            elif kind not in _HELD:
                self.note(f"DSEC has no {kind}: it is left out")
        if "event_instance" in sample.labels:
            self.note("DSEC has no labels of events: they are left out")
        if sample.image is not None:
            self._image(camera, sample.image)

    def _flow(self, way: str, camera: str, arrays: dict[str, np.ndarray]) -> None:
        rectified = self._rectified[camera]
        start, end = (int(t) // 1000 for t in arrays["flow_t"][:: 1 if way == "forward" else -1])
        if start == end:
            return  # at the start of a run, where no interval ends
        valid = rectified.image(arrays[f"{way}_valid"], 0)
        codes = flow_to_codes(rectified.flow(arrays[f"{way}_flow"]), valid)
        self._png(f"flow/{way}", codes)
        self._line(f"flow/{way}_timestamps.txt", f"{start}, {end}\n", FLOW_HEAD)

    def _disparity(self, camera: str, stamp_ns: int, depth: np.ndarray) -> None:
        right = list(self.about.cameras.values())[1]
        whole = self._rectified[camera].image(depth, np.inf)
        codes = disparity_to_codes(whole, float(self.about.cameras[camera].k[0, 0]) * right.baseline)
        self._png("disparity/event", codes[..., None])
        self._line("disparity/timestamps.txt", f"{stamp_ns // 1000}\n")

    def _boxes(self, camera: str, stamp_ns: int, boxes: np.ndarray, ids: np.ndarray) -> None:
        semantic = self.about.cameras[camera].semantic
        if semantic is not None and len(semantic) and int(np.max(semantic)) > 256:
            raise LayoutError(f"DSEC-Det has 256 classes, {self.about.name} has {int(np.max(semantic))}")
        if camera not in self._tracks:
            path = self.directory / "object_detections" / self.sides[camera] / "tracks.npy"
            path.parent.mkdir(parents=True)
            self._tracks[camera] = GrowingNpy(path, (), TRACK)
        self._tracks[camera].append(tracks(stamp_ns // 1000, boxes, ids, semantic))

    def _image(self, camera: str, image: Image) -> None:
        side, pixels = self.sides[camera], np.asarray(image.data)
        rectified = self._rectified[camera]
        self._png(f"images/{side}/rectified", rectified.image(pixels, 0), image.encoding)
        if not rectified.straight or "boxes" in self.about.labels:
            self._png(f"images/{side}/distorted", pixels, image.encoding)
        middle, half = image.header.stamp_ns, image.exposure_ns // 2
        start, end = (middle - half) // 1000, (middle + half) // 1000
        self._line(f"images/{side}/exposure_timestamps.txt", f"{start}, {end}\n", EXPOSURE_HEAD)
        if side == SIDES[0]:
            self._line("images/timestamps.txt", f"{middle // 1000}\n")
            self._frames_us.append(middle // 1000)

    def _png(self, folder: str, pixels: np.ndarray, encoding: str = "") -> None:
        number = self._numbers.setdefault(folder, 0)
        self._numbers[folder] += 1
        path = self.directory / folder / f"{number:06d}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(encoded(pixels, encoding))

    def _line(self, name: str, line: str, head: str = "") -> None:
        if name not in self._texts:
            self._texts[name] = (self.directory / name).open("w")
            self._texts[name].write(head)
        self._texts[name].write(line)

    def _finish(self) -> None:
        for file in self._files.values():
            file.finish(self.about.start_ns + self.about.duration_ns)
        for text in self._texts.values():
            text.close()
        for camera, rows in self._tracks.items():
            rows.close()
            if self.sides[camera] == SIDES[0] and self._frames_us:
                self._pair_boxes(self.directory / "object_detections" / SIDES[0] / "tracks.npy")

    def _pair_boxes(self, path: Path) -> None:
        """Leaves out boxes without a frame: DSEC-Det's loader counts rows from frame to frame, and would give each
        frame those of another (uzh-rpg/dsec-det, src/dsec_det/preprocessing.py)."""
        stamps, paired = keep_stamps(path, np.array(sorted(self._frames_us)))
        if stamps and not paired:
            self.note(
                "DSEC-Det takes boxes of a frame's own stamp, and here none has one: give exposure_ms, the keyframes' "
                "image_rate, and image_phase_ms of 1000 / image_rate - exposure_ms / 2"
            )
        elif paired < stamps:
            self.note("DSEC-Det takes boxes of a frame's own stamp: those of other stamps are left out")
