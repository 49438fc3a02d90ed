"""This is where a fitted model says how its own free swing depends on amplitude: frequency and damping, with bands.

The conservative swing between two turning points of equal potential, r = m + A sin u, has the period

    T = 2 ∫ A cos u / sqrt(2 (E - V(r))) du,  u from -π/2 to π/2,

whose integrand is smooth. What a cycle loses is asked of the damping law along that swing, and spread over the cycle:
λ = ΔE / (T A dE/dA). Both are exact for a linear joint, and to first order in the damping for the others.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from sinew.identify.fitted import Fit
from sinew.identify.record import derivative_order
from sinew.identify.track import LOCAL

__all__ = ["Swing", "swing_of"]

Array = NDArray[np.float64]

_NODES = 96
_SMALLEST = 0.03  # of the largest amplitude: where a curve begins
_POINTS = 41


@dataclass(frozen=True)
class Swing:
    """Frequency and damping of a fitted model against amplitude, shape (a,) each, from small to large.

    amplitude: half of the way between the turning points, unit of the motion.
    frequency_hz: damped; damping_ratio: λ/sqrt(ω² + λ²). *_low, *_high: the pointwise 90 % band.
    """

    amplitude: Array
    frequency_hz: Array
    frequency_low_hz: Array
    frequency_high_hz: Array
    damping_ratio: Array
    damping_ratio_low: Array
    damping_ratio_high: Array


def swing_of(fit: Fit, largest: float | None = None) -> Swing | None:
    """Return the free swing of a fit, up to an amplitude; None where its spring does not bring it back.

    largest: unit of the motion; the largest that the records of the fit reached where it is None.
    """
    x = fit.solution.values
    if largest is None:
        largest = max(_reached(fit, i) for i in range(len(fit.records)))
    amplitude = np.geomspace(_SMALLEST, 1.0, _POINTS) * largest
    value = _curves(fit, x, amplitude)
    known = np.asarray(np.isfinite(value).all(axis=0))
    if not known[0]:
        return None
    count = int(np.argmin(known)) if not known.all() else known.size
    amplitude, value = amplitude[:count], value[:, :count]
    taking = [k for k in _entries(fit) if np.isfinite(fit.covariance.matrix[k, k])]
    slopes = np.zeros((len(taking), *value.shape))
    for i, k in enumerate(taking):
        step = 1e-4 * max(abs(x[k]), 0.01)
        ends = []
        for sign in (1.0, -1.0):
            moved = x.copy()
            moved[k] += sign * step
            ends.append(_curves(fit, moved, amplitude))
        slopes[i] = np.nan_to_num((ends[0] - ends[1]) / (2 * step))
    matrix = fit.covariance.matrix[np.ix_(taking, taking)]
    variance = np.einsum("iqa,ij,jqa->qa", slopes, matrix, slopes)
    half = float(special.stdtrit(fit.covariance.degrees_of_freedom, 0.95)) * np.sqrt(np.maximum(variance, 0.0))
    return Swing(
        amplitude,
        value[0],
        value[0] - half[0],
        value[0] + half[0],
        value[1],
        value[1] - half[1],
        value[1] + half[1],
    )


def _entries(fit: Fit) -> list[int]:
    """Return which numbers of a fit are mechanical and hold for its first record."""
    names = fit.model.mechanics(fit.records[0].excitation)
    group = fit.records[0].group
    return [k for k, entry in enumerate(fit.layout.entries) if entry.local in names and entry.group in ("", group)]


def _reached(fit: Fit, i: int) -> float:
    """Return the largest amplitude of the motion in a record: of a rate or acceleration over its frequency."""
    record = fit.records[i]
    fast = (2 * np.pi * fit.natural_frequency_hz.value) ** derivative_order(record.output_unit)
    return 0.5 * float(np.ptp(fit.predicted[i])) / float(fast)


def _curves(fit: Fit, x: Array, amplitude: Array) -> Array:
    """Return damped frequency [Hz] and damping ratio at amplitudes of the motion, shape (2, a)."""
    scales = fit.layout.parts[0].scales
    local = dict(zip(LOCAL, fit.layout.local(x, 0), strict=True))
    p = {name: local[name] * scales.physical(name) for name in _MECHANICS}
    with np.errstate(invalid="ignore", divide="ignore"):
        energy, omega, path = _conservative(p, amplitude, fit.model.pendulum)
        up, down = (_conservative(p, amplitude * (1 + s), fit.model.pendulum)[0] for s in (1e-4, -1e-4))
        lost = p["damping"] * path + 4.0 * p["coulomb"] * amplitude
        lost = lost + np.pi * p["loss_factor"] * p["stiffness"] * amplitude**2
        rate = lost * omega / (2 * np.pi) / ((up - down) / 2e-4)
        damped = np.sqrt(omega**2 - 0.25 * p["damping"] ** 2) / (2 * np.pi)
    return np.stack([np.where(np.isfinite(energy), damped, np.nan), rate / omega])


_MECHANICS = ("stiffness", "damping", "loss_factor", "coulomb", "quadratic", "cubic")


def _conservative(p: dict[str, float], amplitude: Array, pendulum: bool) -> tuple[Array, Array, Array]:
    """Return energy over the inertia, angular frequency, and ∮ v dr of the swing without loss, shape (a,) each."""

    def potential(r: Array) -> Array:
        linear = (1.0 - np.cos(r)) if pendulum else 0.5 * r**2
        return np.asarray(p["stiffness"] * linear + p["quadratic"] * r**3 / 3.0 + p["cubic"] * r**4 / 4.0)

    def force(r: Array) -> Array:
        linear = np.sin(r) if pendulum else r
        return np.asarray(p["stiffness"] * linear + p["quadratic"] * r**2 + p["cubic"] * r**3)

    middle = np.zeros_like(amplitude)
    if p["quadratic"]:
        for _ in range(30):
            off = potential(middle + amplitude) - potential(middle - amplitude)
            slope = force(middle + amplitude) - force(middle - amplitude)
            middle = np.clip(middle - off / slope, -0.9 * amplitude, 0.9 * amplitude)
    energy = potential(middle + amplitude)
    u = (np.arange(_NODES) + 0.5) / _NODES * np.pi - 0.5 * np.pi
    r = middle[:, None] + amplitude[:, None] * np.sin(u)
    left = 2.0 * (energy[:, None] - potential(r))
    speed = np.sqrt(np.where(left > 0, left, np.nan))
    weight = amplitude[:, None] * np.cos(u) * (np.pi / _NODES)
    period = 2.0 * np.sum(weight / speed, axis=1)
    return energy, 2 * np.pi / period, 2.0 * np.sum(weight * speed, axis=1)
