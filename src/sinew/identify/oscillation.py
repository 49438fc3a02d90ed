"""This is where a free oscillation about a moving rest position is written down, with its derivatives."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

__all__ = ["FreeOscillation", "polynomials"]

Array = NDArray[np.float64]
Complexes = NDArray[np.complex128]

_LARGEST = 50.0  # of the exponent: an amplitude of e^50 is no fit


@dataclass(frozen=True)
class FreeOscillation:
    """x(s) = Σ_m Re[exp(S_m) (1 + h₂ exp(S_m) + h₃ exp(2S_m))] + o |exp(2S)| + rest(s), at the samples of one record.

    S_m(s) = Σ_k c_mk B_mk(s) with complex c: real part the logarithm of the amplitude, imaginary part the phase. With
    B = (1, s) that is one damped oscillation, c_1 = -λ + jω; with more functions of s both change with time.
    s: time in units of the window, from 0 to 1, shape (n,).
    bases: B of each mode, shape (n, K_m).
    rest: columns of the rest position, shape (n, R); relaxing: beside them exp(-s exp(-p)) with its size, p the
        logarithm of the time constant in windows.
    harmonics: with h₂, h₃ and o of the one mode, as a swing of quadratic and cubic stiffness has them.

    Parameters, in this order: Re c_mk, Im c_mk in turn, (Re h₂, Im h₂, Re h₃, Im h₃, o), rest, (size, p).
    """

    s: Array
    bases: tuple[Array, ...]
    rest: Array
    relaxing: bool = False
    harmonics: bool = False
    width: int = field(init=False)

    def __post_init__(self) -> None:
        count = sum(2 * basis.shape[1] for basis in self.bases)
        object.__setattr__(self, "width", count + 5 * self.harmonics + self.rest.shape[1] + 2 * self.relaxing)

    def mode(self, m: int) -> slice:
        """Return where the coefficients of a mode lie in the parameters."""
        first = sum(2 * int(basis.shape[1]) for basis in self.bases[:m])
        return slice(first, first + 2 * int(self.bases[m].shape[1]))

    @property
    def rest_start(self) -> int:
        """Return where the parameters of the rest position begin."""
        return int(self.mode(len(self.bases) - 1).stop) + 5 * self.harmonics

    def exponent(self, p: Array, m: int = 0) -> Complexes:
        """Return S_m at the samples, shape (n,)."""
        c = p[self.mode(m)]
        exponent = self.bases[m] @ (c[0::2] + 1j * c[1::2])
        return np.asarray(np.minimum(exponent.real, _LARGEST) + 1j * exponent.imag)

    def rest_position(self, p: Array) -> Array:
        """Return the rest position at the samples, shape (n,)."""
        first, count = self.rest_start, self.rest.shape[1]
        level = self.rest @ p[first : first + count]
        if self.relaxing:
            level = level + p[-2] * np.exp(-self.s * self._relaxation_rate(p))
        return np.asarray(level, dtype=float)

    def values(self, p: Array) -> Array:
        """Return x at the samples, shape (n,)."""
        x = self.rest_position(p)
        for m in range(len(self.bases)):
            wave = np.exp(self.exponent(p, m))
            if self.harmonics:
                h2, h3, offset = self._harmonics(p)
                x = x + offset * np.abs(wave) ** 2
                wave = wave * (1.0 + wave * (h2 + h3 * wave))
            x = x + wave.real
        return np.asarray(x, dtype=float)

    def jacobian(self, p: Array) -> Array:
        """Return the derivatives of x by the parameters, shape (n, width)."""
        out = np.empty((self.s.size, self.width))
        for m, basis in enumerate(self.bases):
            wave = np.exp(self.exponent(p, m))
            by_real = by_imaginary = wave
            if self.harmonics:
                h2, h3, offset = self._harmonics(p)
                by_imaginary = wave * (1.0 + wave * (2.0 * h2 + 3.0 * h3 * wave))
                by_real = by_imaginary + 2.0 * offset * np.abs(wave) ** 2
                first = self.mode(m).stop
                square, cube = wave**2, wave**3
                columns = [square.real, -square.imag, cube.real, -cube.imag, np.abs(square)]
                out[:, first : first + 5] = np.stack(columns, axis=1)
            where = self.mode(m)
            out[:, where][:, 0::2] = by_real.real[:, None] * basis
            out[:, where][:, 1::2] = -by_imaginary.imag[:, None] * basis
        first, count = self.rest_start, self.rest.shape[1]
        out[:, first : first + count] = self.rest
        if self.relaxing:
            rate = self._relaxation_rate(p)
            fading = np.exp(-self.s * rate)
            out[:, -2], out[:, -1] = fading, p[-2] * fading * self.s * rate
        return out

    @staticmethod
    def _relaxation_rate(p: Array) -> float:
        return float(np.exp(np.clip(-p[-1], -_LARGEST, _LARGEST)))

    def _harmonics(self, p: Array) -> tuple[complex, complex, float]:
        h = p[self.mode(len(self.bases) - 1).stop :]
        return complex(h[0], h[1]), complex(h[2], h[3]), float(h[4])


def polynomials(s: Array, count: int) -> Array:
    """Return 1, s, s², ..., shape (n, count)."""
    return np.asarray(np.vander(s, count, increasing=True), dtype=float)
