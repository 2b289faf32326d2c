"""Reads meshes from files, by trimesh. Imported only for scenes that name such a file."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from evis.files.allowance import AllowanceError
from evis.files.damage import error_text
from evis.scene.errors import SceneError
from evis.scene.folders import Folders
from evis.scene.images.colour import linear_from_srgb
from evis.scene.mesh import gltf_header
from evis.scene.mesh.gltf_plain import plain
from evis.scene.mesh.gltf_primitives import left_out
from evis.scene.mesh.materials import absent_pictures, is_stand_in, layout, read_material, see_through
from evis.scene.mesh.normals import crease_normals
from evis.scene.mesh.ply_faces import cut_faces
from evis.scene.mesh.polygons import cut_polygons
from evis.scene.mesh.shapes import is_flat
from evis.scene.mesh.wavefront import (
    absolute,
    in_utf8,
    laid_throughout,
    spelled_plainly,
    without_libraries,
    without_mixed_normals,
)
from evis.scene.model import Material, Mesh
from evis.scene.sources import note

if TYPE_CHECKING:
    from evis.scene.mesh.assets import Assets

SUFFIXES = (".obj", ".ply", ".stl", ".gltf", ".glb")
Y_UP = gltf_header.SUFFIXES
"""Formats whose vertical axis is y by their own specification."""
FAR = 1000.0
"""Distance from the origin, as a multiple of its size, from where on a mesh has an origin of its own."""
CREASE = float(np.radians(40.0))


@dataclass
class Part:
    """Holds one mesh of a file and its material, None where the file says nothing of it. file: its name."""

    mesh: Mesh
    material: Material | None
    file: str = ""
    lacks: tuple[str, ...] = ()
    """What the file names for its looks and is not there, or cannot be used."""
    opaque: str = ""
    """What of the material's looks is left out since all is drawn opaque, as `see_through` tells it."""
    place: np.ndarray | None = None
    """Where the mesh's origin is in the file's frame, float64 [3] m; None at its origin. One that is far off for its
    size has an origin of its own, since float32 would lose its shape."""

    def points(self) -> np.ndarray:
        """Returns the vertices in the file's frame, float64 [V, 3]."""
        points = self.mesh.vertices.astype(np.float64)
        return points if self.place is None else points + self.place


def load_parts(
    path: Path,
    scale: np.ndarray,
    y_up: bool | None = None,
    crease: float = CREASE,
    textures: bool = True,
    folders: Folders | None = None,
) -> list[Part]:
    """Loads all meshes of a file in the frame of its scene, in the order of its nodes' names.

    scale: [3], applied to the file's axes. y_up: the file's vertical axis is y (turned to z here); None: as the format
    has it. crease: edges sharper than this [rad] stay sharp, the others are smoothed. textures=False leaves images out.
    Colours of vertices: glTF's COLOR_0 is linear; those of PLY (or of its faces) and OBJ are taken as sRGB, integers as
    parts of their type's largest; alpha is left out. A mesh that has them and no material gets a white one.
    Materials: as in `materials`. folders: from which the files it names may come, its own unless given. Raises
    SceneError naming the file.
    """
    import trimesh

    from evis.scene.mesh.assets import Assets

    if path.suffix.lower() not in SUFFIXES:
        raise SceneError(f"{path.name} is of no kind that can be read; there are {', '.join(SUFFIXES)}")
    assets = Assets(note(path), folders or Folders(path.parent))
    scene, nodes, tree, stored = _read(path, assets, textures)
    exact = tree.get("materials", [])
    turn = _upright(path, y_up)
    known: dict[int, Material | None] = {}
    parts = []
    white = Material(f"{path.stem}_white", np.ones(3, np.float32))
    for transform, geometry, name in nodes:
        if not isinstance(geometry, trimesh.Trimesh) or not len(geometry.faces):
            continue  # points and lines have no surface
        mesh, place = _mesh(path, geometry, np.asarray(transform), scale, turn, crease)
        if textures:
            mesh.colours = _colours(path, geometry, stored.get(name, stored.get("", {})), mesh.faces)
        parts.append(Part(mesh, None if mesh.colours is None else white, path.name, place=place))
        source = getattr(geometry.visual, "material", None) if _kind(geometry) == "texture" else None
        if source is not None and not is_stand_in(source):
            if mesh.uv is not None and (laid := layout(source, assets.parent)) is not None:
                mesh.uv = (mesh.uv * laid[0] + laid[1]).astype(np.float32)
            if id(source) not in known:
                known[id(source)] = made = read_material(path, source, exact, textures)
                # Materials of a file may share a name; those of a scene may not.
                taken = {other.name for other in (white, *known.values()) if other is not None and other is not made}
                made.name += f"_{len(known)}" if made.name in taken else ""
            parts[-1].material = known[id(source)]
            parts[-1].opaque = see_through(source, exact)
    if not parts:
        raise SceneError(f"{path.name} has no triangles")
    if all(is_flat(part.mesh) for part in parts):
        raise SceneError(f"{path.name} has no triangle with an area: the corners of each are in one line or one place")
    lacks = (*(assets.absent or absent_pictures(exact, scene)), *left_out(tree, textures))
    return [replace(part, lacks=lacks) for part in parts] if lacks else parts


def _read(path: Path, assets: Assets, textures: bool) -> tuple[Any, list[tuple[Any, Any, str]], Any, Any]:
    """Reads a file by trimesh: its scene, (transform, geometry, name) of its nodes, the JSON of a glTF as the file has
    it, and the colours of vertices by name. Raises SceneError naming the file."""
    import trimesh

    try:
        content, kind, tree = _content(path, assets)
        scene = trimesh.load_scene(io.BytesIO(content), file_type=kind, process=False, resolver=assets)
        # Sorted, for the ids of a scene must not depend on the process that loads it.
        places = [scene.graph[node] for node in sorted(scene.graph.nodes_geometry)]
        nodes = [(transform, scene.geometry[name], str(name)) for transform, name in places]
        coloured = textures and any(_kind(geometry) in ("vertex", "face") for geometry in scene.geometry.values())
        stored = _stored(content, kind, assets) if coloured else {}
    except (AllowanceError, SceneError) as error:
        raise SceneError(f"{path.name}: {error}") from None
    except Exception as error:  # the readers of trimesh raise whatever they stumble over
        raise SceneError(f"{path.name} cannot be read as {path.suffix[1:].upper()}: {error_text(error, 150)}") from None
    finally:
        if assets.refusals:
            raise assets.refusals[0] from None
    return scene, nodes, tree, stored


def _upright(path: Path, y_up: bool | None) -> np.ndarray:
    """Rotation matrix [3, 3] from the file's axes to z up."""
    if y_up if y_up is not None else path.suffix.lower() in Y_UP:
        return np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    return np.eye(3)


def _mesh(path: Path, geometry: Any, transform: np.ndarray, scale: np.ndarray, turn: np.ndarray, crease: float) -> Any:
    """A mesh, and where its origin is if that is not the file's."""
    points = np.asarray(geometry.vertices, np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise SceneError(f"{path.name} has vertices of {points.shape[-1]} numbers; they must have three, x y z")
    points = points @ transform[:3, :3].T + transform[:3, 3]
    points = (points * scale) @ turn.T
    faces = np.asarray(geometry.faces, np.int64)
    bad = ~(np.abs(points) <= np.finfo(np.float32).max).all(axis=-1)
    if bad.any():
        count, first = int(bad.sum()), int(bad.argmax())
        raise SceneError(f"{path.name} has {count} vertices that are not finite, the first is number {first}")
    if faces.min() < 0 or faces.max() >= len(points):
        wrong = faces[(faces < 0) | (faces >= len(points))][0]
        raise SceneError(f"{path.name} has a face with vertex {wrong}; its {len(points)} are numbered from 0")
    if np.linalg.det(transform[:3, :3]) * np.prod(scale) < 0:
        faces = faces[:, ::-1]  # a mirror turns triangles inside out
    uv = getattr(geometry.visual, "uv", None)
    corners = None
    if uv is not None and np.shape(uv) == (len(points), 2) and np.isfinite(uv).all():
        corners = np.asarray(uv, np.float32)[faces]
    normals = crease_normals(points, faces, crease)
    place = _place(points[faces.reshape(-1)])
    points = points if place is None else points - place
    return Mesh(points.astype(np.float32), np.ascontiguousarray(faces, np.int32), corners, normals), place


def _place(used: np.ndarray) -> np.ndarray | None:
    """The middle of points [N, 3] that are far off for their size, else None."""
    low, high = used.min(axis=0), used.max(axis=0)
    middle: np.ndarray = 0.5 * (low + high)
    return middle if np.abs(middle).max() > FAR * (high - low).max() > 0.0 else None


def _kind(geometry: Any) -> str | None:
    """What trimesh has of a mesh's looks: `texture`, `vertex` or `face` colours, or None."""
    return getattr(getattr(geometry, "visual", None), "kind", None)


def _content(path: Path, assets: Any) -> tuple[bytes, str, dict[str, Any]]:
    """What trimesh reads of a file, of which kind that is, and the JSON of a glTF."""
    kind = path.suffix.lower()[1:]
    if path.suffix.lower() in Y_UP:
        tree, binary = gltf_header.read_header(path)
        assets.buffers = gltf_header.buffer_names(tree)
        buffers = gltf_header.buffers_of(tree, binary, assets.get)
        gltf_header.check_header(tree, buffers, path.stat().st_size)
        return plain(tree, buffers), "glb", tree
    content = path.read_bytes()
    if kind == "ply":
        content = cut_faces(_colours_named(content))
    if _binary(content, kind):
        return content, kind, {}
    if kind == "stl" and b"facet" not in content[:4096].lower():
        count = int.from_bytes(content[80:84], "little")
        raise ValueError(f"it has {len(content)} bytes, where {count} triangles have {84 + 50 * count}")
    content = in_utf8(content)
    if kind == "stl":
        _check_facets(content)
    if kind == "obj":
        from evis.scene.mesh.assets import LIBRARIES

        content, assets.libraries = without_libraries(spelled_plainly(content))
        content = cut_polygons(laid_throughout(without_mixed_normals(absolute(content))))
        if assets.libraries:
            content = f"mtllib {LIBRARIES}\n".encode() + content
    return content, kind, {}


def _check_facets(content: bytes) -> None:
    """Raises ValueError for a text of STL that is cut or damaged, of which trimesh reads the solids that are whole."""
    text = content.lower()
    begun, ended = (len(re.findall(word, text)) for word in (rb"(?m)^[ \t]*facet\b", rb"(?m)^[ \t]*endfacet\b"))
    solids = [len(re.findall(word, text)) for word in (rb"(?m)^[ \t]*solid\b", rb"(?m)^[ \t]*endsolid\b")]
    if begun != ended or solids[0] != solids[1]:
        raise ValueError(
            f"it is cut, or damaged: {begun} facets and {solids[0]} solids begin, {ended} and {solids[1]} end"
        )


def _colours_named(content: bytes) -> bytes:
    """A PLY whose colours, called diffuse_red or r by some programs, have the usual names: red, green, blue."""
    header, end, body = content.partition(b"end_header")
    if not end or re.search(rb"(?m)^property\s+\w+\s+red\s*$", header):
        return content
    for name in (b"red", b"green", b"blue"):
        other = rb"(?:diffuse_" + name + rb"|" + name[:1] + rb")"
        header = re.sub(rb"(?m)^(property[ \t]+\w+[ \t]+)" + other + rb"(?=\s*$)", rb"\g<1>" + name, header)
    return header + end + body


def _binary(content: bytes, kind: str) -> bool:
    """Whether a file is not a text."""
    if kind == "ply":
        return b"binary_" in content[:512]
    return kind == "stl" and len(content) >= 84 and len(content) == 84 + 50 * int.from_bytes(content[80:84], "little")


def _stored(content: bytes, kind: str, assets: Any) -> dict[str, Mapping[str, Any]]:
    """What the file's reader says of each mesh, by name, before trimesh rounds colours to 8 bits; "" = the only one."""
    from trimesh.exchange.load import mesh_loaders

    said = mesh_loaders[kind](io.BytesIO(content), file_type=kind, resolver=assets)
    return dict(said["geometry"]) if "geometry" in said else {"": said}


def _colours(path: Path, geometry: Any, stored: Mapping[str, Any], faces: np.ndarray) -> np.ndarray | None:
    """Colours of a mesh's corners, linear float32 [F, 3, 3]; None where it has none."""
    visual, kind = geometry.visual, _kind(geometry)
    if kind == "texture":
        colours = visual.vertex_attributes.get("color")
        colours = geometry.vertex_attributes.get("color") if colours is None else colours
    elif kind in ("vertex", "face"):
        colours = stored.get(f"{kind}_colors")
        colours = getattr(visual, f"{kind}_colors") if colours is None else colours
    else:
        return None
    if colours is None:
        return None
    colours = np.asarray(colours)[:, :3]
    whole = np.issubdtype(colours.dtype, np.integer)
    colours = colours.astype(np.float64) / (np.iinfo(colours.dtype).max if whole else 1.0)
    if kind != "face" and len(colours) <= faces.max():
        raise SceneError(f"{path.name} has {len(colours)} colours of vertices for {len(geometry.vertices)} vertices")
    if not (colours.min() >= 0.0 and colours.max() <= 1.0 + 1e-6):
        raise SceneError(f"{path.name} has colours of {colours.min():g} ... {colours.max():g}; they must be 0 ... 1")
    colours = np.minimum(colours, 1.0)
    linear = colours if path.suffix.lower() in Y_UP else linear_from_srgb(colours)
    corners = linear[:, None].repeat(3, axis=1) if kind == "face" else linear[faces]
    return np.ascontiguousarray(corners, np.float32)
