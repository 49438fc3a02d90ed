"""Least squares, from one start or several: how the search went, and how certain its solution is."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize

from sinew.analysis.signal.least_squares import sandwich
from sinew.measure.arrays import Array, Mask
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import Estimate

_HUGE = 1e8  # of the start's largest residual: what a residual that is not finite counts as


@dataclass(frozen=True)
class Problem:
    """Residuals r(x) whose sum of squares is wanted small.

    residual: takes x, shape (m,), returns shape (n,). jacobian: takes x, returns ∂r/∂x, shape (n, m).
    A residual may be NaN or infinite (a simulation that ran away): such a point is refused.
    """

    residual: Callable[[Array], Array]
    jacobian: Callable[[Array], Array]


def restricted(problem: Problem, x: Array, free: Mask | NDArray[np.intp]) -> Problem:
    """Return the problem of the free ones among the parameters, a mask or indices, the others being as in x."""

    def whole(values: Array) -> Array:
        full = x.copy()
        full[free] = values
        return full

    return Problem(lambda v: problem.residual(whole(v)), lambda v: problem.jacobian(whole(v))[:, free])


@dataclass(frozen=True)
class Solution:
    """The smallest sum of squares that was found.

    values: shape (m,). residual: shape (n,), jacobian: shape (n, m), both there.
    converged: whether the search ended at a minimum; message: how it ended, a sentence.
    """

    values: Array
    residual: Array
    jacobian: Array
    converged: bool
    message: str

    @property
    def sum_of_squares(self) -> float:
        """Return Σ r²."""
        return float(self.residual @ self.residual)

    @property
    def degrees_of_freedom(self) -> int:
        """Return n - m."""
        return self.residual.size - self.values.size

    def lean(self, k: int) -> Array:
        """Return how the numbers move along with number k, which moves by one, shape (m,)."""
        rest = np.delete(self.jacobian, k, axis=1)
        size = np.maximum(np.linalg.norm(rest, axis=0), 1e-300)
        return np.insert(-np.linalg.lstsq(rest / size, self.jacobian[:, k], rcond=1e-8)[0] / size, k, 1.0)


def solve(
    problem: Problem,
    *starts: ArrayLike,
    bounds: tuple[ArrayLike, ArrayLike] | None = None,
    tolerance: float = 1e-12,
    max_evaluations: int = 400,
) -> Solution:
    """Return the best solution over the starts.

    starts: one or more, shape (m,). bounds: (low, high), shape (m,) each, or None.
    tolerance: relative, of the sum of squares and of the parameters; 1e-15 asks for all that double precision has.
    max_evaluations: of each start.

    Levenberg-Marquardt as MINPACK has it (Moré 1978), columns scaled by their norms; with bounds the trust-region
    reflective method (Branch, Coleman, Li 1999). The Jacobian is the caller's, not differences.
    Raises RecordingError where there are fewer residuals than parameters, or none of the starts has finite residuals.
    """
    if not starts:
        raise ValueError("a search needs at least one start")
    found: list[Solution] = []
    for start in starts:
        first = problem.residual(np.asarray(start, dtype=float))
        if first.size < np.size(start):
            raise RecordingError(
                f"found {first.size} samples for {np.size(start)} parameters; record longer or fit a smaller model"
            )
        if _has_a_sum(first):
            found.append(_descend(problem, np.asarray(start, dtype=float), first, bounds, tolerance, max_evaluations))
    if not found:
        raise RecordingError(
            "the model runs away from every start; check the excitation, and the units of input and output"
        )
    return min(found, key=lambda solution: solution.sum_of_squares)


def _has_a_sum(residual: Array) -> bool:
    """Return whether the sum of squares is a number: a model that runs away may stay finite and yet have none."""
    with np.errstate(over="ignore", invalid="ignore"):
        return bool(np.isfinite(residual @ residual))


def _descend(
    problem: Problem,
    start: Array,
    first: Array,
    bounds: tuple[ArrayLike, ArrayLike] | None,
    tolerance: float,
    max_evaluations: int,
) -> Solution:
    huge = _HUGE * max(float(np.abs(first).max()), 1e-100)

    def residual(x: Array) -> Array:
        r = first if np.array_equal(x, start) else problem.residual(x)
        return r if _has_a_sum(r) else np.full(r.shape, huge)

    def jacobian(x: Array) -> Array:
        return np.nan_to_num(problem.jacobian(x), nan=0.0, posinf=0.0, neginf=0.0)

    low, high = (-np.inf, np.inf) if bounds is None else bounds
    box = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    end = optimize.least_squares(
        residual,
        np.clip(start, *box),
        jacobian,
        bounds=box,
        method="lm" if bounds is None else "trf",
        x_scale="jac",
        ftol=tolerance,
        xtol=tolerance,
        gtol=tolerance,
        max_nfev=max_evaluations,
    )
    return Solution(
        np.asarray(end.x, dtype=float),
        np.asarray(end.fun, dtype=float),
        np.asarray(end.jac, dtype=float),  # of a search without a loss function it is that at the solution
        bool(end.status > 0),
        _sentence(int(end.status), int(end.nfev)),
    )


def _sentence(status: int, evaluations: int) -> str:
    reasons: dict[int, str] = {
        1: "the gradient is zero to within the tolerance",
        2: "the sum of squares no longer changes",
        3: "the parameters no longer change",
        4: "neither the sum of squares nor the parameters change any more",
    }
    if status in reasons:
        return f"converged after {evaluations} evaluations: {reasons[status]}"
    return f"not converged after {evaluations} evaluations; start nearer, or give the search more of them"


# How certain a solution is, and what it cannot tell apart.
#
# Three covariances of the parameters, J being the Jacobian (n, m) and r the residuals at the solution:
#
# - classical, s² (JᵀJ)⁻¹ with s² = rᵀr/(n - m): right for independent residuals of one size;
# - coloured, (JᵀJ)⁻¹ JᵀΓJ (JᵀJ)⁻¹ with Γ the autocovariance of an autoregression through the residuals (see
#   `sinew.analysis.signal.least_squares`): for residuals that are correlated from sample to sample;
# - HAC, the same sandwich with the scores' own autocovariance, Σ_k w_k Σ_n J_n r_n r_{n+k} J_{n+k}ᵀ, Bartlett weights
#   (Newey and West 1987): for residuals that also change in size. It needs many samples.

CovarianceKind = Literal["classical", "coloured", "hac"]

_UNCERTAIN = 0.5  # natural scales: a direction whose standard deviation is larger is not determined
_TAKES_PART = 0.25  # of the largest component of such a direction


@dataclass(frozen=True)
class Covariance:
    """Covariance of parameters, shape (m, m), and the degrees of freedom behind its scale."""

    matrix: Array
    degrees_of_freedom: float

    @property
    def std(self) -> Array:
        """Return the standard deviations, shape (m,)."""
        return np.sqrt(np.maximum(np.diag(self.matrix), 0.0))


def covariance(
    jacobian: Array, residual: Array, kind: CovarianceKind = "classical", *, pieces: Sequence[slice] = ()
) -> Covariance:
    """Return the covariance of parameters that a least-squares fit left with this Jacobian and these residuals.

    jacobian: shape (n, m); residual: shape (n,), in time order and, for `coloured`, evenly sampled.
    pieces: stretches of the residuals that are recordings of their own; the default is one.
    A direction that the Jacobian does not see at all has an infinite variance.
    """
    n, m = jacobian.shape
    scale = np.linalg.norm(jacobian, axis=0)
    seen = scale > 0
    matrix = np.zeros((m, m))
    matrix[~seen, ~seen] = np.inf
    if not seen.any():
        return Covariance(matrix, max(n - m, 1))
    scaled = jacobian[:, seen] / scale[seen]
    bread = _inverse_gram(scaled)
    freedom = float(max(n - m, 1))
    if kind == "classical":
        inner = float(residual @ residual) / freedom * bread
    elif kind == "hac":
        inner = bread @ _scores(scaled * residual[:, None], pieces) * (n / freedom) @ bread
    elif len(pieces) <= 1:
        inner, freedom = sandwich(scaled, residual)
    else:
        filling, freedom = np.zeros_like(bread), 0.0
        for piece in pieces:
            own = scaled[piece]
            part, of_part = sandwich(own, residual[piece])
            gram = own.T @ own
            filling += gram @ part @ gram
            freedom += of_part + own.shape[1]
        inner = bread @ filling @ bread
        freedom = max(freedom - m, 1.0)
    matrix[np.ix_(seen, seen)] = inner / np.outer(scale[seen], scale[seen])
    return Covariance(matrix, freedom)


def _inverse_gram(scaled: Array) -> Array:
    """Return (JᵀJ)⁻¹ by singular values; by the Gram matrix half of the digits would be lost."""
    size, turned = _singular(scaled)
    retained = size > 1e-14 * size[0]
    return np.asarray((turned[retained].T / size[retained] ** 2) @ turned[retained])


def _singular(tall: Array) -> tuple[Array, Array]:
    """Return (singular values, right vectors) of a matrix (n, m), by its triangle: a third of the work."""
    _, size, turned = np.linalg.svd(np.linalg.qr(tall, mode="r"), full_matrices=False)
    return size, turned


def _scores(scores: Array, pieces: Sequence[slice]) -> Array:
    """Return the long-run covariance of the scores J_n r_n, Newey-West with Andrews' (1991) bandwidth for AR(1)."""
    total = np.zeros((scores.shape[1], scores.shape[1]))
    for piece in pieces or (slice(0, scores.shape[0]),):
        own = scores[piece]
        rho = np.clip(np.sum(own[1:] * own[:-1], axis=0) / np.maximum(np.sum(own**2, axis=0), 1e-300), -0.97, 0.97)
        alpha = float(np.max(4 * rho**2 / (1 - rho**2) ** 2))
        lags = min(int(1.1447 * (alpha * own.shape[0]) ** (1 / 3)), own.shape[0] // 4)
        total += long_run(own, lags)
    return total


def long_run(scores: Array, lags: int) -> Array:
    """Return the covariance of the sum of scores (n, m) whose neighbours go together, with Bartlett's weights, (m, m).

    Newey and West, Econometrica 55, 1987.
    """
    total = np.asarray(scores.T @ scores)
    for k in range(1, lags + 1):
        lagged = scores[:-k].T @ scores[k:]
        total += (1 - k / (lags + 1)) * (lagged + lagged.T)
    return total


def estimates(values: Array, certainty: Covariance) -> list[Estimate]:
    """Return one estimate for each parameter, 90 % intervals of Student; std NaN where the variance is infinite."""
    found = []
    for value, std in zip(values, certainty.std, strict=True):
        known = float(std) if np.isfinite(std) else np.nan
        found.append(Estimate.student(float(value), known, certainty.degrees_of_freedom))
    return found


def find_unidentifiable(names: Sequence[str], natural: Array, jacobian: Array, noise: float) -> tuple[str, ...]:
    """Return one sentence for each direction of the parameters that the record does not determine.

    names: what people call the parameters, m of them. natural: for each the size of a change that matters, shape (m,).
    jacobian: shape (n, m). noise: standard deviation of one residual, times the square root of the number of samples
        that share one independent draw where the residuals are correlated.

    In parameters measured in their natural scales, the eigenvectors of JᵀJ with noise²/eigenvalue > 0.5² are the
    directions along which the fit could move by half a natural scale and nobody would notice.
    """
    size, turned = _singular(jacobian * natural)
    sentences = []
    for s, direction in zip(size[::-1], turned[::-1], strict=True):
        if s > 0 and noise / s <= _UNCERTAIN and s > 1e-13 * size[0]:
            break
        part = np.abs(direction) > _TAKES_PART * np.abs(direction).max()
        taking = sorted(name for name, takes in zip(names, part, strict=True) if takes)
        sentences.append(
            f"{taking[0]} cannot be determined from this record"
            if len(taking) == 1
            else f"{', '.join(taking[:-1])} and {taking[-1]} cannot be told apart in this record"
        )
    return tuple(sentences)
