"""This is where the newest turn of a signal becomes a phasor, whatever samples of it came."""

import math
from collections import deque

import numpy as np

__all__ = ["Fundamental"]

_ORDERS = (1, 3)
_FEWEST = 12
_WIDEST = 1.0  # rad between neighbours: a fifth of a turn at most is guessed


class Fundamental:
    """Synchronous demodulation over one turn of the drive, by least squares.

    value(ψ) = offset + Re Σ c_h exp(j h ψ), h = 1 and 3, is fitted to the samples of the newest turn, each at the phase
    that the drive had when it was taken. Offset, third harmonic and (by the whole turn) most of the rest do not reach
    c_1; times may be uneven, and lost samples only make the fit a little noisier. The result belongs to the middle of
    the turn: it is half a period old.
    """

    def __init__(self) -> None:
        self._samples: deque[tuple[float, float]] = deque()

    def add(self, phase: float, value: float) -> None:
        """Take a sample of a phase of the drive [rad]; one that is not newer than the last is left out."""
        if self._samples and phase <= self._samples[-1][0]:
            return
        self._samples.append((phase, value))
        while self._samples[0][0] < phase - math.tau:
            self._samples.popleft()

    def phasor(self, now: float) -> complex | None:
        """Return c_1 at the drive's present phase [rad], or None where the newest turn has too few samples."""
        phases = np.array([phase for phase, _ in self._samples])
        if phases.size < _FEWEST or now - phases[-1] > _WIDEST or phases[-1] - phases[0] < math.tau - _WIDEST:
            return None
        if np.diff(phases).max() > _WIDEST:
            return None
        values = np.array([value for _, value in self._samples])
        waves = [wave(order * phases) for order in _ORDERS for wave in (np.cos, np.sin)]
        design = np.stack([np.ones_like(phases), *waves], axis=1)
        # The normal equations of a nearly orthogonal basis: exact enough, and a quarter of the time of a QR.
        found = np.linalg.solve(design.T @ design, design.T @ values)
        return complex(found[1], -found[2])
