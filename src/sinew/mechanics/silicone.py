"""Silicone: the memory that makes its loss factor, as a short Prony series."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import nnls

BAND_HZ = (0.3, 30.0)
"""Band over which the loss factor is held constant [Hz]."""

BRANCHES = 4
"""Maxwell branches; over two decades four keep the loss factor within 2 % of constant."""


def relaxation_times() -> NDArray[np.float64]:
    """Return the relaxation times τ_i of the branches [s], shape (branch,), longest first."""
    corner_hz = np.geomspace(BAND_HZ[0] / 1.3, BAND_HZ[1] * 1.3, BRANCHES)
    return np.asarray(1 / (2 * np.pi * corner_hz))


def prony_shares(loss_factor: float) -> NDArray[np.float64]:
    """Return the branch stiffnesses g_i as shares of the relaxed stiffness, shape (branch,).

    Fitted by non-negative least squares to tan δ = G''/G' = `loss_factor` over `BAND_HZ`; the condition
    G'' - tan δ G' = 0 is linear in g, with G* = 1 + Σ g_i iωτ_i/(1 + iωτ_i).
    """
    omega = 2 * np.pi * np.geomspace(*BAND_HZ, 60)
    wt = omega[:, None] * relaxation_times()
    storage, loss = wt**2 / (1 + wt**2), wt / (1 + wt**2)
    shares, _ = nnls(loss - loss_factor * storage, np.full(omega.size, loss_factor))
    return np.asarray(shares)


def complex_stiffness(shares: ArrayLike, frequency_hz: ArrayLike) -> NDArray[np.complex128]:
    """Return G*(f) over the relaxed stiffness, shape of `frequency_hz`."""
    jwt = 2j * np.pi * np.asarray(frequency_hz, dtype=float)[..., None] * relaxation_times()
    return np.asarray(1 + np.sum(np.asarray(shares) * jwt / (1 + jwt), axis=-1))
