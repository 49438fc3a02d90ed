"""This is where rates that were read and rates that were simulated are made comparable: averaged, low-passed, thinned.

The lever's encoder rounds to 1.5 mrad, and its rounding reaches the simulated rate as noise that grows with frequency.
What the joint does, it does below a few times the drive's frequency. So both rates pass one linear-phase low-pass, and
every so many samples are kept; the same is done to the derivatives.
"""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy import signal

from sinew.identify.joint_swing import Swing

__all__ = ["Sieve", "is_enough", "make_sieve"]

Array = NDArray[np.float64]

_PASS_HZ, _STOP_HZ, _STOPPED_DB = 15.0, 30.0, 60.0
_KEPT_HZ = 50.0
_FEWEST = 16


@dataclass(frozen=True)
class Sieve:
    """The low-pass of one swing.

    taps: odd in number, symmetric. kept: samples of the swing that are compared, shape (k,). average: samples that the
    gyroscope's readings are the mean of.
    """

    taps: Array
    kept: NDArray[np.intp]
    average: int

    def averaged(self, rate: Array) -> Array:
        """Return the causal mean over `average` samples along the first axis, as the twin's sensor takes it."""
        padded = np.concatenate([np.repeat(rate[:1], self.average - 1, axis=0), rate])
        total = np.cumsum(np.concatenate([np.zeros_like(padded[:1]), padded]), axis=0)
        return np.asarray((total[self.average :] - total[: -self.average]) / self.average)

    def passed(self, rate: Array) -> Array:
        """Return what is compared of a rate, (n, ...) to (k, ...); before its first sample the joint was at rest."""
        half = self.taps.size // 2
        ends = np.zeros((half, *rate.shape[1:]))
        windows = sliding_window_view(np.concatenate([ends, rate, ends]), self.taps.size, axis=0)
        return np.asarray(windows[self.kept] @ self.taps)


def make_sieve(swing: Swing, average: int) -> Sieve:
    """Return the sieve of a swing: of its segment what is not at an end or a gap of the record."""
    rate_hz = 1 / swing.sample_s
    every = max(1, int(rate_hz / _KEPT_HZ + 1e-6))
    taps = np.ones(1)
    if rate_hz > 2.2 * _STOP_HZ:
        width = 2 * np.pi * (_STOP_HZ - _PASS_HZ) / rate_hz
        count = int(np.ceil((_STOPPED_DB - 7.95) / (2.285 * width))) // 2 * 2 + 1
        window = ("kaiser", signal.kaiser_beta(_STOPPED_DB))
        taps = signal.firwin(count, 0.5 * (_PASS_HZ + _STOP_HZ), window=window, fs=rate_hz)
    half = taps.size // 2
    # A sample that is not there spoils the lever's motion beside it and every window that it lies in.
    near = np.convolve(~swing.present, np.ones(2 * half + 9), mode="same")[: swing.size] > 0.5
    index = np.arange(swing.recorded, swing.size - half)[::every]
    return Sieve(np.asarray(taps, dtype=float), index[~near[index]], average)


def is_enough(swing: Swing, average: int) -> bool:
    """Return whether a swing keeps enough samples behind its sieve to be compared."""
    return make_sieve(swing, average).kept.size >= _FEWEST
