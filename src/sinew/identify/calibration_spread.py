"""This is where a calibrated rig is told how its parameters vary together, those that only follow among them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sinew.identify.calibration_rig import Source
from sinew.identify.joint_coordinates import make_coordinates
from sinew.measure.errors import SpecError
from sinew.plan.calibrated import Calibrated
from sinew.plan.rig import RigSpec

__all__ = ["calibrated_from_draws", "calibrated_together", "with_ties"]

Array = NDArray[np.float64]

_STEP = 1e-4  # of a coordinate of the search
_STD_DIGITS, _CORRELATION_DIGITS = 6, 8
_HASH = 12


def with_ties(rig: RigSpec, found: Sequence[str], followed: Sequence[str], covariance: Array) -> Array:
    """Return the covariance of the found parameters and of those that are tied to them, shape (k, k), SI.

    rig: calibrated. found: m dotted names; covariance: of them, (m, m), SI. followed: dotted names.
    """
    coordinates = make_coordinates(rig, found)
    m = len(found)
    slopes = np.eye(m + len(followed), m)
    if followed:
        steps = _STEP * np.eye(m)
        moved = [_values(coordinates.rig_at(x), followed) - _values(coordinates.rig_at(-x), followed) for x in steps]
        slopes[m:] = (np.array(moved) / (2 * _STEP) / coordinates.slopes(np.zeros(m))[:, None]).T
    return np.asarray(slopes @ covariance @ slopes.T)


def calibrated_together(
    names: Sequence[str], covariance: Array, sources: Sequence[Source] = (), pretension_mm: Sequence[float] = ()
) -> Calibrated:
    """Return what a rig keeps of a covariance, shape (k, k), SI. Raises SpecError for one that is not finite."""
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    if not np.all(np.isfinite(covariance)):
        raise SpecError("the covariance of the calibrated parameters is not finite; free fewer parameters")
    safe = np.where(std > 0, std, 1.0)
    correlation = np.clip(covariance / np.outer(safe, safe), -1.0, 1.0)
    return Calibrated(
        recordings=tuple(f"{one.file} ({one.content_hash[:_HASH]})" for one in sources),
        pretension_mm=tuple(sorted(set(map(float, pretension_mm)))),
        parameters=tuple(names),
        std=tuple(float(f"{one:.{_STD_DIGITS}g}") for one in std),
        correlation=tuple(
            (*(round(float(one), _CORRELATION_DIGITS) + 0.0 for one in row[:i]), 1.0)
            for i, row in enumerate(correlation)
        ),
    )


def calibrated_from_draws(names: Sequence[str], draws: Array) -> Calibrated:
    """Return what a rig keeps of draws of its parameters, shape (draw, k), SI."""
    return calibrated_together(names, np.atleast_2d(np.cov(draws, rowvar=False)))


def _values(rig: RigSpec, names: Sequence[str]) -> Array:
    table = dict(rig.parameters())
    return np.array([table[name].value for name in names])
