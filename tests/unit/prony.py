"""The dynamic stiffness of a Prony series, written once more in its complex closed form."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sinew.mechanics.silicone import relaxation_times


def complex_stiffness(shares: ArrayLike, frequency_hz: ArrayLike) -> NDArray[np.complex128]:
    """Return 1 + Σ g_i jωτ_i/(1 + jωτ_i), G* over the relaxed one, shape of `frequency_hz`."""
    turned = 2j * np.pi * np.asarray(frequency_hz, dtype=float)[..., None] * relaxation_times()
    return np.asarray(1 + np.sum(np.asarray(shares) * turned / (1 + turned), axis=-1))
