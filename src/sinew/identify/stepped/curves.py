"""Curves of a driven response: frequency and damping over amplitude without a law, peak and backbone of a fit.

In a steady state of amplitude a the joint is, for its fundamental, a linear one whose stiffness and damping are those
of that amplitude (its describing functions):

    [K(a) - ω² + jω d(a)] y = g exp(jφ) · push,   K(a) = K₀ + K₁a² + K₂a⁴, d(a) = d₀ + d₁a + d₂a².

All of it is linear in the coefficients, so points of a few frequencies and levels of the drive tell them by regression,
whatever branch they lie on. ω = sqrt(K(a)) is the backbone: where the motion lags the push by 90°.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize

from sinew.analysis.signal.coloured_noise import solve_scaled
from sinew.identify.oscillator.least_squares import Covariance
from sinew.identify.oscillator.record import Scales, derivative_order
from sinew.identify.stepped.fit import ResponseFit, drive_of, motion_and_push, sandwich
from sinew.identify.stepped.oscillation import free_frequency, fundamentals, lag_of, lagging, swept, top_of_sweep
from sinew.identify.stepped.points import ResponsePoints
from sinew.measure.arrays import Array
from sinew.measure.errors import RecordingError, SpecError
from sinew.measure.estimate import NORMAL_90, Estimate

_ROUNDS = 12
_MOST_TERMS = 3
_UNKNOWN = Estimate(np.nan, np.nan, np.nan, np.nan)


@dataclass(frozen=True)
class Resonance:
    """Where a response to a drive of one amplitude resonates: its peak, or where the motion lags by 90°.

    input_amplitude: in the unit of the input. frequency_hz: of the resonance; amplitude: of the output there; gain:
    that over the drive, of the joint itself, without turn and background of the measuring chain. phase_90_hz: where the
    motion lags by 90°. reason: one sentence where there is no resonance in reach of the points, else empty.
    """

    input_amplitude: float
    frequency_hz: Estimate = _UNKNOWN
    gain: Estimate = _UNKNOWN
    amplitude: Estimate = _UNKNOWN
    phase_90_hz: Estimate = _UNKNOWN
    reason: str = ""


@dataclass(frozen=True)
class ResponseCurves:
    """Stiffness and damping against amplitude of one joint.

    points: that were fitted. stiffness, damping: coefficients K₀ [1/s²], K₁, ...; d₀ [1/s], d₁, ..., of powers of the
    amplitude over `scale`. covariance: of both and of real and imaginary part of the gain, in that order.
    amplitude_low, amplitude_high: of the motion, where there are points. misfit: root mean square of what the curves
    leave of a point, over its size.
    """

    points: tuple[ResponsePoints, ...]
    stiffness: Array
    damping: Array
    gain: complex
    covariance: Covariance
    scale: float
    amplitude_low: float
    amplitude_high: float
    misfit: float

    def frequency_hz(self, amplitude: ArrayLike) -> list[Estimate]:
        """Return the backbone sqrt(K(a))/2π at amplitudes of the motion, shape (a,)."""
        found = []
        for size in np.atleast_1d(np.asarray(amplitude, dtype=float)):
            powers, _ = self._powers(float(size))
            omega = float(np.sqrt(powers @ self.stiffness))
            slope = np.zeros(self.covariance.matrix.shape[0])
            slope[: powers.size] = powers / (2 * omega)
            found.append(self._estimate(omega / (2 * np.pi), slope / (2 * np.pi)))
        return found

    def damping_ratio(self, amplitude: ArrayLike) -> list[Estimate]:
        """Return d(a)/(2 sqrt(K(a))) at amplitudes of the motion, shape (a,)."""
        found = []
        for size in np.atleast_1d(np.asarray(amplitude, dtype=float)):
            even, every = self._powers(float(size))
            stiff, damped = float(even @ self.stiffness), float(every @ self.damping)
            slope = np.zeros(self.covariance.matrix.shape[0])
            slope[: even.size] = -0.25 * damped * stiff**-1.5 * even
            slope[even.size : even.size + every.size] = every / (2 * np.sqrt(stiff))
            found.append(self._estimate(damped / (2 * np.sqrt(stiff)), slope))
        return found

    def resonance(self, input_amplitude: float) -> Resonance:
        """Return where a drive of this amplitude is lagged by 90°, standard deviations to first order."""
        like = self.points[0]
        x = np.concatenate([self.stiffness, self.damping, [self.gain.real, self.gain.imag]])
        lanes = _around(x, self.covariance.matrix)
        found = np.array([self._meet(lane, like, input_amplitude) for lane in lanes])
        if not np.isfinite(found).all():
            reason = f"at a drive of {input_amplitude:g} the lag is 90° at no amplitude near the measured ones"
            return Resonance(input_amplitude, reason=reason)
        rows = (found[:, 0], found[:, 1] / input_amplitude, found[:, 1])
        hertz, gain, amplitude = (_spread_of(row, self.covariance.degrees_of_freedom) for row in rows)
        return Resonance(input_amplitude, hertz, gain, amplitude, hertz)

    def _meet(self, x: Array, like: ResponsePoints, input_amplitude: float) -> tuple[float, float]:
        """Return frequency [Hz] and amplitude at which d(a) ω a is the push."""
        p, q = self.stiffness.size, self.damping.size
        gain = float(np.hypot(x[p + q], x[p + q + 1]))

        def omega(size: float) -> float:
            return float(np.sqrt(max(float(self._powers(size)[0] @ x[:p]), 1e-12)))

        def excess(size: float) -> float:
            at = omega(size)
            push = motion_and_push(like.at(at / (2 * np.pi), input_amplitude), "relative")[1]
            return at * float(self._powers(size)[1] @ x[p : p + q]) * size - gain * float(np.abs(push[0]))

        low, high = 0.5 * self.amplitude_low, 1.3 * self.amplitude_high
        if not excess(low) < 0 < excess(high):
            return np.nan, np.nan
        size = float(optimize.brentq(excess, low, high, xtol=1e-12 * high, rtol=1e-12))
        return omega(size) / (2 * np.pi), size

    def _powers(self, size: float) -> tuple[Array, Array]:
        even = np.arange(0.0, 2.0 * self.stiffness.size, 2.0)
        return np.power(size / self.scale, even), np.power(size / self.scale, np.arange(1.0 * self.damping.size))

    def _estimate(self, value: float, slope: Array) -> Estimate:
        std = float(np.sqrt(max(float(slope @ self.covariance.matrix @ slope), 0.0)))
        return Estimate.student(value, std, self.covariance.degrees_of_freedom)


def _around(x: Array, covariance: Array) -> Array:
    """Return x and one standard deviation to both sides of it along the columns of the covariance, (2m + 1, m)."""
    size, turned = np.linalg.eigh(0.5 * (covariance + covariance.T))
    root = (turned * np.sqrt(np.maximum(size, 0.0))).T
    return np.concatenate([x[None], x + root, x - root])


def _spread_of(values: Array, freedom: float) -> Estimate:
    """Return the estimate of what was read at each row of `_around`, shape (2m + 1,), to first order."""
    count = (values.size - 1) // 2
    share = 0.5 * (values[1 : count + 1] - values[count + 1 :])
    std = float(np.sqrt(share @ share)) if np.isfinite(values).all() else np.nan
    return Estimate.student(float(values[0]), std, freedom)


def fit_response_curves(
    points: ResponsePoints | Sequence[ResponsePoints],
    *,
    terms: tuple[int, int] | None = None,
    turned: bool = False,
) -> ResponseCurves:
    """Return stiffness and damping against amplitude from the points of one or several levels of a drive.

    terms: how many of K and of d (1 to 3 each); None for those that the information criterion prefers. turned: whether
    the measuring chain may turn the phase by a constant.
    The motion is that relative to the base. Residuals are weighted with the points' scatter and, where it is larger,
    with what the curves leave of a point's size, so that no part of the curve outvotes the rest. The covariance is that
    of the scores over neighbouring frequencies (Newey and West), at least the classical one. The measured motion is on
    both sides of the equation, so its scatter should be small beside it, a tenth or less.
    Raises RecordingError for fewer points than coefficients, or a stiffness that is not positive.
    """
    groups = (points,) if isinstance(points, ResponsePoints) else tuple(points)
    if terms is not None:
        return _fit(groups, *terms, turned)[0]
    sizes = range(1, _MOST_TERMS + 1)
    tried = [_fit(groups, p, q, turned) for p in sizes for q in sizes if sum(g.size for g in groups) >= p + q + 3]
    if not tried:
        raise RecordingError("too few points for curves of stiffness and damping; measure at least five")
    return min(tried, key=lambda one: one[1])[0]


def _fit(groups: tuple[ResponsePoints, ...], p: int, q: int, turned: bool) -> tuple[ResponseCurves, float]:
    """Return the curves of p and q terms and their information criterion."""
    pairs = [motion_and_push(one, "relative") for one in groups]
    y, push = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    omega = 2 * np.pi * np.concatenate([one.frequency_hz for one in groups])
    spread = [np.sqrt(0.5 * np.trace(one.covariance, axis1=1, axis2=2)) / np.abs(one.response) for one in groups]
    relative, size = np.concatenate(spread), np.abs(y)
    scale, centre = float(size.max()), float(np.median(omega)) ** 2
    s = size / scale
    columns = [s ** (2 * k) * y for k in range(p)] + [1j * omega * s**k * y for k in range(q)]
    columns += [-push, -1j * push] if turned else [-push]
    table, target = np.stack(columns, axis=1), (omega**2 - centre) * y
    n, m = 2 * y.size, table.shape[1]
    if n <= m:
        raise RecordingError(f"found {y.size} points for {m} coefficients; measure more frequencies or levels")
    x, misfit = np.zeros(m), 0.0
    weight = 1.0 / (np.abs(push) + 1e-300)
    for _ in range(_ROUNDS):
        rows = _real(table * weight[:, None])
        x = solve_scaled(rows, _real((target * weight)[:, None])[:, 0])
        dynamic = np.abs((table[:, : p + q] @ x[: p + q] - target) / y)
        off = np.abs(table @ x - target) / (dynamic * size)
        misfit = float(np.sqrt(np.mean(off**2)))
        weight = 1.0 / (dynamic * size * np.maximum(np.hypot(relative, misfit), 1e-12))
    rows = _real(table * weight[:, None])
    residual = rows @ x - _real((target * weight)[:, None])[:, 0]
    covariance = _covariance(rows, residual, [one.size for one in groups])
    stiffness, gain = x[:p].copy(), x[p + q :]
    stiffness[0] += centre
    curves = ResponseCurves(
        groups,
        stiffness,
        x[p : p + q],
        complex(gain[0], gain[1] if turned else 0.0),
        covariance if turned else Covariance(np.pad(covariance.matrix, (0, 1)), covariance.degrees_of_freedom),
        scale,
        float(size.min()),
        scale,
        misfit,
    )
    if not stiffness[0] > 0:
        raise RecordingError("the points ask for a negative stiffness; is the excitation the right one?")
    return curves, float(n * np.log(max(misfit, 1e-300) ** 2) + m * np.log(n))


def _real(columns: NDArray[np.complex128]) -> Array:
    """Return real and imaginary part of each point in turn, shape (2n, m)."""
    return np.stack([columns.real, columns.imag], axis=1).reshape(-1, columns.shape[1])


def _covariance(rows: Array, residual: Array, sizes: Sequence[int]) -> Covariance:
    n, m = rows.shape
    classical, robust, lengths = sandwich(rows, residual, sizes)
    ratio = np.sqrt(np.maximum(np.diag(classical), 0.0) / np.maximum(np.diag(robust), 1e-300))
    larger = np.maximum(ratio, 1.0)
    return Covariance(robust * np.outer(larger, larger) / np.outer(lengths, lengths), float(n - m))


# Stepped sines at several levels of the drive say how the resonance moves with amplitude.


@dataclass(frozen=True)
class LevelDependence:
    """Resonance against the level of the drive.

    resonances: of each level, by its own points alone (`curves`), in order of level.
    bend_hz: of a straight line of the resonance frequency over the squared amplitude, its fall or rise from rest to the
    largest amplitude; negative where the joint softens. A scatter about it beyond chance is in its interval.
    shift_hz: resonance at the highest level less that at the lowest. verdict: one sentence.
    """

    resonances: tuple[Resonance, ...]
    curves: tuple[ResponseCurves, ...]
    bend_hz: Estimate
    shift_hz: Estimate
    verdict: str


def resonance_by_level(
    points: Sequence[ResponsePoints], *, terms: tuple[int, int] | None = None, turned: bool = False
) -> LevelDependence:
    """Return how the resonance of one joint moves with amplitude, from its response at two or more drive levels.

    points: one group for each level, its input amplitude the same at all frequencies. terms, turned: as in
    `fit_response_curves`.
    Raises SpecError for fewer than two levels, RecordingError as that does.
    """
    if len(points) < 2:
        raise SpecError(f"found {len(points)} level of the drive; an amplitude-dependent resonance needs at least two")
    levels = sorted(points, key=lambda one: float(np.median(one.input_amplitude)))
    curves = tuple(fit_response_curves(one, terms=terms, turned=turned) for one in levels)
    drives = [float(np.median(one.input_amplitude)) for one in levels]
    found = tuple(one.resonance(drive) for one, drive in zip(curves, drives, strict=True))
    bend = _bend(found)
    shift = _difference(found[-1].frequency_hz, found[0].frequency_hz)
    return LevelDependence(found, curves, bend, shift, _verdict(bend, shift))


def _bend(found: Sequence[Resonance]) -> Estimate:
    """Return the slope of frequency over squared amplitude times the largest square."""
    frequency = np.array([one.frequency_hz.value for one in found])
    std = np.array([one.frequency_hz.std for one in found])
    square = np.array([one.amplitude.value for one in found]) ** 2
    if not (np.isfinite(frequency) & np.isfinite(std) & (std > 0)).all():
        return _UNKNOWN
    design = np.stack([np.ones_like(square), square / square.max()], axis=1) / std[:, None]
    inverse = np.linalg.pinv(design)
    line = inverse @ (frequency / std)
    spare = len(found) - 2
    residual = frequency / std - design @ line
    excess = float(np.sqrt(residual @ residual / spare)) if spare else 1.0
    spread = float(np.linalg.norm(inverse[1])) * max(excess, 1.0)
    if excess > 1.0:
        return Estimate.student(float(line[1]), spread, spare)
    return Estimate.normal(float(line[1]), spread)


def _difference(one: Estimate, other: Estimate) -> Estimate:
    std = float(np.hypot(one.std, other.std))
    widest = max(((e.high - e.low) / (2 * e.std) for e in (one, other) if e.std > 0), default=NORMAL_90)
    value = one.value - other.value
    return Estimate(value, std, value - widest * std, value + widest * std)


def _verdict(bend: Estimate, shift: Estimate) -> str:
    if not np.isfinite(bend.value):
        return "cannot tell: a level shows no resonance inside its sweep"
    moved = f"from the lowest level to the highest the resonance moves by {shift.value:.3g} Hz"
    band = f"({shift.low:.3g} to {shift.high:.3g}, 90 %)"
    if bend.high < 0 and shift.high < 0:
        return f"the joint softens: {moved} {band}"
    if bend.low > 0 and shift.low > 0:
        return f"the joint hardens: {moved} {band}"
    return f"no dependence on amplitude beyond chance: {moved} {band}"


# A fitted response gives its resonance, and how that moves with amplitude, with intervals.

_REACH, _LAGS, _DEGREE = 0.25, 11, 5  # of the lag around the top [rad], points there, polynomial through them
_FINE = 2001
_BEYOND = 0.05  # of the swept range: how far outside it a peak is sought


@dataclass(frozen=True)
class ResponseBackbone:
    """Frequency of the free, lossless swing against amplitude, shape (a,) each: the curve on which 90° lags lie.

    amplitude: of the fundamental of the motion. frequency_low_hz, frequency_high_hz: the pointwise 90 % band.
    measured_to: largest amplitude of a fitted point; beyond it the curve is the model's alone.
    """

    amplitude: Array
    frequency_hz: Array
    frequency_std_hz: Array
    frequency_low_hz: Array
    frequency_high_hz: Array
    measured_to: float


def _numbers_around(fit: ResponseFit, part: int) -> Array:
    """Return numbers of one group at the fit and around it, as `_around` has them, shape (2m + 1, l)."""
    count = fit.layout.mechanics
    matrix = fit.covariance.matrix[:count, :count]
    if not np.isfinite(matrix).all():
        raise SpecError("a number of this fit is not determined at all; its peak has no interval, fit a smaller model")
    lanes, rest = _around(fit.solution.values[:count], matrix), fit.solution.values[count:]
    return np.stack([fit.layout.numbers(np.concatenate([lane, rest]), part) for lane in lanes])


def peak_of_response(fit: ResponseFit, input_amplitude: float | None = None, *, part: int = 0) -> Resonance:
    """Return resonance frequency and gain of a fitted response to a drive of one amplitude at all frequencies.

    input_amplitude: in the unit of the input; None for the median of the group's points; a linear joint does not feel
    it. part: index of the group. The peak is sought within the swept range and a twentieth of it beyond; the response
    is read along its lag, against which even a folded peak is single. Standard deviations to first order (delta method)
    from the fit's covariance.
    """
    points, scales = fit.points[part], fit.layout.layout.parts[part].scales
    amplitude = float(np.median(points.input_amplitude)) if input_amplitude is None else float(input_amplitude)
    around, laws = _numbers_around(fit, part), fit.layout.laws(part)
    drive = drive_of(points, scales, amplitude)
    hertz = scales.omega / (2 * np.pi)
    margin = _BEYOND * float(np.ptp(points.frequency_hz))
    low = max(float(points.frequency_hz[0]) - margin, 0.02 * hertz)
    high = float(points.frequency_hz[-1]) + margin
    top, inside = top_of_sweep(around[0], laws, drive, low / hertz, high / hertz)
    if not inside:
        reason = "the response is largest at the edge of the sweep; extend the sweep beyond it"
        return Resonance(amplitude, reason=reason)
    lag = lag_of(top, laws, drive)
    lags = np.r_[lag + np.linspace(-_REACH, _REACH, _LAGS), 0.5 * np.pi]
    lanes = around.shape[0]
    numbers = np.repeat(around, lags.size, axis=0)
    omega, motion, found = lagging(numbers, np.tile(lags, lanes), laws, drive, top)
    first = motion[:, laws.orders == 1][:, 0]
    gain = np.abs(_output(fit, scales, numbers, omega, first, amplitude)) / amplitude
    shape = (lanes, lags.size)
    omega, gain, found = omega.reshape(shape), gain.reshape(shape), found.reshape(shape)
    if not found[:, :-1].all():
        return Resonance(amplitude, reason="the balance was not found around the top of the response")
    frequency, largest = _tops(lags[:-1] - lag, hertz * omega[:, :-1], gain[:, :-1])
    freedom = fit.covariance.degrees_of_freedom
    crossed = found[:, -1].all() and fit.frame == "relative"
    return Resonance(
        amplitude,
        _spread_of(frequency, freedom),
        _spread_of(largest, freedom),
        _spread_of(largest * amplitude, freedom),
        _spread_of(hertz * omega[:, -1], freedom) if crossed else _UNKNOWN,
    )


def response_curve(fit: ResponseFit, part: int = 0) -> tuple[Array, NDArray[np.complex128]]:
    """Return frequencies [Hz] and fitted response of one group along its curve, through its folds, shape (n,) each.

    What turn and background the measuring chain adds is in it, as in the points.
    """
    points, scales = fit.points[part], fit.layout.layout.parts[part].scales
    amplitude, laws = float(np.median(points.input_amplitude)), fit.layout.laws(part)
    numbers, (turn, background) = fit.layout.numbers(fit.solution.values, part), fit.layout.added(fit.solution.values)
    hertz = scales.omega / (2 * np.pi)
    low, high = points.frequency_hz[[0, -1]] / hertz
    found = swept(numbers, laws, drive_of(points, scales, amplitude), float(low), float(high))
    lanes = np.broadcast_to(numbers, (len(found), numbers.size))
    moving = _output(fit, scales, lanes, found[:, -1], fundamentals(found, laws), amplitude)
    return hertz * found[:, -1], np.asarray(moving / amplitude * turn + background)


def _output(
    fit: ResponseFit,
    scales: Scales,
    numbers: Array,
    omega: Array,
    fundamental: NDArray[np.complex128],
    amplitude: float,
) -> NDArray[np.complex128]:
    """Return the output's fundamental, in its unit."""
    points = fit.points[0]
    moving = fundamental * scales.amplitude
    turn = 1j * omega * scales.omega
    if fit.frame == "absolute":
        carried = turn ** (-derivative_order(points.input_unit)) * amplitude
        moving = moving + numbers[:, -1] * scales.physical("gain") * carried
    return np.asarray(moving * turn ** derivative_order(points.output_unit))


def _tops(lag: Array, frequency: Array, gain: Array) -> tuple[Array, Array]:
    """Return frequency and gain of the top of each lane, shape (l,), through polynomials of the lag."""
    s = lag / _REACH
    fine = np.linspace(-1.0, 1.0, _FINE)
    curves = np.polynomial.polynomial.polyfit(s, np.log(gain).T, _DEGREE)
    tops = np.argmax(np.polynomial.polynomial.polyval(fine, curves), axis=1)
    places = np.polynomial.polynomial.polyfit(s, frequency.T, _DEGREE)
    at, largest = np.empty(tops.size), np.empty(tops.size)
    for row, top in enumerate(tops):
        series = np.polynomial.Polynomial(curves[:, row])
        where = fine[top]
        for _ in range(3):
            bend = float(series.deriv(2)(where))
            where = float(np.clip(where - series.deriv()(where) / bend, -1.0, 1.0)) if bend < 0 else where
        at[row] = np.polynomial.Polynomial(places[:, row])(where)
        largest[row] = np.exp(series(where))
    return at, largest


def backbone_of_response(fit: ResponseFit, amplitude: ArrayLike | None = None, *, part: int = 0) -> ResponseBackbone:
    """Return the backbone of a fit with its 90 % band, by the delta method.

    amplitude: of the motion (unit of the output, or of what it is the rate of); None for 21 from none to the largest
    that was measured.
    """
    points, scales = fit.points[part], fit.layout.layout.parts[part].scales
    turn = 2 * np.pi * points.frequency_hz
    moving = np.abs(points.response) * points.input_amplitude / turn ** derivative_order(points.output_unit)
    largest = float(moving.max())
    sizes = (
        np.linspace(0.0, largest, 22)[1:] if amplitude is None else np.atleast_1d(np.asarray(amplitude, dtype=float))
    )
    around, laws = _numbers_around(fit, part), fit.layout.laws(part)
    lanes = around.shape[0]
    numbers = np.repeat(around, sizes.size, axis=0)
    hertz = scales.omega / (2 * np.pi)
    found = hertz * free_frequency(numbers, np.tile(sizes, lanes) / scales.amplitude, laws)
    curves = [_spread_of(column, fit.covariance.degrees_of_freedom) for column in found.reshape(lanes, sizes.size).T]
    value, std, low, high = (
        np.array([getattr(one, name) for one in curves]) for name in ("value", "std", "low", "high")
    )
    return ResponseBackbone(sizes, value, std, low, high, largest)
