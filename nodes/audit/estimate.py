"""Estimates the error of all pixels from that of some, as a ratio of weighted sums, with an interval."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

UNSEEN = 1.5
"""Pixels of the largest weight that have events and were not drawn, as many as are allowed for."""


@dataclass(frozen=True)
class Interval:
    """Holds an estimate and the bounds of its 95 % interval; NaN where there is nothing to estimate from."""

    value: float
    low: float
    high: float


def ratio(amount: np.ndarray, size: np.ndarray, chance: np.ndarray) -> Interval:
    """Estimates sum(amount) / sum(size) over all pixels, a number of 0 ... 1, from those drawn.

    amount, size: float64 [N] of the pixels that were drawn; chance: float64 [N], theirs to be drawn. The variance is
    that of the linearised ratio (Sarndal, Swensson and Wretman, "Model Assisted Survey Sampling", 1992, 5.6) with
    Hajek's approximation for draws of a fixed number, and an allowance for pixels that were not drawn. The interval is
    Student's, with as many degrees of freedom as pixels of equal influence would have, of both parts together
    (Satterthwaite, 1946), on the logit of the ratio, so that it stays in 0 ... 1.
    """
    weight = 1.0 / chance
    total = float((weight * size).sum())
    if not total > 0:
        return Interval(np.nan, np.nan, np.nan)
    value = float((weight * amount).sum() / total)
    influence = weight * (amount - value * size) / total
    inside = (size > 0) & (chance < 1)
    if not inside.any():
        return Interval(value, value, value) if (chance >= 1).all() else Interval(value, 0.0, 1.0)
    share = (1 - chance[inside]) * influence[inside] ** 2
    count = len(share)
    effective = share.sum() ** 2 / max((share**2).sum(), 1e-300) if share.sum() > 0 else 0.0
    if count < 2 or effective <= 1:
        return Interval(value, 0.0, 1.0)
    # The image may hold a few pixels with events where none were expected, of large weight and none of them drawn:
    # one is allowed for, divided by those that were.
    residual = (amount - value * size)[inside]
    heavy = int((weight[inside] >= weight.max() / 2).sum())
    unseen = UNSEEN * weight.max() ** 2 * (residual**2).mean() / total**2 / (1 + heavy)
    found = float(share.sum()) * count / (count - 1)
    freedom = (found + unseen) ** 2 / (found**2 / max(effective - 1, 1.0) + unseen**2 / (count - 1))
    reach = student_quantile(freedom) * np.sqrt(found + unseen)
    if not 0 < value < 1:
        return Interval(value, max(0.0, value - reach), min(1.0, value + reach))
    middle, spread = np.log(value / (1 - value)), reach / (value * (1 - value))
    low, high = (1 / (1 + np.exp(-np.clip(middle + s * spread, -50, 50))) for s in (-1, 1))
    return Interval(value, float(low), float(high))


def student_quantile(freedom: float) -> float:
    """Gives the 97.5 % quantile of Student's t by Hill's expansion about the normal one, to 0.1 % from 3 on.

    G. W. Hill, "Algorithm 396: Student's t-quantiles", 1970; below 3 the exact values of 1 and 2 are joined.
    """
    if freedom < 3:
        return float(np.interp(freedom, [1, 1.5, 2, 2.5, 3], [12.706, 6.318, 4.303, 3.558, 3.182]))
    z = 1.959963984540054
    g1, g2 = (z**3 + z) / 4, (5 * z**5 + 16 * z**3 + 3 * z) / 96
    g3 = (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / 384
    g4 = (79 * z**9 + 776 * z**7 + 1482 * z**5 - 1920 * z**3 - 945 * z) / 92160
    return z + g1 / freedom + g2 / freedom**2 + g3 / freedom**3 + g4 / freedom**4
