"""A place of a keyframe of which few pixels show what is looked for, by hand."""

import numpy as np
import pytest
import warp as wp

from nodes.interpolator.rigid.look_up.look_up_kernels import HIDDEN, SEEN, make_fetches, make_keyframes

SIZE, PATCH, TOLERANCE = 6, 7, 0.1
AT = 2 * SIZE + 2
"""The first of the middle four pixels."""

Keyframes = make_keyframes(1, False)
*_, edge = make_fetches(1, False)


@wp.kernel
def look(keys: Keyframes, fx: float, fy: float, state: wp.array(dtype=int), value: wp.array(dtype=float)):
    seen, log = edge(keys, SIZE, AT, PATCH, 1.0, fx, fy, TOLERANCE)
    state[0] = seen
    value[0] = log


def looked_up(shown, logs, fx, fy):
    """State and log radiance at (fx, fy) where the pixels `shown` bool [6, 6] show the patch, others another one."""
    texels = np.zeros((SIZE, SIZE, 4), np.float32)
    texels[..., 0] = np.where(shown, PATCH, PATCH + 1).astype(np.int32).view(np.float32)
    texels[..., 1], texels[..., 2] = 1.0, logs
    keys = Keyframes()
    keys.texels = wp.array(texels.reshape(-1, 4), dtype=wp.vec4, device="cpu")
    state, value = wp.zeros(1, dtype=int, device="cpu"), wp.zeros(1, dtype=float, device="cpu")
    wp.launch(look, 1, [keys, fx, fy], [state, value], device="cpu")
    return int(state.numpy()[0]), float(value.numpy()[0])


def left_columns():
    """The two left columns of the 4 x 4 pixels show the patch: of the middle four those on the left."""
    shown = np.zeros((SIZE, SIZE), bool)
    shown[1:5, 1:3] = True
    return shown


@pytest.mark.parametrize("fx", [0.0, 0.5, 0.9, 0.985])
def test_the_mean_of_the_pixels_that_show_it(fx):
    logs = np.random.default_rng(2).uniform(-0.04, 0.04, (SIZE, SIZE))
    state, value = looked_up(left_columns(), logs, fx, 0.25)
    assert state == int(SEEN)
    assert value == pytest.approx(0.75 * logs[2, 2] + 0.25 * logs[3, 2], abs=1e-6)


def test_nothing_from_a_place_that_is_hardly_on_it():
    """A hundredth of the way from the others is as good as on them."""
    assert looked_up(left_columns(), np.zeros((SIZE, SIZE)), 0.995, 0.25)[0] == int(HIDDEN)


def test_nothing_from_too_few_pixels():
    shown = left_columns()
    shown[3:] = False
    assert looked_up(shown, np.zeros((SIZE, SIZE)), 0.5, 0.25)[0] == int(HIDDEN)
    shown[3, 2] = True
    assert looked_up(shown, np.zeros((SIZE, SIZE)), 0.5, 0.25)[0] == int(SEEN)


def test_nothing_from_an_uneven_piece():
    logs = np.zeros((SIZE, SIZE))
    logs[1, 1] = 1.01 * TOLERANCE
    assert looked_up(left_columns(), logs, 0.5, 0.25)[0] == int(HIDDEN)
    logs[1, 1] = 0.99 * TOLERANCE
    assert looked_up(left_columns(), logs, 0.5, 0.25)[0] == int(SEEN)
