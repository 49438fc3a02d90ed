"""This is where the physical combinations of a joint fit get their values and intervals."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sinew.identify.joint_balance import Balance, balance
from sinew.identify.joint_coordinates import Coordinates
from sinew.identify.joint_swing import Swing
from sinew.measure.estimate import Estimate

__all__ = ["derive"]

Array = NDArray[np.float64]

_STEP = 1e-4  # of a coordinate: third derivatives then count for 1e-8
_SHARED = ("stiffness_n_m_rad", "tendon_moment_n_m")


def derive(swings: Sequence[Swing], coordinates: Coordinates, x: Array, covariance: Array) -> dict[str, Estimate]:
    """Return the derived quantities of `JointFit`.

    x: shared coordinates, shape (m,); covariance: of them, shape (m, m). Intervals are to first order.
    """
    found = dict(zip(_SHARED, _estimates(partial(_of_the_joint, coordinates), x, covariance), strict=True))
    for pretension in sorted({swing.pretension_mm for swing in swings}):
        mine = [swing for swing in swings if swing.pretension_mm == pretension]
        amplitude, end = _amplitude(mine), f"[{pretension:g} mm]"
        found[f"amplitude_rad{end}"] = Estimate(amplitude, 0.0, amplitude, amplitude)
        at = partial(_at, coordinates, pretension, mine[0].mode, amplitude)
        rows = zip(Balance._fields, _estimates(at, x, covariance), strict=True)
        found |= {name + end: one for name, one in rows}
    return found


def _of_the_joint(coordinates: Coordinates, x: Array) -> Array:
    rig = coordinates.rig_at(x)
    stiffness = rig.silicone.torsional_rigidity.value / rig.silicone.length.value
    return np.array([stiffness, rig.tendons.head_radius.value * rig.tendons.first_contact_tension.value])


def _at(coordinates: Coordinates, pretension_mm: float, mode: float, amplitude: float, x: Array) -> Array:
    return np.array(balance(coordinates.numbers(x), pretension_mm, mode, amplitude), dtype=float)


def _estimates(quantities: Callable[[Array], Array], x: Array, covariance: Array) -> list[Estimate]:
    """Return estimates of what follows from the coordinates, by its slopes (central differences)."""
    values = quantities(x)
    slopes = np.array([(quantities(x + one) - quantities(x - one)) / (2 * _STEP) for one in _STEP * np.eye(x.size)])
    variances = np.maximum(np.einsum("iq,ij,jq->q", slopes, covariance, slopes), 0.0)
    return [Estimate.normal(float(v), float(s)) for v, s in zip(values, np.sqrt(variances), strict=True)]


def _amplitude(swings: Sequence[Swing]) -> float:
    """Return the median torsion amplitude of swings [rad], by the rate's root mean square and the drive's frequency."""
    found = [
        float(np.sqrt(2 * np.mean(swing.gyro[swing.recorded :] ** 2))) / (2 * np.pi * swing.frequency_hz)
        for swing in swings
        if swing.frequency_hz > 0
    ]
    return float(np.median(found)) if found else 0.1
