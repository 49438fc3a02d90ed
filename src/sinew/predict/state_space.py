"""This is where a linear system is kept as a state space, and asked for poles, zeros, gains and frequency response.

    ẋ = A x + B u,        y = C x + D u,        G(s) = C (s - A)⁻¹ B + D

Plain arrays: `control.ss` of python-control and `ss` of MATLAB read (A, B, C, D) as they are.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space

__all__ = ["Channel", "Pole", "StateSpace"]

Array = NDArray[np.float64]
Complexes = NDArray[np.complex128]

_NO_GAIN = 1e-12
_ORIGIN = 1e-6
"""A double root at the origin comes out of the eigenvalues as far from it as the root of their rounding."""


@dataclass(frozen=True)
class Pole:
    """A pole or zero s [1/s]; frequency |s|/2π [Hz] and damping ratio -Re s/|s|, which is one on the negative real
    axis and zero at the origin."""

    s: complex

    @property
    def frequency_hz(self) -> float:
        """Return |s|/2π [Hz], the undamped frequency."""
        return float(abs(self.s) / (2 * np.pi))

    @property
    def damping_ratio(self) -> float:
        """Return -Re s/|s| [1]."""
        return float(-self.s.real / abs(self.s)) if self.s != 0 else 0.0


@dataclass(frozen=True)
class Channel:
    """One input and one output: G(s) = gain Π(s - zeros)/Π(s - poles); static: G(0)."""

    input: str
    output: str
    zeros: tuple[Pole, ...]
    gain: float
    static: float


@dataclass(frozen=True)
class StateSpace:
    """A linear system in SI. a (n, n), b (n, i), c (o, n), d (o, i); states (n), inputs (i), outputs (o): names with
    their units."""

    a: Array
    b: Array
    c: Array
    d: Array
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    def poles(self) -> tuple[Pole, ...]:
        """Return the poles, the slowest first."""
        return _sorted(np.linalg.eigvals(self.a).astype(complex))

    def response(self, frequency_hz: Array | list[float]) -> Complexes:
        """Return G(jω) at frequencies [Hz], shape (f, o, i)."""
        s = 2j * np.pi * np.asarray(frequency_hz, dtype=float)
        matrix = s[:, None, None] * np.eye(len(self.a)) - self.a
        inner = np.linalg.solve(matrix, np.broadcast_to(self.b.astype(complex), (s.size, *self.b.shape)))
        return np.asarray(self.c @ inner + self.d)

    def channel(self, output: str, source: str) -> Channel:
        """Return zeros and gains from an input, by name, to an output."""
        i, o = self.inputs.index(source), self.outputs.index(output)
        b, c, d = self.b[:, i], self.c[o], float(self.d[o, i])
        zeros, gain = _zeros(self.a, b, c, d)
        static = float(d - c @ np.linalg.solve(self.a, b))
        return Channel(source, output, _sorted(zeros), gain, static)


def _sorted(roots: Complexes) -> tuple[Pole, ...]:
    """Return roots, the smallest first; those that rounding has moved away from the origin are put back."""
    small = _ORIGIN * np.max(np.abs(roots), initial=0.0)
    clean = [complex(root) if abs(root) > small else 0j for root in roots]
    return tuple(Pole(s) for s in sorted(clean, key=lambda s: (round(abs(s), 9), s.imag)))


def _zeros(a: Array, b: Array, c: Array, d: float) -> tuple[Complexes, float]:
    """Return (finite zeros, gain) of one channel.

    With r the first number for which h = C Aʳ⁻¹ B is not zero, feedback u = -C Aʳ x / h keeps the output at zero for
    ever on the space where C, C A, ... C Aʳ⁻¹ vanish; the zeros are the poles of what goes on there. No root at
    infinity has to be told from a large one, as it would in the pencil of the system matrix.
    """
    rows: list[Array] = []
    row, gain = c, d
    scale = float(np.linalg.norm(c) * np.linalg.norm(b)) + abs(d)
    while abs(gain) <= _NO_GAIN * scale:
        if len(rows) == len(a):
            return np.zeros(0, dtype=complex), 0.0
        rows.append(row)
        gain = float(row @ b)
        row = row @ a
        scale = float(np.linalg.norm(rows[-1]) * np.linalg.norm(b))
    inner = a - np.outer(b, row) / gain
    if not rows:
        return np.linalg.eigvals(inner).astype(complex), gain
    unit = np.stack([one / np.linalg.norm(one) for one in rows])
    rest = null_space(unit)
    return np.linalg.eigvals(rest.T @ inner @ rest).astype(complex), gain
