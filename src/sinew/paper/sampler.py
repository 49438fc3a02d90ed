"""Sampler of a posterior whose model takes long: a surrogate proposes, the model itself accepts.

Every misfit is approximated by a polynomial in the parameters. NUTS (NumPyro, the extra `posterior`) samples
the posterior of that surrogate; its draws go as independent proposals into a Metropolis-Hastings chain whose
acceptance uses the model (delayed acceptance). What comes out follows the model's own posterior, however rough the
surrogate is: a bad one shows as a low acceptance, a large R-hat and a small effective sample size.
"""

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from sinew.measure.arrays import Array
from sinew.measure.errors import SpecError, how_to_install

Residual = Callable[[Array], Array]

_RIDGES = 10.0 ** np.arange(-8, 2)
_DEGREES = (2, 3)
_WIDER = 1.2
"""How much wider than the normal approximation the first points lie."""
_WARM_UP, _THIN = 500, 5
_NEAR = 10.0
"""Chains of the surrogate start where the model's log density is at most this much below the highest."""


@dataclass(frozen=True)
class Effort:
    """How many points the model is evaluated at: `first` + `rounds` · `points` + `chains` · `draws`.

    The first points teach the surrogate about the start, each round where its own posterior lies by then; the draws
    are those of the answer.
    """

    first: int = 400
    rounds: int = 3
    points: int = 250
    chains: int = 4
    draws: int = 300

    @property
    def evaluations(self) -> int:
        """Number of points in all."""
        return self.first + self.rounds * self.points + self.chains * self.draws


@dataclass(frozen=True)
class Draws:
    """Draws of a posterior and how good they are.

    values: (chain, draw, parameter), in prior standard deviations. acceptance: share of proposals that the model
    accepted. rhat, ess: split R-hat and effective sample size of every parameter, (parameter,).
    evaluations: points at which the model was evaluated.
    """

    values: Array
    acceptance: float
    rhat: Array
    ess: Array
    evaluations: int

    @property
    def flat(self) -> Array:
        """All draws, (draw, parameter)."""
        return self.values.reshape(-1, self.values.shape[-1])


def require_sampler() -> None:
    """Raise SpecError where NumPyro is not installed."""
    if importlib.util.find_spec("numpyro") is None:
        raise SpecError(f"a posterior needs NumPyro, which is not installed; install it: {how_to_install('posterior')}")


def sample_posterior(
    residual: Residual, start: Array, low: Array, high: Array, *, seed: int, effort: Effort | None = None
) -> Draws:
    """Return draws of exp(-|residual(x)|²/2) times a standard normal prior that is cut off at `low` and `high`.

    residual: of points (point, parameter) the misfits (point, target), each in its standard deviations.
    start: a point of high posterior density, (parameter,).
    Raises SpecError where NumPyro is not installed.
    """
    require_sampler()
    effort = effort or Effort()
    rng = np.random.default_rng(seed)
    points, seen = np.empty((0, start.size)), np.empty((0, 0))

    def evaluate(fresh: Array) -> None:
        nonlocal points, seen
        found = residual(fresh)
        seen = np.concatenate([seen.reshape(-1, found.shape[1]), found])
        points = np.concatenate([points, fresh])

    def proposals(draws: int) -> tuple[_Surrogate, Array]:
        surrogate = _Surrogate.fitted(points, seen)
        height = -0.5 * ((seen**2).sum(axis=1) + (points**2).sum(axis=1))
        starts = rng.choice(points[height > height.max() - _NEAR], size=effort.chains)
        return surrogate, _surrogate_draws(surrogate, starts, low, high, draws, rng)

    evaluate(_first_points(residual, start, low, high, effort.first, rng))
    for _ in range(effort.rounds):
        _, sampled = proposals(-(-effort.points // effort.chains))
        evaluate(sampled.reshape(-1, start.size)[: effort.points])
    surrogate, proposed = proposals(effort.draws)
    flat = proposed.reshape(-1, start.size)
    evaluate(flat)
    excess = 0.5 * ((surrogate(flat) ** 2).sum(axis=1) - (seen[-len(flat) :] ** 2).sum(axis=1))
    return _accepted(proposed, excess.reshape(effort.chains, -1), rng, len(points))


def _accepted(proposed: Array, excess: Array, rng: np.random.Generator, evaluations: int) -> Draws:
    """Return the chains that accept independent proposals.

    excess: log density of the model less that of the surrogate that proposed, up to a constant, (chain, draw).
    """
    from numpyro.diagnostics import effective_sample_size, split_gelman_rubin

    chains, draws = excess.shape
    hurdle = np.log(rng.uniform(size=excess.shape))
    kept = np.zeros((chains, draws), dtype=np.intp)
    for i in range(1, draws):
        now = kept[:, i - 1]
        moves = hurdle[:, i] < excess[:, i] - np.take_along_axis(excess, now[:, None], axis=1)[:, 0]
        kept[:, i] = np.where(moves, i, now)
    values = np.take_along_axis(proposed, kept[:, :, None], axis=1)
    acceptance = float((np.diff(kept, axis=1) != 0).mean())
    rhat, ess = np.asarray(split_gelman_rubin(values)), np.asarray(effective_sample_size(values))
    return Draws(values, acceptance, rhat, ess, evaluations)


def _first_points(
    residual: Residual, start: Array, low: Array, high: Array, count: int, rng: np.random.Generator
) -> Array:
    """Return points about the start after the normal approximation of the posterior, widened, inside the bounds."""
    h = 0.05
    steps = h * np.eye(start.size)
    ahead, behind = np.minimum(start + steps, high), np.maximum(start - steps, low)
    seen = residual(np.concatenate([ahead, behind]))
    slope = (seen[: start.size] - seen[start.size :]) / np.diagonal(ahead - behind)[:, None]
    spread = np.linalg.cholesky(np.linalg.inv(slope @ slope.T + np.eye(start.size)))
    drawn = start + _WIDER * rng.standard_normal((count, start.size)) @ spread.T
    for end in (low, high):  # mirrored at the bounds
        drawn = np.where((drawn - end) * (0.5 * (low + high) - end) < 0, 2 * end - drawn, drawn)
    return np.clip(drawn, low, high)


@dataclass(frozen=True)
class _Surrogate:
    """A polynomial for every misfit. factors: (monomial, degree) indices into (1, x); weights: (monomial, target)."""

    factors: NDArray[np.intp]
    weights: Array

    @staticmethod
    def fitted(points: Array, seen: Array) -> "_Surrogate":
        """Return the ridge fit whose degree and penalty have the smallest leave-one-out error.

        Points count the less the further the model is off there: the posterior has nothing to do with them.
        """
        trust = 1 / (1 + 0.5 * (seen**2).mean(axis=1, keepdims=True))
        fits = []
        for degree in _DEGREES:
            factors = np.array(list(combinations_with_replacement(range(points.shape[1] + 1), degree)))
            error, weights = _ridge(_monomials(points, factors) * trust, seen * trust)
            fits.append((error, _Surrogate(factors, weights)))
        return min(fits, key=lambda one: one[0])[1]

    def __call__(self, points: Array) -> Array:
        return np.asarray(_monomials(points, self.factors) @ self.weights)


def _monomials(points: Array, factors: NDArray[np.intp]) -> Array:
    whole = np.concatenate([np.ones((len(points), 1)), points], axis=1)
    return np.asarray(whole[:, factors].prod(axis=-1))


def _ridge(design: Array, wanted: Array) -> tuple[float, Array]:
    """Return (sum of squared leave-one-out errors, weights) of the penalty for which that sum is smallest."""
    scale = np.sqrt((design**2).mean(axis=0))
    left, size, right = np.linalg.svd(design / scale, full_matrices=False)
    along = left.T @ wanted
    best = (np.inf, along)
    for penalty in _RIDGES * len(design):
        shrunk = size**2 / (size**2 + penalty)
        leverage = (left**2) @ shrunk
        off = (wanted - left @ (shrunk[:, None] * along)) / np.maximum(1 - leverage, 1e-9)[:, None]
        error = float((off**2).sum())
        if error < best[0]:
            best = (error, (right.T @ ((size / (size**2 + penalty))[:, None] * along)) / scale[:, None])
    return best


def _surrogate_draws(
    surrogate: _Surrogate, starts: Array, low: Array, high: Array, draws: int, rng: np.random.Generator
) -> Array:
    """Return draws of the surrogate's posterior by NUTS, every `_THIN`th, (chain, draw, parameter).

    starts: of the chains, (chain, parameter).
    """
    import jax
    import jax.numpy as jnp
    import numpyro
    import numpyro.distributions as dist
    from numpyro.infer import MCMC, NUTS

    factors, weights = jnp.asarray(surrogate.factors), jnp.asarray(surrogate.weights)
    prior = dist.TruncatedNormal(0.0, 1.0, low=jnp.asarray(low), high=jnp.asarray(high)).to_event(1)

    def model() -> None:
        x = numpyro.sample("x", prior)
        misfits = jnp.concatenate([jnp.ones(1), x])[factors].prod(axis=-1) @ weights
        numpyro.factor("misfit", -0.5 * (misfits**2).sum())

    sampler = MCMC(
        NUTS(model),
        num_warmup=_WARM_UP,
        num_samples=_THIN * draws,
        thinning=_THIN,
        num_chains=len(starts),
        chain_method="vectorized",
        progress_bar=False,
    )
    inside = np.clip(starts, low + 1e-3 * (high - low), high - 1e-3 * (high - low))
    free = dist.biject_to(prior.support).inv(jnp.asarray(inside))
    sampler.run(jax.random.key(int(rng.integers(2**31))), init_params={"x": free})
    return np.asarray(sampler.get_samples(group_by_chain=True)["x"], dtype=np.float64)
