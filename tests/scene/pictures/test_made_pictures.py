"""Pictures that are made beside the reading of a scene."""

from __future__ import annotations

import numpy as np
import pytest

from evis.scene.images import textures
from evis.scene.images.made_pictures import SMALL, MadePictures, Recipe


def test_they_are_full_after_the_wait_and_what_was_asked_for() -> None:
    recipes: list[Recipe] = [
        (textures.planks, (2 * SMALL, 5, 0.1, 0.9, 0.05, 3), None),
        (textures.leaves, (64, 3, 0.2, 0.0, 1.0, 1.0), None),
        (textures.noise, (128, 1, 0.02, 0.0, 1.0), None),
        (textures.checker, (96, 6, 0.2, 0.7), (0.5, 0.9)),
    ]
    pictures = MadePictures()
    images = [pictures.begin(recipe) for recipe in recipes]
    pictures.wait()
    for image, (make, arguments, sector) in zip(images, recipes):
        expected = make(*arguments) if sector is None else textures.add_wedge(make(*arguments), *sector)
        expected = expected if expected.ndim == 3 else np.stack([expected] * 3, axis=-1)
        assert image.dtype == np.float32 and not image.flags.writeable
        assert np.array_equal(image, np.clip(expected, 0.0, 1.0))
    # Small ones are those of the next scene too.
    again = MadePictures()
    assert again.begin(recipes[1]) is images[1]
    assert again.begin(recipes[0]) is not images[0]
    again.wait()


def test_one_that_cannot_be_made_is_told_and_not_kept() -> None:
    def broken(size: int) -> np.ndarray:
        raise MemoryError(f"{size} texels")

    for _ in range(2):
        pictures = MadePictures()
        pictures.begin((broken, (8,), None))
        with pytest.raises(MemoryError, match="8 texels"):
            pictures.wait()
