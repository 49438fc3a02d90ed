"""This is where the posterior distribution of a fit's numbers is sampled, by NUTS (NumPyro, extra `posterior`).

The likelihood is that of `sinew.identify.posterior_density`: output error, stretched to the fit's robust covariance.

The priors are weak, and normal about zero in the normal form of `sinew.identify.track`, in which numbers are near one:
20 natural scales wide (`sinew.identify.model.NATURAL`), so a stiffness, damping, friction or nonlinear term up to ten
times what rules the motion is welcome; a loss factor about one wide; the creep time and memory, which a record hardly
tells, one natural scale. Stiffness, damping, loss factor and dry friction are not negative (half-normal), unless the
fit says so by more than two standard deviations. An interval of quantiles therefore never reaches zero for them:
whether there is dry friction at all is a question for the comparison of models.

The sampler moves in coordinates in which the fit's covariance is the identity, so it starts adapted and takes few
steps; a number that is not negative is the absolute value of one that moves freely.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from sinew.identify.fitted import Fit
from sinew.identify.numbers import number_names, physical_numbers
from sinew.identify.posterior_chains import effective_number, split_r_hat
from sinew.identify.posterior_density import Density, Laws, density_of, log_density, to_values
from sinew.measure.errors import SpecError
from sinew.measure.estimate import Estimate
from sinew.measure.extras import how_to_install
from sinew.twin.cache import configure

__all__ = ["Posterior", "sample_posterior"]

Array = NDArray[np.float64]

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
    return _described(fit, flat, chains, divergences, _better(fit, density, laws, flat))


def _require_numpyro() -> None:
    try:
        import numpyro.infer.hmc  # noqa: F401 - an optional extra: looked for, and loaded, only here
    except ImportError:
        raise SpecError(
            "the posterior needs NumPyro, which is not installed; take the intervals of the fit or of its profiles, or "
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


def _better(fit: Fit, density: Density, laws: Laws, values: Array) -> bool:
    """Return whether the chains went where the sum of squares is clearly smaller than the fit's."""
    few = values[:: max(1, values.shape[0] // 50)]
    problem = fit.layout.problem(fit.kept)
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
    told = [
        f"{values.shape[0]} draws of {chains} {'chain' if chains == 1 else 'chains'}, "
        f"R-hat at most {worst:.3f}, at least {fewest:.0f} effective"
    ]
    if divergences:
        told.append(f"{divergences} transitions diverged: take profile intervals beside these")
    if not (worst <= _UNMIXED and fewest >= _FEW):
        told.append("the chains have not mixed; ask for more draws and warm-up")
    if better:
        told.append("the chains found a better fit than the search; fit again from another start")
    told += [f"{sentence}: there the prior speaks" for sentence in fit.unidentifiable]
    return Posterior(names, draws, values, estimates, r_hat, effective, divergences, "; ".join(told))
