"""Areas and normals of triangles, against those of known figures."""

import numpy as np

from evis.geometry.triangles import area_vectors, areas


def test_the_faces_of_a_solid_have_its_surface_and_close_it():
    """Of an octahedron with half axes a, b, c; Heron's formula gives a face's area, and the vectors add up to 0."""
    a, b, c = 0.5, 1.5, 2.0
    tip = np.diag([a, b, c])
    corners = []
    for signs in np.ndindex(2, 2, 2):
        face = tip * (1.0 - 2.0 * np.array(signs))[:, None]
        corners.append(face if sum(signs) % 2 == 0 else face[::-1])
    corners = np.array(corners)
    x, y, z = np.hypot(a, b), np.hypot(b, c), np.hypot(c, a)
    s = (x + y + z) / 2
    np.testing.assert_allclose(areas(corners), np.sqrt(s * (s - x) * (s - y) * (s - z)), rtol=1e-13)
    vectors = area_vectors(corners)
    assert (np.einsum("nk,nk->n", vectors, corners.mean(axis=1)) > 0).all()
    np.testing.assert_allclose(vectors.sum(axis=0), 0.0, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=-1), 2.0 * areas(corners), rtol=1e-15)
