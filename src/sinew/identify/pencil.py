"""This is where a sum of decaying oscillations is split into its poles without a guess, by the matrix pencil."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["Poles", "split_poles"]

Array = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Poles = list[tuple[complex, complex]]

_LONGEST = 300  # columns of the pencil: more tell little and cost their cube


def split_poles(values: Array, step_s: float, orders: tuple[int, ...]) -> list[Poles]:
    """Return, for each order, (pole [1/s], amplitude) of the oscillations found, the most energetic first.

    values: shape (n,), evenly sampled, the rest position's mean taken off or not; orders: how many poles to split into,
    an oscillation taking two. Poles above the real axis that decay are returned; a real pole is a creeping rest.
    x(t) = Σ Re[a exp(pt)]. Hua and Sarkar, IEEE Trans. Acoust. Speech Signal Process. 38, 1990: eigenvalues of the
    shift between the dominant right singular vectors of the Hankel matrix of the samples.
    """
    n = values.size
    columns = min(n // 2, _LONGEST)
    hankel = np.lib.stride_tricks.sliding_window_view(values, columns + 1)
    vectors = np.linalg.eigh(hankel.T @ hankel)[1][:, ::-1]  # right singular vectors, the largest first
    found = []
    for order in orders:
        basis = vectors[:, : min(order, columns)]
        shift = np.linalg.lstsq(basis[:-1], basis[1:], rcond=None)[0]
        found.append(_energetic(np.linalg.eigvals(shift).astype(complex), values, step_s))
    return found


def _energetic(steps: Complexes, values: Array, step_s: float) -> Poles:
    steps = steps[(np.abs(steps) > 1e-6) & (np.abs(steps) < 1.05)]
    if steps.size == 0:
        return []
    pole = np.log(steps) / step_s
    courses = np.exp(np.outer(np.arange(values.size) * step_s, pole))
    amplitude = np.linalg.lstsq(courses, values.astype(complex), rcond=None)[0]
    energy = (np.abs(courses) ** 2).sum(axis=0) * np.abs(amplitude) ** 2
    order = np.argsort(-energy)
    return [
        (complex(pole[k]), complex(2.0 * amplitude[k]))
        for k in order
        if pole[k].imag > 1e-6 / step_s and pole[k].real < 0
    ]
