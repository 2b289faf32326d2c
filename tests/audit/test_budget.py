"""How many pixels are audited by default: from scene and size alone, and enough for an interval where that is cheap."""

import pytest
from audit_rig import LIGHT_SCENES, small

from nodes.audit.budget import MOST, USEFUL, Rates, pixels_for

COMING = ("spinning_disk", "fidget_spinner", "falling_objects", "robot_arm", "drone", "warehouse", "tunnel_exit")


def chosen(name: str, width: int, height: int, upsampling: int, envs: int = 1) -> int:
    scene = small(name, width, height)
    return pixels_for(scene, scene.cameras[0], Rates(30.0, upsampling), envs)


@pytest.mark.parametrize("name", COMING)
def test_scenes_get_enough_for_an_interval(name) -> None:
    assert USEFUL <= chosen(name, 346, 260, 8) <= MOST


@pytest.mark.parametrize("path", sorted(LIGHT_SCENES.glob("*.yaml")), ids=lambda path: path.stem)
def test_small_images_do_too(path) -> None:
    assert USEFUL <= chosen(path.stem, 96, 72, 32) <= MOST


def test_larger_runs_are_audited_by_more() -> None:
    numbers = [chosen("spinning_disk", *size) for size in ((64, 48, 8), (346, 260, 8), (346, 260, 16), (1280, 720, 32))]
    assert numbers == sorted(numbers) and numbers[0] < numbers[-1] == MOST
    assert chosen("matte_box", 346, 260, 8, 4) > chosen("matte_box", 346, 260, 8)
