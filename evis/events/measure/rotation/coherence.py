"""Checks a followed rotation over larger angles: whether what turns stays the same pattern while it turns.

Windows of some ms see so little of a turn that a shear, or two wheels side by side, pass for one rotation on an
ellipse. Turned back by the angle that was followed, the pattern of a true rotation looks alike half a radian later.
"""

from __future__ import annotations

import numpy as np

from evis.events.measure.rotation.polar import order_weights

BLOCK = 0.25
"""Way [rad] over which descriptors are summed."""
NEAR, FAR = 0.5, 1.5
"""Ways apart [rad] at which sums are compared."""
_WIDTH = 4.0
"""Width of the weights of the angular orders: an error of the angle of a tenth of a radian does no harm."""


def coherence(coefficients: np.ndarray, angle: np.ndarray) -> float:
    """Computes the mean correlation of the turned back pattern with itself, 1 = the same; NaN where less than 1 rad was
    seen.

    coefficients: complex64 [HARMONICS, steps, columns] of `polar.harmonics_of`; angle: float [steps, rad], NaN in steps
    to be left out.
    """
    known = np.isfinite(angle)
    if not known.any() or np.ptp(angle[known]) < NEAR + 2 * BLOCK:
        return float("nan")
    angle = angle[known]
    orders = np.arange(1, len(coefficients) + 1)
    back = np.exp(1j * orders[:, None] * angle) * np.sqrt(order_weights(_WIDTH))[:, None]
    pattern = (coefficients[:, known] * back[:, :, None]).transpose(1, 0, 2).reshape(len(angle), -1)
    block = np.floor((angle - angle.min()) / BLOCK).astype(np.int64)
    order = np.argsort(block, kind="stable")
    places, first = np.unique(block[order], return_index=True)
    sums = np.zeros((int(block.max()) + 1, pattern.shape[1]), np.complex128)
    sums[places] = np.add.reduceat(pattern[order], first, axis=0)
    size = np.linalg.norm(sums, axis=1)
    alike = whole = 0.0
    for apart in range(round(NEAR / BLOCK), round(FAR / BLOCK) + 1):
        if apart < len(sums):
            alike += float(np.real(np.vdot(sums[:-apart], sums[apart:])))
            whole += float(size[:-apart] @ size[apart:])
    return alike / whole if whole > 0 else float("nan")
