"""Reads what a mesh file names: MTL, pictures, buffers. Imported only for scenes with a mesh file."""

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

LIBRARIES = "all libraries"
"""By which trimesh, which reads one MTL, asks for all that an OBJ names, as one."""


class Assets(Resolver):  # type: ignore[misc]
    """Gives trimesh the files that a mesh names, if they lie in the scene's folders and are no larger than allowed.

    trimesh goes on without a file that it does not get; `refusals` has what it was not given.
    """

    def __init__(self, path: Path, folders: Folders, buffers: set[str] | None = None) -> None:
        self.path, self.folders, self.buffers = path, folders, buffers or set()
        self.refusals: list[SceneError] = []
        self.absent: list[str] = []
        """What the file names and is not there, each once."""
        self.libraries: list[str] = []
        """What an OBJ names as its MTL, a text for each line: a file, or several."""
        self._beside = [path.parent]
        self.parent, self.file_name = str(path.parent), path.name

    def get(self, key: Any) -> bytes:
        """Returns the content of a file. Raises SceneError, or FileNotFoundError where there is none."""
        if key == LIBRARIES:
            return self._libraries()
        name = file_of(str(key).strip())
        try:
            path = self._there(name)
            if name not in self.buffers:
                self._check_picture(path, name)
            return note(path).read_bytes()
        except SceneError as error:
            self.refusals.append(error)
            raise

    def _there(self, name: str) -> Path:
        path = self.find(name)
        if path is None and name in self.buffers:
            told = f"names {name} for its numbers, which is not there; keep that file beside it"
            raise SceneError(f"{self.path.name} {told}")
        if path is None:
            told = f"names {name}, which is not there"
            self.absent += [] if told in self.absent else [told]
            raise FileNotFoundError(name)
        return path

    def _libraries(self) -> bytes:
        """All MTL of an OBJ as one. What several define is that of the first, and trimesh takes the last."""
        read = []
        try:
            for text in self.libraries:
                for name in [text] if self.find(text) is not None else text.split():
                    try:
                        path = self._there(name)
                    except FileNotFoundError:
                        continue
                    self._beside += [] if path.parent in self._beside else [path.parent]
                    read.append(in_utf8(note(path).read_bytes().removeprefix(b"\xef\xbb\xbf")))
        except SceneError as error:
            self.refusals.append(error)
            raise
        return b"\n".join(reversed(read))

    def find(self, name: str) -> Path | None:
        """Finds the file that a mesh names: as it is written, percent-decoded, or by its last part, beside the mesh and
        beside its MTL.

        Raises SceneError for one outside of the folders.
        """
        for text in dict.fromkeys((name, unquote(name))):
            found = first_file([folder / text.removeprefix("file://") for folder in self._beside])
            if found is not None:
                self.folders.check(found, f"{self.path.name}: '{name}'")
                return found
        # A program that wrote the mesh elsewhere left its own folders in the name.
        beside = first_file([folder / Path(unquote(name)).name for folder in self._beside])
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
