"""This is where a record of one and a half to some strides still gives its stride frequency and yaw.

Too few strides show no scatter, so their numbers come without an interval. One frequency is fitted to the whole
stretch: harmonics of it, a level and, where yaw may drift, a slope.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from sinew.analysis.body_yaw import BodyMotion
from sinew.analysis.gait_bout import POINTS, BoutGait, unknown
from sinew.analysis.stride import Walk

__all__ = ["short_gait"]

Floats = NDArray[np.float64]

_YAW_HARMONICS, _BOUNCE_HARMONICS = 3, 4
_NEAR = 0.15


def short_gait(motion: BodyMotion, walk: Walk) -> BoutGait:
    """Return the gait of the longest stretch of walking by one fit; its uncertainties are unknown (NaN).

    The frequency is the one within 15 % of the windows' whose harmonics leave least of yaw and bounce together.
    """
    inside = (motion.time_s >= walk.longest_s[0]) & (motion.time_s <= walk.longest_s[1])
    time = motion.time_s[inside]
    since = time - time.mean()
    signals = [(motion.swing[1][inside], _YAW_HARMONICS)]
    if motion.bounce is not None:
        signals.append((motion.bounce[inside], _BOUNCE_HARMONICS))

    def left(frequency: float) -> float:
        return sum(_left(since, x, frequency, harmonics, motion.drifts) for x, harmonics in signals)

    bounds = walk.frequency_hz * (1 - _NEAR), walk.frequency_hz * (1 + _NEAR)
    grid = np.linspace(*bounds, 31)
    best = int(np.argmin([left(f) for f in grid]))
    ends = grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)]
    frequency = float(minimize_scalar(left, bounds=ends, method="bounded").x)

    def harmonics(yaw: Floats | None) -> NDArray[np.complex128] | None:
        if yaw is None:
            return None
        weights, _ = _fit(since, yaw[inside], frequency, _YAW_HARMONICS, motion.drifts)
        first = 2 if motion.drifts else 1
        return np.asarray(np.rad2deg(weights[first::2]) - 1j * np.rad2deg(weights[first + 1 :: 2]))

    swing, pelvis, trunk = harmonics(motion.swing[1]), harmonics(motion.pelvis), harmonics(motion.trunk)
    assert swing is not None
    order = np.arange(1, swing.size + 1)
    turned = swing * np.exp(-1j * order * np.angle(swing[0]))
    cycle = np.real(turned @ np.exp(2j * np.pi * np.outer(order, np.arange(POINTS) / POINTS)))
    lag = None if pelvis is None or trunk is None else unknown(np.degrees(np.angle(pelvis[0] / trunk[0])))
    return BoutGait(
        start_s=float(time[0]),
        stop_s=float(time[-1]),
        strides=float((time[-1] - time[0]) * frequency),
        frequency_hz=unknown(frequency),
        slowest_hz=frequency,
        fastest_hz=frequency,
        yaw_deg=unknown(abs(swing[0])),
        line_deg=abs(swing[0]),
        peak_to_peak_deg=unknown(np.ptp(cycle)),
        range_deg=float(np.degrees(np.ptp(_level(since, motion.swing[1][inside], motion.drifts)))),
        pelvis_deg=None if pelvis is None else unknown(abs(pelvis[0])),
        trunk_deg=None if trunk is None else unknown(abs(trunk[0])),
        trunk_lag_deg=lag,
        regularity=walk.regularity,
        speed_m_s=motion.speed(float(time[0]), float(time[-1])),
        cycles_deg=cycle[None, :],
    )


def _fit(since: Floats, signal: Floats, frequency: float, harmonics: int, slope: bool) -> tuple[Floats, Floats]:
    """Return (level, slope if asked, cosine and sine of each harmonic; residual) by least squares."""
    angle = 2 * np.pi * frequency * since
    waves = [wave(h * angle) for h in range(1, harmonics + 1) for wave in (np.cos, np.sin)]
    design = np.column_stack([np.ones_like(since), *([since] if slope else []), *waves])
    weights = np.linalg.lstsq(design, signal, rcond=None)[0]
    return weights, signal - design @ weights


def _left(since: Floats, signal: Floats, frequency: float, harmonics: int, slope: bool) -> float:
    spread = float(np.var(signal))
    residual = _fit(since, signal, frequency, harmonics, slope)[1]
    return float(np.mean(residual**2)) / spread if spread > 0 else 0.0


def _level(since: Floats, signal: Floats, slope: bool) -> Floats:
    """Return a signal without its straight drift, where it may drift."""
    return signal - np.polyval(np.polyfit(since, signal, 1), since) if slope else signal
