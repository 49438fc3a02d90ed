"""The paper's method: an exponential through the peaks of a decay and their mean spacing; D by where that begins."""

import math
import statistics
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from sinew.analysis.decay.free_decay import Peaks
from sinew.analysis.signal.repeats import fit_trend, pool_repeats
from sinew.measure.arrays import Array, mean_of_known
from sinew.measure.estimate import Estimate, finite

_NOISE_SHARE = 5.0  # a peak is used while it is this many times its own uncertainty,
_SMALLEST_PEAK = 0.02  # and this share of the largest
_SPACING = (0.6, 1.6)  # of the spacings before; outside it a peak is missing, displaced or made by noise
_MOST_STEPS, _STEADY_RATE = 50, 1e-9  # of the rate's search; five do. Its last step, over the whole row
_DISPLACED = 0.25  # of a spacing: by less do two of them differ from their usual mean around a peak that is displaced


@dataclass(frozen=True)
class Envelope:
    """The paper's numbers of one ring-down (section 4.2), with the damped frequency as printed.

    amplitude, decay_rate_per_s: A and λ of A·exp(-λ(t - time_s[0])) through the sizes of the peaks.
    omega_rad_s: ⟨ω⟩, π over the mean spacing of the peaks: the damped frequency.
    decay_rate_std_per_s, omega_std_rad_s: their standard deviations from the scatter of the peaks; NaN for 2 peaks.
    time_s, size: the peaks that were used, shape (h,), about the rest position.
    inertia_kg_m2: I, or None where the stiffness and damping are not asked for.
    """

    amplitude: float
    decay_rate_per_s: float
    decay_rate_std_per_s: float
    omega_rad_s: float
    omega_std_rad_s: float
    time_s: Array
    size: Array
    inertia_kg_m2: float | None = None

    @property
    def lehr_damping(self) -> float:
        """Return D = λ/⟨ω⟩ as paper Eq. 7 prints it, 1/sqrt(1 - D²) larger than `lehr_damping` of the direct fit."""
        return self.decay_rate_per_s / self.omega_rad_s

    @property
    def quality(self) -> float:
        """Return Q = 1/(2 D) (paper Eq. 8)."""
        return 0.5 / self.lehr_damping

    @property
    def damping_n_m_s_rad(self) -> float:
        """Return d = 2 λ I (paper Eq. 9) [N m s/rad]; NaN without inertia."""
        return 2.0 * self.decay_rate_per_s * self._inertia()

    @property
    def stiffness_n_m_rad(self) -> float:
        """Return k = ⟨ω⟩² I (paper Eq. 10) [N m/rad]; (1 - D²) of the stiffness below; NaN without inertia."""
        return self.omega_rad_s**2 * self._inertia()

    def _inertia(self) -> float:
        return float("nan") if self.inertia_kg_m2 is None else self.inertia_kg_m2


def large_peaks(peaks: Peaks, rest: Array) -> tuple[Array, Array]:
    """Return (times, heights about the rest position) of the regular peaks that stand well out of the noise.

    rest: shape (h,), rest position at the peaks. The row ends at the first peak that is small, on the wrong side or
    out of step with those before and after it.
    """
    height = peaks.value - rest
    size, spacing = np.abs(height), np.diff(peaks.time_s).tolist()
    floor = max(_NOISE_SHARE * peaks.value_std, _SMALLEST_PEAK * float(size.max(initial=0.0)))
    wrong = ~(size > floor)
    wrong[1:] |= height[1:] * height[:-1] > 0
    most = int(np.argmax(np.append(wrong, True)))
    end = next((k for k in range(2, most) if not _keeps_step(spacing, k - 1)), most)
    return peaks.time_s[:end], height[:end]


def _keeps_step(spacing: list[float], at: int) -> bool:
    """Return whether a spacing of peaks is like the three before it, or one peak between two of them is displaced.

    A sensor that sticks at a turning point moves its peak: one spacing is long by what the next is short, or the other
    way round. Where a peak is missing, or noise made some, neither makes up for the other.
    """
    usual = statistics.median(spacing[max(0, at - 3) : at])
    if _SPACING[0] < spacing[at] / usual < _SPACING[1]:
        return True
    off = spacing[at] / usual - 1.0
    beside = [spacing[other] / usual - 1.0 for other in (at - 1, at + 1) if other < len(spacing)]
    return any(off * one < 0 and abs(off + one) < 2.0 * _DISPLACED for one in beside)


def fit_envelope(time_s: Array, size: Array, inertia_kg_m2: float | None = None) -> Envelope:
    """Return the paper's fit through the sizes of at least two peaks.

    time_s, size: shape (h,), both-sided peaks about the rest position, all of one weight (nonlinear least squares).
    """
    return fit_envelopes([(time_s, size)], inertia_kg_m2)[0]


def fit_envelopes(rows: list[tuple[Array, Array]], inertia_kg_m2: float | None = None) -> list[Envelope]:
    """Return the paper's fit, see `fit_envelope`, through each of any number of rows of peaks, (times [s], sizes).

    The amplitude of least squares for a rate λ is A = Σ s e / Σ e², e = exp(-λt). What it leaves is least where the
    mean times by the weights s e and e² are the same: Newton's method on their difference, from the logarithms' line.
    """
    if not rows:
        return []
    known = np.arange(max(time.size for time, _ in rows)) < np.array([[time.size] for time, _ in rows])
    t, s = np.zeros(known.shape), np.zeros(known.shape)  # in units of a row's span and of its first size
    for at, one, (time, size) in zip(t, s, rows, strict=True):
        at[: time.size], one[: size.size] = (time - time[0]) / (time[-1] - time[0]), size / size[0]
    middle, spread = _moments(t, s**2)
    rate = (
        -np.sum(s**2 * (t - middle[:, None]) * np.log(np.where(known, s, 1.0)), axis=1) / np.sum(s**2, axis=1) / spread
    )
    for _ in range(_MOST_STEPS):
        fading = np.exp(-rate[:, None] * t) * known
        (by_size, own), (spread_by_size, spread) = _moments(t, np.stack([s * fading, fading**2]))
        step = (own - by_size) / np.maximum(2.0 * spread - spread_by_size, 0.5 * spread)
        rate = rate + np.clip(step, -1.0, 1.0)
        if np.abs(step).max() < _STEADY_RATE:
            break
    fading = np.exp(-rate[:, None] * t) * known
    power = np.sum(fading**2, axis=1)
    amplitude = np.sum(s * fading, axis=1) / power
    left = np.sum((s - amplitude[:, None] * fading) ** 2, axis=1)
    rate_std = np.sqrt(left / np.maximum(known.sum(axis=1) - 2, 1) / (power * spread)) / amplitude
    fits_of_peaks = np.stack([amplitude, rate, rate_std], axis=1).tolist()
    return [
        _envelope(time, size, a, each, std, inertia_kg_m2)
        for (time, size), (a, each, std) in zip(rows, fits_of_peaks, strict=True)
    ]


def _moments(t: Array, weight: Array) -> tuple[Array, Array]:
    """Return the means and variances of t by weights, both (..., h)."""
    share = weight / weight.sum(axis=-1, keepdims=True)
    mean = np.sum(share * t, axis=-1)
    return mean, np.sum(share * t * t, axis=-1) - mean**2


def _envelope(
    time_s: Array, size: Array, amplitude: float, rate: float, rate_std: float, inertia_kg_m2: float | None
) -> Envelope:
    """Return the paper's numbers of one row of peaks by its fit in units of its span and of its first size."""
    t, n = time_s - time_s[0], time_s.size
    span, omega_std = float(t[-1]), math.nan
    if n > 2:
        order = np.arange(n) - 0.5 * (n - 1)
        scatter = float(np.sum((t - t.mean() - float(order @ t) / float(order @ order) * order) ** 2)) / (n - 2)
        omega_std = math.sqrt(2.0 * scatter) / span * math.pi * (n - 1) / span
    return Envelope(
        amplitude * float(size[0]),
        rate / span,
        rate_std / span if n > 2 else math.nan,
        math.pi * (n - 1) / span,
        omega_std,
        time_s,
        size,
        inertia_kg_m2,
    )


# D over pretension by where its window begins, and what holds for every window.
#
# The paper stops the drive, lets the lever recoil ("parasitic") and fits an exponential through the peaks that follow;
# from which peak on it does not say. A decay that is not exponential has another D in every window, and the window in
# which D is constant over pretension is not the same for every rig. So D over pretension is told for several windows,
# and a statement about it is one that all of them make.


@dataclass(frozen=True)
class DecayWindow:
    """D over pretension from one start of the decay on, by the paper's method.

    start_periods: after the stop of the drive, in its periods. pretension_mm: shape (p,). damping: D at each, with the
    interval of all repeats together. spread: (max - min)/mean of these. change: of the line through them over the whole
    range of pretension, relative to the mean. falling_rates: steps of pretension at which λ does not rise.
    """

    start_periods: float
    pretension_mm: Array
    damping: tuple[Estimate, ...]
    spread: float
    change: Estimate
    falling_rates: int

    @property
    def trend(self) -> str:
        """Return "rises", "falls", or "no trend" where the interval of the change holds zero or is not known."""
        if self.change.low > 0:
            return "rises"
        return "falls" if self.change.high < 0 else "no trend"

    def to_json(self) -> dict[str, Any]:
        """Return the window as plain numbers, lists and texts; what is not finite becomes null."""
        return {
            "start_periods": self.start_periods,
            "pretension_mm": [float(p) for p in self.pretension_mm],
            "lehr_damping": [one.to_json() for one in self.damping],
            "spread": finite(self.spread),
            "relative_change": self.change.to_json(),
            "trend": self.trend,
            "steps_at_which_the_decay_rate_does_not_rise": self.falling_rates,
        }


def decay_windows(results: xr.Dataset) -> list[DecayWindow]:
    """Return D over pretension for every window of the results, the earliest first.

    results: of `sinew.analysis.analysed.analyse_recording`. Empty where they hold no planned ring-downs at two
    pretensions or more: only of those it is known when the drive was told to stop.
    """
    if "window_lehr_damping" not in results:
        return []
    table = []
    for k, start in enumerate(results["window_start_periods"].values):
        damping = np.asarray(results["window_lehr_damping"].values[:, :, k], dtype=float)
        known = np.isfinite(damping).any(axis=1)
        if np.count_nonzero(known) < 2:
            continue
        rates = np.asarray(results["window_decay_rate_per_s"].values[:, :, k], dtype=float)
        pretension = np.asarray(results["pretension_mm"].values, dtype=float)
        order = np.flatnonzero(known)[np.argsort(pretension[known])]
        table.append(_window(float(start), pretension[order], damping[order], rates[order]))
    return table


def _window(start: float, pretension: Array, damping: Array, rates: Array) -> DecayWindow:
    pooled = pool_repeats(damping.tolist(), [])
    mean = np.array([one.value for one in pooled.estimates])
    stds = np.array([one.std for one in pooled.estimates])
    stds = stds[np.isfinite(stds)]
    noise = float(np.sqrt(np.mean(stds**2))) if stds.size else math.nan
    line = fit_trend(pretension, mean, noise, pooled.degrees_of_freedom)
    change = line.slope.times(float(np.ptp(pretension)) / line.middle.value)
    spread = float(np.ptp(mean) / mean.mean())
    falling = int((np.diff(mean_of_known(rates)) <= 0).sum())
    return DecayWindow(start, pretension, pooled.estimates, spread, change, falling)


def windows_agree(table: list[DecayWindow]) -> bool:
    """Return whether one statement about D over pretension holds in all windows.

    They all rise, all fall or all show no trend, or at least one change lies inside all of their intervals: an
    exponential decay has one D, and its windows differ by chance alone.
    """
    if len({window.trend for window in table}) <= 1:
        return True
    known = [window.change for window in table if math.isfinite(window.change.low)]
    return max(one.low for one in known) <= min(one.high for one in known)


def describe_windows(table: list[DecayWindow]) -> str:
    """Return the sentence about D over pretension that holds for every window; empty without a table."""
    if not table:
        return ""
    changes = sorted(window.change.value for window in table)
    ends = f"{_change(changes[0])} and {_change(changes[-1])}"
    starts = f"from {table[0].start_periods:g} to {table[-1].start_periods:g} drive periods after its stop"
    spreads = sorted(window.spread for window in table)
    spread = f"its spread is {_percent(spreads[0])} to {_percent(spreads[-1])} of its mean"
    if windows_agree(table):
        return f"Wherever the decay is taken to begin, {starts}, D says the same: a change between {ends}; {spread}."
    return (
        "Whether D is constant over pretension is not determined: it depends on where the decay is taken to begin. "
        f"With starts {starts} D changes over the range by anything between {ends}; {spread}."
    )


def _change(share: float) -> str:
    return f"a {'rise' if share > 0 else 'fall'} of {_percent(abs(share))}"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"
