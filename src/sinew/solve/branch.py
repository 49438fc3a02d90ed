"""A response curve: its points, what is marked on it, how good it is, and how a sweep meets it."""

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from sinew.measure.arrays import Array, Complexes, Mask
from sinew.solve.landmark import interpolated_peak

_FEWEST = 7  # points of a curve about its peak
_NEUTRAL = 1e-9  # a spring of the guides that never slides keeps a disturbance as it is: its multiplier is one


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
    multiplier: modulus of the largest Floquet multiplier, (n,); stable up to one, NaN where nobody asked for it.
    folds: in the order of the curve. peak: the largest amplitude, None where it lies at an end of the curve.
    phase_90: where the response lags by 90°; of several the one with the largest amplitude.
    error: what the last refinement of the waves changed at each point (n,): of the amplitude, in shares of the largest
    one, and of the frequency [1], the larger of both. What is left after it is smaller.
    motion: amplitudes of all coordinates in their units as `solve.balance` orders them, of `waves` harmonics, (n, m);
    empty where it is not kept.
    holes: indices of the points, ascending, before which others are missing, because they could not be refined.
    complete: whether the curve reaches an end of the band. message: how it ended, in words.
    """

    frequency_hz: Array
    amplitude: Array
    phase: Array
    orders: NDArray[np.int64]
    harmonics: Complexes
    drive: Complexes
    multiplier: Array
    folds: tuple[Mark, ...]
    peak: Mark | None
    phase_90: Mark | None
    error: Array
    complete: bool
    message: str
    motion: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    waves: int = 0
    holes: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, dtype=np.intp), repr=False)

    @property
    def stable(self) -> Mask:
        """Return which points are stable, (n,)."""
        return np.asarray(self.multiplier < 1 + _NEUTRAL)

    @property
    def phasor(self) -> Complexes:
        """Return the complex amplitude c of the fundamental, (n,): response = Re c exp(jΩt)."""
        return np.asarray(self.harmonics[:, self.orders == 1][:, 0])

    @property
    def fundamental(self) -> Array:
        """Return the amplitude of the fundamental, (n,)."""
        return np.asarray(np.abs(self.phasor))

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


# A curve is read at given frequencies, as a sweep up or down would meet it.
#
# A sweep with growing frequency follows the curve from its beginning until a fold throws it on; so at a frequency it
# meets the first place of the curve there, and a sweep with falling frequency the last. Without folds both are the
# same. Between the points of the curve a cubic runs over the length along it.

Direction = Literal["up", "down"]

_PARTS = 12
_NEAR = 1e-9


class Swept(NamedTuple):
    """What a sweep meets at each frequency (g,), NaN where the curve does not reach.

    amplitude: half of peak to peak [rad]. phase: lag of the fundamental [rad]. fundamental: complex, of the response;
    drive: complex, of what drives; their phases are against the command's sine (which is -j).
    """

    amplitude: Array
    phase: Array
    fundamental: Complexes
    drive: Complexes


def sweep(branch: Branch, frequency_hz: Array, direction: Direction) -> Swept:
    """Return what a sweep over a curve meets at frequencies [Hz] in any order, (g,)."""
    columns = _columns(branch)
    along = columns if direction == "up" else columns[::-1]
    found = np.full((frequency_hz.size, columns.shape[1]), np.nan)
    if len(along) > 1:
        f = along[:, 0] if direction == "up" else -along[:, 0]
        asked = frequency_hz if direction == "up" else -frequency_hz
        # The first place at or beyond a frequency: beyond a fold the curve comes back below what it has passed.
        reached = np.maximum.accumulate(f)
        slack = _NEAR * abs(float(f[-1]))
        where = np.searchsorted(reached, asked - slack)
        inside = (asked >= f[0] - slack) & (where < f.size)
        after = np.clip(where[inside], 1, f.size - 1)
        width = f[after] - f[after - 1]
        share = np.clip((asked[inside] - f[after - 1]) / np.where(width == 0, 1.0, width), 0.0, 1.0)
        found[inside] = along[after - 1] + share[:, None] * (along[after] - along[after - 1])
    phase = np.mod(found[:, 2] + np.pi / 2, 2 * np.pi) - np.pi / 2
    return Swept(found[:, 1], phase, found[:, 3] + 1j * found[:, 4], found[:, 5] + 1j * found[:, 6])


def _columns(branch: Branch) -> Array:
    """Return frequency, amplitude, unwrapped lag and both fundamentals along the curve, made dense, (n, 7)."""
    first = branch.phasor
    rows = (branch.frequency_hz, branch.amplitude, np.unwrap(branch.phase))
    columns = np.stack([*rows, first.real, first.imag, branch.drive.real, branch.drive.imag], axis=1)
    if len(columns) < 3:
        return columns
    scale = np.maximum(np.ptp(columns[:, :2], axis=0), 1e-300)
    length = np.hypot(*(np.diff(columns[:, :2], axis=0) / scale).T)
    keep = np.concatenate([[True], length > 0])
    at = np.concatenate([[0.0], np.cumsum(length)])[keep]
    fine = np.unique(np.concatenate([at[:-1] + share * np.diff(at) for share in np.arange(_PARTS) / _PARTS] + [at]))
    return np.asarray(CubicSpline(at, columns[keep])(fine))
