"""The paper's numbers as targets, with what is free to meet them and what the twin gives instead.

The paper prints four numbers that fix the joint's mechanics (resonance and gain at pretension 0 and 12 mm) and some
trends (damping ratio about constant, lag of 90° at the peak). Ten parameters of its rig are printed nowhere.
"""

import importlib.util
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Any, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.signal import find_peaks
from scipy.stats import truncnorm

from sinew.analysis.decay.paper_method import fit_envelope
from sinew.analysis.decay.ring_down import DECAY_FROM_PERIODS
from sinew.measure import tasks
from sinew.measure.arrays import Array, Mask
from sinew.measure.errors import SpecError, how_to_install
from sinew.plan.plan import Group
from sinew.plan.rig import RigSpec
from sinew.solve.march import Track
from sinew.solve.programs import configure
from sinew.twin.simulate import lane_parameters, simulate_tracks

_SAMPLE_HZ, _AMPLITUDE_DEG = 200.0, 20.0
_PRETENSION_MM = (0.0, 6.0, 12.0)
_RESONANCE_HZ = (3.0, 3.65, 4.3)
_TOTAL_INERTIA = 12.74e-3
_MOST_DEVIATIONS = 3.0
"""Standard deviations in a tolerance: the paper's numbers count with a third of their tolerance."""


class Stated(NamedTuple):
    """A number with what is meant to hold of it, in its unit.

    Of a free parameter its dotted name, what is thought likely, and how firmly (standard deviation); of a number of the
    paper its value, and the tolerance within which it is met.
    """

    name: str
    value: float
    within: float


@dataclass(frozen=True)
class Scale:
    """What was thought of the free parameters beforehand: a normal distribution each, cut off at the bounds.

    likely, width: mean and standard deviation of the uncut normal, (free,); low, high: bounds, (free,); SI units.
    """

    likely: Array
    width: Array
    low: Array
    high: Array

    @property
    def ends(self) -> tuple[Array, Array]:
        """The bounds in widths from the likely values, (free,)."""
        return (self.low - self.likely) / self.width, (self.high - self.likely) / self.width

    def at(self, x: Array) -> Array:
        """Return the parameters [SI] that lie so many widths from the likely values, inside the bounds; (free,)."""
        return np.asarray(np.clip(self.likely + self.width * x, self.low, self.high))


FREE = (
    Stated("tendons.head_radius", 0.0278, 0.008),
    Stated("tendons.first_contact_tension", 12.0, 8.0),
    Stated("silicone.diameter", 0.058, 0.008),
    Stated("silicone.loss_factor", 0.10, 0.06),
    Stated("inertia.lever", 8.3e-3, 1.6e-3),
    Stated("tendons.guide_friction", 4e-3, 4e-3),
    Stated("tendons.presliding_angle", 0.3, 0.4),
    Stated("drive.supply_voltage", 13.5, 1.0),
    Stated("drive.armature", 0.0125, 0.006),
    Stated("drive.friction", 0.25, 0.15),
)

TARGETS = (
    Stated("resonance_hz at 0 mm", 3.0, 0.1),
    Stated("resonance_hz at 12 mm", 4.3, 0.1),
    Stated("gain at 0 mm", 2.8, 0.15),
    Stated("gain at 12 mm", 1.4, 0.1),
    Stated("damping spread, 0 mm", 0.0, 0.06),
    Stated("damping spread, 6 mm", 0.0, 0.06),
    Stated("damping spread, 12 mm", 0.0, 0.06),
    Stated("90 degree crossing minus peak at 0 mm, Hz", 0.0, 0.3),
    Stated("90 degree crossing minus peak at 6 mm, Hz", 0.0, 0.3),
    Stated("90 degree crossing minus peak at 12 mm, Hz", 0.0, 0.3),
)


def rig_with(base: RigSpec, values: Array) -> RigSpec:
    """Return the rig with the free parameters at these values [SI], (free,); base radius and head inertia follow."""
    settings = {free.name: float(value) for free, value in zip(FREE, values, strict=True)}
    settings["tendons.base_radius"] = settings["tendons.head_radius"]
    settings["inertia.head"] = _TOTAL_INERTIA - settings["inertia.lever"]
    return base.with_values(settings, origin="calibrated")


def scale_of(base: RigSpec) -> Scale:
    """Return the prior of the free parameters: likely values and widths of `FREE`, bounds of the rig."""
    table = dict(base.parameters())
    low, high = np.array([table[free.name].bounds for free in FREE]).T
    return Scale(np.array([free.value for free in FREE]), np.array([free.within for free in FREE]), low, high)


def misfit(observed: Array) -> Array:
    """Return (observed - paper) in standard deviations, thirds of a tolerance; the last axis is the target."""
    value, tolerance = np.array([(target.value, target.within) for target in TARGETS]).T
    return np.asarray((observed - value) * _MOST_DEVIATIONS / tolerance)


def is_met(observed: Array) -> Mask:
    """Return whether all of the paper's numbers are met within their tolerance, over the leading axes."""
    return np.asarray((np.abs(misfit(observed)) <= _MOST_DEVIATIONS).all(axis=-1))


def paper_groups() -> list[Group]:
    """Return the reduced campaign: nine frequencies and one ring-down at three pretensions."""
    campaign = []
    for pretension, resonance in zip(_PRETENSION_MM, _RESONANCE_HZ, strict=True):
        for frequency in resonance + np.linspace(-0.8, 0.8, 9):
            record_s = 5 / float(frequency)
            campaign.append(Group("steady", pretension, float(frequency), _AMPLITUDE_DEG, 0, 3.0, record_s))
        stop = np.ceil(3.0 * resonance) / resonance
        campaign.append(Group("ring-down", pretension, resonance, _AMPLITUDE_DEG, 0, float(stop), 3.0))
    return campaign


def observe(rigs: Sequence[RigSpec]) -> Array:
    """Return what the paper measured, on the twin of every rig in one batch, shape (rig, target).

    Nothing is random: scatter and noise are off, and the true torsion is read.
    """
    campaign = paper_groups()
    lanes = [lane_parameters(campaign, rig) for rig in rigs]
    stacked = jax.tree.map(lambda *leaves: np.concatenate(leaves), *lanes)
    tracks = simulate_tracks(stacked, campaign * len(rigs), _SAMPLE_HZ)
    size = len(campaign)
    return np.array([_observe_one(campaign, tracks[i * size : (i + 1) * size]) for i in range(len(rigs))])


def _observe_one(campaign: list[Group], tracks: list[Track]) -> Array:
    peaks, gains, crossings, damping = [], [], [], []
    for pretension in _PRETENSION_MM:
        rows = [(g, t) for g, t in zip(campaign, tracks, strict=True) if g.pretension_mm == pretension]
        steady = [(g.frequency_hz, *_amplitudes(g, t)) for g, t in rows if g.kind == "steady"]
        frequency = np.array([row[0] for row in steady])
        response, drive = (np.array([row[k] for row in steady]) for k in (1, 2))
        curve = CubicSpline(frequency, np.abs(response) / np.radians(_AMPLITUDE_DEG))
        fine = np.linspace(frequency[0], frequency[-1], 1601)
        peaks.append(fine[np.argmax(curve(fine))])
        gains.append(float(np.max(curve(fine))))
        lag = CubicSpline(frequency, -np.unwrap(np.angle(response / drive)))(fine)
        crossings.append(float(np.interp(np.pi / 2, lag, fine)))
        damping += [_lehr(g, t) for g, t in rows if g.kind == "ring-down"]
    spread = np.array(damping) / np.mean(damping) - 1
    return np.array([peaks[0], peaks[2], gains[0], gains[2], *spread, *(np.array(crossings) - peaks)])


def _amplitudes(group: Group, track: Track) -> tuple[complex, complex]:
    """Return the complex fundamentals of torsion and lever over the recorded periods, by least squares."""
    start, count = group.sample_counts(_SAMPLE_HZ)
    time_s = np.arange(start, start + count) / _SAMPLE_HZ
    angle = 2 * np.pi * group.frequency_hz * time_s
    design = np.stack([np.sin(angle), np.cos(angle), np.ones(count)], axis=1)
    solution = np.linalg.lstsq(design, np.stack([track.torsion[start:], track.lever[start:]], axis=1))[0]
    return complex(solution[0, 0], solution[1, 0]), complex(solution[0, 1], solution[1, 1])


def _lehr(group: Group, track: Track) -> float:
    """Return λ/⟨ω⟩ of a free decay by the paper's method, on the true torsion from one period after the stop.

    In that period the lever is still settling on its servo; the analysis of a recording leaves it out as well. That the
    paper did so is assumed: aimed at with any other start, D can be made constant as well (decision 23).
    """
    start, _ = group.sample_counts(_SAMPLE_HZ)
    torsion = track.torsion[start + round(DECAY_FROM_PERIODS * _SAMPLE_HZ / group.frequency_hz) :]
    at, _ = find_peaks(np.abs(torsion), height=0.02 * float(np.abs(torsion).max()))
    if at.size < 4:
        return 1.0  # no oscillation to speak of: far outside the paper's numbers
    return fit_envelope(at / _SAMPLE_HZ, np.abs(torsion[at])).lehr_damping


# The undetermined parameters of the paper's rig are calibrated against the paper's numbers.
#
# Ten parameters are free and fewer numbers are printed, so the fit is a maximum a posteriori one: the paper's numbers
# with a third of their tolerance as standard deviation, each parameter with a weak normal prior about what is thought
# likely. Nothing is random, so the same rig gives the same values.

_DIGITS = 4


@dataclass(frozen=True)
class PaperFit:
    """A set of the free parameters and what the twin gives with it.

    values: to four digits, SI, (free,), in the order of `FREE`. observed: (target,), in the order of `TARGETS`.
    """

    rig: RigSpec
    values: Array
    observed: Array

    @property
    def met(self) -> bool:
        """Whether all of the paper's numbers are met within their tolerance."""
        return bool(is_met(self.observed))


def fit_paper(base: RigSpec) -> PaperFit:
    """Return the maximum a posteriori fit of the free parameters, from the likely values on."""
    scale = scale_of(base)
    low, high = scale.ends

    def rig_at(x: Array) -> RigSpec:
        return rig_with(base, scale.at(x))

    def residual(x: Array) -> Array:
        return np.concatenate([misfit(observe([rig_at(x)])[0]), x])

    def jacobian(x: Array) -> Array:
        h = 0.02
        seen = misfit(observe([rig_at(x + sign * h * row) for row in np.eye(x.size) for sign in (1, -1)]))
        return np.concatenate([((seen[0::2] - seen[1::2]) / (2 * h)).T, np.eye(x.size)])

    x0 = np.clip(np.zeros(len(FREE)), low + 1e-6, high - 1e-6)
    solution = least_squares(residual, x0, jacobian, bounds=(low, high), max_nfev=15, xtol=1e-3, ftol=1e-3)
    values = np.array([float(f"{value:.{_DIGITS}g}") for value in scale.at(solution.x)])
    rig = rig_with(base, values)
    return PaperFit(rig, values, observe([rig])[0])


# ---- What the paper's numbers determine: the posterior of the parameters it does not print.
#
# Likelihood: the paper's numbers, each normal with a third of its tolerance as standard deviation. Prior: a normal
# distribution for each free parameter, cut off at its bounds.
#
# The model takes long, so a surrogate proposes and the model itself accepts.
# Every misfit is approximated by a polynomial in the parameters. NUTS (NumPyro, the extra `posterior`) samples the
# posterior of that surrogate; its draws go as independent proposals into a Metropolis-Hastings chain whose acceptance
# uses the model (delayed acceptance). What comes out follows the model's own posterior, however rough the surrogate is:
# a bad one shows as a low acceptance, a large R-hat and a small effective sample size.


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
    accepted = np.zeros((chains, draws), dtype=np.intp)
    for i in range(1, draws):
        now = accepted[:, i - 1]
        moves = hurdle[:, i] < excess[:, i] - np.take_along_axis(excess, now[:, None], axis=1)[:, 0]
        accepted[:, i] = np.where(moves, i, now)
    values = np.take_along_axis(proposed, accepted[:, :, None], axis=1)
    acceptance = float((np.diff(accepted, axis=1) != 0).mean())
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
        """Return the misfits at some points, (point, target)."""
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


_LIMITS = (0.05, 0.95)
_BATCH = 64
_REST_MM = (0.0, 12.0)
_PRIOR_DRAWS = 1000
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

    def to_json(self) -> dict[str, Any]:
        """Return the quantiles to four digits, and the ratio of their widths."""
        low, high, median, *ends = (float(f"{x:.4g}") for x in (*self.prior90, self.median, *self.posterior90))
        return {"prior90": [low, high], "median": median, "posterior90": ends, "ratio": round(self.ratio, 3)}


@dataclass(frozen=True)
class PaperPosterior:
    """The posterior of the free parameters, in the order of `FREE`.

    parameters: by dotted name, SI; units: of them. derived: what follows from them at rest, unit in the key, see
    `rest_stiffness`. draws: what they are quantiles of; seed: of the sampling.
    """

    parameters: dict[str, Spread]
    units: dict[str, str]
    derived: dict[str, Spread]
    draws: Draws
    seed: int

    def intervals(self) -> dict[str, tuple[float, float]]:
        """Return the 90 % interval of every parameter, by dotted name, SI."""
        return {name: one.posterior90 for name, one in self.parameters.items()}

    def sentences(self) -> list[str]:
        """Return what the paper's numbers determine, and what they do not, in sentences."""
        both, draws = self.parameters | self.derived, self.draws
        known = [f"{name} ({one.ratio:.0%})" for name, one in both.items() if one.ratio < _DETERMINED]
        vague = [f"{name} ({one.ratio:.0%})" for name, one in both.items() if one.ratio > _UNDETERMINED]
        return [
            f"narrowed to less than half: {', '.join(known) or 'nothing'}",
            f"left at more than {_UNDETERMINED:.0%}: {', '.join(vague) or 'nothing'}",
            f"{draws.evaluations} evaluations of the twin, {draws.acceptance:.0%} of proposals accepted, largest R-hat "
            f"{draws.rhat.max():.3f}, smallest effective sample size {draws.ess.min():.0f}, seed {self.seed}",
        ]

    def to_json(self) -> dict[str, Any]:
        """Return the document that is stored beside the rig."""
        draws = self.draws
        return {
            "parameters": {
                name: {
                    "unit": self.units[name],
                    **one.to_json(),
                    "rhat": round(float(draws.rhat[i]), 4),
                    "ess": round(float(draws.ess[i])),
                }
                for i, (name, one) in enumerate(self.parameters.items())
            },
            "derived": {name: one.to_json() for name, one in self.derived.items()},
            "acceptance": round(draws.acceptance, 3),
            "evaluations": draws.evaluations,
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
    total = effort.first + effort.rounds * effort.points + effort.chains * effort.draws + 2 * len(FREE)

    def residual(points: Array) -> Array:
        nonlocal done
        rigs = [rig_with(base, scale.at(x)) for x in points]
        batches = [rigs[i : i + _BATCH] for i in range(0, len(rigs), _BATCH)]
        seen = {}
        for position, found in tasks.each_task(_misfit_of, batches, spread):
            seen[position] = found
            done += len(found)
            if progress is not None:
                progress(done, total)
        return np.concatenate([seen[position] for position in range(len(batches))])

    low, high = scale.ends
    start = (values - scale.likely) / scale.width
    draws = sample_posterior(residual, start, low, high, seed=seed, effort=effort)
    units = {free.name: table[free.name].unit for free in FREE}
    before = truncnorm(low, high).rvs((_PRIOR_DRAWS, start.size), random_state=np.random.default_rng(seed))
    derived = [
        [rest_stiffness(rig_with(base, scale.likely + scale.width * x), _REST_MM) for x in some]
        for some in (before, draws.flat)
    ]
    return summarise_draws(draws, scale, units, derived, seed)


def _misfit_of(rigs: Sequence[RigSpec]) -> Array:
    configure()  # another process may take it
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
    prior90 = (scale.likely + scale.width * prior.ppf(np.array(_LIMITS)[:, None])).T
    values = scale.likely + scale.width * draws.flat
    parameters = {name: _spread(prior90[i], values[:, i]) for i, name in enumerate(units)}
    before, after = ({name: np.array([row[name] for row in some]) for name in some[0]} for some in derived)
    further = {name: _spread(np.quantile(before[name], _LIMITS), after[name]) for name in before}
    return PaperPosterior(parameters, dict(units), further, draws, seed)


def _spread(prior90: Array, values: Array) -> Spread:
    (low, high), ends = prior90.tolist(), np.quantile(values, _LIMITS).tolist()
    return Spread((low, high), float(np.median(values)), (ends[0], ends[1]))
