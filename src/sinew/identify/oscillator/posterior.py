"""Posterior distribution of a fit's numbers, sampled by NUTS (NumPyro, extra `posterior`).

The likelihood is output error, stretched to the fit's robust covariance.

The priors are weak, and normal about zero in the normal form of `sinew.identify.oscillator.track`, in which numbers are
near one: 20 natural scales wide (`Number.natural` of `sinew.mechanics.laws`), so a stiffness, damping, friction or
nonlinear term up to ten times what rules the motion is welcome; a loss factor about one wide; the creep time and
memory, which a record hardly tells, one natural scale. Stiffness, damping, loss factor and dry friction are not
negative (half-normal), unless the fit says so by more than two standard deviations. An interval of quantiles therefore
never reaches zero for them: whether there is dry friction at all is a question for the comparison of models.

The sampler moves in coordinates in which the fit's covariance is the identity, so it starts adapted and takes few
steps; a number that is not negative is the absolute value of one that moves freely.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy import special, stats

from sinew.identify.oscillator.model import Fit, Layout, Part, number_names, physical_numbers
from sinew.identify.oscillator.track import LOCAL, Grid, traced_slopes, traced_track
from sinew.measure.arrays import Array, Mask
from sinew.measure.errors import SpecError, how_to_install
from sinew.measure.estimate import Estimate
from sinew.mechanics.laws import Law
from sinew.solve.programs import configure

# The logarithm of a fit's posterior density is computed, with its gradient, for JAX.
#
# With S(x) the sum of squared residuals, x̂ the fit, s² = S(x̂)/(n - m), V the fit's covariance (robust to correlated
# residuals and to misfit, see `sinew.identify.oscillator.least_squares`), ν its degrees of freedom and H = JᵀJ/s² the
# information that independent residuals would carry, the likelihood is, its scale integrated out,
#
#     ln L(x) = -(ν + m)/2 · ln(1 + q(x) (S(x) - S(x̂))/(s² ν)),    q(x) = dᵀV⁻¹d / dᵀHd,    d = x - x̂.
#
# q makes the likelihood fall off as the robust covariance says, direction by direction (the vertical adjustment of
# Chandler and Bate, Biometrika 94, 2007); what is not an ellipsoid in S stays so. For a linear model this is
# Student's distribution about the fit with the fit's covariance. Whitening by an autoregression was the other choice:
# it moves the centre away from the fit's, and takes the misfit of a model for noise that a difference filter removes.
#
# Along directions that the record tells less than the prior, q is one.


PRIOR: dict[str, float] = {name: one.prior or 20.0 * one.natural for name, one in LOCAL.items()}
"""Standard deviation of the normal prior about zero, in normal form; of the gain as a share of its value."""

_FAR_BELOW = 2.0  # standard deviations: a fit that lies there is not forced to be positive


class Laws(NamedTuple):
    """What a simulation is compiled for; orders: of the derivative that each stack of records measured."""

    law: Law
    orders: tuple[int, ...]


class _Stack(NamedTuple):
    """Records of one shape, stacked: grid, what was measured on it, how much it counts, and where their numbers are.

    target, weight: shape (records, s + 1), the weight zero where there is no sample or none that was fitted.
    fixed: shape (records, local); mixing: of the local numbers by those of the search, shape (records, local, f);
    chosen: which those are, shape (records, f, m).
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
    never = np.array([LOCAL[entry.local].positive for entry in fit.layout.entries])
    folded = (never & ~below).astype(float)
    orders, stacks = _stacks(fit.layout, fit.selected)
    laws = Laws(fit.model.law.compiled, orders)
    least, freedom = np.asarray(fit.solution.sum_of_squares), np.asarray(float(fit.covariance.degrees_of_freedom))
    return laws, Density(
        stacks, x, least, np.asarray(variance), freedom, turned, robust, widths, folded, np.asarray(root)
    )


def _stretch(fit: Fit, widths: Array, variance: float) -> tuple[Array, Array]:
    """Return (B, A): the classical information as BᵀB, and the robust one as BᵀAB."""
    jacobian = np.nan_to_num(fit.solution.jacobian) * widths / np.sqrt(variance)
    information, axes = np.linalg.eigh(jacobian.T @ jacobian)
    turned = np.sqrt(np.maximum(information, 0.0))[:, None] * axes.T / widths
    informed = information > 1.0
    robust = np.eye(widths.size)
    if informed.any():
        matrix = np.where(np.isfinite(fit.covariance.matrix), fit.covariance.matrix, 0.0)
        seen = turned[informed] @ matrix @ turned[informed].T
        size, direction = np.linalg.eigh(0.5 * (seen + seen.T))
        robust[np.ix_(informed, informed)] = (direction / np.maximum(size, 1e-3)) @ direction.T
    return turned, robust


def _stacks(layout: Layout, selected: tuple[Mask, ...]) -> tuple[tuple[int, ...], tuple[_Stack, ...]]:
    alike: dict[tuple[int, int, int], list[_Stack]] = {}
    for i, (part, mask) in enumerate(zip(layout.parts, selected, strict=True)):
        key = part.order, part.grid.step.size, layout.index[i].size
        alike.setdefault(key, []).append(_one(layout, part, i, mask))
    return tuple(key[0] for key in alike), tuple(
        jax.tree.map(lambda *arrays: np.stack(arrays), *ones) for ones in alike.values()
    )


def _one(layout: Layout, part: Part, i: int, mask: Mask) -> _Stack:
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
        residual = own.weight * (traced_track(p, own.grid, laws.law, order) - own.target)
        slopes = traced_slopes(p, own.mixing.T, own.grid, laws.law, order)
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
        selected: tuple[jax.Array, tuple[_Stack, ...]], cotangent: jax.Array
    ) -> tuple[jax.Array, tuple[_Stack, ...]]:
        return cotangent * selected[0], jax.tree.map(jnp.zeros_like, selected[1])

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


def split_r_hat(draws: Array) -> float:
    """Return the larger of the split R-hat of the ranks and of the ranks of the distance from the median.

    draws: shape (chain, draw). Infinite where chains stand still at different places, NaN where draws are not finite.
    """
    from numpyro.diagnostics import split_gelman_rubin

    if not np.isfinite(draws).all():
        return float("nan")
    return max(float(split_gelman_rubin(_scores(one))) for one in (draws, np.abs(draws - np.median(draws))))


def effective_number(draws: Array) -> float:
    """Return the bulk effective number of draws; draws: shape (chain, draw). NaN where draws are not finite."""
    from numpyro.diagnostics import effective_sample_size

    if not np.isfinite(draws).all():
        return float("nan")
    half = draws.shape[1] // 2
    with np.errstate(divide="ignore", invalid="ignore"):  # chains that stand still
        return float(effective_sample_size(_scores(np.concatenate([draws[:, :half], draws[:, -half:]]))))


def _scores(draws: Array) -> Array:
    """Return the normal scores of the ranks (Vehtari and others 2021)."""
    ranks = stats.rankdata(draws).reshape(draws.shape)
    return np.asarray(special.ndtri((ranks - 0.375) / (draws.size + 0.25)), dtype=float)


_BLOCK = 50  # transitions between two words of progress; one length, for it is compiled in
_DEPTH = 8  # doublings of a trajectory at most
_ACCEPTED = 0.8
_UNMIXED, _FEW = 1.02, 100.0  # R-hat above which, effective draws below which chains are not to be trusted
_BETTER = 4.0  # residual variances: a rise of the likelihood over the fit's that says the fit is not the best


@dataclass(frozen=True)
class Posterior:
    """Draws from the posterior distribution of a fit's numbers.

    names: those of `Fit.parameters`, natural_frequency_hz and damping_ratio. draws: in their units, shape (draw, name),
        all chains in turn. values: the same draws in normal form, in the order of `Fit.names`, shape (draw, m).
    estimates: by name: median, standard deviation, 5 and 95 % quantiles of the draws.
    r_hat, effective: by name: split R-hat and bulk effective number of draws, both of ranks (Vehtari and others 2021).
    divergences: transitions, after the warm-up, that the integrator could not follow.
    message: how the sampling went, and what the record does not tell, in sentences.
    """

    names: tuple[str, ...]
    draws: Array
    values: Array
    estimates: dict[str, Estimate]
    r_hat: dict[str, float]
    effective: dict[str, float]
    divergences: int
    message: str


def sample_posterior(
    fit: Fit,
    *,
    seed: int = 0,
    draws: int = 1000,
    warmup: int = 500,
    chains: int = 2,
    progress: Callable[[float, float], None] | None = None,
) -> Posterior:
    """Return draws from the posterior of a fit.

    draws: kept of each chain; warmup: transitions before that, of each chain. progress: takes (done, total).
    The same seed gives the same draws. It takes about ten seconds for a decay of 3 s, several times that with dry
    friction, and minutes for a sweep of a minute or many records together.
    Raises SpecError where NumPyro is not installed or a count is too small.
    """
    if chains < 1 or draws < 20 or warmup < 50:
        raise SpecError(
            f"found {chains} chains of {draws} draws after {warmup}; expected at least 1 of 20 after 50 of warm-up"
        )
    _require_numpyro()
    configure()
    laws, density = density_of(fit)
    moved, divergences = _run(laws, density, seed, draws, warmup, chains, progress)
    values = np.asarray(jax.vmap(jax.vmap(lambda u: to_values(u, density)))(moved), dtype=float)
    flat = values.reshape(-1, values.shape[-1])
    return _described(fit, flat, chains, divergences, _better(fit, density, flat))


def _require_numpyro() -> None:
    try:
        import numpyro.infer.hmc  # noqa: F401 - an optional extra: looked for, and loaded, only here
    except ImportError:
        raise SpecError(
            "the posterior needs NumPyro, which is not installed; take the intervals of the fit, or "
            f"install it: {how_to_install('posterior')}"
        ) from None


@cache
def _sampler(laws: Laws, warmup: int) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Return (begin, advance), compiled once for the laws and the shapes of the records, whatever their samples."""
    from numpyro.infer.hmc import hmc
    from numpyro.infer.util import ParamInfo

    def potential(density: Density) -> Callable[[jax.Array], jax.Array]:
        return lambda u: -log_density(u, density, laws)

    init, kernel = hmc(potential_fn_gen=potential, algo="NUTS")

    @jax.jit
    def begin(key: jax.Array, u: jax.Array, density: Density) -> Any:
        def one(own_key: jax.Array, own: jax.Array) -> Any:
            # Energy and force of the Gaussian approximation serve for the very first step and save a compilation.
            energy = 0.5 * jnp.sum(own**2) + 0.5 * jnp.sum((density.optimum / density.widths) ** 2)
            return init(
                ParamInfo(own, energy, own),
                num_warmup=warmup,
                step_size=0.5,
                target_accept_prob=_ACCEPTED,
                dense_mass=True,
                max_tree_depth=_DEPTH,
                model_args=(density,),
                rng_key=own_key,
            )

        return jax.vmap(one)(jax.random.split(key, u.shape[0]), u)

    @jax.jit
    def advance(state: Any, density: Density) -> Any:
        def step(now: Any, _: None) -> tuple[Any, tuple[jax.Array, jax.Array]]:
            after = jax.vmap(lambda own: kernel(own, model_args=(density,)))(now)
            return after, (after.z, after.diverging)

        return jax.lax.scan(step, state, length=_BLOCK)

    return begin, advance


def _run(
    laws: Laws,
    density: Density,
    seed: int,
    draws: int,
    warmup: int,
    chains: int,
    progress: Callable[[float, float], None] | None,
) -> tuple[Array, int]:
    """Return whitened draws, shape (chain, draw, m), and how many transitions diverged."""
    begin, advance = _sampler(laws, warmup)
    keys = jax.random.split(jax.random.key(seed))
    start = jax.random.normal(keys[0], (chains, density.optimum.size))  # spread as the fit's covariance is
    state = begin(keys[1], start, density)
    blocks = []
    for done in range(0, warmup + draws, _BLOCK):
        state, block = advance(state, density)
        blocks.append([np.asarray(one) for one in block])
        if progress is not None:
            progress(min(done + _BLOCK, warmup + draws), warmup + draws)
    moved, diverging = (np.concatenate(parts)[warmup : warmup + draws] for parts in zip(*blocks, strict=True))
    return np.swapaxes(moved, 0, 1), int(diverging.sum())


def _better(fit: Fit, density: Density, values: Array) -> bool:
    """Return whether the chains went where the sum of squares is clearly smaller than the fit's."""
    few = values[:: max(1, values.shape[0] // 50)]
    problem = fit.layout.problem(fit.selected)
    least = min(float(np.sum(problem.residual(x) ** 2)) for x in few)
    return bool(least < float(density.least) - _BETTER * float(density.variance))


def _described(fit: Fit, values: Array, chains: int, divergences: int, better: bool) -> Posterior:
    names, draws = number_names(fit), physical_numbers(fit, values)
    estimates, r_hat, effective = {}, {}, {}
    for name, column in zip(names, draws.T, strict=True):
        low, middle, high = np.quantile(column, [0.05, 0.5, 0.95])
        estimates[name] = Estimate(float(middle), float(np.std(column, ddof=1)), float(low), float(high))
        by_chain = column.reshape(chains, -1)
        r_hat[name], effective[name] = split_r_hat(by_chain), effective_number(by_chain)
    worst, fewest = max(r_hat.values()), min(effective.values())
    lines = [
        f"{values.shape[0]} draws of {chains} {'chain' if chains == 1 else 'chains'}, "
        f"R-hat at most {worst:.3f}, at least {fewest:.0f} effective"
    ]
    if divergences:
        lines.append(f"{divergences} transitions diverged: these intervals may be too narrow")
    if not (worst <= _UNMIXED and fewest >= _FEW):
        lines.append("the chains have not mixed; ask for more draws and warm-up")
    if better:
        lines.append("the chains found a better fit than the search; fit again from another start")
    lines += [f"{sentence}: there the prior speaks" for sentence in fit.unidentifiable]
    return Posterior(names, draws, values, estimates, r_hat, effective, divergences, "; ".join(lines))
