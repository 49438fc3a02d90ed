"""What the paper's numbers determine: the posterior of the parameters it does not print.

Likelihood: the paper's numbers, each normal with a third of its tolerance as standard deviation. Prior: a normal
distribution for each free parameter, cut off at its bounds (`sinew.paper.numbers`).
"""

import importlib.util
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import truncnorm

from sinew.measure import tasks
from sinew.measure.arrays import Array
from sinew.measure.errors import SpecError, how_to_install
from sinew.paper.numbers import FREE, Scale, misfit, observe, rig_with, scale_of
from sinew.plan.plan import Group
from sinew.plan.rig import RigSpec
from sinew.solve.programs import configure
from sinew.twin.simulate import lane_parameters

# ---- sampler of a posterior whose model takes long: a surrogate proposes, the model itself accepts
#
# Every misfit is approximated by a polynomial in the parameters. NUTS (NumPyro, the extra `posterior`) samples
# the posterior of that surrogate; its draws go as independent proposals into a Metropolis-Hastings chain whose
# acceptance uses the model (delayed acceptance). What comes out follows the model's own posterior, however rough the
# surrogate is: a bad one shows as a low acceptance, a large R-hat and a small effective sample size.


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


# The stiffness of a joint at rest is told apart: silicone, tendons, guides.


# ---- the posterior


def rest_stiffness(rig: RigSpec, pretension_mm: Sequence[float]) -> dict[str, float]:
    """Return tension and small-angle stiffness of the joint at rest, keys ending in `[12 mm]`.

    `tension_n` of each tendon. `tendon_stiffness_n_m_rad`: of n tendons at constant tension, n T r_b r_h/ℓ.
    `guide_stiffness_n_m_rad`: of guide friction before it breaks loose, μ n T/φ_s. `joint_stiffness_n_m_rad`: both
    with the relaxed silicone, G J/(L λ). `guide_torque_n_m`: of guide friction that has broken loose, μ n T.
    """
    groups = [Group("idle", p, np.nan, np.nan, 0, 0.0, 1.0) for p in pretension_mm]
    p, shortening = lane_parameters(groups, rig, mode="current")
    tendons = rig.tendons
    total = tendons.count * np.asarray(p.held_tension)
    tendon, silicone = tendons.stiffness(total, shortening), rig.silicone.stiffness(shortening)
    guide_torque, guide = tendons.guides.greatest_torque(total), tendons.guides.stiffness(total)
    rows = {
        "tension_n": total / tendons.count,
        "tendon_stiffness_n_m_rad": tendon,
        "guide_stiffness_n_m_rad": guide,
        "joint_stiffness_n_m_rad": silicone + tendon + guide,
        "guide_torque_n_m": guide_torque,
    }
    return {f"{name}[{at:g} mm]": float(row[i]) for i, at in enumerate(pretension_mm) for name, row in rows.items()}


_ENDS = (0.05, 0.95)
_BATCH = 64
_PRETENSION_MM = (0.0, 12.0)
_PRIOR_DRAWS = 1000
_SMALLEST_EXPONENT = 0.15
_DETERMINED, _UNDETERMINED = 0.5, 0.8


@dataclass(frozen=True)
class Spread:
    """How far a number can be before and after: 5 % and 95 % quantiles of prior and posterior, (low, high)."""

    prior90: tuple[float, float]
    median: float
    posterior90: tuple[float, float]

    @property
    def ratio(self) -> float:
        """Width of `posterior90` over that of `prior90`."""
        return (self.posterior90[1] - self.posterior90[0]) / (self.prior90[1] - self.prior90[0])


@dataclass(frozen=True)
class Combination:
    """A product of powers of parameters. exponents: by dotted name, the largest 1, those below 0.15 left out.

    ratio: standard deviation of it in the posterior over that in the prior, for small changes.
    factor90: the 90 % interval goes from the median over factor90 to the median times factor90.
    """

    exponents: dict[str, float]
    ratio: float
    factor90: float

    def __str__(self) -> str:
        return " · ".join(f"{name}^{power:g}" if power != 1 else name for name, power in self.exponents.items())


@dataclass(frozen=True)
class PaperPosterior:
    """The posterior of the free parameters, in the order of `FREE`.

    parameters: by dotted name, SI; units: of them. derived: what follows from them at rest, unit in the key, see
    `rest_stiffness`. rhat, ess: split R-hat and effective sample size of every parameter, (free,).
    directions: orthogonal combinations of the parameters, the best determined first.
    acceptance, evaluations, seed: of the sampling.
    """

    parameters: dict[str, Spread]
    units: dict[str, str]
    derived: dict[str, Spread]
    directions: tuple[Combination, ...]
    rhat: Array
    ess: Array
    acceptance: float
    evaluations: int
    seed: int

    def intervals(self) -> dict[str, tuple[float, float]]:
        """Return the 90 % interval of every parameter, by dotted name, SI."""
        return {name: one.posterior90 for name, one in self.parameters.items()}

    def sentences(self) -> list[str]:
        """Return what the paper's numbers determine, and what they do not, in sentences."""
        both = self.parameters | self.derived
        known = [f"{name} ({one.ratio:.0%})" for name, one in both.items() if one.ratio < _DETERMINED]
        vague = [f"{name} ({one.ratio:.0%})" for name, one in both.items() if one.ratio > _UNDETERMINED]
        strong = [one for one in self.directions if one.ratio < _DETERMINED]
        return [
            f"the paper's numbers narrow {len(strong)} of {len(self.directions)} orthogonal combinations to less than "
            "half of what was thought likely before",
            *(f"{one} is known to {_percent(one.factor90)}" for one in strong),
            f"narrowed to less than half: {', '.join(known) or 'nothing else'}",
            f"left at more than {_UNDETERMINED:.0%}: {', '.join(vague) or 'nothing'}",
            f"{self.evaluations} evaluations of the twin, {self.acceptance:.0%} of proposals accepted, largest R-hat "
            f"{self.rhat.max():.3f}, smallest effective sample size {self.ess.min():.0f}, seed {self.seed}",
        ]

    def to_json(self) -> dict[str, Any]:
        """Return the document that is stored beside the rig."""
        quality = [
            {"rhat": round(float(r), 4), "ess": round(float(n))} for r, n in zip(self.rhat, self.ess, strict=True)
        ]
        return {
            "parameters": {
                name: {"unit": self.units[name], **_spread_json(one), **row}
                for (name, one), row in zip(self.parameters.items(), quality, strict=True)
            },
            "derived": {name: _spread_json(one) for name, one in self.derived.items()},
            "directions": [
                {"exponents": one.exponents, "ratio": round(one.ratio, 4), "factor90": float(f"{one.factor90:.4g}")}
                for one in self.directions
            ],
            "acceptance": round(self.acceptance, 3),
            "evaluations": self.evaluations,
            "seed": self.seed,
            "sentences": self.sentences(),
        }


def paper_posterior(
    base: RigSpec,
    values: Array,
    *,
    seed: int,
    effort: Effort | None = None,
    spread: tasks.Spread = tasks.HERE,
    progress: Callable[[float, float], None] | None = None,
) -> PaperPosterior:
    """Return the posterior of the free parameters given the paper's numbers.

    base: the rig; only its free parameters are changed. values: of the maximum a posteriori fit, (free,), SI.
    spread: over which processes or cluster the evaluations go, in batches that are the same for any of them. progress:
    called with (done, total) evaluations of the twin. Raises SpecError where NumPyro is not installed.
    """
    scale, table = scale_of(base), dict(base.parameters())
    effort, done = effort or Effort(), 0

    def residual(points: Array) -> Array:
        nonlocal done
        rigs = [rig_with(base, np.clip(scale.likely + scale.width * x, scale.low, scale.high)) for x in points]
        batches = [rigs[i : i + _BATCH] for i in range(0, len(rigs), _BATCH)]
        seen = {}
        for place, found in tasks.each_task(_misfit_of, batches, spread):
            seen[place] = found
            done += len(found)
            if progress is not None:
                progress(done, effort.evaluations + 2 * len(FREE))
        return np.concatenate([seen[place] for place in range(len(batches))])

    low, high = scale.ends
    start = (values - scale.likely) / scale.width
    draws = sample_posterior(residual, start, low, high, seed=seed, effort=effort)
    units = {free.name: table[free.name].unit for free in FREE}
    before = truncnorm(low, high).rvs((_PRIOR_DRAWS, start.size), random_state=np.random.default_rng(seed))
    derived = [
        [rest_stiffness(rig_with(base, scale.likely + scale.width * x), _PRETENSION_MM) for x in some]
        for some in (before, draws.flat)
    ]
    return summarise_draws(draws, scale, units, derived, seed)


def _misfit_of(rigs: Sequence[RigSpec]) -> Array:
    configure()
    return misfit(observe(rigs))


def summarise_draws(
    draws: Draws, scale: Scale, units: Mapping[str, str], derived: Sequence[Sequence[Mapping[str, float]]], seed: int
) -> PaperPosterior:
    """Return the posterior that draws describe; they are in widths of the scale from its likely values.

    units: of the parameters, by name, in the order of the draws. derived: numbers that follow from draws of the prior
    and from the draws.
    """
    low, high = scale.ends
    prior = truncnorm(low, high)
    prior90 = (scale.likely + scale.width * prior.ppf(np.array(_ENDS)[:, None])).T
    values = scale.likely + scale.width * draws.flat
    parameters = {name: _spread(tuple(prior90[i].tolist()), values[:, i]) for i, name in enumerate(units)}
    before, after = derived
    numbers = {name: [np.array([row[name] for row in some]) for some in (before, after)] for name in before[0]}
    return PaperPosterior(
        parameters,
        dict(units),
        {name: _spread(_quantiles(one), other) for name, (one, other) in numbers.items()},
        tuple(_directions(draws.flat / prior.std(), values, scale.width * prior.std(), list(units))),
        draws.rhat,
        draws.ess,
        draws.acceptance,
        draws.evaluations,
        seed,
    )


def _spread(prior90: tuple[float, float], values: Array) -> Spread:
    return Spread(prior90, float(np.median(values)), _quantiles(values))


def _quantiles(values: Array) -> tuple[float, float]:
    low, high = np.quantile(values, _ENDS)
    return float(low), float(high)


def _directions(whitened: Array, values: Array, prior_std: Array, names: Sequence[str]) -> list[Combination]:
    """Return the eigenvectors of the posterior's covariance relative to the prior's as products of powers.

    whitened: draws in prior standard deviations, (draw, parameter): the prior's covariance is one there, so the root
    of an eigenvalue is the ratio of standard deviations along its eigenvector. A weight w of z is the power
    w · p / (prior std of p) of the parameter p, at its median.
    """
    found = []
    size, direction = np.linalg.eigh(np.cov(whitened, rowvar=False))
    for one, vector in zip(size, direction.T, strict=True):
        powers = vector * np.median(values, axis=0) / prior_std
        powers = powers / powers[np.argmax(np.abs(powers))]
        low, high = np.quantile(np.log(np.maximum(values, 1e-12)) @ powers, _ENDS)
        order = [int(i) for i in np.argsort(-np.abs(powers)) if abs(powers[i]) > _SMALLEST_EXPONENT]
        exponents = {names[i]: round(float(powers[i]), 2) for i in order}
        found.append(Combination(exponents, float(np.sqrt(one)), float(np.exp(0.5 * (high - low)))))
    return found


def _spread_json(one: Spread) -> dict[str, Any]:
    def digits(*numbers: float) -> list[float]:
        return [float(f"{number:.4g}") for number in numbers]

    return {
        "prior90": digits(*one.prior90),
        "median": digits(one.median)[0],
        "posterior90": digits(*one.posterior90),
        "ratio": round(one.ratio, 3),
    }


def _percent(factor: float) -> str:
    """Return half the width of a 90 % interval as text: percent where it is small, else a factor."""
    return f"±{100 * (factor - 1):.0f} %" if factor < 1.5 else f"a factor of {factor:.1f}"
