"""This is where a periodic signal gets its mean over a cycle, from samples that hold no whole number of cycles."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["cycle_mean", "energy_between"]

Floats = NDArray[np.float64]

_HARMONICS = 5
_NYQUIST_SHARE = 0.45


def cycle_mean(time_s: Floats, signal: Floats, frequency_hz: Floats) -> tuple[Floats, Floats]:
    """Return the means of q periodic signals of s records and their standard deviations, each (s, q).

    time_s: stamps as they are, (s, n). signal: (s, q, n). frequency_hz: at which the signals repeat, (s,); of a power
    that is twice the drive's.
    Least squares with a mean, a slope and up to five harmonics: a plain mean would keep what the last, broken cycle
    holds. The standard deviation is that of white noise of the residual's size, and of the slope over the record
    where it is more than three times its own noise.
    Records of fewer samples than coefficients give NaN.
    """
    records, samples = time_s.shape
    span = time_s[:, -1:] - time_s[:, :1]
    rate = samples / float(span.max())
    count = int(min(_HARMONICS, _NYQUIST_SHARE * rate / float(frequency_hz.max())))
    if samples < 2 * count + 3:
        return (np.full((records, signal.shape[1]), np.nan),) * 2
    ramp = (time_s - time_s.mean(axis=1, keepdims=True)) / span
    turn = np.exp(2j * np.pi * frequency_hz[:, None] * (time_s - time_s[:, :1]))
    waves = [turn**h for h in range(1, count + 1)]
    parts = [np.ones_like(ramp), ramp, *(w.real for w in waves), *(w.imag for w in waves)]
    design = np.stack(parts, axis=2)
    normal = np.linalg.inv(design.transpose(0, 2, 1) @ design)
    solution = normal @ (design.transpose(0, 2, 1) @ signal.transpose(0, 2, 1))
    residual = signal.transpose(0, 2, 1) - design @ solution
    variance = (residual**2).sum(axis=1) / max(1, samples - design.shape[2])
    slope = solution[:, 1] ** 2
    drift = np.where(slope > 9.0 * variance * normal[:, 1:2, 1], slope, 0.0)
    std = np.sqrt(variance * normal[:, :1, 0] + drift / 12.0)
    return solution[:, 0], std


def energy_between(time_s: Floats, power_w: Floats, edges_s: Floats) -> Floats:
    """Return the energy [J] between successive times, (e - 1,): of the cycles of a motion whose frequency moves.

    time_s, power_w: (n,). edges_s: where cycles begin and end, (e,), inside the record. Trapezoidal rule on the actual
    stamps, with the power at the edges linear between samples.
    """
    steps = 0.5 * (power_w[1:] + power_w[:-1]) * np.diff(time_s)
    total = np.concatenate([[0.0], np.cumsum(steps)])
    place = np.clip(np.searchsorted(time_s, edges_s, side="right") - 1, 0, time_s.size - 2)
    begin, height = time_s[place], power_w[place]
    inside = edges_s - begin
    slope = (power_w[place + 1] - height) / (time_s[place + 1] - begin)
    at_edges = total[place] + inside * (height + 0.5 * slope * inside)
    return np.diff(at_edges)
