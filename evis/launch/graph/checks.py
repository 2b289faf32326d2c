"""Checks that files which parameters name exist, before a process starts."""

from __future__ import annotations

import os
import re
from pathlib import Path

from evis.bag import BagError
from evis.bag.mcap.path_checks import check_name, refusal
from evis.config.document import LaunchError
from evis.config.params import ParamError
from evis.config.suggestions import closest
from evis.files.whole_file import written_at
from evis.launch.arguments import ArgumentError
from evis.launch.graph.wiring import WiredNode


def check_files(node: WiredNode) -> None:
    """Checks that `scene` with its `scene_args`, `file`, `bag` and `emulate` exist, and that the `path` of a recorder,
    or of another node without outputs, is writable.

    Raises LaunchError naming node, file and remedy, ArgumentError for what a user gave.
    """
    where = f"{node.spec.where}: '{node.name}'"
    for key in ("file", "bag", "emulate"):
        value = node.params.get(key)
        if key == "emulate" and isinstance(value, str) and not (os.sep in value or "." in value):
            continue  # a camera model and no recording
        if isinstance(value, str) and value and not Path(value).exists():
            raise LaunchError(f"{where}: no {key} '{value}'{_beside(Path(value))}")
    _check_device(node)
    if isinstance(node.params.get("scene"), str):
        _check_scene(node, where)
    target = node.params.get("path")
    if isinstance(target, str) and target and not node.outputs:
        check = check_bag if node.target.endswith(":RecorderNode") else check_writable
        check(Path(target), where)


def _check_scene(node: WiredNode, where: str) -> None:
    from evis.scene.load import parse_args, scene_values

    try:
        scene_values(node.params["scene"], parse_args(node.params.get("scene_args")))
    except (ParamError, FileNotFoundError) as error:
        raise ArgumentError(str(error)) from None
    except (ValueError, OSError) as error:
        raise LaunchError(f"{where}: {error}") from None


def _check_device(node: WiredNode) -> None:
    """Checks that a name can be that of a device; whether that is there its kernels alone can say."""
    device = node.params.get("device")
    if isinstance(device, str) and not re.fullmatch(r"cpu|cuda(:\d{1,3})?", device):
        raise ArgumentError(f"device is '{device}', must be cpu, cuda or cuda:N")


def check_bag(path: Path, where: str) -> None:
    """Raises LaunchError unless a bag can be recorded at `path`."""
    try:
        check_name(path)
    except BagError as error:
        raise LaunchError(f"{where}: {error}") from None
    check_writable(path, where)
    place = written_at(path)
    if place.is_file() and not os.access(place.parent, os.W_OK):  # where an older bag is put aside
        raise LaunchError(f"{where} cannot write '{path}': {refusal(place.parent)}")


def check_writable(path: Path, where: str) -> None:
    """Raises LaunchError unless a file can be written at `path`."""
    place = written_at(path)
    folder = place.parent
    if path.is_dir():
        raise LaunchError(f"{where} cannot write '{path}': it is a folder; name a file such as {path / 'a.mcap'}")
    if not folder.is_dir():
        raise LaunchError(f"{where} cannot write '{path}': there is no folder '{folder}'")
    needed = place if place.exists() else folder
    if not os.access(needed, os.W_OK):
        raise LaunchError(f"{where} cannot write '{path}': {refusal(needed)}")


def _beside(path: Path) -> str:
    """Suggests a file of the same folder."""
    if not path.parent.is_dir():
        return f"; there is no folder '{path.parent}'"
    near = closest(path.name, (p.name for p in path.parent.iterdir()))
    return f"; did you mean '{path.with_name(near)}'?" if near else ""
