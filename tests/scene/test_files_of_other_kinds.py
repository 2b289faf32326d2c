"""Files that hold a world or a thing and are no scene, and models by other endings."""

from pathlib import Path

import mujoco
import pytest

from evis.config.paths import UnknownLaunch, find_launch
from evis.scene import SceneError, load_scene

MJCF = '<mujoco><worldbody><body name="link"><joint/><geom size="0.1"/></body></worldbody></mujoco>'
URDF = '<robot name="r"><link name="base"><visual><geometry><sphere radius="0.1"/></geometry></visual></link></robot>'


@pytest.mark.parametrize(
    ("ending", "helps"),
    [
        ("mjb", "give the MJCF that it was compiled from"),
        ("mjz", "unpack it and give the MJCF in it"),
        ("usda", "export it as MJCF or URDF"),
        ("sdf", "convert it to URDF or MJCF"),
        ("mjcf", "rename it so that it ends in .xml"),
        ("XML", "rename it so that it ends in .xml"),
        ("OBJ", "a scene file names it: `world: [{shape: mesh, file: FILE}]`"),
        ("fbx", "export it as glTF; a scene file names it"),
    ],
)
def test_a_file_of_another_kind_says_what_helps(tmp_path: Path, ending: str, helps: str) -> None:
    """As what is launched, as a scene, and as the model of one; the compiled one is MuJoCo's own."""
    path = tmp_path / f"thing.{ending}"
    path.write_text(MJCF)
    if ending == "mjb":
        mujoco.mj_saveModel(mujoco.MjModel.from_xml_string(MJCF), str(path), None)
    (tmp_path / "s.yaml").write_text(f"mjcf: {path.name}\n")
    with pytest.raises(UnknownLaunch) as launched:
        find_launch(str(path))
    with pytest.raises(FileNotFoundError) as loaded:
        load_scene(str(path))
    with pytest.raises(SceneError) as named:
        load_scene(str(tmp_path / "s.yaml"))
    for error in (launched, loaded, named):
        assert path.name in str(error.value) and helps in str(error.value)


def test_a_urdf_may_have_its_ending_in_capitals(tmp_path: Path) -> None:
    """As files of other systems have it; the scene is that of the same file with a small one."""
    scenes = []
    for name in ("small.urdf", "LARGE.URDF"):
        (tmp_path / name).write_text(URDF)
        assert find_launch(str(tmp_path / name))[1] == {"scene": str(tmp_path / name)}
        scenes.append(load_scene(str(tmp_path / name)))
    small, large = ([*(body.name for body in s.bodies), *(i.name for i in s.instances)] for s in scenes)
    assert small == large and len(scenes[0].instances) == 1


def test_a_part_that_mujoco_does_not_know_by_its_ending_says_what_it_knows(tmp_path: Path) -> None:
    """A model without an ending is one to MuJoCo itself, and not where parts of it are changed."""
    (tmp_path / "robot").write_text(MJCF)
    (tmp_path / "s.yaml").write_text("mjcf: robot\n")
    with pytest.raises(SceneError, match=r"^robot: could not find decoder .*; MuJoCo knows files by their endings"):
        load_scene(str(tmp_path / "s.yaml"))
