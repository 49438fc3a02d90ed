"""This is where residuals are asked what is left in them: colour, and trends with amplitude and frequency."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special, stats

from sinew.identify.oscillator.fitted import Fit
from sinew.identify.oscillator.record import Record
from sinew.measure.arrays import Array

_LAGS = 20
_SIGNIFICANT = 0.01
_FEWEST_BLOCKS = 8


@dataclass(frozen=True)
class ResidualTests:
    """What the residuals of one record, or of several, look like.

    white_p: of Ljung and Box over 20 lags, summed over the records; neighbours: correlation of neighbouring residuals.
    amplitude_p, frequency_p: of Spearman's rank correlation between the residuals' size and the output's amplitude or
        frequency, over blocks of a period (of 8 records or more: over the records); NaN where there are fewer than 8
        blocks. amplitude_trend, frequency_trend: those correlations.
    share: rms of the residuals over the standard deviation of the output.
    """

    white_p: float
    neighbours: float
    amplitude_p: float
    amplitude_trend: float
    frequency_p: float
    frequency_trend: float
    share: float

    def sentences(self) -> tuple[str, ...]:
        """Return what speaks against the model, in words; none where nothing does."""
        found = []
        if self.white_p < _SIGNIFICANT:
            found.append(f"residuals are not white (neighbours correlate by {self.neighbours:.2f})")
        amplitude, frequency = (self.amplitude_trend, self.amplitude_p), (self.frequency_trend, self.frequency_p)
        return (*found, *trend_sentences(amplitude, frequency))

    def telling(self) -> str:
        """Return how all the tests came out, in words."""
        found = list(self.sentences())
        if self.white_p >= _SIGNIFICANT:
            found.insert(0, "residuals are white")
        if np.isnan(self.amplitude_p):
            found.append("there are too few periods to ask them for trends")
        elif min(self.amplitude_p, self.frequency_p) >= _SIGNIFICANT:
            found.append("they show no trend with amplitude or frequency")
        return ", ".join(found)


def ask_fit(fit: Fit) -> ResidualTests:
    """Return the tests of the residuals of a fit over the samples that it was fitted to, from the first to the last."""
    parts = [slice(int(seen[0]), int(seen[-1]) + 1) for seen in map(np.flatnonzero, fit.kept)]
    records = [record.cut(part.start, part.stop) for record, part in zip(fit.records, parts, strict=True)]
    residuals = [r[part] for r, part in zip(fit.residuals(), parts, strict=True)]
    return ask_residuals(records, residuals, 2 * np.pi * fit.natural_frequency_hz.value)


def ask_residuals(
    records: Record | Sequence[Record], residuals: Array | Sequence[Array], omega: float
) -> ResidualTests:
    """Return the tests of the residuals of one record, or of several that were fitted together.

    residuals: in the unit of the output, one array of shape (n,) for each record. omega: angular frequency whose period
    makes the blocks [rad/s].
    """
    one = isinstance(records, Record)
    owners = (records,) if isinstance(records, Record) else tuple(records)
    centred = [np.asarray(r) - np.mean(r) for r in ([residuals] if one else residuals)]
    power = sum(float(r @ r) for r in centred)
    boxes = [_box(r) for r in centred]
    near = sum(float(r[1:] @ r[:-1]) for r in centred) / max(power, 1e-300)
    whole = len(owners) >= _FEWEST_BLOCKS
    blocks = np.concatenate([_blocks(o, r, omega, whole) for o, r in zip(owners, centred, strict=True)])
    trends = [rank_trend(blocks[:, k], blocks[:, 0]) for k in (1, 2)]
    size = sum(r.size for r in centred)
    moved = sum(float(np.sum((o.output - o.output.mean()) ** 2)) for o in owners)
    return ResidualTests(
        float(special.chdtrc(sum(lags for _, lags in boxes), sum(box for box, _ in boxes))),
        near,
        trends[0][1],
        trends[0][0],
        trends[1][1],
        trends[1][0],
        float(np.sqrt(power / size) / max(np.sqrt(moved / size), 1e-300)),
    )


def _box(r: Array) -> tuple[float, int]:
    """Return the statistic of Ljung and Box, and over how many lags."""
    lags = min(_LAGS, r.size // 5)
    each = np.array([float(r[k:] @ r[:-k]) for k in range(1, lags + 1)]) / max(float(r @ r), 1e-300)
    return r.size * (r.size + 2) * float(np.sum(each**2 / (r.size - np.arange(1, lags + 1)))), lags


def _blocks(record: Record, r: Array, omega: float, whole: bool) -> Array:
    """Return rms of the residuals, amplitude and frequency of the output in every block, shape (b, 3)."""
    period = 2 * np.pi / omega / record.step_s if np.isfinite(omega) and omega > 0 else r.size / _FEWEST_BLOCKS
    size = r.size if whole else min(max(4, round(period)), r.size)
    count = r.size // size
    blocks = r[: count * size].reshape(count, size)
    output = record.output[: count * size].reshape(count, size)
    if not whole:
        output = output - record.output.mean()
    deviation = np.maximum(output.std(axis=1), 1e-150)
    turns = np.sqrt(np.mean(np.diff(output, axis=1) ** 2, axis=1)) / deviation / record.step_s
    return np.stack([np.sqrt(np.mean(blocks**2, axis=1)), output.std(axis=1), turns], axis=1)


def rank_trend(against: Array, size: Array) -> tuple[float, float]:
    """Return Spearman's rank correlation of two arrays, shape (b,), and its p; NaN where b is below 8."""
    if size.size < _FEWEST_BLOCKS:
        return np.nan, np.nan
    if np.ptp(against) == 0 or np.ptp(size) == 0:
        return 0.0, 1.0
    found = stats.spearmanr(against, size)
    return float(found.statistic), float(found.pvalue)


def trend_sentences(amplitude: tuple[float, float], frequency: tuple[float, float]) -> tuple[str, ...]:
    """Return in words how residuals go with amplitude and with frequency; nothing where that may be chance.

    amplitude, frequency: rank correlation and its p, of `rank_trend`.
    """
    told = []
    for (trend, p), of in ((amplitude, "amplitude"), (frequency, "frequency")):
        if p < _SIGNIFICANT:
            told.append(f"residuals {'grow' if trend > 0 else 'shrink'} with {of}")
    return tuple(told)
