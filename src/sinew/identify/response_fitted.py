"""This is where the fit of a stepped sine is held: mechanics with intervals, and what the residuals say."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sinew.identify.certainty import Covariance, correlation
from sinew.identify.grid import Frame
from sinew.identify.least_squares import Solution
from sinew.identify.model import Model
from sinew.identify.residual_tests import trend_sentences
from sinew.identify.response_layout import ResponseLayout
from sinew.identify.response_points import ResponsePoints
from sinew.measure.estimate import Estimate

__all__ = ["ResponseFit", "ResponseTests"]

Complexes = NDArray[np.complex128]

_SIGNIFICANT = 0.01


@dataclass(frozen=True)
class ResponseTests:
    """What the residuals of the points look like.

    misfit: root mean square of the residuals in stated standard deviations, near 1 where model and scatter are right.
    chi_square_p: of the sum of squares by the stated scatter; NaN where that is itself known by too few repeats.
    neighbours_p, neighbours: of the correlation of residuals at neighbouring frequencies.
    amplitude_p, amplitude_trend: Spearman's rank correlation of the residuals' size with the amplitude of the motion;
    frequency_p, frequency_trend: the same with frequency.
    """

    misfit: float
    chi_square_p: float
    neighbours_p: float
    neighbours: float
    amplitude_p: float
    amplitude_trend: float
    frequency_p: float
    frequency_trend: float

    def sentences(self) -> tuple[str, ...]:
        """Return what speaks against the model, in words; none where nothing does."""
        found = []
        if self.chi_square_p < _SIGNIFICANT:
            found.append(f"the model misses the points by {self.misfit:.2g} times their stated scatter")
        if self.neighbours_p < _SIGNIFICANT:
            found.append(f"residuals of neighbouring frequencies go together (correlation {self.neighbours:.2f})")
        amplitude, frequency = (self.amplitude_trend, self.amplitude_p), (self.frequency_trend, self.frequency_p)
        return (*found, *trend_sentences(amplitude, frequency))


@dataclass(frozen=True)
class ResponseFit:
    """What the points of a stepped sine say about a model; names as of a `Fit` in time.

    parameters: mechanical numbers by name with unit. nuisance: turn and background of the measuring chain.
    natural_frequency_hz: sqrt(k/I)/2π; damping_ratio: d/(2 sqrt(k I)) or half the loss factor; of the first group.
    predicted: the fitted response of each group, shape (n,). rmse: of measured less predicted response, over real and
    imaginary parts, output unit per input unit (`unit`).
    converged, message: how the search ended. unidentifiable: sentences. tests: of the residuals.
    covariance, solution, layout: in normal form.
    """

    model: Model
    frame: Frame
    points: tuple[ResponsePoints, ...]
    parameters: dict[str, Estimate]
    nuisance: dict[str, Estimate]
    natural_frequency_hz: Estimate
    damping_ratio: Estimate
    predicted: tuple[Complexes, ...]
    rmse: float
    unit: str
    converged: bool
    message: str
    unidentifiable: tuple[str, ...]
    tests: ResponseTests
    covariance: Covariance
    solution: Solution
    layout: ResponseLayout

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the numbers in the covariance, in order."""
        entries = self.layout.layout.entries
        return (*(entry.local + entry.label() for entry in entries), *self.layout.chain)

    @property
    def correlation(self) -> NDArray[np.float64]:
        """Return the correlation matrix of the numbers in `names`, shape (m, m)."""
        return correlation(self.covariance.matrix)

    def bic(self) -> float:
        """Return the information criterion n ln(mean squared weighted residual) + m ln n, n = 2 for each point."""
        n = self.solution.residual.size
        return float(n * np.log(max(self.solution.sum_of_squares / n, 1e-300)) + self.solution.values.size * np.log(n))

    def residuals(self) -> list[Complexes]:
        """Return measured less predicted response of every group."""
        return [one.response - fitted for one, fitted in zip(self.points, self.predicted, strict=True)]
