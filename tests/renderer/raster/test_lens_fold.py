"""Inverting a lens that folds over on one side of its field, against its polynomial in float64."""

import numpy as np
from numpy.polynomial import Polynomial

from evis.geometry.distortion import Lens

K1, K2, P1, P2, K3 = 0.38, 0.85, 0.32, 0.0, -0.45
"""Brown-Conrady whose tangential part turns the image back below the axis before the radial part does."""

ALONG = Polynomial([0, 1, 3 * P1, K1, 0, K2, 0, K3])
"""v of y on x = 0: y + 3 p1 y^2 + k1 y^3 + k2 y^5 + k3 y^7, for p2 = 0."""


def test_no_direction_is_taken_from_beyond_the_fold():
    """What is found lies between the axis and the fold; nothing is where the image never comes."""
    lens = Lens.of("plumb_bob", (K1, K2, P1, P2, K3))
    turns = ALONG.deriv().roots()
    y_fold = turns[(abs(turns.imag) < 1e-9) & (turns.real < 0)].real.max()
    v_fold = ALONG(y_fold)
    # The radial part alone would go on beyond the fold, where the image comes back over what it has shown.
    rim = np.tan(lens.domain)
    assert -rim < y_fold < -1 and ALONG(-rim) > v_fold + 0.1
    v = np.linspace(1.5 * v_fold, 0.0, 500)
    rays = lens.undistort(np.stack([np.zeros_like(v), v], -1))
    seen = np.isfinite(rays).all(-1)
    assert not seen[v < v_fold].any() and seen[v > 0.999 * v_fold].all()
    y = rays[seen, 1] / rays[seen, 2]
    np.testing.assert_array_equal(rays[seen, 0], 0)
    assert (y > y_fold).all()
    np.testing.assert_allclose(ALONG(y), v[seen], atol=1e-11)
