"""A response curve: its points, what is marked on it, how good it is, and how a sweep meets it."""

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from sinew.measure.arrays import Array, Complexes, Mask
from sinew.solve.balance import Equations, Lane, Size
from sinew.solve.examination import evaluate, half_range, lag_product, rows_of, solved

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
        hertz = frequency_hz if direction == "up" else -frequency_hz
        # The first place at or beyond a frequency: beyond a fold the curve comes back below what it has passed.
        reached = np.maximum.accumulate(f)
        slack = _NEAR * abs(float(f[-1]))
        where = np.searchsorted(reached, hertz - slack)
        inside = (hertz >= f[0] - slack) & (where < f.size)
        after = np.clip(where[inside], 1, f.size - 1)
        width = f[after] - f[after - 1]
        share = np.clip((hertz[inside] - f[after - 1]) / np.where(width == 0, 1.0, width), 0.0, 1.0)
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


# ---- marked points are located as points of their own: folds, peak and 90° of phase
#
# With x = (q / scale, Ω / omega), balance F(x) = 0 and tangent t(x), [F_x; nᵀ] t = (0, 1), a fold is an extremum of the
# frequency along the curve and the peak one of the amplitude: g = ∇h·t = 0. The point is the solution of the extended
# system F = 0, g = 0 by Newton's method. As F_x t = 0 along the curve, the derivative of g needs no second solve per
# unknown: with y from [F_x; nᵀ]ᵀ (y, ·) = ∇h it is H_h t - yᵀ ∂F_x/∂t. The changes along the tangent are central
# differences: they only steer Newton's method, g itself is exact.

FOLD, PEAK, QUARTER = range(3)
"""Kinds: extremum of the frequency, extremum of the amplitude, response 90° behind the drive."""

_STEPS, _LONGEST, _IDLE = 10, 0.05, 3


class Search(NamedTuple):
    """How marked points are searched, in scaled unknowns. nudge: of the central differences. enough: last correction at
    which the search ends; a point whose last correction is larger counts as not found.

    Equations with kinks (a duty at its limit, friction that turns round) have a g that jumps a little where a kink
    passes a sample. Their nudge has to reach over several of these jumps; the points are as exact as the jumps allow,
    and a search that goes from one jump to the next, whose corrections become in three steps no half as long, is given
    up.
    """

    nudge: float = 1e-5
    enough: float = 1e-8


class Located(NamedTuple):
    """Points (k, m + 1) and size of the last correction (k,), in scaled unknowns; half of peak to peak of the response
    in its scale (k,), and drive times conjugate response, fundamentals, (k,)."""

    points: Array
    error: Array
    half_range: Array
    lag: NDArray[np.complex128]


def _height(x: Array, peak: Array, equations: Equations, harmonics: int) -> Array:
    """Return the gradient of what is extremal: the amplitude at a peak, the frequency at a fold."""
    gradient = half_range(x, equations, harmonics).gradient
    level = np.zeros_like(x)
    level[:, -1] = 1.0
    return np.where(peak[:, None], gradient, level)


def locate(
    x: Array, normal: Array, kind: NDArray[np.int64], lane: Lane, equations: Equations, size: Size, search: Search
) -> Located:
    """Return the marked points nearest to k guesses.

    x: (k, m + 1), on or near the curve. normal: tangents of the curve there, (k, m + 1). kind: of each, (k,).
    lane: with a leading axis k.
    """
    best, error = x.copy(), np.full(len(x), np.inf)
    there, tangents, left = x.copy(), normal.copy(), np.arange(len(x))
    near, idle = np.full(len(x), np.inf), np.zeros(len(x), dtype=int)
    for _ in range(_STEPS):
        now, across, own = there[left], normal[left], rows_of(lane, left)
        quarter, peak = kind[left] == QUARTER, kind[left] == PEAK
        bent = np.flatnonzero(~quarter)  # whose condition has derivatives along the curve in it
        nudge = search.nudge * tangents[left[bent]]
        beside = [now[bent] + nudge, now[bent] - nudge]
        lanes = rows_of(own, np.concatenate([np.arange(left.size), bent, bent]))
        seen = evaluate(np.concatenate([now, *beside]), lanes, equations, size)
        slope, ahead, behind = np.split(seen.slope, [left.size, left.size + bent.size])
        matrix = np.concatenate([slope, across[:, None, :]], axis=1)
        last = np.zeros_like(now)
        last[:, -1] = 1.0
        tangents[left] = tangent = solved(matrix, last)
        product, g_slope = lag_product(now, equations, size.harmonics)
        up = _height(now, peak, equations, size.harmonics)
        g = np.where(quarter, product.real, np.sum(up * tangent, axis=1))
        bend = np.subtract(*(_height(z, peak[bent], equations, size.harmonics) for z in beside))
        back = solved(matrix[bent].transpose(0, 2, 1), up[bent])[:, :-1]
        turn = np.einsum("ki,kij->kj", back, ahead - behind)
        g_slope[bent] = (bend - turn) / (2 * search.nudge)
        change = solved(
            np.concatenate([slope, g_slope[:, None, :]], axis=1),
            -np.concatenate([seen.left[: left.size], g[:, None]], axis=1),
        )
        length = np.linalg.norm(change, axis=1)
        there[left] += change * np.minimum(1.0, _LONGEST / np.maximum(length, 1e-300))[:, None]
        again = quarter & (error[left] >= search.enough)  # one more step is free of kinks
        nearer = (length > _LONGEST) | (length < 0.5 * near[left])
        near[left], idle[left] = np.where(nearer, length, near[left]), np.where(nearer, 0, idle[left] + 1)
        better = left[length < error[left]]
        best[better], error[better] = there[better], length[length < error[left]]
        left = left[again | (error[left] >= search.enough) & (idle[left] < _IDLE)]
        if not left.size:
            break
    size_there = half_range(best, equations, size.harmonics).value
    return Located(best, error, size_there, lag_product(best, equations, size.harmonics)[0])


# The marked points of a curve are first seen: between which of its points they lie, and about where.


class Guess(NamedTuple):
    """A marked point about to be located: its kind, point and tangent (m + 1,)."""

    kind: int
    point: Array
    tangent: Array


def _between(points: Array, tangents: Array, i: int, share: float) -> tuple[Array, Array]:
    """Return (point, tangent) at a share of the way from point i to the next one, on the cubic through both."""
    rise = points[i + 1] - points[i]
    length = float(np.linalg.norm(rise))
    begin, end = length * tangents[i], length * tangents[i + 1]
    square, cube = 3 * rise - 2 * begin - end, begin + end - 2 * rise
    point = points[i] + share * (begin + share * (square + share * cube))
    tangent = begin + share * (2 * square + 3 * share * cube)
    return point, tangent / np.linalg.norm(tangent)


def _fold(points: Array, tangents: Array, i: int) -> Guess:
    rise = points[i + 1, -1] - points[i, -1]
    length = float(np.linalg.norm(points[i + 1] - points[i]))
    begin, end = length * tangents[i, -1], length * tangents[i + 1, -1]
    roots = np.roots([3 * (begin + end - 2 * rise), 2 * (3 * rise - 2 * begin - end), begin])
    inside = [float(r.real) for r in np.atleast_1d(roots) if abs(r.imag) < 1e-9 and 0 <= r.real <= 1]
    share = inside[0] if inside else float(begin / (begin - end))
    return Guess(FOLD, *_between(points, tangents, i, share))


def _peak(points: Array, tangents: Array, size: Array) -> list[Guess]:
    i = int(np.argmax(size))
    if i in (0, size.size - 1):
        return []
    left, right = (float(np.linalg.norm(points[j] - points[i])) for j in (i - 1, i + 1))
    down, up = (size[i] - size[i - 1]) / left, (size[i + 1] - size[i]) / right
    curvature = 2 * (up - down) / (left + right)
    slope = (down * right + up * left) / (left + right)
    along = float(np.clip(-slope / curvature, -left, right)) if curvature < 0 else 0.0
    if along < 0:
        return [Guess(PEAK, *_between(points, tangents, i - 1, 1 + along / left))]
    return [Guess(PEAK, *_between(points, tangents, i, along / right))]


def interpolated_peak(frequency: Array, size: Array, lag: Array) -> tuple[float, float, float]:
    """Return frequency, size and lag of the highest point of the quartic through the seven points about the largest.

    frequency, size, lag: along the curve, (n,). Where kinks keep a peak from being located, this is what is left.
    """
    i = int(np.clip(np.argmax(size), 3, max(size.size - 4, 3)))
    near = slice(max(i - 3, 0), i + 4)
    steps = np.hypot(np.diff(frequency[near]) / np.ptp(frequency), np.diff(size[near]) / np.max(size))
    along = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.linspace(0.0, along[-1], 2001)
    degree = min(4, along.size - 1)
    fits = [np.polynomial.Polynomial.fit(along, row[near], degree)(at) for row in (frequency, size, lag)]
    best = int(np.argmax(fits[1]))
    return float(fits[0][best]), float(fits[1][best]), float(fits[2][best])


def _quarter(points: Array, tangents: Array, size: Array, product: NDArray[np.complex128]) -> list[Guess]:
    real = product.real
    crossings = np.flatnonzero((real[:-1] > 0) & (real[1:] <= 0) | (real[:-1] <= 0) & (real[1:] > 0))
    if not crossings.size:
        return []
    i = int(crossings[np.argmax(size[crossings])])
    share = float(real[i] / (real[i] - real[i + 1]))
    return [Guess(QUARTER, *_between(points, tangents, i, share))]


def guesses(points: Array, tangents: Array, size: Array, product: NDArray[np.complex128]) -> list[Guess]:
    """Return what is to be located on one curve: every fold, the highest point, the highest crossing of 90°.

    points, tangents: (n, m + 1). size: half of peak to peak of the response, (n,). product: drive times conjugate
    response, fundamentals, (n,). A curve that is highest at an end has no peak.
    """
    along = tangents[:, -1]
    folds = [_fold(points, tangents, int(i)) for i in np.flatnonzero(along[:-1] * along[1:] < 0)]
    return [*folds, *_peak(points, tangents, size), *_quarter(points, tangents, size, product)]
