"""What the drawing takes of a run at its pixels."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from audit_rig import small

from nodes.audit.drawing import Drawing
from nodes.event_sensor.input.further import Further

RNG = np.random.default_rng(5)
WEIGHTS = (0.2126, 0.7152, 0.0722)


def by_hand(rgb: np.ndarray) -> np.ndarray:
    """Luminance float32 of float32 RGB: float64 holds a product of two of these, so each step is rounded once."""
    parts = [(float(np.float32(w)) * rgb[..., k].astype(np.float64)).astype(np.float32) for k, w in enumerate(WEIGHTS)]
    return (parts[0] + parts[1]) + parts[2]


def test_colour_becomes_luminance_with_the_same_bits_in_any_composition() -> None:
    """Of frames and of samples between them, of which a pixel may have any number."""
    scene = small("matte_box", 12, 9)
    drawing = Drawing(scene, scene.cameras[0], 7, 2, 0)
    drawing.pixels[:] = np.stack(np.unravel_index(RNG.choice(108, (2, drawing.each)), (9, 12)), -1)[..., ::-1]
    x, y = drawing.pixels[..., 0], drawing.pixels[..., 1]
    frames = RNG.gamma(1.0, 2.0, (2, 3, 9, 12, 3)).astype(np.float32)
    first = np.concatenate([[0], np.cumsum(RNG.integers(0, 5, 2 * 108))]).astype(np.int32)
    value = RNG.gamma(1.0, 2.0, (first[-1], 3)).astype(np.float32)
    found = drawing.between(Further(first, np.arange(first[-1], dtype=np.int32), value), 9, 12)
    taken = drawing.values(frames, 0)
    for k, pixel in enumerate(((np.arange(2)[:, None] * 9 + y) * 12 + x).reshape(-1).tolist()):
        env, n = divmod(k, drawing.each)
        np.testing.assert_array_equal(taken[env, :, n], by_hand(frames[env, :, y[env, n], x[env, n]]))
        a, b = list(pairwise(found.first.tolist()))[k]
        np.testing.assert_array_equal(found.offset[a:b], np.arange(first[pixel], first[pixel + 1]))
        np.testing.assert_array_equal(found.value[a:b], by_hand(value[first[pixel] : first[pixel + 1]]))
