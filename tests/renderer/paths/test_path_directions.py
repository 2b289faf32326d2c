"""Directions that paths take about a normal: against the cosine that they were drawn for, and without a jump where many
surfaces have their normals."""

import numpy as np
import warp as wp

from nodes.renderer.paths.sampling_kernels import cosine_direction

COUNT = 20_000


@wp.kernel(enable_backward=False)
def directions(
    normals: wp.array(dtype=wp.vec3),
    rotation: wp.mat33,
    u: wp.array(dtype=wp.vec2),
    out: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    out[i] = cosine_direction(normals[i], rotation, u[i])


def taken(normals: np.ndarray, u: np.ndarray, rotation: np.ndarray | None = None) -> np.ndarray:
    """Directions [n, 3] about normals [n, 3] for u [n, 2]."""
    out = wp.zeros(len(u), dtype=wp.vec3, device="cpu")
    given = [wp.array(values.astype(np.float32), dtype=kind, device="cpu") for values, kind in
             ((normals, wp.vec3), (u, wp.vec2))]  # fmt: skip
    turn = wp.mat33(*(np.eye(3) if rotation is None else rotation).astype(np.float32).ravel().tolist())
    wp.launch(directions, len(u), [given[0], turn, given[1], out], device="cpu")
    return out.numpy().astype(float)


def test_they_have_the_cosine_that_they_were_drawn_for() -> None:
    """Of the density cosine / pi: sqrt(1 - u0), whichever way the normal points, and evenly about it."""
    rng = np.random.default_rng(4)
    normals = rng.normal(size=(COUNT, 3))
    normals[:2000] = [0.0, 0.0, -1.0] + 1e-3 * normals[:2000]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    u = rng.random((COUNT, 2))
    found = taken(normals, u)
    assert np.abs(np.linalg.norm(found, axis=1) - 1).max() < 1e-5
    np.testing.assert_allclose((found * normals).sum(axis=1), np.sqrt(1 - u[:, 0]), atol=1e-5)
    across = taken(np.tile([0.6, 0.0, 0.8], (COUNT, 1)), u) - np.sqrt(1 - u[:, :1]) * [0.6, 0.0, 0.8]
    # The mean of a vector that is uniform about the normal is 0: its deviation is sqrt(mean u0 / 2 / n) an axis.
    assert np.abs(across.mean(axis=0)).max() < 5 * np.sqrt(0.25 / COUNT)


def test_rounding_does_not_turn_them_where_boxes_and_cylinders_have_their_sides() -> None:
    """Normals across each axis of a body, which rounding puts a little to this side or that."""
    angles = np.linspace(0, 2 * np.pi, 97)
    circle = np.stack([np.cos(angles), np.sin(angles), np.zeros(97)], axis=1)
    u = np.random.default_rng(1).random((97, 2))
    for axis in range(3):
        normals = np.roll(circle, axis, axis=1)
        aside = np.eye(3)[(2 + axis) % 3] * 1e-7
        assert np.abs(taken(normals + aside, u) - taken(normals - aside, u)).max() < 1e-4
