"""This is where one bout of walking gives its stride frequency and the yaw that repeats with the strides.

Each stride is brought onto one cycle of phase. The mean over one stride, moved along, is taken off: that removes the
arbitrary zero and the drift of yaw, and nothing that repeats. What is left has a fundamental in each stride, and the
amplitude of the bout is that of their mean: noise and swings out of step do not add to it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from sinew.analysis.body_yaw import BodyMotion
from sinew.analysis.stride import Strides
from sinew.analysis.stride_mean import mean_of_strides
from sinew.measure.estimate import Estimate

__all__ = ["POINTS", "BoutGait", "bout_gait", "fundamental", "unknown"]

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

POINTS = 64
_AVERAGED = 5


@dataclass(frozen=True)
class BoutGait:
    """The gait of one bout.

    start_s, stop_s: its ends [s]. strides: how many are in it, a whole number in a bout of five or more.
    frequency_hz: of the strides; slowest_hz, fastest_hz: least and greatest mean of five strides in a row.
    yaw_deg: amplitude, half of peak to peak of the fundamental of the swing (`BodyMotion.swing`).
    line_deg: amplitude of the one sine, of constant frequency, that fits the whole bout best; smaller where the
    strides' length varies, for the sine then falls out of step. It is what a Fourier spectrum shows.
    peak_to_peak_deg: greatest less least within a stride, all harmonics. range_deg: the same over the whole bout.
    pelvis_deg, trunk_deg: amplitudes of the parts alone. trunk_lag_deg: how late the trunk is behind the pelvis, in
    degrees of the stride, -180 to 180. None where a part is unknown.
    regularity: autocorrelation of the motion at one stride. speed_m_s: NaN where unknown.
    cycles_deg: the swing of each stride from its greatest mean value on, shape (strides, 64).
    """

    start_s: float
    stop_s: float
    strides: float
    frequency_hz: Estimate
    slowest_hz: float
    fastest_hz: float
    yaw_deg: Estimate
    line_deg: float
    peak_to_peak_deg: Estimate
    range_deg: float
    pelvis_deg: Estimate | None
    trunk_deg: Estimate | None
    trunk_lag_deg: Estimate | None
    regularity: float
    speed_m_s: float
    cycles_deg: Floats


def bout_gait(motion: BodyMotion, bout: Strides) -> BoutGait:
    """Return the gait of a bout of at least five strides.

    The uncertainties are those of means over strides that resemble their neighbours (`mean_of_strides`).
    """
    periods = np.diff(bout.start_s)
    mean = mean_of_strides(periods)
    frequency = Estimate(1 / mean.value, mean.std / mean.value**2, 1 / mean.high, 1 / mean.low)
    five = 1.0 / np.convolve(periods, np.full(_AVERAGED, 1 / _AVERAGED), "valid")
    swing = np.degrees(_cycles(motion, motion.swing[1], bout.start_s))
    first = fundamental(swing)
    parts = {
        name: None if yaw is None else fundamental(np.degrees(_cycles(motion, yaw, bout.start_s)))
        for name, yaw in (("pelvis", motion.pelvis), ("trunk", motion.trunk))
    }
    pelvis, trunk = parts["pelvis"], parts["trunk"]
    turn = round(-np.angle(first.mean()) / (2 * np.pi) * POINTS) % POINTS
    return BoutGait(
        start_s=float(bout.start_s[0]),
        stop_s=float(bout.start_s[-1]),
        strides=periods.size,
        frequency_hz=frequency,
        slowest_hz=float(five.min()),
        fastest_hz=float(five.max()),
        yaw_deg=_amplitude(first),
        line_deg=_line(swing, bout.start_s),
        peak_to_peak_deg=mean_of_strides(np.ptp(swing, axis=1)),
        range_deg=float(np.ptp(swing)),
        pelvis_deg=None if pelvis is None else _amplitude(pelvis),
        trunk_deg=None if trunk is None else _amplitude(trunk),
        trunk_lag_deg=None if pelvis is None or trunk is None else _lag(pelvis, trunk),
        regularity=bout.regularity,
        speed_m_s=motion.speed(float(bout.start_s[0]), float(bout.start_s[-1])),
        cycles_deg=np.roll(swing, -turn, axis=1),
    )


def unknown(value: float) -> Estimate:
    """Return a number whose uncertainty is not known."""
    return Estimate(float(value), np.nan, np.nan, np.nan)


def fundamental(cycles: Floats) -> Complexes:
    """Return the complex fundamental c, x = Re(c e^{jφ}), of cycles of shape (s, points), shape (s,)."""
    points = cycles.shape[1]
    return np.asarray(2.0 / points * cycles @ np.exp(-2j * np.pi * np.arange(points) / points))


def _cycles(motion: BodyMotion, yaw: Floats, start_s: Floats) -> Floats:
    """Return the drift-free yaw of each stride over its phase, in the unit of yaw, shape (strides, 64)."""
    strides, half = start_s.size - 1, POINTS // 2
    before, after = start_s[0] - (start_s[1] - start_s[0]), start_s[-1] + (start_s[-1] - start_s[-2])
    phase = np.arange(-half, strides * POINTS + half + 1) / POINTS
    time = np.interp(phase, np.arange(-1, strides + 2), np.concatenate([[before], start_s, [after]]))
    near = slice(*np.searchsorted(motion.time_s, [time[0] - 1.0, time[-1] + 1.0]))
    sampled = CubicSpline(motion.time_s[near], yaw[near])(time)
    weight = np.full(POINTS + 1, 1.0 / POINTS)
    weight[[0, -1]] *= 0.5
    clean = sampled[half:-half] - np.convolve(sampled, weight, "valid")
    return np.asarray(clean[:-1].reshape(strides, POINTS))


def _line(cycles: Floats, start_s: Floats) -> float:
    """Return the amplitude of the sine of constant frequency that fits the strides (s, points) best in time."""
    phase = np.arange(cycles.size) / cycles.shape[1]
    time = np.interp(phase, np.arange(start_s.size), start_s) - start_s[0]
    weight = np.repeat(np.diff(start_s), cycles.shape[1])  # points are even in phase, not in time
    weight /= weight.sum()
    mean = (start_s.size - 1) / (start_s[-1] - start_s[0])

    def size(frequency: float) -> float:
        return float(2.0 * np.abs(np.sum(weight * cycles.ravel() * np.exp(-2j * np.pi * frequency * time))))

    width = 1.0 / (start_s[-1] - start_s[0])
    return max(size(frequency) for frequency in np.linspace(mean - width, mean + width, 101))


def _amplitude(first: Complexes) -> Estimate:
    """Return the size of the mean fundamental; each stride counts with its part in the mean's direction."""
    return mean_of_strides(np.real(first * np.exp(-1j * np.angle(first.mean()))))


def _lag(pelvis: Complexes, trunk: Complexes) -> Estimate:
    """Return how late the trunk's fundamental is behind the pelvis's [deg]."""
    cross = pelvis * trunk.conj()
    middle = float(np.angle(cross.mean()))
    aside = mean_of_strides(np.imag(cross * np.exp(-1j * middle)) / np.abs(cross.mean()))
    value, std, low, high = np.degrees([middle, aside.std, middle + aside.low, middle + aside.high])
    return Estimate(float(value), float(std), float(low), float(high))
