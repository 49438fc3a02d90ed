"""Frequency and damping of a ring-down, with intervals, and a verdict on its shape."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy import integrate, special

from sinew.analysis.decay.decay_fit import DecayFit, fit_decay, lehr_damping, pole_estimates
from sinew.analysis.decay.free_decay import (
    Envelope,
    Peaks,
    block_means,
    checked_record,
    evenly,
    find_peaks,
    fit_envelope,
    free_decay,
    large_peaks,
)
from sinew.analysis.signal.signals import Signals, read_signals
from sinew.measure.arrays import Array
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import Estimate
from sinew.measure.recording import Segment
from sinew.measure.schema import RESULT_VARIABLES, result_axis

# A decay shows whether it is exponential, and how damping and frequency move with amplitude.


_WINDOW_RATIO = 1.4  # a window lasts until the amplitude has shrunk by this factor,
_GOOD_ENOUGH = 0.03  # or its damping is as certain as this
_FEWEST = 4  # peaks of a window
_FAST = 0.15  # relative difference of the half cycles of such a window that makes one mean amplitude meaningless
_VERTEX = 1.23  # std of a vertex's phase by that of its relative height, for the filter of `peaks`
SIGNIFICANCE = 0.01
_DAMPING_EFFECT = 0.10  # relative change of the damping ratio that counts,
_FREQUENCY_EFFECT = 0.01  # and of the frequency
_STEPS = 2001  # of the means over the window
_END_OF_EFFECT = 0.2  # of the first amplitude: end of the comparison by the bent fit


@dataclass(frozen=True)
class AmplitudeDependence:
    """Frequency and damping in windows of the decay, from large amplitude to small.

    amplitude: mean amplitude of each window, shape (w,), unit of the response (of the angle for a rate).
    frequency_hz, damping_ratio: shape (w,), from the peaks of the window; the damped frequency.
    frequency_std_hz, damping_ratio_std: shape (w,), from the noise of the peaks.
    """

    amplitude: Array
    frequency_hz: Array
    damping_ratio: Array
    frequency_std_hz: Array
    damping_ratio_std: Array


@dataclass(frozen=True)
class DecayShape:
    """Whether one exponential describes the decay.

    exponential: the verdict, by the rule of `judge_shape`; reason: one sentence.
    p_value: of the F test for rate and frequency that change with time.
    damping_change, frequency_change: relative, from large amplitude to small.
    """

    exponential: bool
    reason: str
    p_value: float
    damping_change: float
    frequency_change: float


def amplitude_dependence(time_s: Array, height: Array, height_std: float) -> AmplitudeDependence:
    """Return frequency and damping ratio in overlapping windows of the peaks.

    time_s, height: shape (h,), at least three alternating peaks about the rest position; height_std: noise of one.

    A window is the shortest row of four or more peaks that gives damping to 3 %, or whose peaks get 1.4 times smaller;
    the next begins in its middle. Three half cycles of which the first and last differ in length by more than 15 % (a
    swing from near the top of a pendulum) are left out: their mean amplitude says nothing about their frequency.
    Damping is the slope of the logarithm of the swings from peak to opposite peak, which an offset of the rest position
    or a lopsided wave does not touch; frequency is the spacing of the peaks. Neither needs a shape of the wave, so they
    hold for large swings. A window's amplitude is half its mean swing.
    """
    rows: list[tuple[float, float, float, float, float]] = []
    first = 0
    while first + _FEWEST <= height.size or not rows:
        stop = min(first + _FEWEST, height.size)
        while True:
            row = _window(time_s[first:stop], np.abs(np.diff(height[first:stop])), height_std)
            fall = abs(height[first] / height[stop - 1])
            if row[4] < _GOOD_ENOUGH * row[2] or fall >= _WINDOW_RATIO or stop >= height.size:
                break
            stop += 1
        if rows and row[4] > _GOOD_ENOUGH * row[2] and fall < np.sqrt(_WINDOW_RATIO):
            break
        if height.size < 2 * _FEWEST or not _changes_fast(np.diff(time_s[first:stop])):
            rows.append(row)
        first += max(1, (stop - first) // 2 - 1)
    return AmplitudeDependence(*np.array(rows, dtype=float).reshape(-1, 5).T)


def _changes_fast(spacing: Array) -> bool:
    return spacing.size == _FEWEST - 1 and abs(float(spacing[0] / spacing[-1]) - 1.0) > _FAST


def _window(t: Array, swing: Array, height_std: float) -> tuple[float, float, float, float, float]:
    """Return one row of the table from three or more peaks; of four or more, ends of both signs count alike."""
    ends = (slice(0, 2), slice(-2, None)) if t.size > 3 else (slice(0, 1), slice(-1, None))
    halves = t.size - 2 if t.size > 3 else t.size - 1
    length = float(t[ends[1]].mean() - t[ends[0]].mean())
    frequency = 0.5 * halves / length
    omega = 2.0 * np.pi * frequency
    amplitude = 0.5 * swing
    middle = 0.5 * (t[1:] + t[:-1])
    weight = amplitude**2 / np.sum(amplitude**2)
    centred = middle - weight @ middle
    slope = weight * centred / float(weight @ centred**2)
    rate = -float(slope @ np.log(amplitude))
    shares = slope / amplitude
    by_peak = 0.5 * np.concatenate([shares, [0.0]]) - 0.5 * np.concatenate([[0.0], -shares])
    rate_std = height_std * float(np.sqrt(np.sum(by_peak**2)))
    time_std = _VERTEX * height_std / omega * float(np.hypot(1.0 / amplitude[0], 1.0 / amplitude[-1]))
    damping = float(lehr_damping(rate, omega))
    return float(amplitude.mean()), frequency, damping, frequency * time_std / length, rate_std / omega


def mean_poles(bent: DecayFit, time_of_peaks_s: Array, size: Array, size_std: float) -> tuple[Array, Array]:
    """Return ((λ, ω), their covariance), shape (2,) and (2, 2), as means over the window weighted by amplitude.

    bent: from `fit_bent`, λ(t) = λ + 2 λ₂t [1/s] and ω(t) = ω + 2 ω₂t [rad/s] with the amplitude A(t) that follows:
    ⟨λ⟩ = ∫ λ A dt / ∫ A dt, likewise ⟨ω⟩. The covariance is carried from the fit's, through the weights too.
    time_of_peaks_s, size: shape (h,), three or more peaks, size_std: noise of one. The same means are taken from them,
    without a model; where the two differ by more than twice the noise of the peaks, rate and frequency do not change
    linearly with time either, and the difference is added to the standard deviation.
    """
    means, covariance = _means(bent, 0.0, 1.0)
    edges = (time_of_peaks_s[[0, -1]] - bent.start_s) / bent.window_s
    by_peaks, noise = _means_by_peaks(time_of_peaks_s, size, size_std)
    off = _means(bent, *edges)[0] - by_peaks
    return means, covariance + np.diag(np.where(np.abs(off) > 2.0 * noise, off, 0.0) ** 2)


def _means(bent: DecayFit, low: float, high: float) -> tuple[Array, Array]:
    """Return the means of (λ, ω) and their covariance between two times in units of the window."""
    s = np.linspace(low, high, _STEPS)
    places = np.array([0, 1, -2, -1])
    rate, omega, bend, turn = bent.parameters[places]
    amplitude = np.exp(np.clip(-rate * s - bend * s**2, -200.0, 50.0))
    amplitude[[0, -1]] *= 0.5  # trapezoidal rule
    weight = amplitude / amplitude.sum()
    poles = np.stack([rate + 2.0 * bend * s, omega + 2.0 * turn * s])
    means = poles @ weight
    by_weight = (poles - means[:, None]) * weight @ np.stack([-s, -(s**2)], axis=1)
    late = 2.0 * float(s @ weight)
    gradient = np.array([[1.0, 0.0, late, 0.0], [0.0, 1.0, 0.0, late]])
    gradient[:, [0, 2]] += by_weight
    covariance = gradient @ bent.covariance[np.ix_(places, places)] @ gradient.T
    return np.asarray(means / bent.window_s), np.asarray(covariance / bent.window_s**2)


def _means_by_peaks(t: Array, size: Array, size_std: float) -> tuple[Array, Array]:
    """Return the means of (λ, ω) from sizes and spacings of the peaks, and their standard deviations, (2,) each."""
    middle = 0.5 * (size[1:] + size[:-1])
    area = float(middle @ np.diff(t))
    rate, omega = float(size[0] - size[-1]) / area, np.pi * float(middle.sum()) / area
    shares = np.diff(middle, prepend=0.0, append=0.0) / size
    return np.array([rate, omega]), size_std / area * np.array([np.sqrt(2.0), _VERTEX * float(np.linalg.norm(shares))])


def judge_shape(bent: DecayFit, table: AmplitudeDependence, unit: str) -> DecayShape:
    """Return the verdict on one exponential.

    bent: from `fit_bent`; table: from `amplitude_dependence`; unit: of the amplitude, for the sentence.

    Rule: the decay is not exponential where (1) the bent fit's two added terms differ from zero at the 1 % level (F
    test, covariance for coloured noise, effective degrees of freedom), and (2) the change matters: between the first
    and the last quarter of the range of ln amplitude the damping ratio changes by more than 10 % or the frequency by
    more than 1 % (weighted means of the windows whose damping is known to 20 %; with fewer than three such windows, the
    bent fit between the first amplitude and a fifth of it). The second condition keeps a record without noise from
    being called wrong for nothing.
    """
    p_value = bend_p_value(bent)
    solid = table.damping_ratio_std < 0.2 * np.abs(table.damping_ratio)
    if np.count_nonzero(solid) >= 3:
        where = np.log(table.amplitude[solid])
        damping = _ends(where, table.damping_ratio[solid], table.damping_ratio_std[solid])
        frequency = _ends(where, table.frequency_hz[solid], table.frequency_std_hz[solid])
        span = _ends(where, table.amplitude[solid], np.zeros(where.size))
    else:
        damping, frequency = _ends_of_bent(bent)
        span = np.array([bent.amplitude, bent.amplitude * _END_OF_EFFECT])
    changes = tuple(float((v[1] - v[0]) / max(abs(v.mean()), 1e-12)) for v in (damping, frequency))
    matters = abs(changes[0]) > _DAMPING_EFFECT, abs(changes[1]) > _FREQUENCY_EFFECT
    exponential = not (p_value < SIGNIFICANCE and any(matters))
    reason = _praise(changes, p_value) if exponential else _blame(damping, frequency, matters, span, unit)
    return DecayShape(exponential, reason, p_value, *changes)


def _ends(where: Array, values: Array, std: Array) -> Array:
    """Return the weighted means over the first and last quarter of the range of ln amplitude, shape (2,)."""
    reach = 0.25 * float(where[0] - where[-1])
    weight = 1.0 / (std**2 + (0.01 * values) ** 2)
    quarters = (where >= where[0] - reach), (where <= where[-1] + reach)
    return np.array([float(np.average(values[q], weights=weight[q])) for q in quarters])


def bend_p_value(bent: DecayFit) -> float:
    """Return the p value of the F test that the two bending terms are zero."""
    added, covariance = bent.parameters[-2:], bent.covariance[-2:, -2:]
    scale = np.sqrt(np.diag(covariance))
    if not np.all(scale > 0):
        return 0.0 if np.any(np.abs(added) > 1e-9) else 1.0
    z = added / scale
    correlation = np.clip(covariance[0, 1] / (scale[0] * scale[1]), -0.999, 0.999)
    statistic = float(z @ z - 2.0 * correlation * z[0] * z[1]) / float(1.0 - correlation**2) / 2.0
    return float(special.fdtrc(2.0, bent.degrees_of_freedom, statistic))


def _ends_of_bent(bent: DecayFit) -> tuple[Array, Array]:
    """Return damping ratio and frequency of the bent fit at its start and where the amplitude is a fifth."""
    s = np.linspace(0.0, 1.0, 201)
    rate, omega, bend, turn = (float(bent.parameters[i]) for i in (0, 1, -2, -1))
    fallen = np.flatnonzero(rate * s + bend * s**2 > -np.log(_END_OF_EFFECT))
    ends = np.array([0.0, s[fallen[0]] if fallen.size else 1.0])
    rates, omegas = rate + 2.0 * bend * ends, omega + 2.0 * turn * ends
    return lehr_damping(rates, omegas), omegas / (2.0 * np.pi * bent.window_s)


def _praise(changes: tuple[float, ...], p_value: float) -> str:
    why = (
        "less than the 10 % and 1 % that count"
        if p_value < SIGNIFICANCE
        else f"no more than the residual of the fit explains (p = {p_value:.2g})"
    )
    return (
        f"damping changes by {100 * changes[0]:+.1f} % and frequency by {100 * changes[1]:+.2f} % as the amplitude "
        f"falls, {why}: one exponential describes the decay"
    )


def _blame(damping: Array, frequency: Array, matters: tuple[bool, bool], span: Array, unit: str) -> str:
    factor, shown = (180.0 / np.pi, "deg") if unit == "rad" else (1.0, unit)
    parts, causes = [], []
    if matters[0]:
        rises = damping[1] > damping[0]
        parts.append(f"damping {'rises' if rises else 'falls'} from {damping[0]:.3g} to {damping[1]:.3g}")
        causes.append("dry friction" if rises else "losses that grow with amplitude")
    if matters[1]:
        rises = frequency[1] > frequency[0]
        parts.append(f"frequency {'rises' if rises else 'falls'} from {frequency[0]:.4g} to {frequency[1]:.4g} Hz")
        causes.append(f"{'softening' if rises else 'hardening'} at large amplitude")
    fall = f"as the amplitude falls from {span[0] * factor:.3g} to {span[1] * factor:.3g} {shown}"
    return f"{' and '.join(parts)} {fall}: {' and '.join(causes)}; a single exponential is wrong"


DECAY_FROM_PERIODS = 1.0
"""Drive periods after the stop from which a planned ring-down is taken for free. The paper does not say where its fit
begins, and its words fit a start at the stop as well; what other starts give stands in `DECAY_WINDOWS`."""

DECAY_WINDOWS = (0.0, 0.1, 0.5, 1.0, 1.5, 2.0)
"""Starts after the stop, in drive periods, from which the paper's method reads a planned ring-down beside."""


@dataclass(frozen=True)
class RingDown:
    """One analysed ring-down.

    frequency_hz: damped frequency ω_d/2π [Hz]; natural_frequency_hz: undamped, sqrt(ω_d² + λ²)/2π [Hz].
    damping_ratio: λ/sqrt(ω_d² + λ²); decay_rate_per_s: λ [1/s]; quality: 1/(2·damping_ratio).
    All by the direct time-domain fit. Of a decay that is not exponential, whose one sinusoid would fall out of step and
    take that for damping, the fit is the bent one (rate and frequency change linearly with time), λ and ω_d are its
    means over the window weighted by the amplitude, ∫ λ A dt / ∫ A dt, and the rest follows from these two. Where the
    same means of the peaks differ from them by more than noise, the difference is in the intervals.
    rest_drift: change of the rest position from start_s to stop_s, unit of the response (a rate's: of its bias).
    paper: the paper's method, Eq. 7-10 with the damped frequency as printed.
    shape: exponential or not; dependence: frequency and damping against amplitude.
    start_s, stop_s: the free decay that was used, in the time of the record.
    fit: the direct fit, bent where the decay is not exponential, for its curve.
    peak_time_s, peak_value: shape (h,), both-sided peaks about the rest position.
    unit: of the response; peak_unit: of peaks and amplitudes (of the angle where the response is a rate).
    """

    frequency_hz: Estimate
    natural_frequency_hz: Estimate
    damping_ratio: Estimate
    decay_rate_per_s: Estimate
    quality: Estimate
    rest_drift: Estimate
    paper: Envelope
    shape: DecayShape
    dependence: AmplitudeDependence
    start_s: float
    stop_s: float
    fit: DecayFit
    peak_time_s: Array
    peak_value: Array
    unit: str
    peak_unit: str


def analyse_ring_down(
    time_s: ArrayLike,
    response: ArrayLike,
    *,
    drive: ArrayLike | None = None,
    is_rate: bool = False,
    unit: str = "rad",
    inertia_kg_m2: float | None = None,
    free_from_s: float | None = None,
) -> RingDown:
    """Return what a record of a free decay says; the start of the decay is found, unless it is known.

    time_s: shape (n,), increasing [s]; response: shape (n,), in `unit`; drive: shape (n,), any unit, if measured.
    is_rate: the response is the rate of an angle or displacement (gyroscope). Its decay has the same poles and is
        fitted as it is; peaks and amplitudes are those of its integral.
    inertia_kg_m2: I, for the paper's d and k. free_from_s: time from which the decay is known to be free [s].

    The drive tells when it stopped; without it, the start is sought in the response. Window: six time constants. The
    direct fit's standard deviations hold for coloured noise; intervals are Student's with effective degrees of freedom.
    Raises RecordingError (TimeError for time stamps) where the record holds no ring-down that can be analysed.
    """
    t, x, lever, clock = evenly(*checked_record(time_s, response, drive))
    fit, t, x, peaks = free_decay(t, x, lever, free_from_s)
    if is_rate:
        peaks = find_peaks(t, _angle(t, x, fit))
    times, heights = _heights(peaks, fit, is_rate)
    bent = fit_bent(t, x, fit, times, np.abs(heights))
    rest = bent if bend_p_value(bent) < SIGNIFICANCE else fit
    times, heights = _heights(peaks, rest, is_rate)
    table = amplitude_dependence(times, heights, peaks.value_std)
    peak_unit = _integrated(unit) if is_rate else unit
    shape = judge_shape(bent, table, peak_unit)
    poles = np.array([fit.decay_rate_per_s, fit.omega_rad_s]), fit.pole_covariance()
    if not shape.exponential:
        fit, poles = bent, mean_poles(bent, times, np.abs(heights), peaks.value_std)
    return RingDown(
        **_estimates(*poles, fit.degrees_of_freedom, clock),
        rest_drift=Estimate.student(*rest.drift(), rest.degrees_of_freedom),
        paper=fit_envelope(times, np.abs(heights), inertia_kg_m2),
        shape=shape,
        dependence=table,
        start_s=fit.start_s,
        stop_s=fit.stop_s,
        fit=fit,
        peak_time_s=times,
        peak_value=heights,
        unit=unit,
        peak_unit=peak_unit,
    )


def _angle(t: Array, rate: Array, fit: DecayFit) -> Array:
    """Return the angle about its rest position, shape (n,): the rate less its bias, integrated, less its drift.

    The drift is that behind the start of the fit, where the record holds more.
    """
    angle = integrate.cumulative_trapezoid(rate - fit.rest(t), t, initial=0)
    wave = np.exp((1j * fit.omega_rad_s - fit.decay_rate_per_s) * (t - fit.start_s))
    basis = np.stack([wave.real, wave.imag, np.ones_like(t), t - fit.start_s], axis=1)
    free = t >= fit.start_s - 1e-9
    drift = np.linalg.lstsq(basis[free], angle[free], rcond=None)[0][2:]
    return np.asarray(angle - basis[:, 2:] @ drift, dtype=float)


def _heights(peaks: Peaks, fit: DecayFit, is_rate: bool) -> tuple[Array, Array]:
    """Return (times, heights about the rest position) of the peaks of the free decay."""
    rest = np.zeros(peaks.time_s.size) if is_rate else fit.rest(peaks.time_s)
    times, heights = large_peaks(peaks, rest)
    if times.size < 3:
        raise RecordingError(
            f"ring-down too short: {times.size} peaks of the free decay stand out of the noise, at least 3 are needed; "
            "start from a larger amplitude or record longer"
        )
    return times, heights


def _estimates(poles: Array, covariance: Array, freedom: float, clock_std: float) -> dict[str, Estimate]:
    """Return the estimates that follow from (λ, ω), with Q = 1/(2 D)."""
    found = pole_estimates(poles, covariance, freedom, clock_std)
    ratio = found["damping_ratio"]
    least = 0.5 / ratio.low if ratio.low > 0 else np.inf
    return found | {"quality": Estimate(0.5 / ratio.value, 0.5 * ratio.std / ratio.value**2, 0.5 / ratio.high, least)}


def _integrated(unit: str) -> str:
    return unit.removesuffix("/s") if unit.endswith("/s") else f"{unit} s"


def ring_down_json(result: RingDown) -> dict[str, Any]:
    """Return the document of `sinew analyse --kind ring-down`, of plain numbers, lists and texts.

    Amplitudes are in `peak_unit`, `rest_drift` in `unit`. `omega_rad_s` and `lehr_damping` of the paper's method use
    the damped frequency, as Eq. 7 does; `damping_ratio` is by the undamped one.
    """
    table = result.dependence
    return {
        "kind": "ring-down",
        "frequency_hz": result.frequency_hz.to_json(),
        "damping_ratio": result.damping_ratio.to_json(),
        "decay_rate_per_s": result.decay_rate_per_s.to_json(),
        "paper_method": {
            "decay_rate_per_s": result.paper.decay_rate_per_s,
            "omega_rad_s": result.paper.omega_rad_s,
            "lehr_damping": result.paper.lehr_damping,
        },
        "exponential": result.shape.exponential,
        "reason": result.shape.reason,
        "rest_drift": result.rest_drift.value,
        "amplitude_dependence": {
            "amplitude": table.amplitude.tolist(),
            "frequency_hz": table.frequency_hz.tolist(),
            "damping_ratio": table.damping_ratio.tolist(),
        },
    }


def analyse_ring_downs(recording: xr.Dataset | Signals, inertia_kg_m2: float | None = None) -> xr.Dataset:
    """Return the ring-down part of the results: the variables of the result schema over (pretension, repeat).

    inertia_kg_m2: I of head and lever, for the paper's d and k; NaN without it.

    The response is the gyroscope's x axis (a rate), else torsion_rad, else response. Behind a settle segment of
    the same group the drive was told to stop where the ring-down begins, so nothing is sought: the first drive period,
    in which the lever settles on its servo, is left out. A start that depended on how far the lever recoils would jump
    with pretension and take Lehr's damping with it. A ring-down that cannot be analysed is NaN, and the attribute
    `ring_down_notes` says why.
    Raises RecordingError where there is no ring-down, or none can be analysed.
    """
    signals = read_signals(recording)
    found: list[tuple[Segment, RingDown, float]] = []
    windows: list[tuple[Segment, list[Envelope | None]]] = []
    notes: list[str] = []
    asked = [segment for segment, _ in signals.of_kind("ring-down")]
    if not asked:
        raise RecordingError("recording has no ring-down segment; expected at least one")
    for index, (segment, where) in enumerate(signals.segments):
        if segment.kind != "ring-down":
            continue
        try:
            result, read = _analyse_segment(signals, index, inertia_kg_m2)
            found.append((segment, result, float(signals.time_s[where.start])))
            if read:
                windows.append((segment, read))
        except RecordingError as error:
            notes.append(f"ring-down {segment.repeat} at {segment.pretension_mm:g} mm: {error}")
    if not found:
        raise RecordingError(notes[0])
    pretension = np.unique([segment.pretension_mm for segment in asked])
    shape = pretension.size, max(segment.repeat for segment in asked) + 1
    columns = {name: np.full(shape, np.nan) for name in _numbers(*found[0][1:])}
    for segment, result, begins_s in found:
        place = int(np.searchsorted(pretension, segment.pretension_mm)), segment.repeat
        for name, value in _numbers(result, begins_s).items():
            columns[name][place] = value
    rows = {name: RESULT_VARIABLES[name] for name in columns}
    units = {name: found[0][1].unit if row.unit == "*" else row.unit for name, row in rows.items()}
    dataset = xr.Dataset(
        {
            name: (row.dims, columns[name], {"units": units[name], "long_name": row.meaning})
            for name, row in rows.items()
        },
        {
            "pretension_mm": result_axis("pretension_mm", pretension),
            "repeat": result_axis("repeat", np.arange(1, shape[1] + 1)),
        },
        attrs={"ring_down_notes": "; ".join(notes)},
    )
    return dataset.assign(_window_columns(windows, pretension, shape))


def _window_columns(
    windows: list[tuple[Segment, list[Envelope | None]]], pretension: Array, shape: tuple[int, int]
) -> dict[str, Any]:
    """Return the variables over (pretension, repeat, window) of the result schema; none without planned ring-downs."""
    if not windows:
        return {}
    columns = {name: np.full((*shape, len(DECAY_WINDOWS)), np.nan) for name in _WINDOW_NUMBERS}
    for segment, read in windows:
        place = int(np.searchsorted(pretension, segment.pretension_mm)), segment.repeat
        for name, number in _WINDOW_NUMBERS.items():
            columns[name][place] = [np.nan if one is None else number(one) for one in read]
    rows = {name: RESULT_VARIABLES[name] for name in columns}
    return {
        "window_start_periods": result_axis("window_start_periods", np.array(DECAY_WINDOWS)),
        **{
            name: (rows[name].dims, values, {"units": rows[name].unit, "long_name": rows[name].meaning})
            for name, values in columns.items()
        },
    }


_WINDOW_NUMBERS: dict[str, Callable[[Envelope], float]] = {
    "window_decay_rate_per_s": lambda one: one.decay_rate_per_s,
    "window_omega_rad_s": lambda one: one.omega_rad_s,
    "window_lehr_damping": lambda one: one.lehr_damping,
}


def _analyse_segment(
    signals: Signals, index: int, inertia_kg_m2: float | None
) -> tuple[RingDown, list[Envelope | None]]:
    """Return the ring-down, and beside it what each of `DECAY_WINDOWS` says where the stop of the drive is known."""
    (here, where), response, drive = signals.segments[index], signals.response, signals.drive
    time, values, free_from = signals.time_s[where], response.values[where], None
    if index > 0:
        before = signals.segments[index - 1][0]
        same = (before.pretension_mm, before.frequency_hz, before.repeat) == (
            here.pretension_mm,
            here.frequency_hz,
            here.repeat,
        )
        if before.kind == "settle" and same:
            free_from = float(time[0]) + DECAY_FROM_PERIODS / here.frequency_hz
    result = analyse_ring_down(
        time,
        values,
        drive=None if drive is None else drive.values[where],
        is_rate=response.is_rate,
        unit=response.unit,
        inertia_kg_m2=inertia_kg_m2,
        free_from_s=free_from,
    )
    if free_from is None:
        return result, []
    return result, read_windows(time, values, result, 1.0 / here.frequency_hz)


def read_windows(time_s: ArrayLike, response: ArrayLike, result: RingDown, period_s: float) -> list[Envelope | None]:
    """Return what the paper's method says of a planned ring-down from each of `DECAY_WINDOWS` on, None without peaks.

    time_s, response: shape (n,), from the stop of the drive on, as `analyse_ring_down` took them; result: of it.
    period_s: of the drive [s].

    The peaks are those of one record from the stop on, about the rest position that the result found behind its own
    start; a later start leaves the earlier peaks out and changes nothing else. At `DECAY_FROM_PERIODS` it is the
    result's own.
    """
    t, x, _, _ = evenly(*checked_record(time_s, response, None))
    stop = float(t[0])
    is_rate = result.unit != result.peak_unit
    t, x = block_means(t, x, np.pi / result.fit.omega_rad_s)
    t, x = t[t <= result.stop_s], x[t <= result.stop_s]
    peaks = find_peaks(t, _angle(t, x, result.fit) if is_rate else x)
    margin = 0.05 * np.pi / result.fit.omega_rad_s
    read: list[Envelope | None] = []
    for start in DECAY_WINDOWS:
        if start == DECAY_FROM_PERIODS:
            read.append(result.paper)
            continue
        late = peaks.between(stop + start * period_s - margin, float(t[-1]))
        try:
            times, heights = _heights(late, result.fit, is_rate)
        except RecordingError:
            read.append(None)
            continue
        read.append(fit_envelope(times, np.abs(heights)))
    return read


def _numbers(result: RingDown, begins_s: float) -> dict[str, float]:
    paper = result.paper
    return {
        "paper_decay_rate_per_s": paper.decay_rate_per_s,
        "paper_omega_rad_s": paper.omega_rad_s,
        "paper_lehr_damping": paper.lehr_damping,
        "paper_quality": paper.quality,
        "paper_damping_n_m_s_rad": paper.damping_n_m_s_rad,
        "paper_stiffness_n_m_rad": paper.stiffness_n_m_rad,
        "decay_start_s": result.start_s - begins_s,
        "decay_rate_per_s": result.decay_rate_per_s.value,
        "decay_rate_std_per_s": result.decay_rate_per_s.std,
        "decay_frequency_hz": result.frequency_hz.value,
        "decay_frequency_std_hz": result.frequency_hz.std,
        "damping_ratio": result.damping_ratio.value,
        "damping_ratio_std": result.damping_ratio.std,
        "rest_drift": result.rest_drift.value,
        "exponential": float(result.shape.exponential),
    }
