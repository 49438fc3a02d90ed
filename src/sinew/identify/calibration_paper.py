"""This is where the undetermined parameters of the paper's rig are calibrated against the paper's numbers.

Ten parameters are free and fewer numbers are printed, so the fit is a maximum a posteriori one: the paper's numbers
with a third of their tolerance as standard deviation, each parameter with a weak normal prior about what is thought
likely. Nothing is random, so the same rig gives the same values.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from sinew.identify.paper_numbers import FREE, Scale, is_met, misfit, observe, rig_with, scale_of
from sinew.plan.rig import RigSpec

__all__ = ["PaperFit", "find_ranges", "fit_paper"]

Vector = NDArray[np.float64]
Progress = Callable[[float, float], None]
_DIGITS = 4


@dataclass(frozen=True)
class PaperFit:
    """A set of the free parameters and what the twin gives with it.

    values: to four digits, SI, (free,), in the order of `FREE`. observed: (target,), in the order of `TARGETS`.
    """

    rig: RigSpec
    values: Vector
    observed: Vector

    @property
    def met(self) -> bool:
        """Whether all of the paper's numbers are met within their tolerance."""
        return bool(is_met(self.observed))


class _MetError(Exception):
    """Raised inside a search as soon as the paper's numbers are met."""


def fit_paper(base: RigSpec) -> PaperFit:
    """Return the maximum a posteriori fit of the free parameters, from the likely values on."""
    values, _ = _fit(base, scale_of(base).likely)
    values = np.array([float(f"{value:.{_DIGITS}g}") for value in values])
    rig = rig_with(base, values)
    return PaperFit(rig, values, observe([rig])[0])


def find_ranges(base: RigSpec, values: Vector, progress: Progress | None = None) -> dict[str, dict[str, Any]]:
    """Return how far each free parameter can move until one of the paper's numbers is missed, by dotted name.

    values: of the fit, (free,). progress: called with (done, total) parameters.
    A row is `{"value", "unit", "bounds", "alone", "together"}` in SI. alone: the others held, by bisection; together:
    the others readjusted at every step inside their bounds. Together is a search, not a proof: it may stop short of
    the true limit, never beyond it.
    """
    scale, table = scale_of(base), dict(base.parameters())
    ranges: dict[str, dict[str, Any]] = {}
    for index, free in enumerate(FREE):
        ranges[free.name] = {
            "value": float(f"{values[index]:.6g}"),
            "unit": table[free.name].unit,
            "bounds": [float(scale.low[index]), float(scale.high[index])],
            "alone": [float(f"{v:.4g}") for v in _alone(base, values, index)],
            "together": [float(f"{v:.4g}") for v in _together(base, values, index)],
        }
        if progress is not None:
            progress(index + 1, len(FREE))
    return ranges


def _fit(
    base: RigSpec, start: Vector, fixed: dict[int, float] | None = None, *, steps: int = 15, prior: float = 1.0
) -> tuple[Vector, Vector]:
    """Return (values, observed) of the maximum a posteriori fit.

    fixed: parameters that are held, by index. prior: weight of the prior; below 1 the search also ends as soon as
    all of the paper's numbers are met.
    """
    scale = scale_of(base)
    likely, width = scale.likely, scale.width
    free = np.array([i for i in range(len(FREE)) if i not in (fixed or {})])
    values = np.clip(start, scale.low, scale.high)
    for i, value in (fixed or {}).items():
        values[i] = value
    best: list[Vector] = []

    def complete(x: Vector) -> Vector:
        whole = values.copy()
        whole[free] = np.clip(likely[free] + width[free] * x, scale.low[free], scale.high[free])
        return whole

    def residual(x: Vector) -> Vector:
        observed = observe([rig_with(base, complete(x))])[0]
        if prior < 1 and is_met(observed):
            best[:] = [complete(x), observed]
            raise _MetError
        return np.concatenate([misfit(observed), prior * x])

    def jacobian(x: Vector) -> Vector:
        h = 0.02
        moved = [x + sign * h * row for row in np.eye(free.size) for sign in (1, -1)]
        seen = misfit(observe([rig_with(base, complete(m)) for m in moved]))
        return np.concatenate([((seen[0::2] - seen[1::2]) / (2 * h)).T, prior * np.eye(free.size)])

    low, high = _bounds(scale, free)
    x0 = np.clip((values[free] - likely[free]) / width[free], low + 1e-6, high - 1e-6)
    try:
        solution = least_squares(residual, x0, jacobian, bounds=(low, high), max_nfev=steps, xtol=1e-3, ftol=1e-3)
    except _MetError:
        return best[0], best[1]
    final = complete(solution.x)
    return final, observe([rig_with(base, final)])[0]


def _bounds(scale: Scale, free: NDArray[np.intp]) -> tuple[Vector, Vector]:
    """Return the bounds of the free parameters in prior standard deviations from the likely value."""
    low, high = ((end - scale.likely) / scale.width for end in (scale.low, scale.high))
    return low[free], high[free]


def _alone(base: RigSpec, values: Vector, index: int) -> tuple[float, float]:
    scale = scale_of(base)

    def met(value: float) -> bool:
        return bool(is_met(observe([rig_with(base, np.where(np.arange(len(FREE)) == index, value, values))])[0]))

    return _edge(met, values[index], scale.low[index], 7), _edge(met, values[index], scale.high[index], 7)


def _together(base: RigSpec, values: Vector, index: int) -> tuple[float, float]:
    scale = scale_of(base)
    ends = []
    for bound in (scale.low[index], scale.high[index]):
        last = values

        def met(value: float) -> bool:
            nonlocal last
            found, observed = _fit(base, last, {index: value}, steps=8, prior=0.1)
            if is_met(observed):
                last = found
            return bool(is_met(observed))

        ends.append(_edge(met, values[index], float(bound), 4))
    return ends[0], ends[1]


def _edge(met: Callable[[float], bool], inside: float, bound: float, halvings: int) -> float:
    """Return the value nearest to `bound` for which `met` holds, by bisection from a value for which it does."""
    if met(bound):
        return float(bound)
    outside = bound
    for _ in range(halvings):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if met(middle) else (inside, middle)
    return float(inside)
