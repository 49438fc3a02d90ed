"""This is where it is said in numbers how well a prediction meets a recording, and what it was not fitted to."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sinew.measure.estimate import Estimate
from sinew.predict.against import Comparison, Reading

__all__ = ["Score", "Subset", "error_of", "estimate_at", "is_angle", "scores_of"]

Array = NDArray[np.float64]
Subset = Literal["all", "fitted", "others"]


@dataclass(frozen=True)
class Score:
    """Errors of one number over the places where it was both measured and predicted.

    Relative errors, predicted over measured less one [1], or differences of angles [rad]; see `is_angle`.
    count: of places. rms, largest: of the error, the measurement's own among it. noise: what rms a perfect prediction
    would have because of the measurement's standard deviations. inside: share of places whose 90 % interval holds the
    prediction.
    """

    count: int
    rms: float
    largest: float
    noise: float
    inside: float


def is_angle(name: str) -> bool:
    """Return whether a number's error is a difference of angles [rad] instead of a relative one."""
    return name.endswith("_rad")


def error_of(name: str, reading: Reading) -> tuple[Array, Array, Array, Array]:
    """Return (error, its standard deviation, low and high end of its 90 % interval), in the shape of the reading.

    The interval is that of the measurement; the prediction is taken as it is.
    """
    if is_angle(name):
        p = reading.predicted
        return reading.difference, reading.std, p - reading.high, p - reading.low
    low, high = (np.where(end > 0, end, np.nan) for end in (reading.low, reading.high))
    std = reading.predicted * reading.std / reading.measured**2
    return reading.relative, std, reading.predicted / high - 1, reading.predicted / low - 1


def scores_of(comparison: Comparison) -> dict[Subset, dict[str, Score]]:
    """Return the scores of all numbers: over all pretensions, over those that the rig was calibrated to, and over the
    others. A subset without a place is left out."""
    found: dict[Subset, dict[str, Score]] = {}
    subsets: dict[Subset, NDArray[np.bool_]] = {
        "all": np.ones_like(comparison.fitted),
        "fitted": comparison.fitted,
        "others": ~comparison.fitted,
    }
    for subset, rows in subsets.items():
        both = {**comparison.readings, **comparison.points}
        scores = {name: _score(name, reading, rows) for name, reading in both.items()}
        kept = {name: score for name, score in scores.items() if score.count}
        if kept:
            found[subset] = kept
    return found


def estimate_at(name: str, reading: Reading, place: tuple[int, ...]) -> tuple[Estimate, float, Estimate]:
    """Return (measured, predicted, error) at one place."""
    measured = Estimate(*(float(part[place]) for part in (reading.measured, reading.std, reading.low, reading.high)))
    return (
        measured,
        float(reading.predicted[place]),
        Estimate(*(float(part[place]) for part in error_of(name, reading))),
    )


def _score(name: str, reading: Reading, rows: NDArray[np.bool_]) -> Score:
    error, std = (part[rows] for part in error_of(name, reading)[:2])
    low, high, predicted = reading.low[rows], reading.high[rows], reading.predicted[rows]
    known = np.isfinite(error)
    if not known.any():
        return Score(0, *[float("nan")] * 4)
    bounded = known & np.isfinite(low) & np.isfinite(high)
    inside = (low <= predicted) & (predicted <= high)
    return Score(
        int(known.sum()),
        float(np.sqrt(np.mean(error[known] ** 2))),
        float(np.max(np.abs(error[known]))),
        float(np.sqrt(np.mean(np.nan_to_num(std[known]) ** 2))),
        float(np.mean(inside[bounded])) if bounded.any() else float("nan"),
    )
