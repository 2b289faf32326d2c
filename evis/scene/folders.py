"""Restricts which folders the files of a scene may read from: what a model names must not lead anywhere else.

What the scene file names itself is where its user wants it, and the folder of such a file counts as stated with all
that is below it. What that file names in turn (buffers and pictures of glTF, MTL and its pictures, files of MJCF and
URDF) is somebody else's word, and stays within these folders.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from evis.scene.errors import SceneError


@dataclass(frozen=True)
class Folders:
    """Holds the folders whose files may be read, those below them too.

    home: where the scene file lies. stated: others. bare: the scene is a model by itself, without a scene file.
    """

    home: Path
    stated: tuple[Path, ...] = ()
    bare: bool = False

    def beside(self, file: Path) -> Folders:
        """Returns these folders and the folder of `file`, and of what it is a link to."""
        return self.also(file.absolute().parent, file.resolve().parent)

    def also(self, *folders: Path) -> Folders:
        """Returns these folders and others."""
        return replace(self, stated=(*self.stated, *folders))

    def hold(self, path: Path) -> bool:
        """Tells whether a file, links followed, lies in one of them."""
        real = path.resolve()
        return any(real.is_relative_to(folder.resolve()) for folder in (self.home, *self.stated))

    def check(self, path: Path, what: str) -> None:
        """Raises SceneError for a file outside. what: the file that names it and how, such as `chair.mtl: 'a.png'`."""
        if not self.hold(path):
            raise SceneError(f"{what} is {path.resolve()}, outside of the scene's folders; {self._remedy(path)}")

    def _remedy(self, path: Path) -> str:
        folder = path.resolve().parent
        if self.bare:
            return f"to allow it, give assets:={os.path.relpath(folder)}"
        return f"to allow it, state `assets: [{os.path.relpath(folder, self.home.resolve())}]` in the scene file"


def first_file(candidates: Iterable[Path]) -> Path | None:
    """Returns the first of these files that is there, None where none is."""
    for path in candidates:
        try:
            if path.is_file():
                return path
        except (OSError, ValueError):  # a name that is too long, or has a zero in it
            continue
    return None
