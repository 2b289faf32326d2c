"""Kernels find each probe where the host has drawn it."""

import numpy as np
import pytest
import warp as wp

from nodes.interpolator.refine.instants import Instants
from nodes.interpolator.refine.probing.probe_kernels import probe_image
from nodes.interpolator.refine.probing.probes import order_of


@wp.kernel
def find_images(coarse: int, parts: int, images: wp.array2d(dtype=int)):
    k, i = wp.tid()
    images[k, i] = probe_image(coarse, k, i + 1, parts)


@pytest.mark.parametrize(("coarse", "depth", "parts"), [(1, 2, 4), (3, 4, 8), (4, 5, 32), (7, 3, 2)])
def test_a_probe_is_at_its_place_in_the_order(coarse: int, depth: int, parts: int) -> None:
    """By the times that the host lists, counted from 0: part i of interval k ends at k 2^depth + i 2^depth / parts."""
    images = wp.zeros((coarse, parts - 1), dtype=wp.int32, device="cpu")
    wp.launch(find_images, images.shape, [coarse, parts, images], device="cpu")
    length, order = 1 << depth, order_of(Instants(coarse, depth, 1), parts)
    k, i = np.mgrid[:coarse, 1:parts]
    assert np.array_equal(np.array(order)[images.numpy()], k * length + i * (length // parts) - 1)
    assert sorted(images.numpy().ravel().tolist()) == list(range(len(order)))
