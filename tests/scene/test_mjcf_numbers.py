"""Numbers that a MuJoCo model brings: texture coordinates of its meshes, sensors with a size, lights without units."""

from pathlib import Path

import numpy as np
import pytest

from evis.scene import load_scene

pytest.importorskip("mujoco")

CORNERS = [(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
TEXCOORDS = [(0.1, 0.2), (0.9, 0.25), (0.8, 0.7), (0.15, 0.6), (0.5, 0.9)]
FACES = [(1, 3, 2), (1, 4, 3), (1, 2, 5), (2, 3, 5), (3, 4, 5), (4, 1, 5)]
"""A pyramid, with a texture coordinate to every vertex; OBJ counts from 1."""


def load(folder: Path, text: str, **arguments):
    path = folder / "model.xml"
    path.write_text(f"<mujoco>{text}</mujoco>")
    return load_scene(str(path), arguments)


def test_a_mesh_is_textured_as_its_obj_says(tmp_path: Path) -> None:
    """(u, v) of OBJ, v upwards, whatever way MuJoCo counts."""
    lines = [f"v {x} {y} {z}" for x, y, z in CORNERS] + [f"vt {u} {v}" for u, v in TEXCOORDS]
    lines += ["f " + " ".join(f"{k}/{k}" for k in face) for face in FACES]
    (tmp_path / "pyramid.obj").write_text("\n".join(lines))
    scene = load(
        tmp_path,
        """<asset><texture name="t" type="2d" builtin="checker" width="8" height="8"/><material name="m" texture="t"/>
        <mesh name="pyramid" file="pyramid.obj" inertia="legacy"/></asset>
        <worldbody><geom type="mesh" mesh="pyramid" material="m"/></worldbody>""",
    )
    instance = next(i for i in scene.instances if len(i.mesh.faces) == len(FACES))
    assert instance.mesh.uv is not None
    found, said = (np.unique(np.round(uv, 5), axis=0) for uv in (instance.mesh.uv.reshape(-1, 2), np.array(TEXCOORDS)))
    np.testing.assert_allclose(found, said, atol=1e-5)


def test_a_sensors_size_and_focal_length_make_the_intrinsics(tmp_path: Path) -> None:
    """f [px] = f [m] / pixel pitch [m], of each axis its own."""
    scene = load(
        tmp_path,
        """<worldbody><camera name="eye" pos="0 0 1" resolution="400 200" sensorsize="0.008 0.003" focal="0.006 0.004"/>
        <geom size="0.1"/></worldbody>""",
        width=400,
        height=200,
    )
    k = scene.cameras[0].k
    assert k[0, 0] == pytest.approx(0.006 / (0.008 / 400), rel=1e-6)
    assert k[1, 1] == pytest.approx(0.004 / (0.003 / 200), rel=1e-6)


@pytest.mark.parametrize("height", [1.0, 3.0])
def test_a_point_light_makes_a_white_surface_at_the_centre_as_bright_as_its_diffuse(
    height: float, tmp_path: Path
) -> None:
    """Lambert: radiance = albedo / pi * intensity / distance^2, facing the light."""
    scene = load(
        tmp_path,
        f"""<statistic center="0 0 0.5" extent="2"/><worldbody>
        <light name="bulb" type="point" pos="0 0 {height}" diffuse="0.8 0.6 0.4"/><geom size="0.1"/></worldbody>""",
    )
    light = next(one for one in scene.lights if one.name == "bulb")
    assert light.kind == "point"
    np.testing.assert_allclose(light.colour / np.pi / (height - 0.5) ** 2, [0.8, 0.6, 0.4], rtol=1e-6)
