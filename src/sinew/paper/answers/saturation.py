"""Whose the saturation is: the drive's, which falls short of its reach, or the joint's.

Above a threshold of pretension straight lines are laid through the logarithm of the peak gain, once by the nominal and
once by the measured drive amplitude. What falls by the nominal drive only is the drive's: its share of the fall is one
less the ratio of the two slopes, with Fieller's interval.
"""

import math
from typing import NamedTuple

import numpy as np
import xarray as xr

from sinew.analysis.signal.repeats import Trend, fit_trend, ratio_interval
from sinew.analysis.sweep.response import FEWEST_PRETENSIONS, fit_saturation
from sinew.measure.arrays import Array, Mask
from sinew.measure.estimate import Estimate
from sinew.paper.answers.answer import CANNOT_TELL, Answer, Cell, cannot_tell, in_words

NAME = "saturation"
QUESTION = "Is the saturation the drive's or the joint's? (sections 4.1 and 5.2.4)"
_FEWEST = 3
_COLUMNS = ("resonance_hz", "gain_peak", "gain_peak_measured_drive", "drive_amplitude_at_resonance_rad")


def answer_saturation(results: xr.Dataset, beyond: xr.Dataset | None = None) -> Answer:
    """Return whose the fall of the peak gain with pretension is, above the threshold.

    results: of a sweep, by `sinew.analysis.analysed.analyse_recording`. beyond: of a sweep at further pretensions.
    Slopes are relative, d ln G/dp per mm. The threshold is the kink of two lines through the peak gain where the data
    prefer them to one and leave three pretensions above it; else the line runs over the upper half of the range.
    """
    if "gain_peak" not in results:
        return cannot_tell(NAME, QUESTION, "The recording holds no sweep with a resonance; measure one.")
    table = _table(results, beyond)
    if not np.isfinite(table["gain_peak_measured_drive"]).any():
        return cannot_tell(NAME, QUESTION, "The drive was not measured; record the lever's angle.")
    good = np.all([np.isfinite(table[name]) for name in ("gain_peak", "gain_peak_measured_drive")], axis=0)
    table = {name: values[good] for name, values in table.items()}
    pretension = table["pretension_mm"]
    if pretension.size < _FEWEST:
        return cannot_tell(
            NAME,
            QUESTION,
            f"A trend over pretension needs {_FEWEST} pretensions with a resonance, found {pretension.size}.",
        )
    threshold, how = _threshold(pretension, table["gain_peak"])
    above = pretension >= threshold.value
    lines = _lines(table, above)
    share = _drives_share(lines, pretension[above])
    verdict, said = _judge(lines, share)
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
    rows = tuple(_row(table, i) for i in range(pretension.size))
    return Answer(NAME, QUESTION, verdict, (said, how, *_details(lines, table)), numbers, rows)


class _Lines(NamedTuple):
    """Lines above the threshold: ln of the gains and of the drive's amplitude, and the resonance [Hz], over mm."""

    nominal: Trend
    measured: Trend
    resonance: Trend
    reached: Trend | None


def _table(results: xr.Dataset, beyond: xr.Dataset | None) -> dict[str, Array]:
    parts = [part for part in (results, beyond) if part is not None and "gain_peak" in part]
    names = ("pretension_mm", *_COLUMNS, *(_std(name) for name in _COLUMNS))
    table = {name: np.concatenate([np.asarray(part[name].values, dtype=float) for part in parts]) for name in names}
    table["saturated_share"] = np.concatenate([_at_limit(part) for part in parts])
    order = np.argsort(table["pretension_mm"], kind="stable")
    return {name: values[order] for name, values in table.items()}


def _std(name: str) -> str:
    stem, _, unit = name.rpartition("_")
    return f"{stem}_std_{unit}" if unit in ("hz", "rad") else f"{name}_std"


def _at_limit(results: xr.Dataset) -> Array:
    """Return the share of samples at the duty limit at each resonance, mean over repeats, (p,)."""
    share = np.asarray(results["saturated_share"].values, dtype=float)
    found = np.full(share.shape[0], math.nan)
    for p, at in enumerate(results["resonance_hz"].values):
        rows = np.flatnonzero(np.isfinite(share[p]).any(axis=1))
        if math.isfinite(at) and rows.size:
            mean = np.nanmean(share[p, rows], axis=1)
            found[p] = float(np.interp(at, results["frequency_hz"].values[rows], mean))
    return found


def _threshold(pretension: Array, gain: Array) -> tuple[Estimate, str]:
    """Return from where on the lines are laid [mm], with an interval where that is a threshold, and a sentence."""
    middle = 0.5 * (pretension[0] + pretension[-1])
    half = float(min(middle, pretension[-_FEWEST]))
    start = Estimate(half, math.nan, math.nan, math.nan)
    if np.unique(pretension).size >= FEWEST_PRETENSIONS:
        kink = fit_saturation(pretension, gain)
        if kink.preferred and np.count_nonzero(pretension >= kink.threshold_mm.value) >= _FEWEST:
            where = in_words(kink.threshold_mm, 1.0, "mm")
            return kink.threshold_mm, f"Two lines through the peak gain meet at {where}; the slopes are above it."
        return start, (
            "The data do not prefer a kink in the peak gain, or leave fewer than three pretensions above it; slopes "
            f"are over the upper half of the range, from {half:g} mm."
        )
    return start, (
        f"{pretension.size} pretensions are too few to seek a threshold; the slopes are from {half:g} mm up."
    )


def _lines(table: dict[str, Array], above: Mask) -> _Lines:
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


def _drives_share(lines: _Lines, x: Array) -> Estimate:
    ratio = ratio_interval(lines.measured, lines.nominal, x)
    return Estimate(1.0 - ratio.value, ratio.std, 1.0 - ratio.high, 1.0 - ratio.low)


def _judge(lines: _Lines, share: Estimate) -> tuple[str, str]:
    nominal, measured = (in_words(line.slope, 100.0, "% per mm") for line in (lines.nominal, lines.measured))
    slopes = f"the peak gain changes by {nominal} by the nominal drive and by {measured} by the measured one"
    if not (math.isfinite(lines.nominal.slope.high) and lines.nominal.slope.high < 0):
        return CANNOT_TELL, f"By the nominal drive the gain does not fall beyond chance up there: {slopes}."
    told = in_words(share, 100.0, "%")
    if share.low > 0.5:
        verdict = "the drive's"
        return verdict, f"The saturation is the drive's: {told} of the fall vanishes with the measured drive; {slopes}."
    if share.high < 0.5:
        return "the joint's", (
            f"The saturation is the joint's: only {told} of the fall vanishes with the measured drive; {slopes}."
        )
    return CANNOT_TELL, (
        f"It cannot be told whose the fall is: {told} of it vanishes with the measured drive, which is both less and "
        f"more than half; {slopes}."
    )


def _details(lines: _Lines, table: dict[str, Array]) -> list[str]:
    words = []
    slope = lines.resonance.slope
    if slope.low > 0:
        words.append(
            f"The stiffness does not saturate: the resonance rises on by {in_words(slope, 1.0, 'Hz per mm')} there."
        )
    elif math.isfinite(slope.low):
        words.append(
            f"The resonance changes by {in_words(slope, 1.0, 'Hz per mm')} there, no rise beyond chance: the "
            "stiffness may saturate."
        )
    if lines.reached is not None:
        words.append(
            f"The drive's amplitude at resonance changes by {in_words(lines.reached.slope, 100.0, '% per mm')}."
        )
    share = table["saturated_share"]
    if np.isfinite(share).any():
        first, last = share[np.isfinite(share)][[0, -1]]
        words.append(
            f"At resonance the drive's duty is at its limit for {100 * first:.0f} % of the samples at the smallest and "
            f"{100 * last:.0f} % at the largest pretension."
        )
    words.append("A gain by measured drive that stays level says that the joint answers the motion it gets as before.")
    return words


def _row(table: dict[str, Array], i: int) -> dict[str, Cell]:
    row: dict[str, Cell] = {"pretension_mm": float(table["pretension_mm"][i])}
    for name in _COLUMNS:
        row[name] = Estimate.normal(float(table[name][i]), float(table[_std(name)][i]))
    row["saturated_share"] = float(table["saturated_share"][i])
    return row
