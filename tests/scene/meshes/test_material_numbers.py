"""Numbers of materials that cannot be: those not finite are refused, others taken as the nearest that can be."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from one_triangle import gltf, triangle

from evis.scene.errors import SceneError
from evis.scene.mesh.files import load_parts
from evis.scene.model import Material

NAN, INFINITE = float("nan"), float("inf")
STRENGTH = "KHR_materials_emissive_strength"


def read(path: Path, material: dict[str, Any]) -> Material:
    tree = triangle() | {"materials": [{"name": "paint", **material}]}
    tree["meshes"][0]["primitives"][0]["material"] = 0
    made = load_parts(gltf(path, tree), np.ones(3))[0].material
    assert made is not None
    return made


@pytest.mark.parametrize(
    ("material", "key"),
    [
        ({"pbrMetallicRoughness": {"baseColorFactor": [NAN, 0, 0, 1]}}, "albedo"),
        ({"pbrMetallicRoughness": {"roughnessFactor": NAN}}, "roughness"),
        ({"pbrMetallicRoughness": {"metallicFactor": NAN}}, "metallic"),
        ({"emissiveFactor": [NAN, 0, 0]}, "emission"),
        ({"emissiveFactor": [1, 0, 0], "extensions": {STRENGTH: {"emissiveStrength": INFINITE}}}, "emission"),
        ({"emissiveFactor": [1, 0, 0], "extensions": {STRENGTH: {"emissiveStrength": 1e39}}}, "emission"),
    ],
)
def test_numbers_that_are_not_finite_are_refused(tmp_path: Path, material: dict[str, Any], key: str) -> None:
    """They came to the renderer, which drew nan."""
    says = f"^a.gltf has material 'paint' with a number for its {key} that is not finite; write it anew$"
    with pytest.raises(SceneError, match=says):
        read(tmp_path / "a.gltf", material)


def test_an_mtl_with_nan_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_text("newmtl paint\nKd nan 0 0\n")
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl paint\nf 1 2 3\n")
    with pytest.raises(
        SceneError, match=r"^a\.obj has material 'paint' with a number for its albedo that is not finite"
    ):
        load_parts(tmp_path / "a.obj", np.ones(3))


def test_numbers_beyond_their_range_are_its_ends(tmp_path: Path) -> None:
    """Of a roughness, a metallic value and a reflectance 0 ... 1, of an emission 0."""
    factors = {"roughnessFactor": 5, "metallicFactor": -1, "baseColorFactor": [5, 0.5, 0.5, 1]}
    dark = {"emissiveFactor": [1, 0, 0], "extensions": {STRENGTH: {"emissiveStrength": -3}}}
    made = read(tmp_path / "a.gltf", {"pbrMetallicRoughness": factors, **dark})
    assert (made.roughness, made.metallic) == (1.0, 0.0)
    assert made.albedo.tolist() == [1.0, 0.5, 0.5] and (made.emission == 0.0).all()


def test_a_texture_that_is_laid_by_nan_is_refused(tmp_path: Path) -> None:
    """The surface was drawn without its picture."""
    tree = triangle()
    tree["accessors"].append({"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC2"})
    tree["meshes"][0]["primitives"][0] |= {"material": 0, "attributes": {"POSITION": 0, "TEXCOORD_0": 1}}
    laid = {"index": 0, "extensions": {"KHR_texture_transform": {"offset": [NAN, 0]}}}
    tree["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": laid}}]
    tree["textures"], tree["images"] = [{"source": 0}], [{"uri": "a.png"}]
    says = "a.gltf: material 0 has a KHR_texture_transform that is not finite; write it anew"
    with pytest.raises(SceneError, match=re.escape(says)):
        load_parts(gltf(tmp_path / "a.gltf", tree), np.ones(3))


def test_what_is_no_picture_is_told_in_the_same_words_each_time(tmp_path: Path) -> None:
    """The place in memory of a picture within the file was told."""
    tree = triangle() | {"images": [{"bufferView": 0, "mimeType": "image/png"}]}
    with pytest.raises(SceneError, match=r"its image 0, which is no picture: (?!.*0x).*; save it as PNG$"):
        load_parts(gltf(tmp_path / "a.gltf", tree), np.ones(3))
