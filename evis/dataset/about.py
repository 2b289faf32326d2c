"""Holds what is known of a sequence, beside its events and labels, and how it is kept in its folder."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from evis.files.whole_file import whole_file
from msgs.camera import CameraInfo
from msgs.fields import array_specs
from msgs.header import Header

FILE = "about.json"
"""In the folder of every sequence, of any layout."""
FORMAT = 1


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
        try:
            whole = json.loads(path.read_text())
            if whole.pop("format") != FORMAT:
                raise ValueError("another version of evis wrote it")
            cameras = dict(_camera(about) for about in whole.pop("cameras"))
            whole |= {name: tuple(whole[name]) for name in ("labels", "bodies")}
            return About(**whole, cameras=cameras)
        except FileNotFoundError:
            raise ValueError(f"{directory} is no sequence that evis wrote: it has no {FILE}") from None
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"{path} cannot be read ({error}); make the sequence anew") from None


def _plain(name: str, info: CameraInfo) -> dict[str, Any]:
    """A camera's description in JSON's types."""
    arrays = {key: np.asarray(array).tolist() for key, array in info.arrays().items()}
    return {**info.scalars(), **arrays, "name": name}


def _camera(plain: dict[str, Any]) -> tuple[str, CameraInfo]:
    specs = array_specs(CameraInfo)
    values: dict[str, Any] = {k: np.array(v, specs[k].dtypes[0]) if k in specs else v for k, v in plain.items()}
    return plain["name"], CameraInfo(Header(0), **values)


def _as_text(value: Any) -> Any:
    """Numbers of numpy as Python's; anything else that JSON does not know by its text."""
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else str(value)
