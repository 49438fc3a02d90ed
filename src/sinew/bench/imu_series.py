"""This is where the IMU's samples get the times at which they were taken, and are brought onto the rows of a recording.

The node samples by its own crystal. The host knows when by asking, which jitters; but between two clocks nothing except
offset and drift is true over some seconds. So the host's times are replaced by the straight line through them over the
node's own time, and readings are taken between samples by cubics: straight lines would lose 0.2 % at 4 Hz.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["MOST_PERIODS", "ImuSeries", "imu_series", "readings_at"]

Floats = NDArray[np.float64]

MOST_PERIODS = 2.5
"""Between samples further apart than so many periods of the node there are no readings."""

_COUNTER_WRAP_S = 2**32 * 1e-6
_ASTRAY = 0.3  # of a period: from there on it is not sure which of the node's samples it was
_FEWEST = 4


@dataclass(frozen=True)
class ImuSeries:
    """Samples of the node.

    time_s: host times at which they were taken [s], increasing, shape (k,). values: shape (k, columns).
    period_s: of the node by the host's clock [s]. jitter_s: median distance of the host's times from their line [s].
    """

    time_s: Floats
    values: Floats
    period_s: float
    jitter_s: float


def imu_series(imu_time_s: Floats, values: Floats, counter_s: Floats | None = None) -> ImuSeries:
    """Return the node's own samples out of cycles that read its newest one, some seconds of them.

    imu_time_s: host's time of the sample read in each cycle [s], shape (n,), NaN where none came; the same sample may
    come several times. values: what was read, shape (n, columns). counter_s: the node's own time [s], wrapping at
    2³² µs, shape (n,); None, or NaN anywhere, leaves the order of samples, which must then be evenly spaced and not
    asked for much less often than they are taken.
    """
    came = np.isfinite(imu_time_s)
    host, values = imu_time_s[came], values[came]
    if host.size < _FEWEST:
        return ImuSeries(np.empty(0), np.empty((0, values.shape[1])), float("nan"), float("nan"))
    if counter_s is not None and np.isfinite(counter_s[came]).all():
        own = np.unwrap(counter_s[came], period=_COUNTER_WRAP_S)
        own = own - own[0]
        steps = np.diff(own)
        period = float(np.median(steps[steps > 0])) if (steps > 0).any() else float("nan")
    else:
        own, period = _by_order(host)
    offset, slope = _line(own, host)
    off = host - (offset + slope * own)
    sure = np.abs(off) < _ASTRAY * period * slope
    own, first = np.unique(own[sure], return_index=True)
    return ImuSeries(offset + slope * own, values[sure][first], period * slope, float(np.median(np.abs(off))))


def _by_order(host: Floats) -> tuple[Floats, float]:
    """Return (times by the node's clock [s], its period by the host's clock [s]) of samples counted by their times."""
    steps = np.diff(host)
    period = float(np.median(steps[steps > 0.5 * np.median(steps)]))
    number = np.concatenate([[0.0], np.cumsum(np.rint(steps / period))])
    for _ in range(3):
        offset, slope = _line(number, host)
        period, number = slope, np.rint((host - offset) / slope)
    return number * period, period


def _line(x: Floats, y: Floats) -> tuple[float, float]:
    """Return (offset, slope) of the straight line through most of the points: least squares, then Tukey's weights."""
    weight = np.ones(x.size)
    offset, slope = 0.0, 1.0
    for step in range(20):
        mean_x, mean_y = np.average(x, weights=weight), np.average(y, weights=weight)
        dx, dy = x - mean_x, y - mean_y
        slope = float((weight * dx * dy).sum() / max((weight * dx * dx).sum(), 1e-300))
        offset = float(mean_y - slope * mean_x)
        off = np.abs(y - offset - slope * x)
        scale = 1.4826 * float(np.median(off)) + 1e-9
        # Absolute values first, which no outlier can lead astray.
        weight = scale / np.maximum(off, scale) if step < 8 else np.clip(1 - (off / (4.685 * scale)) ** 2, 0, None) ** 2
    return offset, slope


def readings_at(series: ImuSeries, time_s: Floats) -> Floats:
    """Return the readings at other times, shape (n, columns): the cubic through the four samples around each.

    Beside a gap or an end the cubic leans to one side. NaN outside the samples, and between two that are more than
    `MOST_PERIODS` apart. Error of a sine: (ωT)⁴·3/128, at 4.3 Hz and 200 Hz 8e-6 of its amplitude.
    """
    found = np.full((time_s.size, series.values.shape[1]), np.nan)
    if series.time_s.size < _FEWEST:
        return found
    near = np.concatenate([np.diff(series.time_s) <= MOST_PERIODS * series.period_s, [False, False, False]])
    three = near[:-2] & near[1:-1] & near[2:]  # three[i]: samples i..i+3 follow one another
    interval = np.searchsorted(series.time_s, time_s, side="right") - 1
    interval[time_s == series.time_s[-1]] -= 1
    inside = (interval >= 0) & (interval < series.time_s.size - 1)
    start = np.full(time_s.size, -1)
    for lean in (0, 2, 1):
        candidate = interval - lean
        usable = inside & (candidate >= 0)
        usable[usable] &= three[np.minimum(candidate[usable], three.size - 1)]
        start[usable] = candidate[usable]  # the last one, centred, is the best
    rows = np.flatnonzero(start >= 0)
    nodes = start[rows, None] + np.arange(4)
    at, times = time_s[rows, None], series.time_s[nodes]
    for j in range(4):
        others = [k for k in range(4) if k != j]
        weight = np.prod((at - times[:, others]) / (times[:, [j]] - times[:, others]), axis=1)
        found[rows] = (0.0 if j == 0 else found[rows]) + weight[:, None] * series.values[nodes[:, j]]
    return found
