"""This is where the vector that a search moves becomes physical numbers by name."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sinew.identify.certainty import Covariance
from sinew.identify.fitted import Fit
from sinew.identify.mechanics import mechanical_parameters, oscillation

__all__ = ["DAMPING", "FREQUENCY", "number_names", "physical_numbers"]

Array = NDArray[np.float64]

FREQUENCY = "natural_frequency_hz"
DAMPING = "damping_ratio"


def number_names(fit: Fit) -> tuple[str, ...]:
    """Return the names of the numbers that a fit tells: those of `Fit.parameters`, frequency and damping ratio."""
    return (*fit.parameters, FREQUENCY, DAMPING)


def physical_numbers(fit: Fit, values: Array) -> Array:
    """Return the numbers of `number_names`, in their units, at other vectors of the search.

    values: in normal form, in the order of `Fit.names`, shape (d, m). Returned: shape (d, number).
    They are worked out as those of the fit itself were, so what is NaN there (a spring that pushes away has no natural
    frequency) is NaN here.
    """
    certainty = Covariance(np.zeros_like(fit.covariance.matrix), 1.0)  # only values are asked for
    found = []
    for x in np.asarray(values, dtype=float):
        solution = replace(fit.solution, values=x)
        numbers = mechanical_parameters(fit.layout, solution, certainty)
        frequency, damping = oscillation(fit.layout, solution, certainty)
        found.append([*(numbers[name].value for name in fit.parameters), frequency.value, damping.value])
    return np.array(found, dtype=float).reshape(-1, len(fit.parameters) + 2)
