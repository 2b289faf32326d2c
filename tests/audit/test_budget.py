"""How many pixels are audited by default: from scene and size alone, for a small share of the run."""

import pytest
from audit_rig import LIGHT_SCENES, small

from nodes.audit.budget import (
    LEAST,
    MOST,
    SHARE,
    SMALL_NS,
    USEFUL,
    Rates,
    audit_cost,
    pixels_for,
    run_cost,
    sample_cost,
)

COMING = ("spinning_disk", "fidget_spinner", "falling_objects", "robot_arm", "drone", "warehouse", "tunnel_exit")


def chosen(name: str, width: int, height: int, upsampling: int, envs: int = 1) -> int:
    scene = small(name, width, height)
    return pixels_for(scene, scene.cameras[0], Rates(30.0, upsampling), envs)


@pytest.mark.parametrize("name", COMING)
def test_an_audit_is_a_small_share_of_its_run(name) -> None:
    scene, rates = small(name, 346, 260), Rates(30.0, 8)
    camera, number = scene.cameras[0], chosen(name, 346, 260, 8)
    fixed, each = audit_cost(scene, camera, sample_cost(scene, 1, 16, 0))
    assert LEAST <= number <= MOST
    assert fixed + number * each <= SHARE * run_cost(scene, camera, 1, 1, rates) or number == LEAST


@pytest.mark.parametrize("path", sorted(LIGHT_SCENES.glob("*.yaml")), ids=lambda path: path.stem)
def test_small_images_get_enough_for_an_interval(path) -> None:
    scene = small(path.stem, 96, 72)
    cheap = run_cost(scene, scene.cameras[0], 1, 1, Rates(30.0, 32)) < SMALL_NS
    assert (USEFUL if cheap else LEAST) <= chosen(path.stem, 96, 72, 32) <= MOST


def test_larger_runs_are_audited_by_more() -> None:
    numbers = [
        chosen("spinning_disk", *size) for size in ((346, 260, 8), (346, 260, 16), (640, 480, 16), (1280, 720, 32))
    ]
    assert numbers == sorted(numbers) and numbers[0] < numbers[-1] == MOST
    assert chosen("matte_box", 346, 260, 8, 4) > chosen("matte_box", 346, 260, 8)
