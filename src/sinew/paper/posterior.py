"""What the paper's numbers determine: the posterior of the parameters it does not print.

Likelihood: the paper's numbers, each normal with a third of its tolerance as standard deviation. Prior: a normal
distribution for each free parameter, cut off at its bounds (`sinew.paper.numbers`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import truncnorm

from sinew.measure.arrays import Array
from sinew.paper.numbers import FREE, Scale, misfit, observe, rig_with, scale_of
from sinew.paper.sampler import Draws, Effort, sample_posterior
from sinew.plan.plan import Group
from sinew.plan.rig import RigSpec
from sinew.twin.simulate import lane_parameters

# The stiffness of a joint at rest is told apart: silicone, tendons, guides.


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
    progress: Callable[[float, float], None] | None = None,
) -> PaperPosterior:
    """Return the posterior of the free parameters given the paper's numbers.

    base: the rig; only its free parameters are changed. values: of the maximum a posteriori fit, (free,), SI.
    progress: called with (done, total) evaluations of the twin. Raises SpecError where NumPyro is not installed.
    """
    scale, table = scale_of(base), dict(base.parameters())
    effort, done = effort or Effort(), 0

    def residual(points: Array) -> Array:
        nonlocal done
        rigs = [rig_with(base, np.clip(scale.likely + scale.width * x, scale.low, scale.high)) for x in points]
        seen = []
        for i in range(0, len(rigs), _BATCH):
            seen.append(misfit(observe(rigs[i : i + _BATCH])))
            done += len(seen[-1])
            if progress is not None:
                progress(done, effort.evaluations + 2 * len(FREE))
        return np.concatenate(seen)

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
