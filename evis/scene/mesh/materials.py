"""Reads materials of mesh files.

glTF's metallic-roughness ones: base colour factor linear, its texture sRGB, emission times
KHR_materials_emissive_strength. A surface has one emission, roughness and metallic value here, so those that a texture
gives are its means. Of KHR_materials_pbrSpecularGlossiness the diffuse colour and the glossiness.
MTL's Kd and map_Kd (with -s and -o) taken as sRGB, Ke as a radiance, Pr and Pm as roughness and metallic.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from evis.scene.errors import SceneError
from evis.scene.images.colour import linear_from_codes, linear_from_srgb
from evis.scene.images.pictures import codes_of
from evis.scene.mesh.gltf_plain import NO_MATERIAL
from evis.scene.mesh.wavefront import layout_of
from evis.scene.model import Material

_PICTURES = ("baseColorTexture", "metallicRoughnessTexture", "emissiveTexture")
_OLD = "KHR_materials_pbrSpecularGlossiness"


def is_stand_in(source: Any) -> bool:
    """Tells whether a material was made for texture coordinates of which the file says no more."""
    if hasattr(source, "baseColorFactor"):
        return bool(source.name == NO_MATERIAL)
    image = getattr(source, "image", None)
    return image is not None and image.format is None


def layout(source: Any, folder: str) -> tuple[np.ndarray, np.ndarray] | None:
    """Returns how an MTL's picture lies over the coordinates, as `layout_of`; None as it is. folder: of the mesh."""
    image = getattr(source, "image", None)
    named = "" if image is None else str(image.info.get("file_path", ""))
    named = named.removeprefix(os.path.join(os.path.abspath(folder), ""))
    return layout_of(named) if named.startswith("-") else None


def read_material(path: Path, source: Any, exact: Sequence[Mapping[str, Any]], textures: bool) -> Material:
    """Reads a material as trimesh has it. exact: those of a glTF's JSON, of which its name is the number. textures:
    whether the picture of its colour is wanted. Raises SceneError naming the file for numbers that are not finite.
    """
    with np.errstate(invalid="ignore", over="ignore"):  # which is refused below
        if hasattr(source, "baseColorFactor"):
            made = _gltf(path, source, exact, textures)
        else:
            made = _mtl(path, source, textures)
    for key in ("albedo", "emission", "roughness", "metallic"):
        if not np.isfinite(getattr(made, key)).all():
            name = made.name.removeprefix(f"{path.stem}_")
            raise SceneError(
                f"{path.name} has material '{name}' with a number for its {key} that is not finite; write it anew"
            )
    return made


def absent_pictures(exact: Sequence[Mapping[str, Any]], scene: Any) -> list[str]:
    """Tells which pictures of a glTF's materials trimesh did not get, those that name no file."""
    found = []
    for geometry in scene.geometry.values():
        source: Any = getattr(getattr(geometry, "visual", None), "material", None)
        if not hasattr(source, "baseColorFactor") or is_stand_in(source):
            continue
        stored = exact[int(source.name)]
        told = {**stored, **stored.get("pbrMetallicRoughness", {})}
        for key in _PICTURES:
            if key in told and getattr(source, key) is None:
                text = f"has a {key} of a kind that is not read"
                found += [] if text in found else [text]
    return found


def see_through(source: Any, exact: Sequence[Mapping[str, Any]]) -> str:
    """Tells of a material that lets light through, since all are drawn opaque; "" of others. exact: as of
    `read_material`.
    """
    if hasattr(source, "baseColorFactor"):
        stored = exact[int(source.name)]
        name, mode = stored.get("name", source.name), str(stored.get("alphaMode", "OPAQUE"))
        passes = stored.get("extensions", {}).get("KHR_materials_transmission", {}).get("transmissionFactor", 0)
        how = f"alphaMode {mode}" if mode != "OPAQUE" else "KHR_materials_transmission" if passes else ""
    else:
        said, name = source.kwargs, getattr(source, "name", None) or "material"
        opaque, clear = (_numbers(said.get(key)) for key in ("d", "tr"))
        thin = opaque[0][0] < 1.0 if opaque else bool(clear) and clear[0][0] > 0.0  # some write both, and Tr as d
        how = "map_d" if "map_d" in said else f"{'d' if opaque else 'Tr'} {(opaque or clear)[0][0]:g}" if thin else ""
    return f"has material '{name}' with {how}, which is drawn opaque" if how else ""


def _mtl(path: Path, source: Any, textures: bool) -> Material:
    said = source.kwargs
    diffuse = said.get("kd")
    if diffuse is None or np.shape(diffuse) != (3,):
        # Nothing is said against the picture's own colours.
        diffuse = np.ones(3) if source.image is not None else np.asarray(source.diffuse, np.float64)[:3] / 255
    (emission,) = _numbers(said.get("ke")) or (np.zeros(3),)
    roughness, metallic = (_numbers(said.get(key)) or (default,) for key, default in (("pr", 1.0), ("pm", 0.0)))
    return Material(
        f"{path.stem}_{getattr(source, 'name', None) or 'material'}",
        linear_from_srgb(np.clip(np.asarray(diffuse, np.float64), 0.0, 1.0)),
        _image(path, source.image) if textures else None,
        np.maximum(np.broadcast_to(emission, 3), 0.0).astype(np.float32),
        float(np.clip(np.ravel(roughness)[0], 0.0, 1.0)),
        float(np.clip(np.ravel(metallic)[0], 0.0, 1.0)),
    )


def _numbers(words: Any) -> tuple[np.ndarray, ...]:
    """One or three finite numbers of an MTL's line, within a tuple; an empty one for anything else."""
    try:
        values = np.array([float(word) for word in words or ()])
    except ValueError:
        return ()
    return (values,) if len(values) in (1, 3) and np.isfinite(values).all() else ()


def _gltf(path: Path, source: Any, exact: Sequence[Mapping[str, Any]], textures: bool) -> Material:
    stored = exact[int(source.name)]
    # trimesh rounds the factor to 8 bits, which is 7 % of a dark linear reflectance.
    pbr, extensions = stored.get("pbrMetallicRoughness", {}), stored.get("extensions", {})
    albedo = pbr.get("baseColorFactor", [1, 1, 1, 1])
    roughness, metallic = float(pbr.get("roughnessFactor", 1.0)), float(pbr.get("metallicFactor", 1.0))
    if not pbr and _OLD in extensions:
        old = extensions[_OLD]
        albedo = old.get("diffuseFactor", [1, 1, 1, 1])
        roughness, metallic = 1.0 - float(old.get("glossinessFactor", 1.0)), 0.0
    elif "metallicRoughnessTexture" in pbr and source.metallicRoughnessTexture is not None:
        codes = _codes(path, source.metallicRoughnessTexture)
        values = codes.mean((0, 1), np.float64) / np.iinfo(codes.dtype).max
        roughness, metallic = roughness * values[1], metallic * values[2]
    strength = float(extensions.get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0))
    emission = strength * np.array(stored.get("emissiveFactor", [0, 0, 0]), np.float64)
    if "emissiveTexture" in stored and emission.any() and (glow := _image(path, source.emissiveTexture)) is not None:
        emission = emission * glow.mean((0, 1), np.float64)
    return Material(
        f"{path.stem}_{stored.get('name') or 'material'}",
        np.clip(np.asarray(albedo, np.float32)[:3], 0.0, 1.0),
        _image(path, source.baseColorTexture) if textures else None,
        np.maximum(emission, 0.0).astype(np.float32),
        float(np.clip(roughness, 0.0, 1.0)),
        float(np.clip(metallic, 0.0, 1.0)),
        bool(stored.get("doubleSided", False)),
    )


def _image(path: Path, image: Any) -> np.ndarray | None:
    """A Pillow image as linear float32 [h, w, 3]."""
    return None if image is None else linear_from_codes(_codes(path, image))


def _codes(path: Path, image: Any) -> np.ndarray:
    try:
        return codes_of(image)
    except SceneError as error:
        named = Path(image.info["file_path"]).name if "file_path" in image.info else "a texture"
        raise SceneError(f"{path.name} names {named}, {error}") from None
