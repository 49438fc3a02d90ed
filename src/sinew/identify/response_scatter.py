"""This is where the scatter of single points borrows strength from that of all."""

from dataclasses import replace

import numpy as np
from scipy import special

from sinew.identify.response_points import ResponsePoints

__all__ = ["squeeze_scatter"]

_LEAST = 1e-12


def squeeze_scatter(points: ResponsePoints) -> ResponsePoints:
    """Return the points with variances drawn towards their common one, as far as chance explains that they differ.

    A variance from few sidebands or repeats is itself uncertain, and points that came out quiet by chance would get
    too much weight. The variances of the output's fundamental are taken for draws about one value with a spread of its
    own, which the spread of their logarithms tells (Smyth, Stat. Appl. Genet. Mol. Biol. 3, 2004); each becomes the
    mean of its own and the common one, weighted with degrees of freedom. Known scatter (infinite `scatter_freedom`),
    and fewer than four points, stay as they are.
    """
    own = points.scatter_freedom
    if not np.isfinite(own) or points.size < 4:
        return points
    variance = 0.5 * np.trace(points.covariance, axis1=1, axis2=2) * points.input_amplitude**2
    half = 0.5 * own
    logarithm = np.log(variance) - special.digamma(half) + np.log(half)
    extra = float(logarithm.var(ddof=1) - special.polygamma(1, half))
    if extra > _LEAST:
        common = 2.0 * _inverse_trigamma(extra)
        middle = float(np.exp(logarithm.mean() + special.digamma(0.5 * common) - np.log(0.5 * common)))
        weight, freedom = common / (common + own), common + own
    else:
        middle, weight, freedom = float(np.exp(logarithm.mean())), 1.0, own * points.size
    shared = (middle / points.input_amplitude**2)[:, None, None] * np.eye(2)
    covariance = (1.0 - weight) * points.covariance + weight * shared
    return replace(points, covariance=covariance, scatter_freedom=float(freedom))


def _inverse_trigamma(value: float) -> float:
    if value > 1e7:
        return float(1.0 / np.sqrt(value))
    if value < 1e-6:
        return 1.0 / value
    x = 0.5 + 1.0 / value
    for _ in range(50):
        slope = float(special.polygamma(1, x))
        step = slope * (1.0 - slope / value) / float(special.polygamma(2, x))
        x += step
        if -step < 1e-8 * x:
            break
    return x
