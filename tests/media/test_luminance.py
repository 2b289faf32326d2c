"""Luminance of linear RGB: the same bits wherever a pixel lies, and those of a graph."""

from __future__ import annotations

import numpy as np

from evis.media.colour import luminance_of
from nodes.interpolator.luminance import luminance_of as of_a_graph

RGB = np.random.default_rng(2).gamma(1.0, 2.0, (13, 17, 3)).astype(np.float32)


def test_a_pixel_has_the_same_bits_wherever_it_lies():
    """In the whole picture, alone, in a row, mirrored and turned."""
    whole = luminance_of(RGB)
    assert (np.array([[luminance_of(pixel) for pixel in row] for row in RGB]) == whole).all()
    assert (np.stack([luminance_of(row) for row in RGB]) == whole).all()
    assert (luminance_of(RGB[:, ::-1]) == whole[:, ::-1]).all()
    assert (luminance_of(RGB.transpose(1, 0, 2)) == whole.T).all()


def test_each_product_and_sum_is_rounded_once():
    """float64 holds a product of two float32 numbers, and so the one rounding can be made by hand."""

    def single(value):
        return np.float32(value).astype(np.float64)

    r, g, b = (single(weight) * RGB[..., i].astype(np.float64) for i, weight in enumerate((0.2126, 0.7152, 0.0722)))
    by_hand = single(single(single(r) + single(g)) + single(b))
    assert (luminance_of(RGB) == by_hand).all()
    assert (of_a_graph(RGB.reshape(1, *RGB.shape)).numpy()[0] == by_hand).all()
