"""Lists what a folder of pictures or meshes holds, by file name, and whether it can be used."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from evis.scene.errors import SceneError
from evis.scene.sources import note


@dataclass(frozen=True)
class Kind:
    """Describes what a folder is to hold. name, names: of one and of several; endings: of the files that count."""

    name: str
    names: str
    endings: tuple[str, ...]


PICTURES = Kind("picture", "pictures", (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr"))
MESHES = Kind("mesh", "meshes", (".obj", ".stl", ".ply", ".gltf", ".glb"))
KINDS = {"texture": PICTURES, "shape": MESHES}
"""By what of a scene they take the place of."""


def files_of(folder: Path, kind: Kind) -> list[Path]:
    """Lists the files of a folder that count, by name; others are left alone, as what meshes name in turn is.

    Raises SceneError for a folder that is not there, or holds none; the caller puts the place before it.
    """
    if not folder.is_dir():
        what = "is no folder" if folder.exists() else "is not there"
        raise SceneError(f"names the folder {folder}, which {what}; name a folder of {kind.names}, or leave it empty")
    note(folder)  # its time changes when a file comes or goes
    found = [path for path in folder.iterdir() if _counts(path, kind)]
    if not found:
        endings = ", ".join(kind.endings)
        raise SceneError(f"names the folder {folder}, which holds no {kind.name}: none of its files ends in {endings}")
    return sorted(found, key=lambda path: path.name)


def _counts(path: Path, kind: Kind) -> bool:
    return path.suffix.lower() in kind.endings and not path.name.startswith(".") and path.is_file()
