"""This is where the size of steady motions is measured: half of peak to peak, fundamental, phase behind the drive.

Motions are rows x of scaled unknowns, (k, m + 1); so are gradients by them.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sinew.predict.waves import Equations, orders, slices

__all__ = ["HalfRange", "drive_phasor", "half_range", "lag_product", "phasors"]

Array = NDArray[np.float64]
Complexes = NDArray[np.complex128]

_GRID = 96
_STEPS = 4


class HalfRange(NamedTuple):
    """Half of peak to peak of the response in its scale (k,), and its gradient (k, m + 1)."""

    value: Array
    gradient: Array


def _places(equations: Equations, harmonics: int, index: int) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """Return a coordinate's orders and where its cosines and (for orders above zero) sines stand."""
    part, h = slices(equations, harmonics)[index], orders(equations.coordinates[index], harmonics)
    cosines = part.start + np.arange(h.size)
    return h.astype(float), cosines, np.arange(part.start + h.size, part.stop)


def phasors(x: Array, equations: Equations, harmonics: int, index: int) -> Complexes:
    """Return the complex amplitudes c_h of a coordinate in its scale, y = Re Σ c_h exp(jhτ), shape (k, h)."""
    h, cosines, sines = _places(equations, harmonics, index)
    c = x[:, cosines].astype(complex)
    c[:, h > 0] -= 1j * x[:, sines]
    return c


def _fundamental(equations: Equations, harmonics: int, index: int) -> tuple[int, int]:
    h, cosines, sines = _places(equations, harmonics, index)
    return int(cosines[h == 1][0]), int(sines[h[h > 0] == 1][0])


def drive_phasor(x: Array, equations: Equations, harmonics: int) -> Complexes:
    """Return the fundamental of what drives: of a coordinate in its scale, or -j where sin τ drives, (k,)."""
    if equations.drive is None:
        return np.full(len(x), -1j)
    cosine, sine = _fundamental(equations, harmonics, equations.drive)
    return np.asarray(x[:, cosine] - 1j * x[:, sine])


def lag_product(x: Array, equations: Equations, harmonics: int) -> tuple[Complexes, Array]:
    """Return (drive times conjugate response, the fundamentals in their scales, (k,); gradient of its real part,
    (k, m + 1)). Its argument is the lag; the real part is zero where the response lags by 90°."""
    cosine, sine = _fundamental(equations, harmonics, equations.response)
    drive = drive_phasor(x, equations, harmonics)
    gradient = np.zeros_like(x)
    gradient[:, cosine], gradient[:, sine] = drive.real, -drive.imag
    if equations.drive is not None:
        theirs = _fundamental(equations, harmonics, equations.drive)
        gradient[:, theirs] += x[:, (cosine, sine)]
    return drive * np.conj(x[:, cosine] - 1j * x[:, sine]), gradient


def _turning_point(c: Complexes, h: Array, sign: float) -> tuple[Array, Array]:
    """Return (largest value for sign 1, least for -1, (k,); its phase (k,)), refined from a grid by Newton's method."""
    phase = 2 * np.pi * np.arange(_GRID) / _GRID
    waves = np.exp(1j * np.outer(h, phase))
    at = phase[np.argmax(sign * (c @ waves).real, axis=1)]
    for _ in range(_STEPS):
        terms = c * np.exp(1j * at[:, None] * h)
        slope, curvature = (terms * 1j * h).real.sum(axis=1), -(terms * h**2).real.sum(axis=1)
        step = slope / np.where(curvature == 0, 1.0, curvature)
        at = at - np.clip(step, -2 * np.pi / _GRID, 2 * np.pi / _GRID)
    return (c * np.exp(1j * at[:, None] * h)).real.sum(axis=1), at


def half_range(x: Array, equations: Equations, harmonics: int) -> HalfRange:
    """Return half of peak to peak of the response over the period."""
    h, cosines, sines = _places(equations, harmonics, equations.response)
    c = phasors(x, equations, harmonics, equations.response)
    symmetric = equations.coordinates[equations.response].parity == "odd"
    value, gradient = np.zeros(len(x)), np.zeros_like(x)
    for sign in (1.0,) if symmetric else (1.0, -1.0):
        share = sign if symmetric else 0.5 * sign
        height, at = _turning_point(c, h, sign)
        value += share * height
        gradient[:, cosines] += share * np.cos(at[:, None] * h)
        gradient[:, sines] += share * np.sin(at[:, None] * h[h > 0])
    return HalfRange(value, gradient)
