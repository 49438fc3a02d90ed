"""Frequency and damping of a ring-down, with intervals, and a verdict on its shape."""

import math
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Annotated, Any, NamedTuple

import numpy as np
import scipy
import xarray as xr
from numpy.typing import ArrayLike
from scipy import special

from sinew.analysis.decay.decay_fit import DecayFit, fit_bent, lehr_damping, pole_estimates
from sinew.analysis.decay.free_decay import (
    Peaks,
    band_passed,
    block_means,
    find_peaks,
    free_decay,
    noise_level,
    spectral_lines,
)
from sinew.analysis.decay.history import (
    AmplitudeHistory,
    clearly_better,
    close_modes,
    differing_halves,
    exponential_history,
    louder_line,
    smooth_history,
    with_further_modes,
)
from sinew.analysis.decay.modes import DecayMode
from sinew.analysis.decay.paper_method import Envelope, fit_envelope, fit_envelopes, large_peaks
from sinew.analysis.decay.samples import Samples, read_samples
from sinew.analysis.signal.repeats import variable_of
from sinew.analysis.signal.signals import Signals, read_signals
from sinew.measure.arrays import Array
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import NORMAL_90, ROUND_OFF, Estimate, number
from sinew.measure.recording import result_axis
from sinew.measure.result import Column, Field, Result

# A decay shows whether it is exponential, and how damping and frequency move with amplitude.


_WINDOW_RATIO = 1.4  # a window lasts until the amplitude has shrunk by this factor,
_GOOD_ENOUGH = 0.03  # or its damping is as certain as this
_FEWEST = 4  # peaks of a window
_FAST = 0.15  # relative difference of the half cycles of such a window that makes one mean amplitude meaningless
_VERTEX = 1.23  # std of a vertex's phase by that of its relative height, for the filter of `peaks`
SIGNIFICANCE = 0.01  # of the F test: from here on a decay is read, and called, other than one exponential
_DAMPING_EFFECT = 0.10  # relative change of the damping ratio that counts,
_FREQUENCY_EFFECT = 0.01  # and of the frequency
_STANDS_OUT = 3.0  # standard deviations of either change, for it to be told
_LEANS = 0.6  # of a change of the damping ratio: by so much of a half cycle crests move where it changes
_OWN = 3.0  # times the relative change of the frequency: a pendulum's damping ratio moves 1.8 times as much with it
_TELLING_FALL = 1.6  # of the amplitude, between the ends: over less, two modes that beat look like any cause
_END_OF_EFFECT = 0.2  # of the first amplitude: end of the comparison by the bent fit


@dataclass(frozen=True, repr=False)
class AmplitudeDependence(Result):
    """Frequency and damping in windows of the decay, from large amplitude to small.

    amplitude: mean amplitude of each window, shape (w,), unit of the response (of the angle for a rate).
    frequency_hz, damping_ratio: shape (w,), from the peaks of the window; the damped frequency.
    frequency_std_hz, damping_ratio_std: shape (w,), from the noise of the peaks.
    """

    amplitude: Column
    frequency_hz: Column
    damping_ratio: Column
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


def _means_by_peaks(t: Array, size: Array, size_std: float) -> tuple[Array, Array]:
    """Return the means of (λ, ω) from sizes and spacings of the peaks, and their standard deviations, (2,) each."""
    middle = 0.5 * (size[1:] + size[:-1])
    area = float(middle @ np.diff(t))
    rate, omega = float(size[0] - size[-1]) / area, np.pi * float(middle.sum()) / area
    shares = np.diff(middle, prepend=0.0, append=0.0) / size
    return np.array([rate, omega]), size_std / area * np.array([np.sqrt(2.0), _VERTEX * float(np.linalg.norm(shares))])


def judge_shape(bent: DecayFit, table: AmplitudeDependence, unit: str, p_value: float | None = None) -> DecayShape:
    """Return the verdict on one exponential.

    bent: from `fit_bent`; p_value: that it is no better, where that is known otherwise; table: from
    `amplitude_dependence`; unit: of the amplitude, for the sentence.

    Rule: the decay is not exponential where (1) the bent fit's two added terms differ from zero at the 1 % level (F
    test, covariance for coloured noise, effective degrees of freedom), and (2) the change matters: between the first
    and the last quarter of the range of ln amplitude the damping ratio changes by more than 10 % or the frequency by
    more than 1 % (weighted means of the windows whose damping is known to 20 %; with fewer than three such windows, the
    bent fit between the first amplitude and a fifth of it). The second condition keeps a record with hardly any
    noise from being called wrong for nothing.
    """
    p_value = bend_p_value(bent) if p_value is None else p_value
    solid = table.damping_ratio_std < 0.2 * np.abs(table.damping_ratio)
    if np.count_nonzero(solid) >= 3:
        where = np.log(table.amplitude[solid])
        damping, damping_std = _ends(where, table.damping_ratio[solid], table.damping_ratio_std[solid])
        frequency, frequency_std = _ends(where, table.frequency_hz[solid], table.frequency_std_hz[solid])
        span = _ends(where, table.amplitude[solid], np.zeros(where.size))[0]
    else:
        damping, frequency = _ends_of_bent(bent)
        damping_std = frequency_std = 0.0
        span = np.array([bent.amplitude, bent.amplitude * _END_OF_EFFECT])
    changes = tuple(float((v[1] - v[0]) / max(abs(v.mean()), 1e-12)) for v in (damping, frequency))
    matters = (
        abs(changes[0]) > _DAMPING_EFFECT and abs(damping[1] - damping[0]) > _STANDS_OUT * damping_std,
        abs(changes[1]) > max(_FREQUENCY_EFFECT, _LEANS * abs(float(damping[1] - damping[0])))
        and abs(frequency[1] - frequency[0]) > _STANDS_OUT * frequency_std,
    )
    exponential = not (p_value < SIGNIFICANCE and any(matters))
    reason = _praise(changes, p_value) if exponential else _blame(damping, frequency, matters, span, unit)
    return DecayShape(exponential, reason, p_value, *changes)


def _ends(where: Array, values: Array, std: Array) -> tuple[Array, float]:
    """Return the weighted means over the first and last quarter of the range of ln amplitude, shape (2,), and the
    standard deviation of their difference, as if windows that overlap were one."""
    reach = 0.25 * float(where[0] - where[-1])
    weight = 1.0 / (std**2 + (0.01 * values) ** 2)
    quarters = (where >= where[0] - reach), (where <= where[-1] + reach)
    ends = np.array([float(np.average(values[q], weights=weight[q])) for q in quarters])
    early, late = (float(np.average(std[q], weights=weight[q])) for q in quarters)
    return ends, math.hypot(early, late)


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
    if p_value >= SIGNIFICANCE:
        return (
            "damping and frequency change with the amplitude by no more than the residual of the fit explains "
            f"(p = {p_value:.2g}): one exponential describes the decay"
        )
    return (
        f"damping changes by {100 * changes[0]:+.1f} % and frequency by {100 * changes[1]:+.2f} % as the amplitude "
        "falls, less than the 10 % and 1 % that count: one exponential describes the decay"
    )


def _blame(damping: Array, frequency: Array, matters: tuple[bool, bool], span: Array, unit: str) -> str:
    factor, shown = (180.0 / np.pi, "deg") if unit == "rad" else (1.0, unit)
    parts, causes = [], []
    if matters[0]:
        rises = damping[1] > damping[0]
        parts.append(f"damping {'rises' if rises else 'falls'} from {damping[0]:.3g} to {damping[1]:.3g}")
        moved = [abs(float(np.log(max(v[1], 1e-12) / max(v[0], 1e-12)))) for v in (damping, frequency)]
        if not matters[1] or moved[0] > _OWN * moved[1]:
            causes.append("dry friction" if rises else "losses that grow with amplitude, or a second mode near by")
    if matters[1]:
        rises = frequency[1] > frequency[0]
        parts.append(f"frequency {'rises' if rises else 'falls'} from {frequency[0]:.4g} to {frequency[1]:.4g} Hz")
        causes.append(f"{'softening' if rises else 'hardening'} at large amplitude")
    if span[0] < _TELLING_FALL * span[1]:
        causes = []
    fall = f"as the amplitude falls from {span[0] * factor:.3g} to {span[1] * factor:.3g} {shown}"
    named = f": {' and '.join(causes)}" if causes else ""
    return f"{' and '.join(parts)} {fall}{named}; a single exponential is wrong"


DECAY_FROM_PERIODS = 1.0
"""Drive periods after the stop from which a planned ring-down is taken for free. The paper does not say where its fit
begins, and its words fit a start at the stop as well; what other starts give stands in `DECAY_WINDOWS`."""

DECAY_WINDOWS = (0.0, 0.1, 0.5, 1.0, 1.5, 2.0)
"""Starts after the stop, in drive periods, from which the paper's method reads a planned ring-down beside."""


@dataclass(frozen=True, repr=False)
class IntervalParts(Result):
    """What the interval of one quantity is made of, in its unit.

    noise: value with standard deviation and 90 % interval by the scatter of the samples alone. misfit_std: standard
    deviation that the model's disagreement with the record adds: what one number leaves out.
    """

    noise: Annotated[Estimate, Field("by noise")]
    misfit_std: Annotated[float, Field("by misfit")]

    @property
    def together(self) -> Estimate:
        """Return the estimate with both; the misfit is taken as known (Welch and Satterthwaite)."""
        one = self.noise
        std = math.hypot(one.std, self.misfit_std)
        if not (self.misfit_std > 0 and math.isfinite(one.high - one.low)):
            return one
        if not one.std > 0:
            return Estimate.normal(one.value, std)
        # between Student's quantile of the noise alone and the normal one of a known misfit
        share = (one.std / std) ** 2
        quantile = NORMAL_90 + (0.5 * (one.high - one.low) / one.std - NORMAL_90) * share
        return Estimate(one.value, std, one.value - quantile * std, one.value + quantile * std)


@dataclass(frozen=True)
class RingDown:
    """One analysed ring-down.

    frequency_hz: damped frequency ω_d/2π [Hz]; natural_frequency_hz: undamped, sqrt(ω_d² + λ²)/2π [Hz].
    damping_ratio: λ/sqrt(ω_d² + λ²); decay_rate_per_s: λ [1/s].
    All by the direct time-domain fit, of the strongest mode where there are several. Where rate and frequency move
    with the amplitude, one sinusoid would fall out of step and take that for damping; size and phase are then smooth
    functions of time (`sinew.analysis.decay.history`), λ and ω_d their means over the window weighted by the amplitude,
    ∫ λ A dt / ∫ A dt, and the rest follows from these two. The intervals hold the noise and the misfit together.
    parts: the two by name of the quantity. misfit: a sentence on where it comes from, empty without any. Its parts:
    early and late half of the decay differ by more than their noise (the 90 % interval then reaches one and a half
    times as far: of a value that drifts evenly, the intervals of both halves, read alone, then meet), the same means of
    the peaks differ beyond theirs, the residual grows with the amplitude, or swings at the oscillation's frequency.
    rest_drift: change of the rest position from start_s to stop_s, unit of the response (a rate's: of its bias).
    paper: the paper's method, Eq. 7-10 with the damped frequency as printed; withheld: why it should not be believed.
    shape: exponential or not; dependence: frequency and damping against amplitude.
    modes: where several swing in the record, all of them, the one of most energy first; else empty.
    start_s, stop_s: the free decay that was used, in the time of the record.
    fit: the direct fit, bent where the decay is not exponential, for its curve.
    peak_time_s, peak_value: shape (h,), both-sided peaks about the rest position.
    unit: of the response; peak_unit: of peaks and amplitudes (of the angle where the response is a rate).
    remarks: what was found in the samples and done about it, a sentence each.
    """

    frequency_hz: Estimate
    natural_frequency_hz: Estimate
    damping_ratio: Estimate
    decay_rate_per_s: Estimate
    parts: dict[str, IntervalParts]
    misfit: str
    rest_drift: Estimate
    paper: Envelope
    withheld: str
    shape: DecayShape
    dependence: AmplitudeDependence
    modes: tuple[DecayMode, ...]
    start_s: float
    stop_s: float
    fit: DecayFit
    peak_time_s: Array
    peak_value: Array
    unit: str
    peak_unit: str
    remarks: tuple[str, ...]


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

    The drive tells when it stopped; without it, the start is sought in the response, and where that finds nothing that
    explains the record, in the band of each line of its spectrum. Window: six time constants. The
    direct fit's standard deviations hold for coloured noise; intervals are Student's with effective degrees of freedom.
    Raises RecordingError (TimeError for time stamps) where the record holds no ring-down that can be analysed.
    """
    samples = read_samples(time_s, response, drive, unit)
    return _analysed(samples, is_rate, unit, inertia_kg_m2, free_from_s)


def _analysed(
    samples: Samples, is_rate: bool, unit: str, inertia_kg_m2: float | None, free_from_s: float | None
) -> RingDown:
    """Return what samples of a free decay say; arguments and errors as of `analyse_ring_down`."""
    sought = _seek(samples, free_from_s)
    read = _read(samples, sought)
    strongest = max(range(len(read.history.model.bases)), key=read.history.energy)
    if strongest and free_from_s is None:
        hz = float(read.history.poles(mode=strongest)[0][1]) / (2.0 * np.pi)
        again = _in_band(samples, hz)
        if again is not None:
            sought, read = again, _read(samples, again)
            strongest = max(range(len(read.history.model.bases)), key=read.history.energy)
    fit, times, heights = sought.fit, read.peak_time_s, read.height
    peaks = sought.peaks
    if is_rate:
        peaks, times, heights = _angle_peaks(samples, sought)
    table = amplitude_dependence(times, heights, peaks.value_std)
    peak_unit = _integrated(unit) if is_rate else unit
    shape = judge_shape(read.bent, table, peak_unit, read.p_value)
    if sought.is_exact:
        shape = replace(shape, reason=_EXACT)
    poles, by_noise, by_misfit, why = _poles(read, sought, strongest)
    parts = _parts(poles, by_noise, by_misfit, read.degrees_of_freedom, samples.clock_std)
    found = {name: one.together for name, one in parts.items()}
    frequency = found["frequency_hz"]
    if frequency.low <= 0:
        raise RecordingError(
            f"no frequency can be told: the oscillation has {frequency.shown('Hz')}; record more of it, with less noise"
        )
    rest = read.bent if read.p_value < SIGNIFICANCE else fit
    drift, drift_std = (one if abs(one) > ROUND_OFF * fit.amplitude else 0.0 for one in rest.drift())
    paper = fit_envelope(times, np.abs(heights), inertia_kg_m2)
    remarks = samples.remarks
    if strongest:
        of_peaks = float(read.history.poles()[0][1]) / (2.0 * np.pi)
        remarks = (
            *remarks,
            f"peaks and shape are told of the mode at {number(of_peaks, 3)} Hz, the easier one to follow",
        )
    by_period = 1.0 / (frequency.value * float(np.median(np.diff(samples.time_s))))
    return RingDown(
        **found,
        parts=parts,
        misfit=_misfit_said(parts, why),
        rest_drift=Estimate.student(drift, drift_std, rest.degrees_of_freedom),
        paper=paper,
        withheld=_withheld(paper, found, by_period, strongest > 0),
        shape=shape,
        dependence=table,
        modes=_modes(read.history, samples.clock_std) if len(read.history.model.bases) > 1 else (),
        start_s=fit.start_s,
        stop_s=read.stop_s,
        fit=fit if shape.exponential else read.bent,
        peak_time_s=times,
        peak_value=heights,
        unit=unit,
        peak_unit=peak_unit,
        remarks=remarks,
    )


def paper_envelope(time_s: ArrayLike, rate: ArrayLike, *, free_from_s: float) -> Envelope:
    """Return what the paper's method, peaks and Eq. 7, says of a decay of which a gyroscope has the rate.

    time_s: shape (n,), increasing [s]; rate: shape (n,) [rad/s]. free_from_s: time from which the decay is free [s].

    It is `analyse_ring_down`'s, whose direct fit takes three times as long to tell how sure it is.
    Raises RecordingError where there are no peaks.
    """
    samples = read_samples(time_s, rate, None, "rad/s")
    _, times, heights = _angle_peaks(samples, _seek(samples, free_from_s))
    return fit_envelope(times, np.abs(heights))


# What is sought: the start of the decay, and which oscillation it is.

_EXPLAINED = 0.7  # share of the motion that the oscillation found first should make
_RISE, _RISEN = 3.0, 0.25  # times the swing before, and of the largest one, that begin a decay anew
_SURE_OF_BAND = 60.0  # fall of n ln(residual²) that an oscillation sought in a band must bring
_SURE_SHARE, _SURE_OF_SHARE = 0.5, 15.0  # the same of one that makes so much of the motion
_OFF_BAND = 1.5  # times the band's frequency, either way, that its fit may have
_AS_STRONG = 0.5  # of the energy of the strongest: then what was found without a band stays
_OVERDAMPED = 0.7
_LATE = 0.25  # of the record: a decay that begins later may be that of modes that beat before
_ALL_OF_IT = 1.5  # times the noise is what such modes leave of the record
_SURE_TO_DECAY = 4.0  # standard deviations of the rate of a mode that beats with another


_EXACT = (
    "one exponential leaves nothing but the round-off of the numbers: there is no noise, so no uncertainty is known"
)


class _Sought(NamedTuple):
    """A free decay in a record: its fit, the samples of that, (n,) each, its peaks, and whether these are about zero,
    for they were found in a band."""

    fit: DecayFit
    t: Array
    x: Array
    peaks: Peaks
    centred: bool

    @property
    def energy(self) -> float:
        """Return the energy of the oscillation in the window, unit of the response squared times seconds."""
        swing = self.fit.model(self.t) - self.fit.rest(self.t)
        return float(np.mean(swing**2)) * self.fit.window_s

    @property
    def is_exact(self) -> bool:
        """Return whether the fit leaves only round-off, as of a record that was computed: it tests nothing."""
        return float(np.std(self.fit.residual)) <= ROUND_OFF * float(np.ptp(self.x))

    @property
    def explained(self) -> float:
        """Return which share of the motion about the rest position the oscillation makes."""
        motion = float(np.sum((self.x - self.fit.rest(self.t)) ** 2))
        return 1.0 - float(np.sum(self.fit.residual**2)) / motion if motion > 0 else 1.0


def _sought(
    samples: Samples, free_from_s: float | None = None, *, band: Array | None = None, may_beat: bool = False
) -> _Sought:
    """Return the free decay that `free_decay` finds in the samples, or in a band of them, with three peaks at least."""
    found = free_decay(
        samples.even_s,
        samples.even,
        samples.drive,
        free_from_s,
        samples=None if samples.is_even else (samples.time_s, samples.values),
        sought=band,
        floor=samples.resolution,
        may_beat=may_beat,
    )
    sought = _Sought(*found, band is not None)
    sought = _filled(samples, sought) if band is None else sought
    _heights(sought.peaks, sought.fit, sought.centred)
    return sought


def _seek(samples: Samples, free_from_s: float | None) -> _Sought:
    """Return the free decay that explains a record: the one its peaks show, else the strongest of its spectrum."""
    first: _Sought | None = None
    refusal: RecordingError | None = None
    try:
        first = _sought(samples, free_from_s)
    except RecordingError as error:
        refusal = error
    sought_freely = free_from_s is None and samples.drive is None
    late = first is not None and first.fit.start_s - samples.even_s[0] > _LATE * np.ptp(samples.even_s)
    if first is None or (late and sought_freely):
        whole = _beating(samples, free_from_s)
        if whole is not None:
            return whole
    if first is not None and (free_from_s is not None or first.explained > _EXPLAINED):
        return first
    lines = spectral_lines(samples.even_s, samples.even) if free_from_s is None else []
    others = [one for one in (_in_band(samples, hz) for hz in lines) if one is not None]
    best = max(others, key=lambda one: one.energy, default=None)
    if first is not None and (best is None or first.energy > _AS_STRONG * best.energy):
        return first
    best = best or _behind_a_rise(samples, free_from_s)
    if best is None:
        assert refusal is not None
        if not samples.missing.any() or free_from_s is not None:
            raise refusal
        raise RecordingError(
            f"what is left of the samples does not show three half cycles of a decay: {'; '.join(samples.remarks)}; "
            "choose a stretch without that (--start, --stop)"
        ) from refusal
    return best


def _behind_a_rise(samples: Samples, free_from_s: float | None) -> _Sought | None:
    """Return the free decay behind the last sudden rise of the swings, as of a body that was held, or None."""
    if free_from_s is not None or samples.drive is not None:
        return None
    try:
        peaks = find_peaks(samples.even_s, samples.even)
        before, swing = peaks.swing[:-1], peaks.swing[1:]
        rises = np.flatnonzero((swing > _RISE * before) & (swing > _RISEN * peaks.swing.max(initial=0.0)))
        if not rises.size:
            return None
        start = float(peaks.time_s[rises[-1] + 2])  # the release takes half a cycle
        sought = _sought(samples, start)
    except RecordingError:
        return None
    return sought if sought.explained > _EXPLAINED else None


def _beating(samples: Samples, free_from_s: float | None) -> _Sought | None:
    """Return the free decay of modes that beat and explain the whole record to its noise, or None.

    One exponential does not see that they decay, or finds a start late in the record, behind the largest beat.
    """
    if free_from_s is None and samples.drive is None:  # no start is seen where the swing comes and goes
        free_from_s = float(samples.even_s[0])
    try:
        sought = _sought(samples, free_from_s, may_beat=True)
        history = _read(samples, sought).history
    except RecordingError:
        return None
    if len(history.model.bases) < 2 or float(np.std(history.residual)) > _ALL_OF_IT * noise_level(sought.x):
        return None
    poles, gradient = history.poles(mode=max(range(len(history.model.bases)), key=history.energy))
    std = math.sqrt(max(float(gradient[0] @ history.grown @ gradient[0]), 0.0))
    return sought if poles[0] > _SURE_TO_DECAY * std else None


def _filled(samples: Samples, sought: _Sought) -> _Sought:
    """Return a free decay with the peaks that its fit has where samples are missing; they were interpolated before."""
    if not samples.missing.any():
        return sought
    fit, half = sought.fit, sought.peaks.half_period_s
    inside = (samples.even_s >= fit.start_s - 0.5 * half) & (samples.even_s <= fit.stop_s)
    t, x = samples.even_s[inside], samples.even[inside]
    x = np.where(samples.missing[inside], fit.model(t), x)
    return sought._replace(peaks=find_peaks(t, x).between(fit.start_s - 0.05 * half, fit.stop_s))


def _in_band(samples: Samples, frequency_hz: float) -> _Sought | None:
    """Return the free decay of the oscillation near a frequency, or None where there is none for sure."""
    try:
        one = _sought(samples, band=band_passed(samples.even_s, samples.even, frequency_hz))
    except RecordingError:
        return None
    fit, still = one.fit, np.polynomial.Polynomial.fit(one.t, one.x, 1)
    before = float(np.sum((one.x - still(one.t)) ** 2))
    effective = fit.degrees_of_freedom + fit.parameters.size
    after = max(float(fit.residual @ fit.residual), 1e-300)
    rate, _ = fit.mean_rate_per_s()
    off = abs(math.log(max(fit.omega_rad_s, 1e-300) / (2.0 * np.pi * frequency_hz)))
    enough = _SURE_OF_BAND if one.explained < _SURE_SHARE else _SURE_OF_SHARE
    if effective * math.log(max(before, 1e-300) / after) < enough or off > math.log(_OFF_BAND):
        return None
    return one if rate < _OVERDAMPED * fit.omega_rad_s else None


# What is read from it: the course of its size and phase, and what else swings.

_SUSPECT = 0.15  # p value from which on halves are compared, though one exponential is not refuted
_BEYOND = 2.0  # standard deviations by which halves, or fit and peaks, differ beyond noise
_REACH = 1.5  # times the difference of the halves: of a value that drifts evenly, those of each half just meet at 1
_PLAIN_BETTER = 10.0  # fall of Akaike's criterion that a smooth course must bring where there are several modes
_PLAINLY_BENT = 50.0  # of twice the logarithm of the likelihood ratio of two parameters
_FEWEST_PER_PERIOD = 12  # samples, for the paper's peaks
_SCATTERS, _WITHIN = 3.0, 0.03  # by which the paper's numbers may differ from the direct fit's


class _Read(NamedTuple):
    """What the samples of one free decay say.

    bent: its bent fit; p_value: that a plain one is as good. history: of its size and phase, and of further modes;
    halves: one whose early and late half can differ, where that is suspected. is_plain: the course is one exponential
    alone, whose numbers are the fit's own. peak_time_s, height: shape (h,), of the response about its rest position;
    height_std: noise of one. stop_s: end of the window.
    """

    fit: DecayFit
    bent: DecayFit
    p_value: float
    history: AmplitudeHistory
    halves: AmplitudeHistory | None
    is_plain: bool
    peak_time_s: Array
    height: Array
    height_std: float
    stop_s: float

    @property
    def degrees_of_freedom(self) -> float:
        """Return those of the numbers."""
        return self.fit.degrees_of_freedom if self.is_plain else self.history.degrees_of_freedom


def _read(samples: Samples, sought: _Sought) -> _Read:
    fit, t, x, peaks = sought.fit, sought.t, sought.x, sought.peaks
    times, heights = _heights(peaks, fit, sought.centred)
    bent = fit_bent(t, x, fit, times, np.abs(heights))
    p_value = 1.0 if sought.is_exact else bend_p_value(bent)
    left = float(np.std(bent.residual))
    if p_value >= SIGNIFICANCE and not fit.bending and left > _ALL_OF_IT * noise_level(x):
        # Two bending terms left a misfit, which their own test takes for noise; a course that leaves none tests it.
        smooth = smooth_history(t, x, bent, times, heights)
        p_value = 0.0 if clearly_better(exponential_history(t, x, fit), smooth, _PLAIN_BETTER) else p_value
    if p_value < SIGNIFICANCE and not sought.centred:
        times, heights = _heights(peaks, bent, False)
    moves = p_value < SIGNIFICANCE or fit.bending
    stop = fit.stop_s
    halves = smooth_history(t, x, bent, times, heights, functions=3) if p_value < _SUSPECT and not moves else None
    if moves:
        size = np.abs(peaks.value - (0.0 if sought.centred else bent.rest(peaks.time_s)))
        large = size > max(5.0 * peaks.value_std, 0.02 * float(size.max()))
        last = float(peaks.time_s[np.flatnonzero(large)[-1]]) + 0.5 * peaks.half_period_s
        inside = t <= max(last, float(times[-1]))
        if np.count_nonzero(inside) >= 32:
            t, x = t[inside], x[inside]
        history, stop = smooth_history(t, x, bent, times, heights), float(t[-1])
        two = close_modes(t, x, history)
        history = history if two is None else two
    else:
        history = exponential_history(t, x, fit)
    several = history if sought.is_exact else with_further_modes(t, x, history)
    if len(several.model.bases) > 1 and several.functions > 2:
        simple = with_further_modes(t, x, exponential_history(t, x, fit))
        if not clearly_better(simple, several, _PLAIN_BETTER):
            several = simple
    if len(several.model.bases) > 1 and several.functions == 2:
        p_value = 1.0
    elif moves and _likelihood_ratio(sought, bent) > _PLAINLY_BENT:
        p_value = 0.0  # the F test's covariance is of no use where the residual is mostly misfit
    alone = several.functions == 2 and len(several.model.bases) == 1 and not fit.bending
    if len(several.model.bases) > 1 or moves:
        halves = several if several.functions > 2 else None
    return _Read(fit, bent, p_value, several, halves, alone, times, heights, peaks.value_std, stop)


def _likelihood_ratio(sought: _Sought, bent: DecayFit) -> float:
    """Return twice the logarithm of the likelihood ratio of a bent fit to a plain one, in independent samples."""
    fit, effective = sought.fit, bent.degrees_of_freedom + bent.parameters.size
    before = (
        exponential_history(sought.t, sought.x, fit).left_over if fit.bending else float(fit.residual @ fit.residual)
    )
    after = float(bent.residual @ bent.residual)
    return effective * math.log(before / after) if after > 0 and before > 0 else 0.0


def _poles(read: _Read, sought: _Sought, mode: int) -> tuple[Array, Array, Array, list[str]]:
    """Return (λ, ω) of a mode, the covariance of both by noise and by misfit, (2, 2) each, and where that is from."""
    history, why = read.history, []
    if read.is_plain:
        fit = read.fit
        poles, noise = np.array([fit.decay_rate_per_s, fit.omega_rad_s]), fit.pole_covariance()
        if sought.is_exact:
            return poles, noise, np.zeros_like(noise), []
        _, gradient = history.poles()
        grown = gradient @ (history.grown - history.covariance) @ gradient.T
    else:
        poles, gradient = history.poles(mode=mode)
        noise = gradient @ history.covariance @ gradient.T
        grown = gradient @ (history.grown - history.covariance) @ gradient.T
    misfit = np.diag(np.maximum(np.diag(grown), 0.0))
    if np.any(np.diag(misfit) > 0.2 * np.diag(noise)):
        why.append("the residual grows with the amplitude")
    louder = louder_line(history, float(poles[1]))
    if louder > 1.0:
        misfit = misfit + (louder - 1.0) * noise
        why.append("the residual still swings near the oscillation's frequency")
    if read.halves is None or mode:
        return poles, noise, misfit, why
    first, last = float(read.peak_time_s[0]), float(read.peak_time_s[-1])
    off, std = differing_halves(read.halves, 0.5 * (first + last), last)
    beyond = np.abs(off) > _BEYOND * std
    excess = np.where(beyond, np.sign(off) * np.sqrt(np.maximum(off**2 - std**2, 0.0)), 0.0) * _REACH / NORMAL_90
    if beyond.any():
        why.append("its early half, of large swings, and its late one, of small swings, differ beyond their noise")
    misfit = misfit + np.outer(excess, excess)
    if history.functions < 3:
        return poles, noise, misfit, why
    window = history.stop_s - history.start_s
    edges = np.clip((np.array([first, last]) - history.start_s) / window, 0.0, 1.0)
    if edges[1] - edges[0] > 0.3:
        by_peaks, scatter = _means_by_peaks(read.peak_time_s, np.abs(read.height), read.height_std)
        apart = history.poles(float(edges[0]), float(edges[1]))[0] - by_peaks
        apart = np.where(np.abs(apart) > _BEYOND * scatter, apart, 0.0)
        if np.any(apart**2 > 0.2 * np.diag(noise + misfit)):
            why.append("its peaks say otherwise than the fit")
        misfit = misfit + np.diag(apart**2)
    return poles, noise, misfit, why


def _parts(poles: Array, noise: Array, misfit: Array, freedom: float, clock_std: float) -> dict[str, IntervalParts]:
    """Return the parts of every quantity that follows from (λ, ω)."""
    alone = pole_estimates(poles, noise, freedom, clock_std)
    beside = pole_estimates(poles, misfit, freedom)
    return {name: IntervalParts(one, beside[name].std) for name, one in alone.items()}


def _misfit_said(parts: dict[str, IntervalParts], why: list[str]) -> str:
    """Return a sentence on how much of the intervals of frequency and damping ratio is misfit; empty without any."""
    if not why:
        return ""
    shares = []
    for name, words, unit in (("frequency_hz", "frequency", " Hz"), ("damping_ratio", "damping ratio", "")):
        one = parts[name]
        if one.misfit_std > 0.3 * one.noise.std:
            shares.append(
                f"{words} ±{number(one.noise.std, 2)} by noise and ±{number(one.misfit_std, 2)}{unit} by misfit"
            )
    return f"{'; '.join(shares)}: {' and '.join(why)}" if shares else ""


def _withheld(paper: Envelope, found: dict[str, Estimate], by_period: float, of_other: bool) -> str:
    """Return why the paper's method is not to be believed here, or an empty text."""
    if of_other:
        return "the peaks are those of another mode than the strongest"
    if by_period < _FEWEST_PER_PERIOD:
        return (
            f"{number(by_period, 2)} samples in a period are too few for its peaks; expected {_FEWEST_PER_PERIOD} or "
            "more"
        )
    direct = found["decay_rate_per_s"], found["frequency_hz"].times(2.0 * np.pi)
    own = (paper.decay_rate_per_s, paper.decay_rate_std_per_s), (paper.omega_rad_s, paper.omega_std_rad_s)
    for one, (value, std), words in zip(direct, own, ("decay rate", "angular frequency"), strict=True):
        scatter = math.hypot(one.std, 0.0 if math.isnan(std) else std)
        if abs(value - one.value) > _SCATTERS * scatter + _WITHIN * abs(one.value):
            return (
                f"its {words} of {number(value, 3)} is {number(abs(value - one.value) / max(scatter, 1e-300), 2)} "
                f"standard deviations from the direct fit's {number(one.value, 3)}"
            )
    return ""


def _modes(history: AmplitudeHistory, clock_std: float) -> tuple[DecayMode, ...]:
    """Return all modes of a course, the one of most energy first."""
    found = []
    for m in sorted(range(len(history.model.bases)), key=lambda m: -history.energy(m)):
        poles, gradient = history.poles(mode=m)
        first, freedom = history.model.mode(m).start, history.degrees_of_freedom
        begin = history.at(np.array([history.start_s]), m)[0]
        stds = np.sqrt(np.maximum(np.diag(history.grown)[first : first + 2], 0.0))
        size = history.scale * math.exp(float(begin.real))
        found.append(
            DecayMode(
                **pole_estimates(poles, gradient @ history.grown @ gradient.T, freedom, clock_std),
                amplitude=Estimate.student(size, size * float(stds[0]), freedom),
                phase_rad=Estimate.student(math.remainder(begin.imag, 2.0 * math.pi), float(stds[1]), freedom),
            )
        )
    return tuple(found)


def _angle(t: Array, rate: Array, fit: DecayFit) -> Array:
    """Return the angle about its rest position, shape (n,): the rate less its bias, integrated, less its drift.

    The drift is that behind the start of the fit, where the record holds more.
    """
    angle = scipy.integrate.cumulative_trapezoid(rate - fit.rest(t), t, initial=0)
    wave = np.exp((1j * fit.omega_rad_s - fit.decay_rate_per_s) * (t - fit.start_s))
    basis = np.stack([wave.real, wave.imag, np.ones_like(t), t - fit.start_s], axis=1)
    free = t >= fit.start_s - 1e-9
    drift = np.linalg.lstsq(basis[free], angle[free], rcond=None)[0][2:]
    return np.asarray(angle - basis[:, 2:] @ drift, dtype=float)


def _angle_peaks(samples: Samples, sought: _Sought) -> tuple[Peaks, Array, Array]:
    """Return the peaks of the angle whose rate was measured; times and heights of those that are large."""
    fit = sought.fit
    inside = (samples.even_s >= fit.start_s - 1e-9) & (samples.even_s <= fit.stop_s + 1e-9)
    t, x = block_means(samples.even_s[inside], samples.even[inside], sought.peaks.half_period_s)
    peaks = find_peaks(t, _angle(t, x, fit))
    return peaks, *_heights(peaks, fit, True)


def _heights(peaks: Peaks, fit: DecayFit, centred: bool) -> tuple[Array, Array]:
    """Return (times, heights about the rest position) of the peaks of the free decay; centred: that is zero."""
    rest = np.zeros(peaks.time_s.size) if centred else fit.rest(peaks.time_s)
    times, heights = large_peaks(peaks, rest)
    if times.size >= 3:
        return times, heights
    half = peaks.half_period_s
    if fit.stop_s - fit.start_s < 4.0 * half:
        raise RecordingError(
            f"ring-down too short: {times.size} peaks of the free decay stand out of the noise, at least 3 are needed; "
            "start from a larger amplitude or record longer"
        )
    raise RecordingError(
        f"too few peaks: {times.size} in a row of the free decay stand out of the noise, at least 3 are needed; start "
        "from a larger amplitude, or measure with less noise"
    )


def _integrated(unit: str) -> str:
    return unit.removesuffix("/s") if unit.endswith("/s") else f"{unit} s"


def analyse_ring_downs(recording: xr.Dataset | Signals, inertia_kg_m2: float | None = None) -> xr.Dataset:
    """Return the ring-down part of the results: the variables of the result schema over (pretension, repeat).

    inertia_kg_m2: I of head and lever, for the paper's d and k; NaN without it.

    The response is the gyroscope's x axis (a rate), else torsion_rad, else response. Behind a settle segment of
    the same group the drive was told to stop where the ring-down begins, so nothing is sought: the first drive period,
    in which the lever settles on its servo, is left out. A start that depended on how far the lever recoils would jump
    with pretension and take Lehr's damping with it. Planned ring-downs begin alike, so the means over their windows are
    compared by their noise, which the standard deviations hold; what one number leaves out of each decay is the misfit
    beside them. Of other records the paper's numbers are NaN where they are withheld. A ring-down that cannot be
    analysed is NaN, and the attribute `ring_down_notes` says why.
    Raises RecordingError where there is no ring-down, or none can be analysed.
    """
    signals = read_signals(recording)
    indices = [index for index, (segment, _) in enumerate(signals.segments) if segment.kind == "ring-down"]
    if not indices:
        raise RecordingError("recording has no ring-down segment; expected at least one")
    segments = [signals.segments[index][0] for index in indices]
    pretension = np.unique([segment.pretension_mm for segment in segments])
    shape = pretension.size, max(segment.repeat for segment in segments) + 1
    columns: dict[str, Array] = {}
    notes = []
    for index, segment in zip(indices, segments, strict=True):
        cell = int(np.searchsorted(pretension, segment.pretension_mm)), segment.repeat
        try:
            numbers = _numbers_of(signals, index, inertia_kg_m2)
        except RecordingError as error:
            notes.append(f"ring-down {segment.repeat} at {segment.pretension_mm:g} mm: {error}")
            continue
        for name, value in numbers.items():
            columns.setdefault(name, np.full((*shape, *np.shape(value)), np.nan))[cell] = value
    if not columns:
        raise RecordingError(notes[0])
    axes = {"pretension_mm": pretension, "repeat": np.arange(1, shape[1] + 1)}
    if "window_lehr_damping" in columns:
        axes["window_start_periods"] = np.array(DECAY_WINDOWS)
    return xr.Dataset(
        {name: variable_of(name, values, signals.response.unit) for name, values in columns.items()},
        {name: result_axis(name, values) for name, values in axes.items()},
        attrs={"ring_down_notes": "; ".join(notes)},
    )


_AT_HAND = 0.2
"""Of a sample interval by which a decay may begin before its rule says. A period of 4 Hz is 50 samples of 200 Hz to the
microsecond: without this some microseconds of jitter in the stamps decide whether the decay begins one sample later,
and its mean rate with it, by 0.4 % where it falls as the paper's does."""


def _numbers_of(signals: Signals, index: int, inertia_kg_m2: float | None) -> dict[str, Any]:
    """Return the numbers of a ring-down by name, those by where it begins (w,) among them where the stop of the drive
    is known. Raises RecordingError where it cannot be analysed."""
    (here, where), response, drive = signals.segments[index], signals.response, signals.drive
    time, free_from = signals.time_s[where], None
    before = signals.segments[index - 1][0] if index > 0 else here
    marks = [(one.pretension_mm, one.frequency_hz, one.repeat) for one in (before, here)]
    if before.kind == "settle" and marks[0] == marks[1]:
        sample = float(np.median(np.diff(time))) if time.size > 1 else 0.0
        free_from = float(time[0]) + DECAY_FROM_PERIODS / here.frequency_hz - _AT_HAND * sample
    driven = None if drive is None else drive.values[where]
    samples = read_samples(time, response.values[where], driven, response.unit)
    result = _analysed(samples, response.is_rate, response.unit, inertia_kg_m2, free_from)
    numbers: dict[str, Any] = _numbers(result, float(time[0]))
    if free_from is not None:
        read = _read_windows(samples, result, 1.0 / here.frequency_hz)
        for name in ("decay_rate_per_s", "omega_rad_s", "lehr_damping"):
            numbers[f"window_{name}"] = [np.nan if one is None else getattr(one, name) for one in read]
    elif result.withheld:
        numbers |= {name: np.nan for name in numbers if name.startswith("paper_")}
    return numbers


def _read_windows(samples: Samples, result: RingDown, period_s: float) -> list[Envelope | None]:
    """Return what the paper's method says of a planned ring-down from each of `DECAY_WINDOWS` on, None without peaks.

    samples: from the stop of the drive on, of which result is. period_s: of the drive [s].

    The peaks are those of one record from the stop on, about the rest position that the result found behind its own
    start; a later start leaves the earlier peaks out and changes nothing else. At `DECAY_FROM_PERIODS` it is the
    result's own. Where samples are missing its fit stands in; before that begins none is read across them.
    """
    fit, t = result.fit, samples.even_s
    stop, is_rate = float(t[0]), result.unit != result.peak_unit
    lost = t[samples.missing & (t < fit.start_s)]
    x = samples.even
    if samples.missing.any():
        x = np.where(samples.missing, fit.model(np.maximum(t, fit.start_s)), x)
    t, x = block_means(t, x, np.pi / fit.omega_rad_s)
    t, x = t[t <= fit.stop_s], x[t <= fit.stop_s]
    peaks = find_peaks(t, _angle(t, x, fit) if is_rate else x)
    margin = 0.05 * np.pi / fit.omega_rad_s
    rows: dict[float, tuple[Array, Array]] = {}
    for start in DECAY_WINDOWS:
        begin = stop + start * period_s - margin
        if start == DECAY_FROM_PERIODS or (lost >= begin).any():
            continue
        with suppress(RecordingError):
            times, heights = _heights(peaks.between(begin, float(t[-1])), fit, is_rate)
            rows[start] = times, np.abs(heights)
    read = dict(zip(rows, fit_envelopes(list(rows.values())), strict=True))
    read[DECAY_FROM_PERIODS] = result.paper
    return [read.get(start) for start in DECAY_WINDOWS]


def _numbers(result: RingDown, begins_s: float) -> dict[str, float]:
    paper = result.paper
    rate, frequency, ratio = (result.parts[name] for name in ("decay_rate_per_s", "frequency_hz", "damping_ratio"))
    return {
        "paper_decay_rate_per_s": paper.decay_rate_per_s,
        "paper_omega_rad_s": paper.omega_rad_s,
        "paper_lehr_damping": paper.lehr_damping,
        "paper_quality": paper.quality,
        "paper_damping_n_m_s_rad": paper.damping_n_m_s_rad,
        "paper_stiffness_n_m_rad": paper.stiffness_n_m_rad,
        "decay_start_s": result.start_s - begins_s,
        "decay_rate_per_s": rate.noise.value,
        "decay_rate_std_per_s": rate.noise.std,
        "decay_rate_misfit_per_s": rate.misfit_std,
        "decay_frequency_hz": frequency.noise.value,
        "decay_frequency_std_hz": frequency.noise.std,
        "decay_frequency_misfit_hz": frequency.misfit_std,
        "damping_ratio": ratio.noise.value,
        "damping_ratio_std": ratio.noise.std,
        "damping_ratio_misfit": ratio.misfit_std,
        "rest_drift": result.rest_drift.value,
        "exponential": float(result.shape.exponential),
    }
