"""Points of a stepped sine: frequency, complex response, scatter, size of the input; from a table or a recording."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from sinew.analysis.signal.least_squares import unit_columns
from sinew.analysis.sweep.response import Response
from sinew.identify.oscillator.least_squares import long_run
from sinew.identify.oscillator.model import SIGNIFICANT, Trends, rank_trend
from sinew.identify.oscillator.record import Excitation, Record, derivative_order, input_derivative
from sinew.measure.arrays import Array, Complexes, Mask
from sinew.measure.errors import RecordingError, SpecError

_FIVE_PERIODS = 12.0  # degrees of freedom of the scatter of a stretch of five periods: three pairs of sidebands
_ASSUMED, _FLOOR = 0.05, 0.1  # scatter where no row is repeated, over the size; sizes below this share of the largest
_FEWEST_REPEATS = 5  # degrees of freedom of a scatter from repeated rows
_SAME_LEVEL, _SAME_FREQUENCY = 0.1, 1e-4


@dataclass(frozen=True)
class ResponsePoints:
    """One stepped sine under one condition: n steady states, in order of frequency.

    frequency_hz: shape (n,). response: complex, fundamental of the output over that of the input, output_unit per
    input_unit, positive time convention exp(+jΩt), shape (n,). covariance: of its real and imaginary part,
    shape (n, 2, 2). input_amplitude: of the input's fundamental, shape (n,), in input_unit.
    excitation, output_unit, input_unit, output_said, input_said: as of a `Record`. group: name of the condition (a
    pretension, a level).
    scatter_freedom: degrees of freedom of each point's scatter, infinity where it is known.
    """

    frequency_hz: Array
    response: Complexes
    covariance: Array
    input_amplitude: Array
    excitation: Excitation
    output_unit: str = "1"
    input_unit: str = "1"
    group: str = ""
    scatter_freedom: float = np.inf
    notes: tuple[str, ...] = field(default=())
    output_said: str = ""
    input_said: str = ""

    @property
    def size(self) -> int:
        """Return the number of points."""
        return self.frequency_hz.size

    @property
    def signals(self) -> Record:
        """Return a record without samples that carries excitation, units and group, whose rules hold for points too."""
        nothing = np.empty(0)
        record = Record(nothing, nothing, nothing, self.excitation, self.output_unit, self.input_unit, group=self.group)
        return replace(record, output_said=self.output_said, input_said=self.input_said)

    def at(self, frequency_hz: float, input_amplitude: float) -> "ResponsePoints":
        """Return one point of the same kind at a frequency and drive, its response unknown."""
        one, unknown = np.ones(1), np.full(1, np.nan + 0j)
        return replace(
            self,
            frequency_hz=frequency_hz * one,
            response=unknown,
            covariance=np.full((1, 2, 2), np.nan),
            input_amplitude=input_amplitude * one,
        )

    def only(self, chosen: Mask | NDArray[np.intp]) -> "ResponsePoints":
        """Return the chosen points: a mask of shape (n,) or indices."""
        return replace(
            self,
            frequency_hz=self.frequency_hz[chosen],
            response=self.response[chosen],
            covariance=self.covariance[chosen],
            input_amplitude=self.input_amplitude[chosen],
        )


def make_points(
    frequency_hz: ArrayLike,
    response: ArrayLike,
    scatter: ArrayLike,
    input_amplitude: ArrayLike,
    *,
    excitation: Excitation,
    output_unit: str = "1",
    input_unit: str = "1",
    group: str = "",
    scatter_freedom: float = np.inf,
    notes: Sequence[str] = (),
) -> ResponsePoints:
    """Return points of a table, put in order of frequency; those that are not finite are left out.

    response: complex, output over input, shape (n,). scatter: its covariance, shape (n, 2, 2), or the standard
    deviations of real and imaginary part, shape (n, 2), or one for both, shape (n,) or a number; of the point itself.
    input_amplitude: shape (n,), or one number for all.
    Raises SpecError for an excitation without input, RecordingError for shapes that differ or points without scatter.
    """
    if excitation not in get_args(Excitation) or excitation == "none":
        raise SpecError(f"excitation is {excitation!r}; a response has an input: force, torque, base or lever")
    f, h = np.asarray(frequency_hz, dtype=float), np.asarray(response, dtype=complex)
    amplitude = np.broadcast_to(np.asarray(input_amplitude, dtype=float), f.shape)
    spread = np.asarray(scatter, dtype=float)
    if spread.ndim == 0:
        spread = np.broadcast_to(spread, f.shape)
    if spread.shape == f.shape:
        spread = np.repeat(spread[..., None], 2, axis=-1)
    if spread.ndim == 2:
        spread = spread[:, :, None] ** 2 * np.eye(2)
    if f.ndim != 1 or h.shape != f.shape or spread.shape != (f.size, 2, 2):
        raise RecordingError(
            f"frequency has shape {f.shape}, response {h.shape}, scatter {np.shape(scatter)}; expected one row a point"
        )
    known = np.isfinite(f) & np.isfinite(h) & np.isfinite(spread).all(axis=(1, 2)) & (amplitude > 0)
    good = known & (np.linalg.det(np.where(known[:, None, None], spread, 0.0)) > 0) & (f > 0)
    if known.any() and not good.any():
        raise RecordingError("no point has a scatter above zero; give the standard deviation of each point")
    order = np.flatnonzero(good)[np.argsort(f[good], kind="stable")]
    return ResponsePoints(
        f[order],
        h[order],
        spread[order],
        np.array(amplitude[order]),
        excitation,
        output_unit,
        input_unit,
        group,
        scatter_freedom,
        tuple(notes),
    )


def points_of_table(
    frequency_hz: ArrayLike,
    amplitude: ArrayLike,
    phase_rad: ArrayLike,
    drive: ArrayLike,
    *,
    excitation: Excitation,
    output_unit: str = "1",
    input_unit: str = "1",
) -> tuple[ResponsePoints, ...]:
    """Return the points of a table of steady states, one group for each level of the drive, with notes on them.

    frequency_hz, amplitude (of the output's fundamental), phase_rad (against the input's), drive (amplitude of the
    input's): shape (n,), in any order, rows may be repeated. A phase may count ahead or behind: a joint never runs
    ahead of what drives it, which tells. excitation: what the input is: force, torque, base or lever. output_unit,
    input_unit: SI and radians. The scatter, the same share of each size, is that of repeated rows; without them it is
    taken for 5 %, of which intervals do not depend, as they follow from what the fit leaves.
    Raises RecordingError for fewer than four rows, a drive that is not positive, or as `make_points` does.

    >>> import numpy as np
    >>> import sinew as sn
    >>> hertz = np.linspace(2, 4, 9)
    >>> sine = 0.1 / (9 - hertz**2 + 0.3j * hertz)
    >>> (points,) = sn.points_of_table(hertz, abs(sine), np.angle(sine), 0.1 * np.ones(9), excitation="force")
    >>> points.size
    9
    """
    f, a, phase, d = (np.asarray(one, dtype=float) for one in (frequency_hz, amplitude, phase_rad, drive))
    known = np.isfinite(f) & np.isfinite(a) & np.isfinite(phase) & np.isfinite(d)
    f, a, phase, d = f[known], a[known], phase[known], d[known]
    if f.size < 4:
        raise RecordingError(f"found {f.size} whole rows of steady states, expected at least 4; measure more of them")
    if not (f > 0).all() or not (d > 0).all():
        raise RecordingError(
            "found a frequency or an amplitude of the drive that is not above zero; each row is one steady state"
        )
    response = a * np.exp(1j * phase) / d
    notes = []
    if _runs_ahead(f, response, excitation, output_unit, input_unit):
        response = response.conj()
        notes.append("the phase was taken as a lag: nothing runs ahead of what drives it")
    order = np.argsort(d)
    level = np.zeros(f.size, dtype=int)
    level[order] = np.cumsum(np.diff(np.log(d[order]), prepend=np.log(d[order[0]])) > _SAME_LEVEL)
    floor = _FLOOR * float(np.abs(response).max())
    size = np.hypot(np.abs(response), floor)
    share, freedom = _repeated_scatter(f, level, response, floor)
    if share is None:
        share = _ASSUMED
        notes.append(
            "no row was repeated: intervals follow from what the fit leaves, be that scatter or a law that is missing"
        )
    unit = "" if input_unit == "1" else f" {input_unit}"
    return tuple(
        make_points(
            f[mine],
            response[mine],
            share * size[mine],
            d[mine],
            excitation=excitation,
            output_unit=output_unit,
            input_unit=input_unit,
            group=f"{float(np.median(d[mine])):.3g}{unit}",
            scatter_freedom=freedom,
            notes=notes,
        )
        for mine in (level == one for one in range(int(level.max()) + 1))
    )


def _runs_ahead(f: Array, response: Complexes, excitation: Excitation, output_unit: str, input_unit: str) -> bool:
    """Return whether the motion, the input being what it is, would take no energy up but give it."""
    signals = Record(np.empty(0), np.empty(0), np.empty(0), excitation, output_unit, input_unit)
    turn = 2j * np.pi * f
    sign = -1.0 if excitation in ("base", "lever") else 1.0
    over_push = sign * response / turn ** (derivative_order(output_unit) + input_derivative(signals))
    return bool(np.sum((over_push / np.abs(over_push).max()).imag) > 0)


def _repeated_scatter(
    f: Array, level: NDArray[np.int64], response: Complexes, floor: float
) -> tuple[float | None, float]:
    """Return standard deviation of real and imaginary part over the size, from repeated rows, and its degrees of
    freedom; None and infinity without them."""
    total, freedom = 0.0, 0
    order = np.lexsort((f, level))
    new = (np.diff(np.log(f[order]), prepend=-np.inf) > _SAME_FREQUENCY) | (np.diff(level[order], prepend=-1) > 0)
    for rows in np.split(order, np.flatnonzero(new)[1:]):
        middle = response[rows].mean()
        away = (response[rows] - middle) / np.hypot(np.abs(middle), floor)
        total, freedom = total + float(np.sum(np.abs(away) ** 2)), freedom + 2 * (rows.size - 1)
    if freedom < _FEWEST_REPEATS or total == 0:
        return None, np.inf
    return float(np.sqrt(total / freedom)), float(freedom)


def turned(response: Complexes, relative: Array) -> Array:
    """Return covariances of real and imaginary part, (n, 2, 2), from relative noise of size and angle, (n, 2)."""
    turn = np.moveaxis(np.array([[response.real, -response.imag], [response.imag, response.real]]), 2, 0)
    return np.asarray(turn @ (relative[:, :, None] ** 2 * np.eye(2)) @ np.swapaxes(turn, 1, 2))


def points_of_response(response: Response, *, excitation: Excitation = "lever") -> tuple[ResponsePoints, ...]:
    """Return the points of an analysed recording, one group for each pretension, all repeats together.

    Torsion over measured drive, sensor chain undone (`sinew.analysis.sweep.response`). Groups are called "4 mm"; where
    the recording knows no pretension there is one group without a name.
    Raises RecordingError where no point has a measured drive.
    """
    columns = response.columns
    found = []
    for p, pretension in enumerate(response.pretension_mm):
        transfer = response.transfer[p]
        gain, gain_std = columns["gain_measured_drive"][p], columns["gain_measured_drive_std"][p]
        amplitude, angle_std = columns["drive_amplitude_rad"][p], columns["phase_std_rad"][p]
        frequency = np.broadcast_to(response.frequency_hz[:, None], transfer.shape)
        seen = np.isfinite(transfer) & np.isfinite(gain_std) & np.isfinite(angle_std) & (amplitude > 0)
        if not seen.any():
            continue
        h = transfer[seen]
        scatter = turned(h, np.stack([gain_std[seen] / gain[seen], angle_std[seen]], axis=1))
        name = f"{pretension:g} mm" if np.isfinite(pretension) else ""
        found.append(
            make_points(
                frequency[seen],
                h,
                scatter,
                amplitude[seen],
                excitation=excitation,
                output_unit="rad",
                input_unit="rad",
                group=name,
                scatter_freedom=_FIVE_PERIODS,
            )
        )
    if not found:
        raise RecordingError("no steady point has a measured drive; record the lever's angle, or fit in time instead")
    return tuple(found)


# The scatter of single points borrows strength from that of all, and residuals are asked whether it alone explains
# them.

_LEAST = 1e-12


def squeeze_scatter(points: ResponsePoints) -> ResponsePoints:
    """Return the points with variances drawn towards their common one, as far as chance explains that they differ.

    A variance from few sidebands or repeats is itself uncertain, and points that came out quiet by chance would get
    too much weight. The variances of the output's fundamental are taken for draws about one value with a spread of its
    own, which the spread of their logarithms tells (Smyth, Stat. Appl. Genet. Mol. Biol. 3, 2004); each becomes the
    mean of its own and the common one, weighted with degrees of freedom. Known scatter (infinite `scatter_freedom`),
    and fewer than four points, stay as they are.
    """
    own = points.scatter_freedom
    if not np.isfinite(own) or points.size < 4:
        return points
    variance = 0.5 * np.trace(points.covariance, axis1=1, axis2=2) * points.input_amplitude**2
    half = 0.5 * own
    logarithm = np.log(variance) - special.digamma(half) + np.log(half)
    extra = float(logarithm.var(ddof=1) - special.polygamma(1, half))
    if extra > _LEAST:
        common = 2.0 * _inverse_trigamma(extra)
        middle = float(np.exp(logarithm.mean() + special.digamma(0.5 * common) - np.log(0.5 * common)))
        weight, freedom = common / (common + own), common + own
    else:
        middle, weight, freedom = float(np.exp(logarithm.mean())), 1.0, own * points.size
    shared = (middle / points.input_amplitude**2)[:, None, None] * np.eye(2)
    covariance = (1.0 - weight) * points.covariance + weight * shared
    return replace(points, covariance=covariance, scatter_freedom=float(freedom))


def _inverse_trigamma(value: float) -> float:
    if value > 1e7:
        return float(1.0 / np.sqrt(value))
    if value < 1e-6:
        return 1.0 / value
    x = 0.5 + 1.0 / value
    for _ in range(50):
        slope = float(special.polygamma(1, x))
        step = slope * (1.0 - slope / value) / float(special.polygamma(2, x))
        x += step
        if -step < 1e-8 * x:
            break
    return x


@dataclass(frozen=True)
class ResponseTests:
    """What the residuals of the points look like.

    misfit: root mean square of the residuals in stated standard deviations, near 1 where model and scatter are right.
    chi_square_p: of the sum of squares by the stated scatter; NaN where that is itself known by too few repeats.
    neighbours_p, neighbours: of the correlation of residuals at neighbouring frequencies. trends: with the motion's.
    """

    misfit: float
    chi_square_p: float
    neighbours_p: float
    neighbours: float
    trends: Trends

    def sentences(self) -> tuple[str, ...]:
        """Return what speaks against the model, in words; none where nothing does."""
        found = []
        if self.chi_square_p < SIGNIFICANT:
            found.append(f"the model misses the points by {self.misfit:.2g} times their stated scatter")
        if self.neighbours_p < SIGNIFICANT:
            found.append(f"residuals of neighbouring frequencies go together (correlation {self.neighbours:.2f})")
        return (*found, *self.trends.sentences())


def ask_points(
    points: Sequence[ResponsePoints], residuals: Sequence[Complexes], motion: Sequence[Array], parameters: int
) -> ResponseTests:
    """Return the tests of the residuals of all groups.

    residuals: measured less predicted, in the unit of the response. motion: amplitude of the motion, shape (n,) each.
    parameters: how many were fitted.
    """
    whitened = [whiten(one, r) for one, r in zip(points, residuals, strict=True)]
    squares = [np.sum(w**2, axis=1) for w in whitened]
    count = 2 * sum(one.size for one in points)
    total = float(sum(s.sum() for s in squares))
    freedom = max(count - parameters, 1)
    # Over a scatter that was estimated with ν degrees of freedom each square is Hotelling's, 2ν/(ν-1) F(2, ν-1);
    # their sum is taken for a gamma variate of the same mean and variance.
    mean, variance = _hotelling(min(one.scatter_freedom for one in points))
    scale = freedom / count
    p = np.nan
    if np.isfinite(variance):
        n = 0.5 * count
        p = float(special.gammaincc(scale * n * mean**2 / variance, total * mean / variance))
    neighbours, pairs = _neighbours(whitened)
    size = np.sqrt(np.concatenate(squares))
    frequency = np.concatenate([one.frequency_hz for one in points])
    return ResponseTests(
        float(np.sqrt(total / freedom)),
        p,
        float(2 * special.ndtr(-abs(neighbours) * np.sqrt(pairs))) if pairs else np.nan,
        neighbours,
        Trends(rank_trend(np.concatenate(list(motion)), size), rank_trend(frequency, size)),
    )


def whiten(points: ResponsePoints, residual: Complexes) -> Array:
    """Return residuals as uncorrelated pairs of unit variance by the stated scatter, shape (n, 2)."""
    root = np.linalg.cholesky(points.covariance)
    pair = np.stack([residual.real, residual.imag], axis=1)
    return np.asarray(np.linalg.solve(root, pair[:, :, None])[:, :, 0])


def _hotelling(freedom: float) -> tuple[float, float]:
    """Return mean and variance of the square of a whitened pair."""
    if not np.isfinite(freedom):
        return 2.0, 4.0
    second = freedom - 1.0
    if second <= 4:
        return 2.0, np.inf
    factor = 2.0 * freedom / second
    mean = factor * second / (second - 2)
    return mean, factor**2 * 2 * second**2 * second / (2 * (second - 2) ** 2 * (second - 4))


def _neighbours(whitened: Sequence[Array]) -> tuple[float, int]:
    """Return the correlation of neighbouring pairs and how many products are in it."""
    above = sum(float(np.sum(w[1:] * w[:-1])) for w in whitened)
    below = sum(float(np.sum(w**2)) for w in whitened)
    pairs = sum(2 * max(w.shape[0] - 1, 0) for w in whitened)
    return (above / below if below > 0 else 0.0), pairs


def sandwich(rows: Array, residual: Array, sizes: Sequence[int]) -> tuple[Array, Array, Array]:
    """Return (classical, robust, lengths): covariances (m, m) of coefficients over `lengths`, of the columns (m,).

    rows, residual: weighted, two for each point, (2n, m) and (2n,). sizes: of the groups. The robust one is that of the
    scores of points, which go together over a sixth of their group.
    """
    n, m = rows.shape
    (scaled, lengths), freedom = unit_columns(rows), max(n - m, 1)
    gram = np.linalg.pinv(scaled.T @ scaled, hermitian=True)
    scores = (scaled * residual[:, None]).reshape(-1, 2, m).sum(axis=1)
    summed = sum(long_run(own, own.shape[0] // 6) for own in np.split(scores, np.cumsum(sizes)[:-1]))
    return float(residual @ residual) / freedom * gram, gram @ summed @ gram * (n / freedom), lengths
