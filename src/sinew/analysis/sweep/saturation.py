"""Saturation threshold: the pretension beyond which the gain hardly falls any more."""

import math
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy import special

from sinew.measure.arrays import Array, mean_and_spread
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import NORMAL_90, Estimate

FEWEST_PRETENSIONS = 6
_GRID = 401


@dataclass(frozen=True)
class SaturationFit:
    """A continuous line with one kink through the peak gain against pretension, beside one straight line.

    threshold_mm: the kink, its 90 % interval where the residual is within the F test's reach of the smallest.
    slope_below_per_mm, slope_above_per_mm: of the two parts.
    preferred: whether the kink is worth its two parameters (Bayesian information criterion lower by 2 or more).
    sentence: all this in words.
    """

    threshold_mm: Estimate
    slope_below_per_mm: float
    slope_above_per_mm: float
    preferred: bool
    sentence: str


def fit_saturation(pretension_mm: Array, gain_peak: Array) -> SaturationFit:
    """Return the saturation threshold of a campaign (paper, sections 4.1 and 5.2.4).

    pretension_mm, gain_peak: shape (p,); NaN pairs are left out.
    The kink is searched on a grid between the second and the last but one pretension, the lines by least squares.
    A kink that the data do not prefer is given all the same, with its (then wide) interval.
    Raises RecordingError below six pretensions.
    """
    valid = np.isfinite(pretension_mm) & np.isfinite(gain_peak)
    x, y = pretension_mm[valid], gain_peak[valid]
    if x.size < FEWEST_PRETENSIONS:
        raise RecordingError(
            f"a saturation threshold needs at least {FEWEST_PRETENSIONS} pretensions, found {x.size}; measure more"
        )
    order = np.argsort(x)
    x, y = x[order], y[order]
    kinks = np.linspace(x[1], x[-2], _GRID)
    residual, lines = zip(*(_line(x, y, kink) for kink in kinks), strict=True)
    squares = np.asarray(residual)
    straight, _ = _line(x, y, None)
    best = int(np.argmin(squares))
    freedom = x.size - 4
    smallest = max(float(squares[best]), 1e-24 * float(y @ y))
    reach = smallest * (1.0 + float(special.fdtri(1.0, freedom, 0.9)) / freedom)
    inside = kinks[squares <= reach]
    low, high = float(inside[0]), float(inside[-1])
    bic_gain = x.size * math.log(max(straight, smallest) / smallest) - 2.0 * math.log(x.size)
    _, below, bend = lines[best]
    threshold = Estimate(float(kinks[best]), (high - low) / (2.0 * NORMAL_90), low, high)
    preferred = bic_gain >= 2.0
    told = _sentence(threshold, below, bend, preferred, bic_gain)
    return SaturationFit(threshold, below, below + bend, preferred, told)


def _line(x: Array, y: Array, kink: float | None) -> tuple[float, tuple[float, float, float]]:
    """Return residual sum of squares and (level, slope, bend) of a line through y, bent at the kink if there is one."""
    columns = [np.ones_like(x), x - (kink or 0.0)]
    if kink is not None:
        columns.append(np.maximum(x - kink, 0.0))
    design = np.stack(columns, axis=1)
    solution = np.linalg.lstsq(design, y, rcond=None)[0]
    residual = y - design @ solution
    level, slope, bend = (*map(float, solution), 0.0)[:3]
    return float(residual @ residual), (level, slope, bend)


def _sentence(threshold: Estimate, below: float, bend: float, preferred: bool, bic_gain: float) -> str:
    kink = f"a kink at {threshold.value:.1f} mm (90 % interval {threshold.low:.1f} to {threshold.high:.1f} mm)"
    slopes = f"the peak gain changes by {below:+.3f} per mm below and {below + bend:+.3f} per mm above"
    if preferred:
        return f"The data prefer {kink} to one straight line by {bic_gain:.1f} in BIC: {slopes}."
    return f"The data do not prefer {kink} to one straight line ({bic_gain:+.1f} in BIC, 2 needed): {slopes}."


# The gain becomes a map over pretension and frequency, with the resonance as its ridge.


def gain_map(results: xr.Dataset, by: str = "gain") -> xr.Dataset:
    """Return mean gain over repeats, its tube and its ridge (paper, figures 6 and 8).

    results: with a sweep part. by: gain (nominal drive, mean of peaks), gain_harmonic or gain_measured_drive.
    Variables: `gain` and `gain_std` (±1 standard deviation over repeats, NaN for one repeat), `phase_lag` and
    `phase_lag_std` [rad], all over (pretension_mm, frequency_hz); `ridge_hz` and `ridge_gain` over pretension_mm,
    from the resonance part, NaN where no peak was found. Both axes are index coordinates.
    Raises RecordingError where the results hold no sweep.
    """
    if by not in ("gain", "gain_harmonic", "gain_measured_drive"):
        raise ValueError(f"no such gain {by!r}; choose gain, gain_harmonic or gain_measured_drive")
    if "gain" not in results:
        raise RecordingError("these results hold no sweep, so there is no gain to map; analyse a recording with one")
    out = xr.Dataset(coords={name: results[name].variable for name in ("pretension_mm", "frequency_hz")})
    for name, source, unit in (("gain", by, "1"), ("phase_lag", "phase_lag_rad", "rad")):
        mean, std = mean_and_spread(results[source].values)
        out[name] = (("pretension_mm", "frequency_hz"), mean, {"units": unit})
        out[f"{name}_std"] = (("pretension_mm", "frequency_hz"), std, {"units": unit})
    measured = by == "gain_measured_drive"
    for name, source in (
        ("ridge_hz", "resonance_measured_drive_hz" if measured else "resonance_hz"),
        ("ridge_gain", "gain_peak_measured_drive" if measured else "gain_peak"),
    ):
        missing = np.full(results.sizes["pretension_mm"], np.nan)
        out[name] = ("pretension_mm", results[source].values if source in results else missing)
    return out
