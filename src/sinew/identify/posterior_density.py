"""This is where the logarithm of a fit's posterior density is computed, with its gradient, for JAX.

With S(x) the sum of squared residuals, x̂ the fit, s² = S(x̂)/(n - m), V the fit's covariance (robust to correlated
residuals and to misfit, see `sinew.identify.certainty`), ν its degrees of freedom and H = JᵀJ/s² the information that
independent residuals would carry, the likelihood is, its scale integrated out,

    ln L(x) = -(ν + m)/2 · ln(1 + q(x) (S(x) - S(x̂))/(s² ν)),    q(x) = dᵀV⁻¹d / dᵀHd,    d = x - x̂.

q makes the likelihood fall off as the robust covariance says, direction by direction (the vertical adjustment of
Chandler and Bate, Biometrika 94, 2007); what is not an ellipsoid in S stays so. For a linear model this is
Student's distribution about the fit with the fit's covariance. Whitening by an autoregression was the other choice: it
moves the centre away from the fit's, and takes the misfit of a model for noise that a difference filter removes.

Along directions that the record tells less than the prior, q is one.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from sinew.identify.fitted import Fit
from sinew.identify.layout import Layout, Part
from sinew.identify.model import NATURAL
from sinew.identify.track import (
    LARGEST_LOSS_FACTOR,
    LOCAL,
    DampingLaw,
    Grid,
    StiffnessLaw,
    traced_slopes,
    traced_track,
)

__all__ = ["PRIOR", "Density", "Laws", "density_of", "log_density", "prior_widths", "to_values"]

Array = NDArray[np.float64]

PRIOR: dict[str, float] = {name: 20.0 * scale for name, scale in NATURAL.items()} | {
    "loss_factor": LARGEST_LOSS_FACTOR,
    "creep_time": NATURAL["creep_time"],
    "memory": NATURAL["memory"],
}
"""Standard deviation of the normal prior about zero, in normal form; of the gain as a share of its value."""

_NEVER_NEGATIVE = ("stiffness", "damping", "loss_factor", "coulomb")
_FAR_BELOW = 2.0  # standard deviations: a fit that lies there is not forced to be positive


class Laws(NamedTuple):
    """What a simulation is compiled for; orders: of the derivative that each stack of records measured."""

    damping: DampingLaw
    stiffness: StiffnessLaw
    orders: tuple[int, ...]


class _Stack(NamedTuple):
    """Records of one shape, stacked: grid, what was measured on it, how much it counts, and where their numbers are.

    target, weight: shape (records, s + 1), the weight zero where there is no sample or none that was fitted.
    fixed: shape (records, 13); mixing: of the local numbers by those of the search, shape (records, 13, f); chosen:
    which those are, shape (records, f, m).
    """

    grid: Grid
    target: Array
    weight: Array
    fixed: Array
    mixing: Array
    chosen: Array


class Density(NamedTuple):
    """What a posterior density depends on; arrays only, so that code compiled for one fit serves the next.

    optimum: shape (m,). least: S there; variance: s²; freedom: ν. turned: B with dᵀHd = |B d|², shape (m, m).
    robust: A with dᵀV⁻¹d = (B d)ᵀA(B d). widths: of the prior, shape (m,). folded: 1 for a number that is never
    negative, else 0. root: the whitening u with x = x̂ + root·u, shape (m, m).
    """

    stacks: tuple[_Stack, ...]
    optimum: Array
    least: Array
    variance: Array
    freedom: Array
    turned: Array
    robust: Array
    widths: Array
    folded: Array
    root: Array


def prior_widths(fit: Fit) -> Array:
    """Return the standard deviation of the prior of every number of the search, shape (m,)."""
    widths = np.array([PRIOR[entry.local] for entry in fit.layout.entries])
    gain = [k for k, entry in enumerate(fit.layout.entries) if entry.local == "gain"]
    widths[gain] *= np.maximum(np.abs(fit.solution.values[gain]), 1e-6)
    return widths


def density_of(fit: Fit) -> tuple[Laws, Density]:
    """Return the posterior density of a fit: what is compiled for, and the arrays."""
    widths, x = prior_widths(fit), fit.solution.values
    n, m = fit.solution.jacobian.shape
    variance = max(fit.solution.sum_of_squares, 1e-300) / max(n - m, 1)
    turned, robust = _stretch(fit, widths, variance)
    precision = turned.T @ robust @ turned + np.diag(1.0 / widths**2)
    scaled = precision * np.outer(widths, widths)
    root = widths[:, None] * np.linalg.inv(np.linalg.cholesky(scaled)).T
    below = x < -_FAR_BELOW * np.nan_to_num(fit.covariance.std, posinf=np.inf)
    never = np.array([entry.local in _NEVER_NEGATIVE for entry in fit.layout.entries])
    folded = (never & ~below).astype(float)
    orders, stacks = _stacks(fit.layout, fit.kept)
    laws = Laws(fit.model.damping, fit.model.stiffness, orders)
    least, freedom = np.asarray(fit.solution.sum_of_squares), np.asarray(float(fit.covariance.degrees_of_freedom))
    return laws, Density(
        stacks, x, least, np.asarray(variance), freedom, turned, robust, widths, folded, np.asarray(root)
    )


def _stretch(fit: Fit, widths: Array, variance: float) -> tuple[Array, Array]:
    """Return (B, A): the classical information as BᵀB, and the robust one as BᵀAB."""
    jacobian = np.nan_to_num(fit.solution.jacobian) * widths / np.sqrt(variance)
    information, axes = np.linalg.eigh(jacobian.T @ jacobian)
    turned = np.sqrt(np.maximum(information, 0.0))[:, None] * axes.T / widths
    told = information > 1.0
    robust = np.eye(widths.size)
    if told.any():
        matrix = np.where(np.isfinite(fit.covariance.matrix), fit.covariance.matrix, 0.0)
        seen = turned[told] @ matrix @ turned[told].T
        size, direction = np.linalg.eigh(0.5 * (seen + seen.T))
        robust[np.ix_(told, told)] = (direction / np.maximum(size, 1e-3)) @ direction.T
    return turned, robust


def _stacks(layout: Layout, kept: tuple[NDArray[np.bool_], ...]) -> tuple[tuple[int, ...], tuple[_Stack, ...]]:
    alike: dict[tuple[int, int, int], list[_Stack]] = {}
    for i, (part, mask) in enumerate(zip(layout.parts, kept, strict=True)):
        key = part.order, part.grid.step.size, layout.index[i].size
        alike.setdefault(key, []).append(_one(layout, part, i, mask))
    return tuple(key[0] for key in alike), tuple(
        jax.tree.map(lambda *arrays: np.stack(arrays), *ones) for ones in alike.values()
    )


def _one(layout: Layout, part: Part, i: int, mask: NDArray[np.bool_]) -> _Stack:
    target, weight = np.zeros(part.grid.time.size), np.zeros(part.grid.time.size)
    target[part.samples] = part.record.output / part.unit_size
    weight[part.samples] = mask
    mixing = np.zeros((len(LOCAL), layout.index[i].size))
    mixing[layout.column[i], np.arange(layout.index[i].size)] = layout.ratio[i]
    chosen = np.eye(len(layout.entries))[layout.index[i]]
    fixed = part.fixed.copy()
    fixed[layout.column[i]] = 0.0
    grid = Grid(*(np.asarray(array, dtype=float) for array in part.grid))
    return _Stack(grid, target, weight, fixed, mixing, chosen)


def _squares(x: jax.Array, stack: _Stack, laws: Laws, order: int) -> tuple[jax.Array, jax.Array]:
    """Return the sum of squares of one stack and its gradient, shape (m,), by the simulation's forward derivatives."""

    def one(own: _Stack) -> tuple[jax.Array, jax.Array]:
        p = own.fixed + own.mixing @ (own.chosen @ x)
        residual = own.weight * (traced_track(p, own.grid, laws.damping, laws.stiffness, order) - own.target)
        slopes = traced_slopes(p, own.mixing.T, own.grid, laws.damping, laws.stiffness, order)
        return jnp.sum(residual**2), 2.0 * own.chosen.T @ (slopes.T @ residual)

    squares, gradients = jax.vmap(one)(stack)
    return jnp.sum(squares), jnp.sum(gradients, axis=0)


def _sum_of_squares(laws: Laws) -> Callable[[jax.Array, tuple[_Stack, ...]], jax.Array]:
    """Return S(x, stacks), whose gradient comes with it: that of the whole loop would be many times slower."""

    def both(x: jax.Array, stacks: tuple[_Stack, ...]) -> tuple[jax.Array, jax.Array]:
        found = [_squares(x, stack, laws, order) for stack, order in zip(stacks, laws.orders, strict=True)]
        return jnp.sum(jnp.stack([a for a, _ in found])), jnp.sum(jnp.stack([b for _, b in found]), axis=0)

    @jax.custom_vjp
    def squares(x: jax.Array, stacks: tuple[_Stack, ...]) -> jax.Array:
        return both(x, stacks)[0]

    def forward(x: jax.Array, stacks: tuple[_Stack, ...]) -> tuple[jax.Array, tuple[jax.Array, tuple[_Stack, ...]]]:
        value, gradient = both(x, stacks)
        return value, (gradient, stacks)

    def backward(
        kept: tuple[jax.Array, tuple[_Stack, ...]], cotangent: jax.Array
    ) -> tuple[jax.Array, tuple[_Stack, ...]]:
        return cotangent * kept[0], jax.tree.map(jnp.zeros_like, kept[1])

    squares.defvjp(forward, backward)
    return squares


def to_values(u: jax.Array, density: Density) -> jax.Array:
    """Return the vector of the search at whitened coordinates u, shape (m,); what is never negative is folded up."""
    x = density.optimum + density.root @ u
    return jnp.where(density.folded > 0, jnp.abs(x), x)


def log_density(u: jax.Array, density: Density, laws: Laws) -> jax.Array:
    """Return the logarithm of the posterior density at whitened coordinates u, shape (m,), less a constant."""
    x = to_values(u, density)
    risen = _sum_of_squares(laws)(x, density.stacks) - density.least
    y = density.turned @ (x - density.optimum)
    classical, robust = y @ y, y @ density.robust @ y
    far = classical > 1e-12
    stretched = jnp.where(far, robust / jnp.where(far, classical, 1.0), 1.0)
    share = jnp.maximum(stretched * risen / (density.variance * density.freedom), -0.999)
    likelihood = -0.5 * (density.freedom + x.size) * jnp.log1p(share)
    return jnp.asarray(likelihood - 0.5 * jnp.sum((x / density.widths) ** 2))
