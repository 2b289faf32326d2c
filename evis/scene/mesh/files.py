"""Meshes from files, by trimesh. Imported only for scenes that name such a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from evis.files.allowance import AllowanceError
from evis.scene.errors import SceneError
from evis.scene.folders import Folders
from evis.scene.images.colour import linear_from_srgb
from evis.scene.images.pictures import texels_of
from evis.scene.mesh import gltf_header
from evis.scene.mesh.normals import crease_normals
from evis.scene.model import Material, Mesh
from evis.scene.sources import note

SUFFIXES = (".obj", ".ply", ".stl", ".gltf", ".glb")
Y_UP = gltf_header.SUFFIXES
"""Formats whose vertical axis is y by their own specification."""
CREASE = float(np.radians(40.0))


@dataclass
class Part:
    """Holds one mesh of a file and its material, None where the file says nothing of it."""

    mesh: Mesh
    material: Material | None


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
    Materials: glTF's metallic-roughness ones (base colour factor linear, its texture sRGB, emission times
    KHR_materials_emissive_strength), MTL's Kd and map_Kd taken as sRGB. folders: from which the files it names may
    come, its own unless given. Raises SceneError naming the file.
    """
    import trimesh

    from evis.scene.mesh.assets import Assets

    if path.suffix.lower() not in SUFFIXES:
        raise SceneError(f"{path.name} is of no kind that can be read; there are {', '.join(SUFFIXES)}")
    assets = Assets(note(path), folders or Folders(path.parent))
    try:
        exact = _exact(path, assets) if path.suffix.lower() in Y_UP else {}
        scene = trimesh.load_scene(str(path), process=False, resolver=assets)
        # Sorted, for the ids of a scene must not depend on the process that loads it.
        places = [scene.graph[node] for node in sorted(scene.graph.nodes_geometry)]
        nodes = [(transform, scene.geometry[name], str(name)) for transform, name in places]
        coloured = textures and any(_kind(geometry) in ("vertex", "face") for geometry in scene.geometry.values())
        stored = _stored(path, assets) if coloured else {}
    except (AllowanceError, SceneError) as error:
        raise SceneError(f"{path.name}: {error}") from None
    except Exception as error:  # the readers of trimesh raise whatever they stumble over
        raise SceneError(f"{path.name} cannot be read as {path.suffix[1:].upper()}: {_line(error)}") from None
    finally:
        if assets.refusals:
            raise assets.refusals[0] from None
    turn = _upright(path, y_up)
    known: dict[int, Material | None] = {}
    parts = []
    white = Material(f"{path.stem}_white", np.ones(3, np.float32))
    for transform, geometry, name in nodes:
        if not isinstance(geometry, trimesh.Trimesh) or not len(geometry.faces):
            continue  # points and lines have no surface
        mesh = _mesh(path, geometry, np.asarray(transform), scale, turn, crease)
        if textures:
            mesh.colours = _colours(path, geometry, stored.get(name, stored.get("", {})), mesh.faces)
        parts.append(Part(mesh, None if mesh.colours is None else white))
        source = getattr(geometry.visual, "material", None) if _kind(geometry) == "texture" else None
        if source is not None:
            if id(source) not in known:
                known[id(source)] = made = _material(path, source, exact, textures)
                # Materials of a file may share a name; those of a scene may not.
                taken = {other.name for other in (white, *known.values()) if other is not None and other is not made}
                made.name += f"_{len(known)}" if made.name in taken else ""
            parts[-1].material = known[id(source)]
    if not parts:
        raise SceneError(f"{path.name} has no triangles")
    return parts


def _upright(path: Path, y_up: bool | None) -> np.ndarray:
    """Rotation matrix [3, 3] from the file's axes to z up."""
    if y_up if y_up is not None else path.suffix.lower() in Y_UP:
        return np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    return np.eye(3)


def _mesh(path: Path, geometry: Any, transform: np.ndarray, scale: np.ndarray, turn: np.ndarray, crease: float) -> Mesh:
    points = np.asarray(geometry.vertices, np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise SceneError(f"{path.name} has vertices of {points.shape[-1]} numbers; they must have three, x y z")
    points = points @ transform[:3, :3].T + transform[:3, 3]
    points = (points * scale) @ turn.T
    faces = np.asarray(geometry.faces, np.int64)
    bad = ~np.isfinite(points).all(axis=-1)
    if bad.any():
        count, first = int(bad.sum()), int(bad.argmax())
        raise SceneError(f"{path.name} has {count} vertices that are not finite, the first is number {first}")
    if faces.min() < 0 or faces.max() >= len(points):
        raise SceneError(f"{path.name} has a face with vertex {faces.max()}; there are {len(points)}")
    if np.linalg.det(transform[:3, :3]) * np.prod(scale) < 0:
        faces = faces[:, ::-1]  # a mirror turns triangles inside out
    uv = getattr(geometry.visual, "uv", None)
    corners = None
    if uv is not None and np.shape(uv) == (len(points), 2) and np.isfinite(uv).all():
        corners = np.asarray(uv, np.float32)[faces]
    return Mesh(
        points.astype(np.float32), np.ascontiguousarray(faces, np.int32), corners, crease_normals(points, faces, crease)
    )


def _kind(geometry: Any) -> str | None:
    """What trimesh has of a mesh's looks: `texture`, `vertex` or `face` colours, or None."""
    return getattr(getattr(geometry, "visual", None), "kind", None)


def _exact(path: Path, assets: Any) -> dict[str, list[dict[str, Any]]]:
    """The materials of a glTF file as its JSON has them, which is checked for what it asks for."""
    tree, binary = gltf_header.read_header(path)
    assets.buffers = gltf_header.buffer_names(tree)
    gltf_header.check_header(tree, binary, assets.get, path.stat().st_size)
    return gltf_header.materials_of(tree)


def _stored(path: Path, assets: Any) -> dict[str, Mapping[str, Any]]:
    """What the file's reader says of each mesh, by name, before trimesh rounds colours to 8 bits; "" = the only one."""
    from trimesh.exchange.load import mesh_loaders

    kind = path.suffix.lower()[1:]
    with path.open("rb") as file:
        said = mesh_loaders[kind](file, file_type=kind, resolver=assets)
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


def _material(path: Path, source: Any, exact: Mapping[str, Sequence[Mapping[str, Any]]], textures: bool) -> Material:
    name = f"{path.stem}_{getattr(source, 'name', None) or 'material'}"
    if not hasattr(source, "baseColorFactor"):  # MTL
        diffuse = source.kwargs.get("kd") if isinstance(source.kwargs, dict) else None
        if diffuse is None or len(diffuse) != 3:
            diffuse = np.asarray(source.diffuse, np.float64)[:3] / 255
        reflectance = linear_from_srgb(np.clip(np.asarray(diffuse, np.float64), 0.0, 1.0))
        return Material(name, reflectance, _image(path, source.image) if textures else None)
    stored = next((m for m in exact.get(str(source.name), ()) if _agree(m, source)), {})
    pbr = stored.get("pbrMetallicRoughness", {})
    factor = source.baseColorFactor
    # trimesh rounds the factor to 8 bits, which is 7 % of a dark linear reflectance.
    albedo = pbr.get("baseColorFactor") or ([1, 1, 1] if factor is None else np.asarray(factor, np.float64) / 255)
    strength = stored.get("extensions", {}).get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0)
    emission = np.zeros(3) if source.emissiveFactor is None else np.asarray(source.emissiveFactor, np.float64)
    return Material(
        name,
        np.clip(np.asarray(albedo, np.float32)[:3], 0.0, 1.0),
        _image(path, source.baseColorTexture) if textures else None,
        (emission * float(strength)).astype(np.float32),
        1.0 if source.roughnessFactor is None else float(source.roughnessFactor),
        1.0 if source.metallicFactor is None else float(source.metallicFactor),
        bool(source.doubleSided),
    )


def _image(path: Path, image: Any) -> np.ndarray | None:
    """A Pillow image as linear float32 [h, w, 3]."""
    try:
        return None if image is None else texels_of(image)
    except SceneError as error:
        named = Path(image.info["file_path"]).name if "file_path" in image.info else "a texture"
        raise SceneError(f"{path.name} names {named}, {error}") from None


def _agree(stored: Mapping[str, Any], source: Any) -> bool:
    """Whether a material of the file is the one that trimesh rounded to this."""
    factor = stored.get("pbrMetallicRoughness", {}).get("baseColorFactor", [1, 1, 1, 1])
    rounded = 255 if source.baseColorFactor is None else np.asarray(source.baseColorFactor, np.float64)
    return bool(np.abs(255 * np.asarray(factor, np.float64) - rounded).max() <= 1)


def _line(error: Exception) -> str:
    return (" ".join(str(error).split()) or type(error).__name__)[:150]
