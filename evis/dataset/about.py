"""Holds what is known of a sequence, beside its events and labels, and how it is kept in its folder."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from evis.dataset.names import below
from evis.events.pixel_limit import check_pixels
from evis.files.allowance import AllowanceError
from evis.files.json_text import parsed
from evis.files.regular import check_file
from evis.files.whole_file import whole_file
from msgs.camera import CameraInfo
from msgs.fields import array_specs
from msgs.header import Header

FILE = "about.json"
"""In the folder of every sequence, of any layout."""
FORMAT = 1
_KINDS = {
    "name": str, "scene": str, "arguments": dict, "seed": int, "duration_ns": int, "start_ns": int, "layout": str,
    "counts": dict,
}  # fmt: skip


@dataclass(frozen=True)
class About:
    """Describes one sequence.

    arguments: of the scene and of the launch file. duration_ns: its length, from start_ns on. keyframe_rate: labels per
    second [Hz]. cameras: by name, the first one first. labels: kinds that were asked for. start_ns: time of its start;
    every event is later. bodies: names of those that poses and velocities are of, once a writer has seen them. layout:
    in which it was written. counts: events of each camera, once they are written.
    """

    name: str
    scene: str
    arguments: Mapping[str, Any]
    seed: int
    duration_ns: int
    keyframe_rate: float
    cameras: Mapping[str, CameraInfo]
    labels: tuple[str, ...] = ()
    start_ns: int = 0
    bodies: tuple[str, ...] = field(default=())
    layout: str = ""
    counts: Mapping[str, int] = field(default_factory=dict)

    def save(self, directory: Path) -> None:
        """Writes it into a folder, with its keys in order, so that equal sequences have equal files."""
        whole = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        whole |= {"format": FORMAT, "cameras": [_plain(name, info) for name, info in self.cameras.items()]}
        text = json.dumps(whole, indent=1, sort_keys=True, default=_as_text)
        with whole_file(directory / FILE) as partial:
            partial.write_text(text + "\n")

    @staticmethod
    def load(directory: Path) -> About:
        """Reads it from a folder. Raises ValueError with one line for a folder without it, or one of another format."""
        path = directory / FILE
        check_file(path)
        try:
            whole = parsed(path.read_text())
            if not isinstance(whole, dict):
                raise ValueError("it is no map")
            if whole.pop("format") != FORMAT:
                raise ValueError("another version of evis wrote it")
            cameras = dict(_camera(about) for about in whole.pop("cameras"))
            whole |= {name: tuple(whole[name]) for name in ("labels", "bodies")}
            about = About(**whole, cameras=cameras)
            about._check()
            return about
        except FileNotFoundError:
            raise ValueError(f"{directory} is no sequence that evis wrote: it has no {FILE}") from None
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"{path} cannot be read ({error}); make the sequence anew") from None

    def _check(self) -> None:
        """Raises ValueError for values that no sequence has, and for names that lead out of the folder."""
        for name, kind in _KINDS.items():
            if type(value := getattr(self, name)) is not kind:
                raise ValueError(f"its {name} is {value!r:.80}")
        end_ns = self.start_ns + self.duration_ns
        if self.duration_ns < 0 or max(abs(self.start_ns), abs(end_ns)) >= 1 << 63:
            raise ValueError(f"it lasts from {self.start_ns} to {end_ns} ns")
        self.check_names()

    def check_names(self) -> None:
        """Raises ValueError where the name of the sequence or of a camera, as files have, leads out of its folder."""
        for name in filter(None, (self.name, *self.cameras)):
            below(name)


def _plain(name: str, info: CameraInfo) -> dict[str, Any]:
    """A camera's description in JSON's types."""
    arrays = {key: np.asarray(array).tolist() for key, array in info.arrays().items()}
    return {**info.scalars(), **arrays, "name": name}


def _camera(plain: dict[str, Any]) -> tuple[str, CameraInfo]:
    specs = array_specs(CameraInfo)
    values: dict[str, Any] = {k: np.array(v, specs[k].dtypes[0]) if k in specs else v for k, v in plain.items()}
    info = CameraInfo(Header(0), **values)
    info.check()
    try:
        check_pixels(info.width, info.height)
    except AllowanceError:
        raise ValueError(f"its camera {info.name} has {info.width} x {info.height} pixels") from None
    return info.name, info


def _as_text(value: Any) -> Any:
    """Numbers of numpy as Python's; anything else that JSON does not know by its text."""
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else str(value)
