"""Checks what a MuJoCo model or URDF asks for, before MuJoCo reads it: which files, how many parts, how much memory.

MuJoCo itself reads whatever file is named, makes as many copies as are asked for, and ends the process where a model
attaches itself.
"""

from __future__ import annotations

import itertools
import math
import struct
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from evis.files.allowance import Allowance, AllowanceError
from evis.files.regular import other_than_file
from evis.scene.errors import SceneError
from evis.scene.folders import Folders
from evis.scene.images.pictures import TEXEL, check_picture, check_size
from evis.scene.mjcf.compiling.asset_cache import refresh_cache
from evis.scene.mjcf.compiling.xml import Element, read_xml
from evis.scene.sources import note

MAX_MADE = 30_000
"""Most elements that replicate, composite, flexcomp and attach make; MuJoCo takes 17 s for as many, and four times as
long for twice as many."""
MAX_FILES = 1000
"""Most files of XML that a model is made of."""
MAX_NUMBER = 10_000_000
"""Largest number that says how many of something there are, of those that are not told apart below."""
MAX_VERTICES = 1_000_000
"""Most vertices of a mesh made by MuJoCo, which looks for their convex hull."""
ARRAYS = 2 << 30
"""Memory for what a few letters ask for, height fields and textures made by code [bytes]."""
CELL = 400
"""Bytes of a sample of a height field, as the two triangles that are drawn, and what is made on the way."""
_COUNTS = (
    "nkey", "nuserdata", "nuser_body", "nuser_jnt", "nuser_geom", "nuser_site", "nuser_cam", "nuser_tendon",
    "nuser_actuator", "nuser_sensor", "njmax", "nconmax", "nstack", "dim", "num", "nsample", "actdim", "size",
)  # fmt: skip
_FILES = ("file", "fileright", "fileleft", "fileup", "filedown", "filefront", "fileback", "filename")
_TEXTURES, _MESHES = ("texturedir", "assetdir"), ("meshdir", "assetdir")
_PICTURES = (b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"BM", b"GIF8")


def check_model(path: Path, folders: Folders) -> None:
    """Refuses a model that reads files outside of `folders`, or asks for more parts or memory than is allowed.

    Raises SceneError with file and line. What is merely wrong is left to MuJoCo.
    """
    _Checker(folders).model(path, ())


class _Checker:
    def __init__(self, folders: Folders) -> None:
        self.folders = folders
        self.allowance = Allowance(0, base=ARRAYS)
        self.files = 0
        self.sizes: dict[Path, int] = {}

    def model(self, path: Path, above: tuple[Path, ...]) -> int:
        """Checks a model file with all that it includes and attaches. Returns how many elements it makes.

        above: the models that lead to this one.
        """
        real = path.resolve()
        if real in self.sizes:
            return self.sizes[real]
        root = self._read(path)
        self._include(root, path.parent, {real})
        elements = [element for element, _ in _walk(root)]
        attached: dict[str, int] = {}
        for element in elements:
            if element.tag == "model" and "file" in element.attributes:
                for found in self._found(element, element.attributes["file"], [path.parent, element.file.parent]):
                    if found.resolve() in (*above, real):
                        raise SceneError(f"{element.where}: {found.name} is a part of itself")
                    name = element.attributes.get("name", found.stem)
                    attached[name] = max(attached.get(name, 0), self.model(found, (*above, real)))
        dirs = {
            key: [e.attributes[key] for e in elements if e.tag == "compiler" and key in e.attributes]
            for key in ("meshdir", "texturedir", "assetdir")
        }
        for element in elements:
            self._files(element, path.parent, dirs)
            self._arrays(element)
        made = sum(times for _, times in _walk(root, attached))
        if made - len(elements) > MAX_MADE:
            worst = max(elements, key=lambda e: _copies(e, attached))
            raise SceneError(
                f"{worst.where}: `{worst.tag}` and the like make {made} elements of {len(elements)}; "
                f"the most is {MAX_MADE} more than are written"
            )
        self.sizes[real] = made
        return made

    def _read(self, path: Path) -> Element:
        self.files += 1
        if self.files > MAX_FILES:
            raise SceneError(f"{path.name}: the model is made of more than {MAX_FILES} files")
        try:
            self.allowance.read += path.stat().st_size
            return read_xml(path)
        except OSError as error:
            raise SceneError(f"{path.name}: cannot be read: {error.strerror}") from None

    def _include(self, root: Element, main: Path, seen: set[Path]) -> None:
        """Put what included files hold below the elements that name them; a file twice is an error of MuJoCo's."""
        left = [root]
        while left:
            element = left.pop()
            if element.tag == "include" and "file" in element.attributes:
                for found in self._found(element, element.attributes["file"], [main, element.file.parent]):
                    if found.resolve() not in seen:
                        seen.add(found.resolve())
                        element.children += self._read(found).children
            left += element.children

    def _found(self, element: Element, name: str, places: list[Path]) -> list[Path]:
        """The files that a name may mean. Raises SceneError where one of them is outside of the folders, or a pipe or a
        device, of which MuJoCo would wait for the end."""
        found: list[Path] = []
        for place in dict.fromkeys(places):
            path = place / name
            if not path.is_dir() and (what := other_than_file(path)):
                raise SceneError(f"{element.where}: '{name}' is {what}, and must be a file")
            if path.is_file() and path.resolve() not in [p.resolve() for p in found]:
                self.folders.check(path, f"{element.where}: '{name}'")
                found.append(refresh_cache(note(path)))
        return found

    def _files(self, element: Element, main: Path, dirs: dict[str, list[str]]) -> None:
        if element.tag in ("include", "model"):
            return
        for key in _FILES:
            name = element.attributes.get(key)
            if not name or "://" in name:  # URDF's are resolved, and checked, before MuJoCo sees them
                continue
            kinds = _TEXTURES if element.tag == "texture" else _MESHES
            below = [d for kind in kinds for d in dirs[kind]]
            bases = dict.fromkeys((main, element.file.parent))
            places = [base / d for base, d in itertools.product(bases, below or [""])]
            for found in [*self._found(element, name, places), *self._found(element, Path(name).name, places)]:
                self._content(element, found)

    def _content(self, element: Element, path: Path) -> None:
        """Check the size that a picture or height field says it has."""
        if element.tag not in ("texture", "hfield"):
            return
        with path.open("rb") as file:
            head = file.read(8)
        if not head.startswith(_PICTURES):
            if element.tag == "hfield" and len(head) == 8:  # rows and columns, then as many float32
                rows, columns = struct.unpack("<ii", head)
                self._take(element, max(0, rows) * max(0, columns) * CELL, f"{rows} x {columns} samples of {path.name}")
            return
        try:
            check_picture(path)
        except SceneError as error:
            raise SceneError(f"{element.where}: names {path.name}, {error}") from None

    def _arrays(self, element: Element) -> None:
        """Numbers that MuJoCo makes arrays of."""
        number = _whole(element)
        if element.tag == "hfield":
            rows, columns = number("nrow"), number("ncol")
            self._take(element, rows * columns * CELL, f"{rows} x {columns} samples")
        elif element.tag == "texture" and "builtin" in element.attributes:
            width, height = number("width"), number("height")
            if element.attributes.get("type", "cube") != "2d":
                height = 6 * width
            if width * height:
                try:
                    check_size(width, height, 1 << 30)
                except SceneError as error:
                    raise SceneError(f"{element.where}: is a texture {error}") from None
                self._take(element, width * height * TEXEL, f"a texture of {width} x {height} px")
        elif element.tag == "mesh" and "builtin" in element.attributes:
            params = [_int(v) for v in element.attributes.get("params", "").split()]
            flat = element.attributes["builtin"] in ("wedge", "plate")
            sides = params[:2] if flat else params[:1] * (2 if element.attributes["builtin"].startswith("super") else 1)
            if math.prod(sides) > MAX_VERTICES:
                raise SceneError(f"{element.where}: a mesh of {math.prod(sides)} vertices; the most is {MAX_VERTICES}")
        elif element.tag == "camera" and "resolution" in element.attributes:
            width, height = ([_int(v) for v in element.attributes["resolution"].split()] + [1, 1])[:2]
            if width * height > MAX_NUMBER:
                raise SceneError(f"{element.where}: a resolution of {width} x {height}; the most is {MAX_NUMBER} px")
        for key in _COUNTS:
            if key != "size" or element.tag == "numeric":
                if number(key) > MAX_NUMBER:
                    raise SceneError(f"{element.where}: {key} is {number(key)}; the most is {MAX_NUMBER}")

    def _take(self, element: Element, size: int, what: str) -> None:
        try:
            self.allowance.take(size)
        except AllowanceError as error:
            raise SceneError(f"{element.where}: {what}: {error}") from None


def _walk(root: Element, attached: Mapping[str, int] | None = None) -> Iterator[tuple[Element, int]]:
    """All elements below one, each with how often it is made."""
    left = [(root, 1)]
    while left:
        element, times = left.pop()
        if element is not root:
            inside = times * _copies(element, attached or {})
            yield element, times if element.tag == "replicate" else inside
            times = inside
        left += [(child, times) for child in reversed(element.children)]


def _copies(element: Element, attached: Mapping[str, int]) -> int:
    """How many times an element and what is below it is made."""
    if element.tag == "replicate":
        return max(1, _int(element.attributes.get("count", "1")))
    if element.tag in ("composite", "flexcomp"):
        counts = (element.attributes.get(key, "1") for key in ("count", "cellcount"))
        return max(1, *(math.prod(max(1, _int(v)) for v in count.split()) for count in counts))
    if element.tag == "attach":
        return max(1, attached.get(element.attributes.get("model", ""), 1))
    return 1


def _whole(element: Element) -> Callable[[str], int]:
    return lambda key: max(0, _int(element.attributes.get(key, "0").split()[0] if element.attributes.get(key) else "0"))


def _int(text: str) -> int:
    """A number as MuJoCo reads it; 0 for what is none, which it refuses."""
    try:
        return int(float(text))
    except (ValueError, OverflowError):
        return 0
