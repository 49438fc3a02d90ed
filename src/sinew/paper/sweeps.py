"""The questions on a whole recording: is D constant, whose is the saturation, which delay explains the phase?"""

import math
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import f_oneway

from sinew.analysis.decay.paper_method import decay_windows, describe_windows, windows_agree
from sinew.analysis.decay.ring_down import DECAY_FROM_PERIODS
from sinew.analysis.signal.repeats import Trend, detectable, fit_trend, pool_repeats, ratio_interval
from sinew.analysis.signal.signals import DelayBudget, read_signals, torsion_delay
from sinew.analysis.sweep.response import FEWEST_PRETENSIONS, fit_saturation
from sinew.identify.joint.fit import JointFit
from sinew.measure.arrays import Array, Mask
from sinew.measure.estimate import NORMAL_90, Estimate
from sinew.paper.answer import CANNOT_TELL, Answer, cannot_tell, exact, in_words, rows_of
from sinew.plan.rig import RigSpec

# ---- Whether Lehr's damping stays constant over pretension, beyond chance and beyond the choice of a window.
#
# One-way analysis of variance asks whether D differs between pretensions by more than between repeats; a line over
# pretension asks whether it has a trend. Because "no trend was found" is worth what the trend that would have been
# found is, two laws are held against the data: with a constant damping constant d, D = d/(2 sqrt(k I)) falls as 1/ω;
# with losses in the silicone alone, and a stiffness that grows by lossless tension, D = η k_s/(2 k) falls as 1/ω².
#
# Where the decays begin is a choice (`sinew.analysis.decay.paper_method`): the verdict is what all windows say, and
# where they contradict each other, that they do.


NOT_DETERMINED = "not determined: depends on the window"
"""Verdict where windows of the decay contradict each other."""

_LITTLE = 0.25  # of the change that a constant d makes


def answer_constancy(results: xr.Dataset) -> Answer:
    """Return whether D changes over pretension, by the direct fit of the ring-downs and by the paper's method.

    results: with ring-downs at two pretensions or more.
    Numbers: `slope_per_mm` of D, `relative_change` over the range, `detectable_change`: the relative change that its
    90 % interval would have told from zero in nine of ten such recordings, and what the two laws expect of this range.
    `relative_change_from_N_periods`: by the paper's method, with the decay begun N drive periods after its stop.
    """
    if "damping_ratio" not in results:
        return cannot_tell("constancy", "The recording holds no ring-downs; record some at several pretensions.")
    damping, std, frequency = (
        np.asarray(results[name].values, dtype=float)
        for name in ("damping_ratio", "damping_ratio_std", "decay_frequency_hz")
    )
    known = np.isfinite(damping).any(axis=1)
    damping, pretension = damping[known], np.asarray(results["pretension_mm"].values, dtype=float)[known]
    omega = 2.0 * np.pi * np.nanmean(frequency[known], axis=1)
    if pretension.size < 2:
        return cannot_tell("constancy", f"Ring-downs at {pretension.size} pretension cannot tell a trend; record more.")
    pooled = pool_repeats(damping.tolist(), std[known].tolist())
    stds = np.array([one.std for one in pooled.estimates if math.isfinite(one.std)])
    noise = float(np.sqrt(np.mean(stds**2))) if stds.size else math.nan
    trend = fit_trend(pretension, np.nanmean(damping, axis=1), noise, pooled.degrees_of_freedom)
    span = float(np.ptp(pretension))
    change = trend.slope.times(span / trend.middle.value)
    seen = span / trend.middle.value * detectable(trend.slope.std, trend.degrees_of_freedom)
    laws = {
        "change_by_constant_d": _expected(pretension, 1.0 / omega),
        "change_by_silicone_alone": _expected(pretension, 1.0 / omega**2),
    }
    repeated = [row[np.isfinite(row)] for row in damping]
    has_repeats = sum(row.size for row in repeated) > len(repeated)
    numbers = {
        "relative_change": change,
        "slope_per_mm": trend.slope,
        "mean": trend.middle,
        "detectable_change": exact(seen),
        **{name: exact(value) for name, value in laws.items()},
        "p_value": exact(float(f_oneway(*repeated).pvalue) if has_repeats else math.nan),
    }
    rows = rows_of(pretension_mm=pretension.tolist(), damping_ratio=pooled.estimates, omega_rad_s=omega.tolist())
    for row, values in zip(rows, repeated, strict=True):
        row |= {f"repeat_{r}": float(value) for r, value in enumerate(values)}
    verdict, said = _judge_constancy(change, seen, laws["change_by_constant_d"])
    windows = decay_windows(results)
    numbers |= {f"relative_change_from_{one.start_periods:g}_periods": one.change for one in windows}
    words = [said, *([describe_windows(windows)] if windows else [])]
    if windows and not windows_agree(windows):
        verdict = NOT_DETERMINED
        words = [words[1], f"From {DECAY_FROM_PERIODS:g} drive period on, by the direct fit: {said}"]
    return Answer("constancy", verdict, tuple(words), numbers, rows, ("damping_ratio",))


def _expected(pretension: Array, law: Array) -> float:
    """Return the relative change over the range if D followed a law: of the line through that law's values."""
    return float(fit_trend(pretension, law / law.mean()).slope.value * np.ptp(pretension))


def _judge_constancy(change: Estimate, seen: float, constant_d: float) -> tuple[str, str]:
    shown = in_words(change, 100.0, "%")
    if not math.isfinite(change.low):
        return CANNOT_TELL, "Two pretensions without repeats give a slope without an interval; repeat the ring-downs."
    if change.low > 0 or change.high < 0:
        verdict = "rises" if change.value > 0 else "falls"
        if max(abs(change.low), abs(change.high)) < _LITTLE * abs(constant_d):
            return "nearly constant", (
                f"D is nearly constant: over the range it changes by {shown}, beyond chance but little beside the "
                f"{abs(100 * constant_d):.2g} % that a constant damping constant d would make of it."
            )
        return verdict, f"D {verdict} beyond chance: it changes by {shown} over the range of pretension."
    power = f"a change of {100 * seen:.2g} % would have been found in nine of ten such recordings"
    if seen < abs(constant_d):
        return (
            "constant within chance",
            f"D has no trend beyond chance: it changes by {shown} over the range; {power}.",
        )
    return CANNOT_TELL, (
        f"It cannot be told whether D is constant: it changes by {shown} over the range, and {power}, more than "
        f"the {abs(100 * constant_d):.2g} % that a constant damping constant d would make of it."
    )


# ---- Whose the saturation is: the drive's, which falls short of its reach, or the joint's.
#
# Above a threshold of pretension straight lines are laid through the logarithm of the peak gain, once by the nominal
# and once by the measured drive amplitude. What falls by the nominal drive only is the drive's: its share of the fall
# is one less the ratio of the two slopes, with Fieller's interval.


_FEWEST_ABOVE = 3
_COLUMNS = ("resonance_hz", "gain_peak", "gain_peak_measured_drive", "drive_amplitude_at_resonance_rad")


def answer_saturation(results: xr.Dataset, beyond: xr.Dataset | None = None) -> Answer:
    """Return whose the fall of the peak gain with pretension is, above the threshold.

    results: of a sweep, by `sinew.analysis.analysed.analyse_recording`. beyond: of a sweep at further pretensions.
    Slopes are relative, d ln G/dp per mm. The threshold is the kink of two lines through the peak gain where the data
    prefer them to one and leave three pretensions above it; else the line runs over the upper half of the range.
    """
    if "gain_peak" not in results:
        return cannot_tell("saturation", "The recording holds no sweep with a resonance; measure one.")
    table = _saturation_table(results, beyond)
    if not np.isfinite(table["gain_peak_measured_drive"]).any():
        return cannot_tell("saturation", "The drive was not measured; record the lever's angle.")
    good = np.all([np.isfinite(table[name]) for name in ("gain_peak", "gain_peak_measured_drive")], axis=0)
    table = {name: values[good] for name, values in table.items()}
    pretension = table["pretension_mm"]
    if pretension.size < _FEWEST_ABOVE:
        return cannot_tell(
            "saturation", f"A trend needs {_FEWEST_ABOVE} pretensions with a resonance, found {pretension.size}."
        )
    threshold, how = _threshold(pretension, table["gain_peak"])
    above = pretension >= threshold.value
    lines = _lines_above(table, above)
    ratio = ratio_interval(lines.measured, lines.nominal, pretension[above])
    share = Estimate(1.0 - ratio.value, ratio.std, 1.0 - ratio.high, 1.0 - ratio.low)
    verdict, said = _judge_saturation(lines, share)
    numbers = {
        "drives_share_of_the_fall": share,
        "nominal_slope_per_mm": lines.nominal.slope,
        "measured_slope_per_mm": lines.measured.slope,
        "resonance_slope_hz_per_mm": lines.resonance.slope,
    }
    if math.isfinite(threshold.low):
        numbers["threshold_mm"] = threshold
    if lines.reached is not None:
        numbers["drive_amplitude_slope_per_mm"] = lines.reached.slope
    columns = {
        name: [Estimate.normal(*map(float, pair)) for pair in zip(table[name], table[_std(name)], strict=True)]
        for name in _COLUMNS
    }
    rows = rows_of(pretension_mm=pretension.tolist(), **columns)
    return Answer("saturation", verdict, (said, how), numbers, rows, _COLUMNS)


class _Lines(NamedTuple):
    """Lines above the threshold: ln of the gains and of the drive's amplitude, and the resonance [Hz], over mm."""

    nominal: Trend
    measured: Trend
    resonance: Trend
    reached: Trend | None


def _saturation_table(results: xr.Dataset, beyond: xr.Dataset | None) -> dict[str, Array]:
    parts = [part for part in (results, beyond) if part is not None and "gain_peak" in part]
    names = ("pretension_mm", *_COLUMNS, *(_std(name) for name in _COLUMNS))
    table = {name: np.concatenate([np.asarray(part[name].values, dtype=float) for part in parts]) for name in names}
    order = np.argsort(table["pretension_mm"], kind="stable")
    return {name: values[order] for name, values in table.items()}


def _std(name: str) -> str:
    stem, _, unit = name.rpartition("_")
    return f"{stem}_std_{unit}" if unit in ("hz", "rad") else f"{name}_std"


def _threshold(pretension: Array, gain: Array) -> tuple[Estimate, str]:
    """Return from where on the lines are laid [mm], with an interval where that is a threshold, and a sentence."""
    half = float(min(0.5 * (pretension[0] + pretension[-1]), pretension[-_FEWEST_ABOVE]))
    if np.unique(pretension).size >= FEWEST_PRETENSIONS:
        kink = fit_saturation(pretension, gain)
        if kink.preferred and np.count_nonzero(pretension >= kink.threshold_mm.value) >= _FEWEST_ABOVE:
            where = in_words(kink.threshold_mm, 1.0, "mm")
            return kink.threshold_mm, f"Two lines through the peak gain meet at {where}; the slopes are above it."
    return exact(half), (
        f"No kink in the peak gain is preferred with {_FEWEST_ABOVE} pretensions above it; the slopes are over the "
        f"upper half of the range, from {half:g} mm."
    )


def _lines_above(table: dict[str, Array], above: Mask) -> _Lines:
    x = table["pretension_mm"][above]

    def line(name: str, *, log: bool = True) -> Trend:
        y, std = table[name][above], table[_std(name)][above]
        relative = std / y if log else std
        known = relative[np.isfinite(relative)]
        noise = float(np.sqrt(np.mean(known**2))) if known.size else math.nan
        return fit_trend(x, np.log(y) if log else y, noise, float(2 * known.size))

    reached = None
    drive = table["drive_amplitude_at_resonance_rad"][above]
    if np.isfinite(drive).all() and (drive > 0).all():
        reached = line("drive_amplitude_at_resonance_rad")
    return _Lines(line("gain_peak"), line("gain_peak_measured_drive"), line("resonance_hz", log=False), reached)


def _judge_saturation(lines: _Lines, share: Estimate) -> tuple[str, str]:
    nominal, measured = (in_words(line.slope, 100.0, "% per mm") for line in (lines.nominal, lines.measured))
    slopes = f"the peak gain changes by {nominal} by the nominal drive and by {measured} by the measured one"
    if not (math.isfinite(lines.nominal.slope.high) and lines.nominal.slope.high < 0):
        return CANNOT_TELL, f"By the nominal drive the gain does not fall beyond chance up there: {slopes}."
    shown = in_words(share, 100.0, "%")
    verdict = "the drive's" if share.low > 0.5 else "the joint's" if share.high < 0.5 else CANNOT_TELL
    whose = "It cannot be told whose the fall is" if verdict == CANNOT_TELL else f"The saturation is {verdict}"
    return verdict, f"{whose}: {shown} of the fall vanishes with the measured drive; {slopes}."


# ---- The delay that would explain the phase: one extra delay, fitted to the measured response.
#
# The dynamic stiffness over the inertia follows from the response H (torsion over measured lever angle, lag negative)
# as
#
#     K(A) + j S(A, ω) = ω² + γ ω² exp(-jωτ)/H,
#
# γ being the lever's share of the inertia and τ how much later than the written delay budget says the torsion was
# recorded. K is a polynomial of the amplitude A, for a joint that hardens or whose friction gives way, and grows with
# ln ω as the stiffness of a lossy solid does; S is a polynomial of A too, for losses that do not depend on frequency,
# plus a part in proportion to ω for viscous ones, which cannot be negative. A delay shows where the joint itself
# cannot: far above the resonance the lever's inertia is all there is, and a lag beyond 180° grows as ω τ.


_FEWEST_OF_SWEEP = 8
_FIRST = 4  # unknowns before the polynomials
_SCALE_S = 1e-3
_DELAY = "imu.residual_delay"
_LONGEST_S = 0.05  # of an extra delay: beyond it the phase is no delay


class _Curve(NamedTuple):
    """One response: angular frequency, complex response, amplitude over its largest (zero where unknown), (f,)."""

    omega: Array
    response: NDArray[np.complex128]
    amplitude: Array


def answer_delay(
    results: xr.Dataset, recording: xr.Dataset, rig: RigSpec | None = None, joint: JointFit | None = None
) -> Answer:
    """Return the extra delay of the torsion behind the lever that the phase asks for, beside the written budget.

    results: of a sweep with a measured drive. recording: whose sample rate the budget needs. rig: with the budget that
    `phase_lag_rad` of the results is corrected by; None where nothing was corrected. joint: a tendon joint fitted to
    the recording from this rig on, whose own delay is told beside.

    Numbers: `extra_delay_s`, over all pretensions, the scatter between them in its interval; `budget_s`, what was
    corrected at 3 Hz, with its own uncertainty; `total_delay_s`; `extra_delay_of_joint_s`, of `joint`. Rows: the same
    by pretension, and `misfit`.
    """
    if "phase_lag_rad" not in results:
        return cannot_tell("delay", "The recording holds no sweep; a delay shows in the phase of one.")
    if not np.isfinite(results["phase_lag_rad"].values).any():
        return cannot_tell("delay", "The drive was not measured, so there is no phase; record the lever's angle.")
    budget = read_signals(recording, rig).budget
    pretensions, delays, misfits = _all_delays(results)
    if not pretensions:
        return cannot_tell(
            "delay", f"A delay needs {_FEWEST_OF_SWEEP} frequencies on both sides of a resonance at one pretension."
        )
    pooled = pool_repeats([[d for d, _ in row] for row in delays], [[s for _, s in row] for row in delays])
    means = np.array([one.value for one in pooled.estimates])
    extra = _overall(means, pooled.std / math.sqrt(max(len(delays[0]), 1)))
    written = torsion_delay(budget, 3.0) - budget.drive_delay_s
    known = Estimate.normal(written, budget.delay_std_s)
    numbers = {
        "extra_delay_s": extra,
        "budget_s": known,
        "total_delay_s": Estimate(written + extra.value, extra.std, written + extra.low, written + extra.high),
    }
    if rig is not None and joint is not None and _DELAY in joint.parameters:
        fitted, rigs = joint.parameters[_DELAY], rig.imu.residual_delay.value
        more = Estimate(fitted.value - rigs, fitted.std, fitted.low - rigs, fitted.high - rigs)
        numbers["extra_delay_of_joint_s"] = more
    levels = results["pretension_mm"].values[pretensions].astype(float).tolist()
    rows = rows_of(pretension_mm=levels, extra_delay_s=pooled.estimates, misfit=misfits)
    verdict, said = _judge_delay(extra, budget, written)
    limit = (
        "The model allows stiffness and losses that change with amplitude, and losses with and without dependence on "
        f"frequency; it leaves up to {100 * max(misfits):.2g} % of the response unexplained."
    )
    return Answer("delay", verdict, (said, limit), numbers, rows, ("extra_delay_s",))


def _all_delays(results: xr.Dataset) -> tuple[list[int], list[list[tuple[float, float]]], list[float]]:
    """Return of the pretensions that have one: place, (delay, std) [s] of each repeat, and the largest misfit."""
    gain, lag = (results[name].values for name in ("gain_measured_drive", "phase_lag_rad"))
    amplitude = results["amplitude_rad"].values if "amplitude_rad" in results else np.full_like(gain, np.nan)
    omega = 2.0 * np.pi * results["frequency_hz"].values
    places, delays, misfits = [], [], []
    for p in range(gain.shape[0]):
        found, worst = [], 0.0
        for r in range(gain.shape[2]):
            good = np.isfinite(gain[p, :, r]) & np.isfinite(lag[p, :, r]) & (gain[p, :, r] > 0)
            seen = lag[p, good, r]
            if np.count_nonzero(good) < _FEWEST_OF_SWEEP or not seen.min() < 0.5 * np.pi < seen.max():
                continue
            swing = np.nan_to_num(amplitude[p, good, r])
            swing = swing / swing.max() if swing.max() > 0 else swing
            curve = _Curve(omega[good], gain[p, good, r] * np.exp(-1j * lag[p, good, r]), swing)
            delay, std, misfit = _fit_delay(curve)
            found.append((delay, std))
            worst = max(worst, misfit)
        if found:
            places.append(p)
            delays.append(found)
            misfits.append(worst)
    return places, delays, misfits


def _fit_delay(curve: _Curve) -> tuple[float, float, float]:
    """Return the extra delay of one response, its standard deviation [s], and the relative rmse that is left.

    Unknowns: the lever's share, the delay [ms], the viscous loss and the stiffness' growth with ln ω (both at least
    zero, else they would pass for a delay), the polynomials of stiffness and loss.
    """
    centre = float(curve.omega[np.argmax(np.abs(curve.response))])
    x = curve.omega / centre
    powers = _powers(curve)
    split = _FIRST + powers.shape[1]

    def residual(theta: Array) -> Array:
        stiffness = powers @ theta[_FIRST:split] + theta[3] * np.log(x)
        loss = powers @ theta[split:] + theta[2] * x
        late = np.exp(-1j * curve.omega * theta[1] * _SCALE_S)
        off = theta[0] * x**2 * late / (stiffness + 1j * loss - x**2) / curve.response - 1.0
        return np.concatenate([off.real, off.imag])

    begin = _begin(curve, x, powers)
    low, high = np.full(begin.size, -np.inf), np.full(begin.size, np.inf)
    low[1], high[1] = -_LONGEST_S / _SCALE_S, _LONGEST_S / _SCALE_S
    low[2:_FIRST] = 0.0
    found = least_squares(residual, begin, bounds=(low, high), x_scale="jac", max_nfev=300)
    free = (found.x - low > 1e-6) | ~np.isfinite(low)
    free[1] = True
    seen = np.asarray(found.jac)[:, free]
    scale = float(found.fun @ found.fun) / max(found.fun.size - seen.shape[1], 1)
    covariance = np.linalg.pinv(seen.T @ seen) * scale
    misfit = math.sqrt(2.0 * float(np.mean(found.fun**2)))
    return float(found.x[1]) * _SCALE_S, math.sqrt(max(float(covariance[1, 1]), 0.0)) * _SCALE_S, misfit


def _powers(curve: _Curve) -> Array:
    """Return the columns of a polynomial of the amplitude, (f, 1 to 3): as many as the points can pay for."""
    room = 1 if not curve.amplitude.any() else 2 if curve.omega.size < 2 * _FEWEST_OF_SWEEP else 3
    return np.stack(
        [(2.0 * curve.amplitude - 1.0) ** k if k else np.ones_like(curve.omega) for k in range(room)], axis=1
    )


def _begin(curve: _Curve, x: Array, powers: Array) -> Array:
    """Return where the search begins: the equation above is linear without a delay."""
    inverse = x**2 / curve.response
    few = np.ones((x.size, 1))
    rows = np.concatenate(
        [
            np.concatenate([-inverse.real[:, None], few, np.zeros_like(few)], axis=1),
            np.concatenate([-inverse.imag[:, None], np.zeros_like(few), few], axis=1),
        ]
    )
    target = np.concatenate([x**2, np.zeros_like(x)])
    weight = np.tile(np.abs(curve.response) / x**2, 2)
    share, stiffness, loss = np.linalg.lstsq(rows * weight[:, None], target * weight, rcond=None)[0]
    begin = np.zeros(_FIRST + 2 * powers.shape[1])
    begin[2:_FIRST] = 1e-3
    begin[0], begin[_FIRST], begin[_FIRST + powers.shape[1]] = share, stiffness, max(float(loss), 1e-3)
    return begin


def _overall(means: Array, noise: float) -> Estimate:
    """Return the mean over pretensions. What differs between them by more than noise is the model's misfit, no chance:
    it is counted in full, not divided by the root of their number."""
    count = means.size
    scatter = float(means.std(ddof=1)) if count > 1 else 0.0
    misfit = math.sqrt(max(scatter**2 - noise**2, 0.0))
    return Estimate.normal(float(means.mean()), math.hypot(noise / math.sqrt(count), misfit))


def _judge_delay(extra: Estimate, budget: DelayBudget, written: float) -> tuple[str, str]:
    shown = in_words(extra, 1e3, "ms")
    reach = math.hypot(0.5 * (extra.high - extra.low), NORMAL_90 * budget.delay_std_s)
    if not math.isfinite(reach):
        return CANNOT_TELL, "One response at one pretension leaves the delay without an interval; measure more."
    if written > 0 and reach > written:
        return CANNOT_TELL, (
            f"The phase asks for an extra delay of {shown}, an interval wider than the written budget of "
            f"{1e3 * written:.1f} ms itself; measure more frequencies far above the resonance."
        )
    if abs(extra.value) <= reach:
        if written == 0:
            return "none", f"No delay is needed: the phase asks for {shown}."
        return "the written budget", (
            f"The written budget of {1e3 * written:.1f} ms ± {1e3 * budget.delay_std_s:.1f} ms explains the phase: "
            f"what it leaves is {shown}."
        )
    what = "beyond the written budget" if written > 0 else "with no budget written"
    return "an extra delay", f"A delay of {shown} {what} would explain the phase."
