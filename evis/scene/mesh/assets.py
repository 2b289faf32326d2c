"""What a mesh file names: MTL, pictures, buffers. Imported only for scenes with a mesh file."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from urllib.parse import unquote

from trimesh.resolvers import Resolver

from evis.scene.errors import SceneError
from evis.scene.folders import Folders, first_file
from evis.scene.images.pictures import check_picture
from evis.scene.mesh.wavefront import file_of, in_utf8
from evis.scene.sources import note


class Assets(Resolver):  # type: ignore[misc]
    """Gives trimesh the files that a mesh names, if they lie in the scene's folders and are no larger than allowed.

    trimesh goes on without a file that it does not get; `refusals` has what it was not given.
    """

    def __init__(self, path: Path, folders: Folders, buffers: set[str] | None = None) -> None:
        self.path, self.folders, self.buffers = path, folders, buffers or set()
        self.refusals: list[SceneError] = []
        self.absent: list[str] = []
        """What the file names and is not there, each once."""
        self.parent, self.file_name = str(path.parent), path.name

    def get(self, key: Any) -> bytes:
        """Returns the content of a file. Raises SceneError, or FileNotFoundError where there is none."""
        name = file_of(str(key).strip())
        try:
            path = self.find(name)
            if path is None:
                told = f"names {name}, which is not there"
                self.absent += [] if told in self.absent else [told]
                raise FileNotFoundError(name)
            if path.suffix.lower() == ".mtl":
                return in_utf8(note(path).read_bytes())
            if name not in self.buffers:
                self._check_picture(path, name)
            return note(path).read_bytes()
        except SceneError as error:
            self.refusals.append(error)
            raise

    def find(self, name: str) -> Path | None:
        """Finds the file that a mesh names: as it is written, percent-decoded, or by its last part beside the mesh.

        Raises SceneError for one outside of the folders.
        """
        folder = self.path.parent
        for text in dict.fromkeys((name, unquote(name))):
            found = first_file([folder / text.removeprefix("file://")])
            if found is not None:
                self.folders.check(found, f"{self.path.name}: '{name}'")
                return found
        # A program that wrote the mesh elsewhere left its own folders in the name.
        beside = first_file([folder / Path(unquote(name)).name])
        if beside is not None:
            self.folders.check(beside, f"{self.path.name}: '{name}'")
        return beside

    def _check_picture(self, path: Path, name: str) -> None:
        try:
            check_picture(path)
        except SceneError as error:
            raise SceneError(f"{self.path.name} names {name}, {error}") from None

    def keys(self) -> list[str]:
        """Returns an empty list: the files are not listed."""
        return []

    def write(self, name: str, data: Any) -> None:
        """Refuses to write. Raises NotImplementedError."""
        raise NotImplementedError

    def namespaced(self, namespace: str) -> Assets:
        """Refuses to give a part of the assets, which nothing asks for. Raises NotImplementedError."""
        raise NotImplementedError
