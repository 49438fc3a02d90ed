"""Whether Lehr's damping stays constant over pretension, beyond chance and beyond the choice of a window.

One-way analysis of variance asks whether D differs between pretensions by more than between repeats; a line over
pretension asks whether it has a trend. Because "no trend was found" is worth what the trend that would have been found
is, two laws are held against the data: with a constant damping constant d, D = d/(2 sqrt(k I)) falls as 1/ω; with
losses in the silicone alone, and a stiffness that grows by lossless tension, D = η k_s/(2 k) falls as 1/ω².

Where the decays begin is a choice (`sinew.analysis.decay.decay_windows`): the verdict is what all windows say, and
where they contradict each other, that they do.
"""

import math
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy import special

from sinew.analysis.decay.decay_windows import DecayWindow, decay_windows, describe_windows, windows_agree
from sinew.analysis.decay.ring_down import DECAY_FROM_PERIODS
from sinew.analysis.signal.repeats import Trend, detectable, fit_trend, pool_repeats
from sinew.measure.arrays import Array
from sinew.measure.estimate import Estimate
from sinew.paper.answers.answer import CANNOT_TELL, Answer, Cell, cannot_tell, in_words

NAME = "constancy"
QUESTION = "Does Lehr's damping D stay constant over pretension, beyond chance? (section 4.2)"
NOT_DETERMINED = "not determined: depends on the window"
"""Verdict where windows of the decay contradict each other."""

_SIGNIFICANCE = 0.05
_LITTLE = 0.25  # of the change that a constant d makes


@dataclass(frozen=True)
class _Series:
    """D by pretension [mm] and repeat, shape (p, r), its standard deviations, and the angular frequency [rad/s]."""

    pretension: Array
    damping: Array
    std: Array
    omega: Array

    @property
    def mean(self) -> Array:
        """Return D at each pretension, shape (p,)."""
        return np.asarray(np.nanmean(self.damping, axis=1))


def answer_constancy(results: xr.Dataset) -> Answer:
    """Return whether D changes over pretension, by the direct fit of the ring-downs and by the paper's method.

    results: with ring-downs at two pretensions or more.
    Numbers: `slope_per_mm` of D, `relative_change` over the range, `detectable_change`: the relative change that its
    90 % interval would have told from zero in nine of ten such recordings, and what the two laws expect of this range.
    `relative_change_from_N_periods`: by the paper's method, with the decay begun N drive periods after its stop.
    """
    if "damping_ratio" not in results:
        return cannot_tell(NAME, QUESTION, "The recording holds no ring-downs; record some at several pretensions.")
    series = _series(results, "damping_ratio", "damping_ratio_std")
    if series.pretension.size < 2:
        return cannot_tell(
            NAME, QUESTION, f"Ring-downs at {series.pretension.size} pretension cannot tell a trend; record more."
        )
    rows, std, freedom = _rows(series)
    trend = fit_trend(series.pretension, series.mean, std, freedom)
    span = float(np.ptp(series.pretension))
    change = trend.slope.times(span / trend.middle.value)
    seen = span / trend.middle.value * detectable(trend.slope.std, trend.degrees_of_freedom)
    laws = {"change_by_constant_d": _expected(series, 1.0), "change_by_silicone_alone": _expected(series, 2.0)}
    numbers = {
        "relative_change": change,
        "slope_per_mm": trend.slope,
        "mean": trend.middle,
        "detectable_change": _exact(seen),
        **{name: _exact(value) for name, value in laws.items()},
        "p_value": _exact(_anova(series)),
    }
    verdict, said = _judge(change, seen, laws["change_by_constant_d"])
    windows = decay_windows(results)
    numbers |= {f"relative_change_from_{one.start_periods:g}_periods": one.change for one in windows}
    first = _of_windows(windows, said)
    if windows and not windows_agree(windows):
        verdict = NOT_DETERMINED
    words = [*first, *_differences(series, trend), *_laws(change, laws), *_paper(results, span)]
    return Answer(NAME, QUESTION, verdict, tuple(words), numbers, rows)


def _of_windows(windows: list[DecayWindow], said: str) -> list[str]:
    """Return what holds for every window, and what the decays say from the usual start on."""
    if not windows:
        return [said]
    if windows_agree(windows):
        return [said, describe_windows(windows)]
    each = ", ".join(
        f"{in_words(one.change, 100.0, '%')} from {one.start_periods:g}"
        for one in windows
        if math.isfinite(one.change.low)
    )
    return [
        describe_windows(windows),
        f"By the paper's peaks and Eq. 7 the change, by drive periods after the stop, is {each}.",
        f"From {DECAY_FROM_PERIODS:g} drive period on, by the direct fit: {said}",
    ]


def _series(results: xr.Dataset, name: str, std: str | None) -> _Series:
    damping = np.asarray(results[name].values, dtype=float)
    known = np.isfinite(damping).any(axis=1)
    own = np.full_like(damping, np.nan) if std is None else np.asarray(results[std].values, dtype=float)
    omega = 2.0 * np.pi * np.asarray(results["decay_frequency_hz"].values, dtype=float)[known]
    pretension = np.asarray(results["pretension_mm"].values, dtype=float)[known]
    return _Series(pretension, damping[known], own[known], np.asarray(np.nanmean(omega, axis=1)))


def _rows(series: _Series) -> tuple[tuple[dict[str, Cell], ...], float, float]:
    """Return the rows, and the standard deviation of a mean over repeats with its degrees of freedom."""
    pooled = pool_repeats(series.damping.tolist(), series.std.tolist())
    rows: list[dict[str, Cell]] = []
    for i, one in enumerate(pooled.estimates):
        row: dict[str, Cell] = {
            "pretension_mm": float(series.pretension[i]),
            "damping_ratio": one,
            "omega_rad_s": float(series.omega[i]),
        }
        known = series.damping[i][np.isfinite(series.damping[i])]
        rows.append(row | {f"repeat_{r}": float(value) for r, value in enumerate(known)})
    stds = np.array([one.std for one in pooled.estimates])
    stds = stds[np.isfinite(stds)]
    std = float(np.sqrt(np.mean(stds**2))) if stds.size else math.nan
    return tuple(rows), std, pooled.degrees_of_freedom


def _exact(value: float) -> Estimate:
    """Return a number that has no interval of its own."""
    return Estimate(value, math.nan, math.nan, math.nan)


def _expected(series: _Series, power: float) -> float:
    """Return the relative change over the range if D fell as ω to a power: of the line through that law's values."""
    law = series.omega**-power
    line = fit_trend(series.pretension, law / law.mean())
    return float(line.slope.value * np.ptp(series.pretension))


def _anova(series: _Series) -> float:
    """Return the p value of equal D at all pretensions; NaN without repeats."""
    known = [row[np.isfinite(row)] for row in series.damping]
    sizes = np.array([row.size for row in known])
    freedom = int((sizes - 1).sum())
    if freedom < 1:
        return math.nan
    means = np.array([row.mean() for row in known])
    within = sum(float(((row - row.mean()) ** 2).sum()) for row in known) / freedom
    grand = float(sizes @ means) / float(sizes.sum())
    between = float(sizes @ (means - grand) ** 2) / (sizes.size - 1)
    return float(special.fdtrc(sizes.size - 1, freedom, between / within)) if within > 0 else 0.0


def _judge(change: Estimate, seen: float, constant_d: float) -> tuple[str, str]:
    told = in_words(change, 100.0, "%")
    if not math.isfinite(change.low):
        return CANNOT_TELL, "Two pretensions without repeats give a slope without an interval; repeat the ring-downs."
    if change.low > 0 or change.high < 0:
        verdict = "rises" if change.value > 0 else "falls"
        if max(abs(change.low), abs(change.high)) < _LITTLE * abs(constant_d):
            return "nearly constant", (
                f"D is nearly constant: over the range it changes by {told}, beyond chance but little beside the "
                f"{abs(100 * constant_d):.2g} % that a constant damping constant d would make of it."
            )
        return verdict, f"D {verdict} beyond chance: it changes by {told} over the range of pretension."
    power = f"a change of {100 * seen:.2g} % would have been found in nine of ten such recordings"
    if seen < abs(constant_d):
        return "constant within chance", f"D has no trend beyond chance: it changes by {told} over the range; {power}."
    return CANNOT_TELL, (
        f"It cannot be told whether D is constant: it changes by {told} over the range, and {power}, more than "
        f"the {abs(100 * constant_d):.2g} % that a constant damping constant d would make of it."
    )


def _differences(series: _Series, trend: Trend) -> list[str]:
    p_value = _anova(series)
    if not math.isfinite(p_value):
        return ["There is one ring-down at each pretension: the interval is not from repeats."]
    bend = float(np.abs(trend.residual).max() / trend.middle.value)
    told = f"p = {p_value:.2g}" if p_value >= 1e-4 else "p < 0.0001"
    if p_value < _SIGNIFICANCE:
        return [
            f"The single pretensions differ by more than the repeats explain ({told}): D departs from its line by up "
            f"to {100 * bend:.2g} %."
        ]
    return [f"The single pretensions do not differ by more than the repeats explain ({told})."]


def _laws(change: Estimate, laws: dict[str, float]) -> list[str]:
    names = {
        "change_by_constant_d": "A constant damping constant d",
        "change_by_silicone_alone": "Losses in the silicone alone, with a stiffness that grows by lossless tension,",
    }
    words = []
    for key, law in laws.items():
        if not math.isfinite(change.low):
            continue
        excluded = not change.low <= law <= change.high
        words.append(
            f"{names[key]} would change D by {100 * law:+.2g} % over this range, which the data "
            f"{'rule out' if excluded else 'do not rule out'}.".replace(" -", " −")
        )
    return words


def _paper(results: xr.Dataset, span: float) -> list[str]:
    """Return what the paper's own method says of the same ring-downs."""
    series = _series(results, "paper_lehr_damping", None)
    if series.pretension.size < 2:
        return []
    _, std, freedom = _rows(series)
    trend = fit_trend(series.pretension, series.mean, std, freedom)
    change = trend.slope.times(span / trend.middle.value)
    return [f"By the paper's peaks and Eq. 7 the change is {in_words(change, 100.0, '%')}."]
