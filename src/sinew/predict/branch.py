"""This is where a predicted response is kept: its curve, what is marked on it, and how good it is."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sinew.predict.curve_guess import interpolated_peak

__all__ = ["Branch", "Mark", "Prediction"]

Array = NDArray[np.float64]

_FEWEST = 7  # points of a curve about its peak


@dataclass(frozen=True)
class Mark:
    """A marked point: frequency [Hz], amplitude (half of peak to peak), lag of the fundamental [rad]."""

    frequency_hz: float
    amplitude: float
    phase: float


@dataclass(frozen=True)
class Branch:
    """One curve of n steady motions in the order in which it was followed, in the unit of the response (rad).

    amplitude: half of peak to peak over the period, (n,). harmonics: complex amplitudes c_h, (n, h), of the orders
    (h,): response = Re Σ c_h exp(jhΩt). drive: fundamental of what drives, (n,); its unit is the drive's.
    phase: lag of the response's fundamental behind the drive's [rad], from -π/2 to 3π/2, (n,).
    multiplier: modulus of the largest Floquet multiplier, (n,); stable below one, NaN where nobody asked for it.
    folds: in the order of the curve. peak: the largest amplitude, None where it lies at an end of the curve.
    phase_90: where the response lags by 90°; of several the one with the largest amplitude.
    error: what the last refinement of the waves changed at each point (n,): of the amplitude, in shares of the largest
    one, and of the frequency [1], the larger of both. What is left after it is smaller.
    complete: whether the curve reaches an end of the band. message: how it ended, in words.
    """

    frequency_hz: Array
    amplitude: Array
    phase: Array
    orders: NDArray[np.int64]
    harmonics: NDArray[np.complex128]
    drive: NDArray[np.complex128]
    multiplier: Array
    folds: tuple[Mark, ...]
    peak: Mark | None
    phase_90: Mark | None
    error: Array
    complete: bool
    message: str

    @property
    def stable(self) -> NDArray[np.bool_]:
        """Return which points are stable, (n,)."""
        return np.asarray(self.multiplier < 1)

    @property
    def fundamental(self) -> Array:
        """Return the amplitude of the fundamental, (n,)."""
        return np.asarray(np.abs(self.harmonics[:, self.orders == 1][:, 0]))

    @property
    def fundamental_peak(self) -> Mark | None:
        """Return where the fundamental is largest, its size in place of the amplitude; None at an end of the curve.

        `peak` is that of half of peak to peak, which of a motion that repeats is the paper's mean of peaks (Eq. 6).
        """
        size = self.fundamental
        if size.size < _FEWEST or int(np.argmax(size)) in (0, size.size - 1):
            return None
        return Mark(*interpolated_peak(self.frequency_hz, size, self.phase))


@dataclass(frozen=True)
class Prediction:
    """Curves of several lanes. harmonics: the highest that was used. error_estimate: the largest error of all points.
    wall_s: time that it took [s]."""

    branches: tuple[Branch, ...]
    harmonics: int
    error_estimate: float
    wall_s: float
