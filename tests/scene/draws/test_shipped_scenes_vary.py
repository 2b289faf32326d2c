"""The scenes that come with EVIS: nothing is drawn by default, and `vary` draws worlds that go side by side."""

from __future__ import annotations

import pytest

from evis.config import paths
from evis.scene import load_scene
from evis.scene.load import drawn_places, scene_args
from evis.scene.worlds import Worlds

SMALL = {"warehouse": {"bays": 2}}
"""Arguments by which a scene loads fast."""


@pytest.mark.parametrize("name", paths.names("scenes"))
def test_vary_draws_a_world_for_every_seed(name: str) -> None:
    small = SMALL.get(name, {})
    assert load_scene(name, small, textures=False).drawn == [] and drawn_places(name, small) == []
    assert "vary" in scene_args(name)
    vary = {**small, "vary": 1}
    worlds = Worlds(lambda env, seed: load_scene(name, vary, textures=False, seed=seed), range(4))
    drawn = worlds.drawn()
    assert len(drawn) >= 7 and drawn_places(name, vary)
    assert all(len(set(map(str, values))) > 1 for place, values in drawn.items() if "texture" not in place)


def test_a_share_of_vary_draws_closer_to_the_plain_scene() -> None:
    for share in (0.1, 0.3, 1.0):
        for seed in range(20):
            scene = load_scene("spinning_disk", {"vary": share}, visuals=False, seed=seed)
            omega = next(one.value for one in scene.drawn if one.place == "args.omega.default")
            assert 50 - 35 * share <= omega <= 50 + 20 * share
