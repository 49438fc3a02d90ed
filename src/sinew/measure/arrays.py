"""Arrays: the types of real and complex ones, and the mean that leaves out what was not measured."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complexes = NDArray[np.complex128]


def mean_of_known(values: Array, otherwise: float = np.nan) -> Array:
    """Return the mean over the last axis without what is not finite, `otherwise` where nothing is left.

    `numpy.nanmean` does the same but warns where nothing is left, which a sweep with a lost group is.
    """
    known = np.isfinite(values)
    count = known.sum(axis=-1)
    return np.asarray(np.where(count > 0, np.where(known, values, 0.0).sum(axis=-1) / np.maximum(count, 1), otherwise))
