"""Meshes and pictures of a MuJoCo model that are rewritten within a second are read anew: MuJoCo keeps decoded files by
the whole second of their change."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from evis.scene import load_scene
from evis.scene.images.colour import linear_from_srgb

SECOND = 1_700_000_000
MODEL = """<mujoco>
  <asset><mesh name="m" file="m.obj"/><texture name="t" type="2d" file="t.png"/><material name="p" texture="t"/></asset>
  <worldbody><body pos="0 0 1"><freejoint/><geom type="mesh" mesh="m" material="p" mass="1"/></body></worldbody>
</mujoco>"""
ROBOT = """<robot name="r"><link name="base"/><link name="arm">
  <inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
  <visual><geometry><mesh filename="m.obj"/></geometry></visual></link>
  <joint name="j" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint></robot>"""


def write_mesh(folder: Path, size: float, nanosecond: int) -> None:
    """Writes a tetrahedron of three edges of a length along the axes."""
    corners = size * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"vt {u} {v}" for u, v in ((0, 0), (1, 0), (0, 1), (1, 1))]
    lines += [f"f {a}/{a} {b}/{b} {c}/{c}" for a, b, c in ((1, 3, 2), (1, 2, 4), (1, 4, 3), (2, 3, 4))]
    (folder / "m.obj").write_text("\n".join(lines) + "\n")
    os.utime(folder / "m.obj", ns=(SECOND * 10**9, SECOND * 10**9 + nanosecond))


def write_picture(folder: Path, grey: int, nanosecond: int) -> None:
    """Writes a picture of one grey."""
    Image.new("RGB", (4, 4), (grey, grey, grey)).save(folder / "t.png")
    os.utime(folder / "t.png", ns=(SECOND * 10**9, SECOND * 10**9 + nanosecond))


def edge(path: Path) -> float:
    """Gives the longest distance of two vertices of what a scene's last instance shows, over the root of 2."""
    vertices = load_scene(str(path)).instances[-1].mesh.vertices
    return float(max(np.linalg.norm(a - b) for a in vertices for b in vertices) / np.sqrt(2))


@pytest.mark.parametrize(("name", "text"), [("a.xml", MODEL), ("r.urdf", ROBOT)])
def test_a_mesh_rewritten_within_a_second_has_its_new_shape(tmp_path: Path, name: str, text: str) -> None:
    """Twice, with a picture beside it that stays."""
    write_picture(tmp_path, 100, 0)
    (tmp_path / name).write_text(text)
    for nanosecond, size in enumerate((1.0, 2.0, 3.0)):
        write_mesh(tmp_path, size, nanosecond)
        assert edge(tmp_path / name) == pytest.approx(size, rel=1e-5)


def test_a_picture_rewritten_within_a_second_has_its_new_colours(tmp_path: Path) -> None:
    """In linear light, of sRGB's codes."""
    write_mesh(tmp_path, 1.0, 0)
    (tmp_path / "a.xml").write_text(MODEL)
    for nanosecond, grey in enumerate((100, 200)):
        write_picture(tmp_path, grey, nanosecond)
        scene = load_scene(str(tmp_path / "a.xml"))
        texture = scene.materials[scene.instances[-1].material].texture
        assert texture is not None
        assert np.allclose(texture, linear_from_srgb(np.array([grey / 255.0])), atol=1e-3)
