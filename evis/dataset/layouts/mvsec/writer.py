"""Writes MVSEC's layout: `<name>_data.hdf5`, `<name>_gt.hdf5`, and its flow as npz; the cameras are davis/left and
right.

Names, types and shapes are those of MVSEC's own converter (daniilidis-group/mvsec, branch mvsec_hdf5,
tools/mvsec_simple_reader/mvsec_h5py.py; tools/gt_flow/compute_flow.py for the archive). The flow at a stamp leads to
the next one, as daniilidis-group/EV-FlowNet reads it (src/eval_utils.py, estimate_corresponding_gt_flow), and is 0
where it is not known, which that leaves out (flow_error_dense).
"""

from __future__ import annotations

from typing import Any

import h5py
import numpy as np

from evis.dataset.layouts import LayoutError
from evis.dataset.layouts.mvsec.event_table import first_row, nanoseconds
from evis.dataset.layouts.npz.archive import pack
from evis.dataset.layouts.npz.growing_npy import GrowingNpy
from evis.dataset.layouts.rectification import Rectification
from evis.dataset.layouts.sample import Sample
from evis.dataset.layouts.stereo_sides import SIDES, sides
from evis.dataset.layouts.writer import SequenceWriter
from evis.files.hdf5_rows import GrowingRows
from evis.files.hdf5_writing import NewFile
from evis.geometry import se3
from evis.media.colour import REC709
from msgs.camera import CameraInfo, Image

FLOW = {"timestamps": (), "x_flow_dist": ("H", "W"), "y_flow_dist": ("H", "W")}
_HELD = {"depth", "poses", "forward_flow"}


class MvsecWriter(SequenceWriter):
    """Writes a sequence as MVSEC has them: times in float64 seconds, polarity -1 or 1, NaN where depth is unknown.

    Events, raw images and flow are in the sensor's own pixels, `depth_image_rect` in rectified ones.
    """

    LAYOUT = "mvsec"

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.sides = sides(dict(self.about.cameras), self.about.name)
        stem = self.directory / self.about.name
        self._data, self._truth = (
            NewFile(f"{stem}_{part}.hdf5", libver=("earliest", "v110")) for part in ("data", "gt")
        )
        self._rectified = {camera: Rectification(info) for camera, info in self.about.cameras.items()}
        self._rows: dict[str, GrowingRows] = {}
        self._flow: dict[str, GrowingNpy] = {}
        self._flow_end = 0.0
        for side in self.sides.values():
            self._grow(self._data, f"davis/{side}/events", np.empty((0, 4)))

    def _add(self, camera: str, sample: Sample) -> None:
        group, e = f"davis/{self.sides[camera]}", sample.events
        seconds = sample.stamp_ns * 1e-9
        rows = np.stack((e.x, e.y, e.t * 1e-9, np.where(e.p > 0, 1.0, -1.0)), 1)
        if sample.image is not None:
            self._image(group, sample.image)
        self._grow(self._data, f"{group}/events", rows)
        for kind, arrays in sample.kinds():
            if kind == "depth":
                known = np.where(np.isfinite(arrays["depth"]), arrays["depth"], np.nan)
                self._stamped(self._truth, f"{group}/depth_image_raw", known.astype(np.float32), seconds)
                rectified = self._rectified[camera].image(known, np.nan)
                self._stamped(self._truth, f"{group}/depth_image_rect", rectified.astype(np.float32), seconds)
            elif kind == "poses" and camera in sample.bodies:
                pose = arrays["pose"][sample.bodies.index(camera)]
                self._stamped(self._truth, f"{group}/pose", matrix(pose), seconds)
            elif kind == "forward_flow" and group.endswith("left"):
                self._add_flow(group, self.about.cameras[camera], arrays)
            elif kind == "flow":
                self.note("MVSEC's flow is over an interval, labels forward_flow; flow, in px/s, is left out")
            elif kind not in _HELD:
                self.note(f"MVSEC has no {kind}: it is left out")
        if "event_instance" in sample.labels:
            self.note("MVSEC has no labels of events: they are left out")

    def _image(self, group: str, image: Image) -> None:
        pixels = np.asarray(image.data)
        if pixels.shape[-1] == 3:
            self.note("MVSEC has grey images: colour is left out")
            pixels = np.rint(pixels @ np.array(REC709)).astype(pixels.dtype)[..., None]
        self._stamped(self._data, f"{group}/image_raw", pixels[..., 0], image.header.stamp_ns * 1e-9)

    def _stamped(self, file: NewFile, name: str, array: np.ndarray, seconds: float) -> None:
        self._grow(file, name, array[None])
        self._grow(file, f"{name}_ts", np.array([seconds]))

    def _grow(self, file: NewFile, name: str, rows: np.ndarray) -> None:
        if name not in self._rows:
            self._rows[name] = GrowingRows(
                file, name, rows.shape[1:], rows.dtype, compression="gzip", compression_opts=1
            )
        self._rows[name].add(rows)
        file.check()

    def _add_flow(self, group: str, info: CameraInfo, arrays: dict[str, np.ndarray]) -> None:
        start, end = (int(t) for t in arrays["flow_t"])
        if start == end:
            return  # at the start of a run, where no interval ends
        if self._flow and start * 1e-9 != self._flow_end:
            raise LayoutError("MVSEC's flow goes on from where it ended; take labels with flow_from 0 and flow_to 1")
        known = (arrays["forward_valid"][..., None] > 0) & np.isfinite(arrays["forward_flow"])
        flow = np.where(known, arrays["forward_flow"], 0.0).astype(np.float64)
        if bool((known.all(-1) & (flow == 0).all(-1)).any()):
            self.note("MVSEC's flow is 0 where it is unknown: what stands still is not told from it")
        self._flow_rows(group, info, start * 1e-9, flow)
        self._flow_end = end * 1e-9

    def _flow_rows(self, group: str, info: CameraInfo, seconds: float, flow: np.ndarray) -> None:
        self._stamped(self._truth, f"{group}/flow_dist", flow.transpose(2, 0, 1), seconds)
        sizes = {"H": info.height, "W": info.width}
        for name, array in zip(FLOW, (np.array(seconds), flow[..., 0], flow[..., 1])):
            if name not in self._flow:
                shape = tuple(sizes[d] for d in FLOW[name])
                self._flow[name] = GrowingNpy(self.directory / f"{name}.part.npy", shape, np.dtype(np.float64))
            self._flow[name].append(array[None])

    def _finish(self) -> None:
        if self._flow:
            # The last displacement ends at a stamp of its own, of which there is no displacement.
            info = next(iter(self.about.cameras.values()))
            self._flow_rows(f"davis/{SIDES[0]}", info, self._flow_end, np.zeros((info.height, info.width, 2)))
            for file in self._flow.values():
                file.close()
            parts = {name: self.directory / f"{name}.part.npy" for name in FLOW}
            pack(self.directory / f"{self.about.name}_gt_flow_dist.npz", parts)
        for rows in self._rows.values():
            rows.flush()
        for side in self.sides.values():
            self._index_images(self._data[f"davis/{side}"])
        self._data.close()
        self._truth.close()

    def _index_images(self, group: h5py.Group) -> None:
        """Finds the last event before each image, as MVSEC's converter does."""
        if "image_raw_ts" in group:
            stamps = nanoseconds(group["image_raw_ts"][:]).tolist()
            before = [max(first_row(group["events"], stamp) - 1, 0) for stamp in stamps]
            group["image_raw_event_inds"] = np.array(before, np.int64)


def matrix(pose: np.ndarray) -> np.ndarray:
    """Returns the transform float64 [4, 4] of a pose [7] (p, q xyzw)."""
    corners = se3.transform(pose, np.concatenate((np.eye(3), np.zeros((1, 3)))))
    whole = np.eye(4)
    whole[:3, :3], whole[:3, 3] = (corners[:3] - corners[3]).T, corners[3]
    return whole
