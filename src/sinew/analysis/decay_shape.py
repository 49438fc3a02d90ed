"""This is where a decay shows whether it is exponential, and how damping and frequency move with amplitude."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from sinew.analysis.decay_fit import DecayFit, fit_decay

__all__ = [
    "SIGNIFICANCE",
    "AmplitudeDependence",
    "DecayShape",
    "amplitude_dependence",
    "bend_p_value",
    "fit_bent",
    "judge_shape",
    "mean_poles",
]

Array = NDArray[np.float64]

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
    damping = rate / float(np.hypot(omega, rate))
    return float(amplitude.mean()), frequency, damping, frequency * time_std / length, rate_std / omega


def fit_bent(time_s: Array, values: Array, fit: DecayFit, time_of_peaks_s: Array, size: Array) -> DecayFit:
    """Return the fit whose rate and frequency change linearly with time, started from the peaks.

    time_s, values: shape (n,), what the plain `fit` was fitted to. time_of_peaks_s, size: shape (h,), three or more.
    """
    t, index = time_of_peaks_s - fit.start_s, np.arange(size.size) * np.pi
    degree = 2 if size.size > 3 else 1
    log_size = np.polyfit(t, np.log(size), degree, w=size)
    phase = np.polyfit(t, index, degree, w=size)
    bend = (-float(log_size[0]), float(phase[0])) if degree == 2 else (0.0, 0.0)
    relaxing = float(np.exp(fit.parameters[7])) if fit.relaxing else None
    return fit_decay(time_s, values, (-float(log_size[-2]), float(phase[-2])), relaxing=relaxing, bend=bend)


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
    return rates / np.hypot(rates, omegas), omegas / (2.0 * np.pi * bent.window_s)


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
