"""This is where the current that a swing needs is parted into spring, inertia and what the two save each other."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

__all__ = ["FEWEST_POINTS", "LineTrend", "SwingTrend", "fit_line_trend", "fit_swing_trend"]

Floats = NDArray[np.float64]

FEWEST_POINTS = 6
"""Frequencies that a trend needs at least."""

_ROUNDS = 30
_BAND = (0.8, 1.25)


@dataclass(frozen=True)
class SwingTrend:
    """Squared current (root mean square) over squared torsion amplitude: s + n f⁴ - c f² + q/φ₁².

    spring s [A²/rad²], inertia n [A² s⁴/rad²], saved c [A² s²/rad²], friction q [A²]; none is negative.
    saved_std: of c, from the residual. misfit: root mean square of the residual over the trend.
    """

    spring: float
    inertia: float
    saved: float
    friction: float
    saved_std: float
    misfit: float

    def squared_saving(self, frequency_hz: Floats) -> Floats:
        """Return c f² [A²/rad²]: by how much spring and inertia together need less than each for itself."""
        return self.saved * frequency_hz**2


def fit_swing_trend(frequency_hz: Floats, current_a: Floats, torsion_rad: Floats) -> SwingTrend | None:
    """Return the trend of the current that a swing of the head needs; None with fewer than six usable frequencies.

    frequency_hz, current_a (root mean square), torsion_rad (amplitude): shape (f,); what is not finite is left out.

    Away from resonance the drive's torque fights the spring or the inertia: per swing it is a constant, or goes with
    f². Both are in antiphase, so that torque squared holds s + n f⁴ and twice their product with a minus: what the two
    save each other, which is all there is to resonance. For a linear viscous joint this form is exact. Coulomb
    friction adds a current of its own, whatever the swing: q/φ₁².
    Non-negative least squares, with the deviations taken relative to the trend s + n f⁴ + q/φ₁², so that the flanks
    and the resonance count alike.
    """
    valid = np.isfinite(frequency_hz) & np.isfinite(current_a) & np.isfinite(torsion_rad) & (torsion_rad > 0)
    if valid.sum() < FEWEST_POINTS:
        return None
    f, swing = frequency_hz[valid], torsion_rad[valid]
    wanted = (current_a[valid] / swing) ** 2
    design = np.stack([np.ones_like(f), f**4, -(f**2), swing**-2], axis=1)
    without = wanted
    terms = np.zeros(4)
    for _ in range(_ROUNDS):
        weight = 1.0 / without
        scale = np.linalg.norm(design * weight[:, None], axis=0)
        terms = nnls(design * weight[:, None] / scale, wanted * weight)[0] / scale
        moved = wanted + terms[2] * f**2
        if np.allclose(moved, without, rtol=1e-9):
            break
        without = moved
    residual = (wanted - design @ terms) / without
    used = terms > 0
    weighted = design[:, used] / without[:, None]
    freedom = max(1, f.size - int(used.sum()))
    covariance = np.linalg.pinv(weighted.T @ weighted) * float(residual @ residual) / freedom
    place = int(used[:2].sum())
    std = float(np.sqrt(covariance[place, place])) if used[2] else 0.0
    spring, inertia, saved, friction = map(float, terms)
    return SwingTrend(spring, inertia, saved, friction, std, float(np.sqrt(np.mean(residual**2))))


@dataclass(frozen=True)
class LineTrend:
    """A straight line a + b f through the current off resonance: intercept [A], slope [A/Hz]."""

    intercept: float
    slope: float

    def current(self, frequency_hz: float) -> float:
        """Return the line at a frequency [A]."""
        return self.intercept + self.slope * frequency_hz


def fit_line_trend(frequency_hz: Floats, current_a: Floats, resonance_hz: float) -> LineTrend | None:
    """Return the paper's linear increase: a line by least squares through what was measured off resonance.

    Off resonance: outside 0.8 to 1.25 times the resonance. None where fewer than two frequencies lie on either side.
    """
    valid = np.isfinite(frequency_hz) & np.isfinite(current_a)
    f, current = frequency_hz[valid], current_a[valid]
    below, above = f < _BAND[0] * resonance_hz, f > _BAND[1] * resonance_hz
    if not np.isfinite(resonance_hz) or below.sum() < 2 or above.sum() < 2:
        return None
    off = below | above
    slope, intercept = np.polyfit(f[off], current[off], 1)
    return LineTrend(float(intercept), float(slope))
