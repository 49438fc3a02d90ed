"""This is where a fit is held: numbers with intervals, what they do not tell, and how well they predict."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sinew.identify.certainty import Covariance, correlation
from sinew.identify.grid import Frame
from sinew.identify.layout import Layout
from sinew.identify.least_squares import Solution
from sinew.identify.model import Model
from sinew.identify.record import Record
from sinew.measure.estimate import Estimate

__all__ = ["Fit"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Fit:
    """What the records say about a model.

    parameters: mechanical numbers by name with unit, over the inertia where that is not known; where the input is a
        torque on an angle or a force on a length, the inertia or mass and its multiples too.
    nuisance: start and rest position of each record, in its units.
    natural_frequency_hz: sqrt(k/I)/2π, of the linear part. damping_ratio: d/(2 sqrt(k I)), or half the loss factor;
        the viscous part where there is dry friction.
    predicted: the fitted output of each record, in its unit, all samples. kept: which of them were fitted.
    rmse: over the samples that were fitted, unit.
    converged, message: how the search ended. unidentifiable: sentences.
    covariance, solution, layout: in normal form, for profiles and predictions; see `sinew.identify.layout`.
    """

    model: Model
    frame: Frame
    records: tuple[Record, ...]
    parameters: dict[str, Estimate]
    nuisance: dict[str, Estimate]
    natural_frequency_hz: Estimate
    damping_ratio: Estimate
    predicted: tuple[Array, ...]
    kept: tuple[NDArray[np.bool_], ...]
    rmse: float
    unit: str
    converged: bool
    message: str
    unidentifiable: tuple[str, ...]
    covariance: Covariance
    solution: Solution
    layout: Layout

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the numbers in the covariance, in order."""
        return tuple(entry.local + entry.label() for entry in self.layout.entries)

    @property
    def correlation(self) -> Array:
        """Return the correlation matrix of the numbers in `names`, shape (m, m)."""
        return correlation(self.covariance.matrix)

    @property
    def condition(self) -> float:
        """Return the condition number of the Jacobian, columns scaled to one."""
        scaled = self.solution.jacobian / np.maximum(np.linalg.norm(self.solution.jacobian, axis=0), 1e-300)
        return float(np.linalg.cond(scaled))

    @property
    def effective_samples(self) -> float:
        """Return how many independent residuals the fitted samples are worth."""
        return min(self.covariance.degrees_of_freedom + self.solution.values.size, float(self.solution.residual.size))

    def bic(self, effective_samples: float | None = None) -> float:
        """Return the information criterion n ln(mean squared residual) + m ln n.

        effective_samples: n, of independent residuals; to compare models it has to be the same for all, best that of
        the model that fits best. Its own where it is None. What a loss factor saw before the record is not counted in
        m: the record hardly tells it, and it is no mechanics.
        """
        n = self.effective_samples if effective_samples is None else effective_samples
        counted = sum(entry.local != "memory" for entry in self.layout.entries)
        return float(n * np.log(max(self.rmse, 1e-300) ** 2) + counted * np.log(n))

    def residuals(self) -> list[Array]:
        """Return measured less predicted of every record, in its unit, all samples."""
        return [record.output - fitted for record, fitted in zip(self.records, self.predicted, strict=True)]
