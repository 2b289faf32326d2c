"""Resolves `folder:` of a texture or a shape: a file of the user's takes its place, drawn by the seed."""

from __future__ import annotations

from pathlib import Path

from evis.scene.draws import Choice
from evis.scene.errors import SceneError
from evis.scene.own.folder import KINDS, files_of
from evis.scene.yaml.reader import Fields


def drawn_file(fields: Fields, of: str, home: Path) -> Path | None:
    """Draws a file of the folder that an entry names; None where it names none, or \"\".

    Args:
        of: `texture` or `shape`.
        home: the scene's folder, from where the other begins.

    Raises SceneError for a folder without files that can be used.
    """
    name = fields.text("folder", "")
    if not name:
        return None
    try:
        files = files_of(home / Path(name).expanduser(), KINDS[of])
    except SceneError as error:
        raise fields.error("folder", str(error)) from None
    if fields.draws is None:
        raise fields.error("folder", "is drawn from; what stands here must be the same in every world")
    chosen = fields.draws.value(fields.within("folder"), Choice(tuple(path.name for path in files)))
    return home / Path(name).expanduser() / chosen
