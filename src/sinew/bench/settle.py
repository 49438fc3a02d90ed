"""This is where it is told from the response itself when a group has settled.

A linear joint that is driven from rest swings at the drive's frequency and, dying away, at its own. Seen period by
period, the mean and the complex amplitudes at the drive's frequency and its harmonics are then

    z_k = Z + a q^k + b q̄^k,   q = exp((-λ + j(ω_d - Ω)) 2π/Ω),

the last two terms being the two halves of one real decay. Fitting them says how much of the transient is left, whether
it beats (far from the resonance) or creeps (at it), where a bare difference of two periods would be small by chance or
drown in noise. The harmonics are there because a decay at twice the drive's frequency hides from the fundamental.
"""

import math
from collections import deque
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from sinew.measure.arrays import Array, Complexes
from sinew.plan.plan import Sweep

_MEMORY = 16  # periods; a joint that is not quite linear is followed rather than averaged
_FEWEST = 5  # periods
_HARMONICS = 3
_DECAYS = np.geomspace(0.03, 4.0, 14)  # λ·2π/Ω of the grid
_TURNS = (np.arange(22) + 0.5) * math.pi / 22  # |(ω_d - Ω) 2π/Ω| of the grid, as far as a period shows it
_FAR = 20.0  # tolerances; what was further from the end is too large for a linear model to tell the last of it
_AHEAD = np.arange(0.5, 8.5, 0.5)  # periods over which what is left is looked for
_POLISH = 4
_SIGNIFICANT = 2.0
_BOUNDS = np.array([[math.log(_DECAYS[0]), 0.02], [math.log(_DECAYS[-1]), math.pi - 0.02]])


class SettleRule:
    """Says when the response to a drive of one frequency is steady.

    settle_s: never before [s], counted from the first sample. most_s: at the latest [s]. tolerance: share of the steady
    amplitude that the transient may still have. frequency_hz: of the drive.
    """

    def __init__(self, frequency_hz: float, settle_s: float, tolerance: float, most_s: float) -> None:
        self._frequency, self._settle_s, self._tolerance, self._most_s = frequency_hz, settle_s, tolerance, most_s
        self._amplitudes: deque[Complexes] = deque(maxlen=_MEMORY)
        self._start = math.nan
        self._elapsed = 0.0
        self.remaining = math.inf

    @classmethod
    def of(cls, sweep: Sweep, frequency_hz: float) -> "SettleRule":
        """Return the adaptive rule of a plan's sweep, for one of its frequencies."""
        return cls(frequency_hz, sweep.settle_s, sweep.settle_tolerance, sweep.settle_most_s)

    @property
    def is_settled(self) -> bool:
        """Whether recording may begin: little is left of the transient, or time is up."""
        return self.is_out_of_time or (self._elapsed >= self._settle_s and self.remaining < self._tolerance)

    @property
    def is_out_of_time(self) -> bool:
        """Whether the longest time has passed."""
        return self._elapsed >= self._most_s

    def feed(self, times: Sequence[float], rates: Sequence[float]) -> None:
        """Take one period of the drive.

        times: of the samples [s]. rates: of the torsion [rad/s], or any response that is linear in it. The first period
        begins with the drive. A period with too few samples makes the rule begin anew, without turning back its time.
        """
        if times:
            self._start = times[0] if math.isnan(self._start) else self._start
            self._elapsed = times[-1] - self._start + (times[-1] - times[0]) / max(len(times) - 1, 1)
        else:
            self._elapsed += 1.0 / self._frequency
        if len(times) < 2 * (2 * _HARMONICS + 1):
            self._amplitudes.clear()
            self.remaining = math.inf
            return
        self._amplitudes.append(_amplitudes(np.asarray(times) - self._start, np.asarray(rates), self._frequency))
        if len(self._amplitudes) >= _FEWEST and self._elapsed >= self._settle_s:
            self.remaining = _remaining(_late(np.array(self._amplitudes), _FAR * self._tolerance))


def _amplitudes(time: Array, rate: Array, frequency_hz: float) -> Complexes:
    """Return √2 times the mean and the amplitudes of the harmonics over one period, such that their squares add up."""
    phase = 2.0 * np.pi * frequency_hz * time
    columns = [np.full(time.size, math.sqrt(0.5))]
    for h in range(1, _HARMONICS + 1):
        columns += [np.cos(h * phase), np.sin(h * phase)]
    found = np.linalg.lstsq(np.stack(columns, axis=1), rate, rcond=None)[0]
    return np.concatenate([found[:1].astype(complex), found[1::2] - 1j * found[2::2]])


def _late(z: Complexes, far: float) -> Complexes:
    """Return the periods after the last one that differs from the newest by more than a share; five at least."""
    away = np.sqrt((np.abs(z - z[-1]) ** 2).sum(axis=1)) > far * abs(z[-1, 1])
    start = int(np.flatnonzero(away)[-1]) + 1 if away.any() else 0
    return z[min(start, len(z) - _FEWEST) :]


def _remaining(z: Complexes) -> float:
    """Return the transient's share of the steady amplitude after the last period; z: shape (periods, 1 + harmonics).

    The grid finds the place, a few steps of Gauss-Newton the point. The scatter of the periods counts as not settled
    too: noise beyond the tolerance hides what is left. Where the transient is not significant, it is all there is.
    """
    count = len(z)
    z = z / max(float(np.abs(z[:, 1]).mean()), 1e-12)
    caught = np.einsum("gik,ic->gkc", _grid(count).conj(), z)
    best = int(np.argmax((np.abs(caught) ** 2).sum(axis=(1, 2))))
    point = np.array([math.log(_DECAYS[best // _TURNS.size]), _TURNS[best % _TURNS.size]])
    value, off = _fit(point, z)
    for _ in range(_POLISH):
        slope = np.stack([(_fit(point + step, z)[1] - off).ravel() / 1e-4 for step in 1e-4 * np.eye(2)], axis=1)
        both = np.concatenate([slope.real, slope.imag])
        move = np.linalg.lstsq(both, -np.concatenate([off.real.ravel(), off.imag.ravel()]), rcond=1e-8)[0]
        candidate = np.clip(point + np.clip(move, -0.5, 0.5), *_BOUNDS)
        new, new_off = _fit(candidate, z)
        if _square(new_off) >= _square(off):
            break
        point, value, off = candidate, new, new_off
    numbers = 2 * z.size
    plain = _square(z - z.mean(axis=0))
    freedom = numbers - 6 * z.shape[1] - 2
    if (plain - _square(off)) / (4 * z.shape[1] + 2) < _SIGNIFICANT * _square(off) / freedom:
        return math.sqrt(plain / count)
    steady, first, second = value
    q = np.exp((count - 1 + _AHEAD) * complex(-math.exp(point[0]), point[1]))[:, None]
    ahead = np.sqrt((np.abs(first * q + second * q.conj()) ** 2).sum(axis=1))
    noise = math.sqrt(2 * z.shape[1] * _square(off) / freedom)
    return float(math.hypot(ahead.max(), noise) / max(abs(steady[1]), 1e-12))


def _square(z: Complexes) -> float:
    return float((np.abs(z) ** 2).sum())


def _basis(point: Array, count: int) -> Complexes:
    """Return (1, q^k, q̄^k) for periods k = 0 .. count - 1; point: (log of the decay, turn) per period, (..., 2)."""
    k = np.arange(count)
    q = np.exp(k * (-np.exp(point[..., :1]) + 1j * point[..., 1:]))
    return np.stack([np.ones_like(q), q, q.conj()], axis=-1)


def _fit(point: Array, z: Complexes) -> tuple[Complexes, Complexes]:
    """Return (Z, a and b with k = 0 at the first period, shape (3, channels); what they leave of z)."""
    basis = _basis(point, len(z))
    value = np.asarray(np.linalg.lstsq(basis, z, rcond=1e-6)[0], dtype=complex)
    return value, z - basis @ value


@lru_cache(maxsize=_MEMORY)
def _grid(count: int) -> Complexes:
    """Return an orthonormal basis of the model at every point of the grid, shape (points, count, 3)."""
    points = np.stack(np.meshgrid(np.log(_DECAYS), _TURNS, indexing="ij"), axis=-1).reshape(-1, 2)
    return np.linalg.qr(_basis(points, count))[0]
