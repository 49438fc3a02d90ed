"""The joint fit as a least-squares problem: rows of the gyroscope, of the currents, and of what is known.

The coordinates are the shared parameters (see `joint_coordinates`), then for every repetition at a pretension its two
deviations, in units of the rig's stated repeatability. Their rows, and those of the rig's bounds, are priors.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz

from sinew.identify.joint.coordinates import Coordinates
from sinew.identify.joint.motion import Seen, simulate_swings
from sinew.identify.joint.swing import Sieve, Swing, make_sieve
from sinew.identify.oscillator.least_squares import Problem
from sinew.measure.arrays import Array

Pair = tuple[int, float, int]

_ROUGH = 0.2  # share of a swing's rate that a first search takes for noise
_ORDER = 6
_ROUNDING = 0.289  # LSB: standard deviation of what rounding does to a constant
_DITHERED = 0.0716  # LSB: the same of the mean over a sine of so many LSB, times the root of that


@dataclass(frozen=True)
class Whitening:
    """How the residuals of one swing become independent draws of variance one.

    coefficients: a of e_n + Σ a_k e_{n-k}, shape (order,). std: of that sum [rad/s].
    """

    coefficients: Array
    std: float

    def applied(self, rows: Array) -> Array:
        """Return whitened rows, (k, ...) to (k - order, ...), less their mean, as the gyroscope may have any bias."""
        order = self.coefficients.size
        white = rows[order:].copy()
        for k, a in enumerate(self.coefficients, start=1):
            white += a * rows[order - k : -k]
        return np.asarray((white - white.mean(axis=0)) / self.std)


@dataclass(frozen=True)
class JointProblem:
    """Everything that a search needs.

    measured: what is compared of the gyroscope's rate, for each swing. pairs: of recording, pretension and repeat.
    repeatability: standard deviations of pretension [m] and guide friction [1]; where one is zero the pair has no such
    deviation. current_std: of each swing's mean current [A].
    """

    swings: tuple[Swing, ...]
    coordinates: Coordinates
    sieves: tuple[Sieve, ...]
    measured: tuple[Array, ...]
    pairs: tuple[Pair, ...]
    repeatability: tuple[float, float]
    current_std: Array
    steps: int
    whitenings: tuple[Whitening, ...]

    @property
    def shared(self) -> int:
        """Return the number of shared parameters."""
        return len(self.coordinates.names)

    @property
    def size(self) -> int:
        """Return the number of coordinates."""
        return self.shared + 2 * len(self.pairs)

    def column(self, swing: Swing) -> int:
        """Return the coordinate of the deviation of the pretension that a swing shares; the friction's is the next."""
        return self.shared + 2 * self.pairs.index(swing.pair)

    def deviations(self, x: Array) -> Array:
        """Return the deviations of pretension [m] and guide friction [1] of every swing, shape (swing, 2)."""
        rows = [x[column : column + 2] for column in map(self.column, self.swings)]
        return np.array(rows) * self.repeatability

    def simulated(self, x: Array, *, slopes: bool = False) -> list[Seen]:
        """Return what every swing would look like."""
        shared = x[: self.shared]
        directions = self.coordinates.directions(shared) if slopes else None
        numbers = self.coordinates.numbers(shared)
        return simulate_swings(self.swings, numbers, self.deviations(x), self.steps, directions)

    def predicted(self, x: Array) -> list[tuple[Array, float]]:
        """Return the gyroscope's readings of every swing [rad/s], (n,), and the mean current over its segment [A]."""
        found = []
        for swing, sieve, seen in zip(self.swings, self.sieves, self.simulated(x), strict=True):
            current = float(seen.values[swing.recorded :, 1].mean())
            found.append((sieve.averaged(seen.values[:, 0]), current))
        return found

    def residuals(self, x: Array) -> list[Array]:
        """Return simulated less measured of every swing, low-passed and thinned [rad/s]."""
        rows = zip(self.sieves, self.measured, self.predicted(x), strict=True)
        return [sieve.passed(rate) - measured for sieve, measured, (rate, _) in rows]

    def problem(self) -> Problem:
        """Return the least-squares problem over the coordinates."""
        return Problem(self._residual, self._jacobian)

    def bounds(self) -> tuple[Array, Array]:
        """Return the bounds of the coordinates."""
        far = np.full(2 * len(self.pairs), 20.0)
        return np.concatenate([self.coordinates.low, -far]), np.concatenate([self.coordinates.high, far])

    def settings(self) -> list[tuple[tuple[float, str, float], slice]]:
        """Return of every swing its setting (pretension, kind, frequency), and its rows in residual and Jacobian."""
        found: list[tuple[tuple[float, str, float], slice]] = []
        begin = 0
        for swing, measured, whitening in zip(self.swings, self.measured, self.whitenings, strict=True):
            end = begin + measured.size - whitening.coefficients.size
            found.append(((swing.pretension_mm, swing.kind, swing.frequency_hz), slice(begin, end)))
            begin = end
        return found

    def data_rows(self, jacobian: Array) -> Array:
        """Return those rows of a Jacobian that are data or deviations, without what the rig's bounds say."""
        return np.asarray(jacobian[: -self.shared] if self.shared else jacobian)

    def _residual(self, x: Array) -> Array:
        rows, currents = [], []
        for i, (rate, current) in enumerate(self.predicted(x)):
            rows.append(self.whitenings[i].applied(self.sieves[i].passed(rate) - self.measured[i]))
            currents.append((current - self.swings[i].current_a) / self.current_std[i])
        prior, _ = self.coordinates.prior(x[: self.shared])
        known = np.isfinite(self.current_std)
        return np.concatenate([*rows, np.array(currents)[known], x[self.shared :], prior])

    def _jacobian(self, x: Array) -> Array:
        rows, currents = [], []
        for i, seen in enumerate(self.simulated(x, slopes=True)):
            assert seen.slopes is not None
            own = self._own_columns(self.swings[i])
            rate = self.sieves[i].averaged(seen.slopes[:, :, 0].T)
            white = self.whitenings[i].applied(self.sieves[i].passed(rate)) * self._scales()
            rows.append(_spread(white, own, self.size))
            current = seen.slopes[:, self.swings[i].recorded :, 1].mean(axis=1) * self._scales()
            currents.append(_spread(current[None] / self.current_std[i], own, self.size))
        _, slope = self.coordinates.prior(x[: self.shared])
        known = np.isfinite(self.current_std)
        free = np.eye(self.size)[self.shared :]
        stated = np.hstack([np.diag(slope), np.zeros((self.shared, 2 * len(self.pairs)))])
        return np.concatenate([*rows, np.concatenate(currents)[known], free, stated])

    def _own_columns(self, swing: Swing) -> NDArray[np.intp]:
        first = self.column(swing)
        return np.array([*range(self.shared), first, first + 1], dtype=np.intp)

    def _scales(self) -> Array:
        return np.array([*[1.0] * self.shared, *self.repeatability])


def _spread(rows: Array, columns: NDArray[np.intp], size: int) -> Array:
    wide = np.zeros((rows.shape[0], size))
    wide[:, columns] = rows
    return wide


def make_problem(swings: Sequence[Swing], coordinates: Coordinates, steps: int) -> JointProblem:
    """Return the problem of a first search: a fifth of every swing's rate counts as noise."""
    rig = coordinates.rig
    sieves = tuple(make_sieve(swing, rig.imu.average_samples) for swing in swings)
    measured = tuple(sieve.passed(swing.gyro) for sieve, swing in zip(sieves, swings, strict=True))
    floor = max(rig.imu.gyro_noise.value, 1e-4)
    rough = [Whitening(np.zeros(0), _ROUGH * float(np.sqrt(np.mean(m**2))) + floor) for m in measured]
    repeatability = (rig.repeatability.pretension.value, rig.repeatability.guide_friction.value)
    pairs = tuple(dict.fromkeys(swing.pair for swing in swings))
    currents = _current_std(swings, rig.tendons.current_lsb.value)
    return JointProblem(
        tuple(swings), coordinates, sieves, measured, pairs, repeatability, currents, steps, tuple(rough)
    )


def _current_std(swings: Sequence[Swing], lsb: float) -> Array:
    """Return the standard deviation of every swing's mean current [A], infinite where there is none.

    Rounding of a constant errs by up to half an LSB, and by the same in all swings of a pair; over a sine of a LSB its
    mean is J₀(2πa)/π, which falls with the root of a. Counted as one common error per pair.
    """
    found = []
    for swing in swings:
        if not np.isfinite(swing.current_a):
            found.append(np.inf)
            continue
        amplitude = max(swing.current_swing_a / lsb, 1e-6)
        alike = sum(other.pair == swing.pair for other in swings)
        found.append(lsb * min(_ROUNDING, _DITHERED / np.sqrt(amplitude)) * np.sqrt(alike))
    return np.array(found)


def whitening_of(residuals: Sequence[Array], floor: float) -> tuple[Whitening, ...]:
    """Return the whitening of every swing from the residuals of a fit: one autoregression for all, a size for each.

    floor: smallest standard deviation of a whitened residual [rad/s].
    """
    centred = [r - r.mean() for r in residuals]
    sizes = [max(float(np.sqrt(np.mean(r**2))), 1e-12) for r in centred]
    count = sum(r.size for r in centred)
    lags = np.array(
        [
            sum(float(r[: r.size - k] @ r[k:]) / s**2 for r, s in zip(centred, sizes, strict=True))
            for k in range(_ORDER + 1)
        ]
    )
    lags[0] *= 1 + 1e-6
    coefficients = -solve_toeplitz(lags[:-1], lags[1:]) if count > 20 * _ORDER else np.zeros(0)
    plain = Whitening(np.asarray(coefficients, dtype=float), 1.0)
    stds = [float(np.sqrt(np.mean(plain.applied(r) ** 2))) for r in centred]
    return tuple(Whitening(plain.coefficients, max(std, floor)) for std in stds)
