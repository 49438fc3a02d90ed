"""The paper's numbers as targets, with what is free to meet them and what the twin gives instead.

The paper prints four numbers that fix the joint's mechanics (resonance and gain at pretension 0 and 12 mm) and some
trends (damping ratio about constant, lag of 90° at the peak). Ten parameters of its rig are printed nowhere.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.signal import find_peaks

from sinew.analysis.decay.free_decay import fit_envelope
from sinew.analysis.decay.ring_down import DECAY_FROM_PERIODS
from sinew.measure.arrays import Array, Mask
from sinew.measure.tasks import HERE, Spread, run_tasks
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

Progress = Callable[[float, float], None]
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


class _MetError(Exception):
    """Raised inside a search as soon as the paper's numbers are met."""


def fit_paper(base: RigSpec) -> PaperFit:
    """Return the maximum a posteriori fit of the free parameters, from the likely values on."""
    values, _ = _fit(base, scale_of(base).likely)
    values = np.array([float(f"{value:.{_DIGITS}g}") for value in values])
    rig = rig_with(base, values)
    return PaperFit(rig, values, observe([rig])[0])


def find_ranges(
    base: RigSpec, values: Array, progress: Progress | None = None, *, spread: Spread = HERE
) -> dict[str, dict[str, Any]]:
    """Return how far each free parameter can move until one of the paper's numbers is missed, by dotted name.

    values: of the fit, (free,). progress: called with (done, total) parameters. spread: over which processes or cluster
    the parameters go.
    A row is `{"value", "unit", "bounds", "alone", "together"}` in SI. alone: the others held, by bisection; together:
    the others readjusted at every step inside their bounds. Together is a search, not a proof: it may stop short of
    the true limit, never beyond it.
    """
    scale, table = scale_of(base), dict(base.parameters())
    found = run_tasks(_range_of, [(base, values, index) for index in range(len(FREE))], spread, progress)
    return {
        free.name: {
            "value": float(f"{values[index]:.6g}"),
            "unit": table[free.name].unit,
            "bounds": [float(scale.low[index]), float(scale.high[index])],
            "alone": [float(f"{v:.4g}") for v in found[index][0]],
            "together": [float(f"{v:.4g}") for v in found[index][1]],
        }
        for index, free in enumerate(FREE)
    }


def _range_of(task: tuple[RigSpec, Array, int]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return how far a parameter can move, (alone, together)."""
    configure()
    return _alone(*task), _together(*task)


def _fit(
    base: RigSpec, start: Array, fixed: dict[int, float] | None = None, *, steps: int = 15, prior: float = 1.0
) -> tuple[Array, Array]:
    """Return (values, observed) of the maximum a posteriori fit.

    fixed: parameters that are held, by index. prior: weight of the prior; below 1 the search also ends as soon as
    all of the paper's numbers are met.
    """
    scale = scale_of(base)
    likely, width = scale.likely, scale.width
    free = np.array([i for i in range(len(FREE)) if i not in (fixed or {})])
    values = np.clip(start, scale.low, scale.high)
    for i, value in (fixed or {}).items():
        values[i] = value
    best: list[Array] = []

    def complete(x: Array) -> Array:
        whole = values.copy()
        whole[free] = np.clip(likely[free] + width[free] * x, scale.low[free], scale.high[free])
        return whole

    def residual(x: Array) -> Array:
        observed = observe([rig_with(base, complete(x))])[0]
        if prior < 1 and is_met(observed):
            best[:] = [complete(x), observed]
            raise _MetError
        return np.concatenate([misfit(observed), prior * x])

    def jacobian(x: Array) -> Array:
        h = 0.02
        moved = [x + sign * h * row for row in np.eye(free.size) for sign in (1, -1)]
        seen = misfit(observe([rig_with(base, complete(m)) for m in moved]))
        return np.concatenate([((seen[0::2] - seen[1::2]) / (2 * h)).T, prior * np.eye(free.size)])

    low, high = (end[free] for end in scale.ends)
    x0 = np.clip((values[free] - likely[free]) / width[free], low + 1e-6, high - 1e-6)
    try:
        solution = least_squares(residual, x0, jacobian, bounds=(low, high), max_nfev=steps, xtol=1e-3, ftol=1e-3)
    except _MetError:
        return best[0], best[1]
    final = complete(solution.x)
    return final, observe([rig_with(base, final)])[0]


def _alone(base: RigSpec, values: Array, index: int) -> tuple[float, float]:
    scale = scale_of(base)

    def met(value: float) -> bool:
        return bool(is_met(observe([rig_with(base, np.where(np.arange(len(FREE)) == index, value, values))])[0]))

    return _edge(met, values[index], scale.low[index], 7), _edge(met, values[index], scale.high[index], 7)


def _together(base: RigSpec, values: Array, index: int) -> tuple[float, float]:
    scale = scale_of(base)
    ends = []
    for bound in (scale.low[index], scale.high[index]):
        last = values

        def met(value: float) -> bool:
            nonlocal last
            found, observed = _fit(base, last, {index: value}, steps=8, prior=0.1)
            if is_met(observed):
                last = found
            return bool(is_met(observed))

        ends.append(_edge(met, values[index], float(bound), 4))
    return ends[0], ends[1]


def _edge(met: Callable[[float], bool], inside: float, bound: float, halvings: int) -> float:
    """Return the value nearest to `bound` for which `met` holds, by bisection from a value for which it does."""
    if met(bound):
        return float(bound)
    outside = bound
    for _ in range(halvings):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if met(middle) else (inside, middle)
    return float(inside)
