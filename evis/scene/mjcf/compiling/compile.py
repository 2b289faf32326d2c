"""Compiles an MJCF file to MuJoCo's model, and puts what MuJoCo says against a file in one line."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from evis.scene.errors import SceneError
from evis.scene.folders import Folders
from evis.scene.mjcf.compiling.check import check_model
from evis.scene.mjcf.compiling.numbers import check_numbers

Edit = Callable[[Any], None]
"""Changes an MjSpec before it is compiled."""


def compile_mjcf(path: Path, folders: Folders, edits: Sequence[Edit] = ()) -> Any:
    """Compiles an MJCF file to its MjModel, with some edits. Raises SceneError in one line that names the file."""
    check_model(path, folders)
    if edits:
        return compiled(path, lambda: edited(mujoco.MjSpec.from_file(str(path)), edits))
    return compiled(path, lambda: mujoco.MjModel.from_xml_path(str(path)))


def edited(spec: Any, edits: Sequence[Edit]) -> Any:
    """Compiles an MjSpec after some edits."""
    for edit in edits:
        edit(spec)
    return _compile(spec)


def compile_drawn(path: Path, folders: Folders) -> Any:
    """Compiles an MJCF file to the MjModel that is drawn, as `with_textures`. Raises SceneError in one line that names
    the file.
    """
    check_model(path, folders)
    return compiled(path, lambda: with_textures(mujoco.MjSpec.from_file(str(path))))


def with_textures(spec: Any) -> Any:
    """Compiles an MjSpec with the pixels of all its textures, those by reference too, and with the colour spaces that
    it states: MuJoCo's `auto` makes linear of a PNG without an sRGB chunk, whose values its renderer shows as they are.
    """
    model = _compile(spec)
    if (np.asarray(model.tex_adr) < 0).any():
        model = mujoco.mj_embedAssets(model)
    for texture in spec.textures:
        model.tex_colorspace[texture.id] = int(texture.colorspace)
    return model


def _compile(spec: Any) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of an MjSpec they come as Python's, which a user would see
        return spec.compile()


def compiled(path: Path, compile_it: Callable[[], Any]) -> Any:
    """Returns what `compile_it` returns, and turns what MuJoCo raises into a SceneError of one line that names the
    file; as it does for numbers that MuJoCo lets pass and that nothing can be simulated with.
    """
    try:
        model = compile_it()
    except (ValueError, RuntimeError, MemoryError) as error:
        if isinstance(error, SceneError):
            raise
        raise SceneError(f"{path.name}: {in_one_line(error)}") from None
    check_numbers(path.name, model)
    return model


def in_one_line(error: Exception) -> str:
    """Makes one line of what MuJoCo says against a file, with what helps where it does not say so."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    if "unknown exception" in str(error) or not lines:
        lines = ["MuJoCo cannot read it; most likely it needs more memory than there is"]
    if "could not find decoder" in str(error):
        lines.append("MuJoCo knows files by their endings, in small letters: .xml, .obj, .stl, .png and others")
    elif "no decoder found for mesh" in str(error):
        lines.append("MuJoCo reads meshes as .obj and .stl; convert it to one of these")
    return "; ".join(lines)
