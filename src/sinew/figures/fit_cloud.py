"""This is where the parameters of a fit become a cloud: values, covariance and, where there are any, draws."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from sinew.figures.style import Floats
from sinew.identify.fitted import Fit
from sinew.identify.layout import free_mechanics
from sinew.identify.numbers import number_names, physical_numbers

__all__ = ["Cloud", "cloud_of"]


@dataclass(frozen=True)
class Cloud:
    """What is known of several parameters together.

    names: as in the document, m of them. value: shape (m,). covariance: shape (m, m). draws: shape (d, m), of a
    posterior or a bootstrap, or None. All in the units that the names state.
    """

    names: tuple[str, ...]
    value: Floats
    covariance: Floats
    draws: Floats | None = None

    @property
    def std(self) -> Floats:
        """Return the standard deviations: of the draws, else by the covariance, shape (m,)."""
        if self.draws is not None:
            return np.asarray(self.draws.std(axis=0), dtype=float)
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)), dtype=float)

    @property
    def correlation(self) -> Floats:
        """Return the correlations: of the draws, else by the covariance, shape (m, m)."""
        matrix = self.covariance if self.draws is None else np.atleast_2d(np.cov(self.draws.T))
        std = np.maximum(np.sqrt(np.maximum(np.diag(matrix), 0.0)), 1e-300)
        return np.asarray(np.clip(matrix / np.outer(std, std), -1.0, 1.0), dtype=float)

    def take(self, kept: Sequence[int]) -> "Cloud":
        """Return some of the parameters. kept: indices, in the order that is wanted."""
        k = list(kept)
        draws = None if self.draws is None else self.draws[:, k]
        return Cloud(tuple(self.names[i] for i in k), self.value[k], self.covariance[np.ix_(k, k)], draws)

    def drawn(self, names: Sequence[str], draws: ArrayLike) -> "Cloud":
        """Return the same parameters by draws, shape (d, n), of numbers of these names; those drawn in no way left out.

        The value becomes the median of the draws.
        """
        found = np.asarray(draws, dtype=float)
        mine = [i for i, name in enumerate(self.names) if name in names]
        chosen = found[:, [list(names).index(self.names[i]) for i in mine]]
        return replace(self.take(mine), value=np.median(chosen, axis=0), draws=chosen)


def cloud_of(fit: Fit) -> Cloud:
    """Return the mechanical parameters of a fit, in full where the inertia is known, else over the inertia.

    Numbers with an infinite variance are left out.
    """
    every, x = number_names(fit), fit.solution.values
    mechanical = free_mechanics(fit.model, fit.layout.parts[0].record)
    count = sum(entry.local in mechanical for entry in fit.layout.entries)
    # `Fit.parameters` holds the numbers over the inertia first, then those in full where the inertia is known.
    over, full = every[:count], every[count : len(fit.parameters)]
    names = (*full, *(name for name in over if name.startswith("loss_factor"))) if full else over
    steps = 1e-6 * np.maximum(np.abs(x), 1e-3)
    ends = [physical_numbers(fit, x + sign * np.diag(steps)) for sign in (1.0, -1.0)]
    slope = ((ends[0] - ends[1]) / (2.0 * steps[:, None])).T[[every.index(name) for name in names]]
    known = np.isfinite(np.diag(fit.covariance.matrix))
    matrix = slope[:, known] @ fit.covariance.matrix[np.ix_(known, known)] @ slope[:, known].T
    value = np.array([fit.parameters[name].value for name in names])
    told = [i for i in range(len(names)) if not slope[i, ~known].any() and matrix[i, i] > 0]
    return Cloud(tuple(names), value, matrix).take(told)
