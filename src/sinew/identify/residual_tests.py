"""This is where residuals are asked what is left in them: colour, and trends with amplitude and frequency."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special, stats

from sinew.identify.record import Record

__all__ = ["ResidualTests", "ask_residuals"]

Array = NDArray[np.float64]

_LAGS = 20
_SIGNIFICANT = 0.01
_FEWEST_BLOCKS = 8


@dataclass(frozen=True)
class ResidualTests:
    """What the residuals of one record look like.

    white_p: of Ljung and Box over 20 lags; neighbours: correlation of neighbouring residuals.
    amplitude_p, frequency_p: of Spearman's rank correlation between the residuals' size and the output's amplitude or
        frequency, over blocks of a period; NaN where there are fewer than 8 blocks. amplitude_trend, frequency_trend:
        those correlations.
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
        for p, trend, of in (
            (self.amplitude_p, self.amplitude_trend, "amplitude"),
            (self.frequency_p, self.frequency_trend, "frequency"),
        ):
            if p < _SIGNIFICANT:
                found.append(f"residuals {'grow' if trend > 0 else 'shrink'} with {of}")
        return tuple(found)


def ask_residuals(record: Record, residual: Array, omega: float) -> ResidualTests:
    """Return the tests of one record's residuals.

    residual: in the unit of the output, shape (n,). omega: angular frequency whose period makes the blocks [rad/s].
    """
    r = residual - residual.mean()
    power = float(r @ r)
    lags = min(_LAGS, r.size // 5)
    each = np.array([float(r[k:] @ r[:-k]) for k in range(1, lags + 1)]) / max(power, 1e-300)
    box = r.size * (r.size + 2) * float(np.sum(each**2 / (r.size - np.arange(1, lags + 1))))
    size = max(4, round(2 * np.pi / omega / record.step_s))
    count = r.size // size
    trends = [(np.nan, np.nan), (np.nan, np.nan)]
    if count >= _FEWEST_BLOCKS:
        blocks = r[: count * size].reshape(count, size)
        output = (record.output - record.output.mean())[: count * size].reshape(count, size)
        loud = np.sqrt(np.mean(blocks**2, axis=1))
        turns = np.sqrt(np.mean(np.diff(output, axis=1) ** 2, axis=1) / np.maximum(output.var(axis=1), 1e-300))
        trends = [_trend(output.std(axis=1), loud), _trend(turns, loud)]
    return ResidualTests(
        float(special.chdtrc(lags, box)),
        float(each[0]),
        trends[0][1],
        trends[0][0],
        trends[1][1],
        trends[1][0],
        float(np.sqrt(power / r.size) / max(float(record.output.std()), 1e-300)),
    )


def _trend(against: Array, loud: Array) -> tuple[float, float]:
    if np.ptp(against) == 0 or np.ptp(loud) == 0:
        return 0.0, 1.0
    found = stats.spearmanr(against, loud)
    return float(found.statistic), float(found.pvalue)
