"""The result of a fit: numbers with intervals, what they do not tell, and how well they predict."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from sinew.identify.oscillator.least_squares import Covariance, Solution, correlation, estimates, find_unidentifiable
from sinew.identify.oscillator.model import Layout, Model, free_mechanics, parameter_name
from sinew.identify.oscillator.record import Frame, Record, derivative_order
from sinew.identify.oscillator.track import LOCAL
from sinew.measure.arrays import Array, Mask
from sinew.measure.estimate import Estimate
from sinew.mechanics.laws import HISTORIES, NUMBERS, Cycle, Law, LossFactor

# The numbers of a solution get their names, units and intervals.


def _scaled(estimate: Estimate, factor: float) -> Estimate:
    ends = sorted((estimate.low * factor, estimate.high * factor))
    return Estimate(estimate.value * factor, estimate.std * abs(factor), ends[0], ends[1])


def mechanical_parameters(layout: Layout, solution: Solution, certainty: Covariance) -> dict[str, Estimate]:
    """Return the mechanical numbers by name with unit, over the inertia and, where the input is a torque or force in
    N m or N on an angle or a length, in full."""
    record, scales = layout.parts[0].record, layout.parts[0].scales
    found, full = {}, {}
    gain = next((k for k, entry in enumerate(layout.entries) if entry.local == "gain"), None)
    kind = _FULL.get((record.motion_unit, record.input_unit)) if gain is not None else None
    for k, one in enumerate(estimates(solution.values, certainty)):
        entry = layout.entries[k]
        if entry.local not in free_mechanics(layout.model, record):
            continue
        name = parameter_name(entry.local, record.excitation, record.motion_unit, record.input_motion_unit)
        found[name + (entry.label() if entry.group else "")] = _scaled(one, scales.physical(entry.local))
        if kind is not None and gain is not None and (entry.local == "gain" or LOCAL[entry.local].force):
            called = kind[0] if entry.local == "gain" else LOCAL[entry.local].in_full(*kind[1:])
            factor = (1.0 if entry.local == "gain" else scales.physical(entry.local)) / scales.physical("gain")
            whole = _over(k, gain, solution.values, certainty)
            full[called + (entry.label() if entry.group else "")] = _scaled(whole, factor)
    return found | full


_FULL = {("rad", "N*m"): ("inertia_kg_m2", "n_m", "rad"), ("m", "N"): ("mass_kg", "n", "m")}
"""By the units of motion and input what the gain becomes in full, 1/gain, and the words of the units in other names."""


def _over(k: int, gain: int, x: Array, certainty: Covariance) -> Estimate:
    """Return x[k]/x[gain], or 1/x[gain] for k = gain, to first order."""
    slope = np.zeros(x.size)
    top = 1.0 if k == gain else float(x[k])
    slope[gain] = -top / x[gain] ** 2
    if k != gain:
        slope[k] = 1.0 / x[gain]
    return Estimate.student(top / float(x[gain]), _std(slope, certainty), certainty.degrees_of_freedom)


def nuisance_parameters(layout: Layout, solution: Solution, certainty: Covariance) -> dict[str, Estimate]:
    """Return start and rest position of every record; the creep time is the logarithm of its share of the record."""
    found = {}
    for entry, one in zip(layout.entries, estimates(solution.values, certainty), strict=True):
        part = layout.parts[max(entry.record, 0)]
        if entry.local in layout.model.nuisance(part.record.excitation):
            scaled = entry.local in ("offset", "drift")
            factor = part.unit_size if scaled else part.scales.physical(entry.local)
            found[entry.local + entry.label()] = _scaled(one, factor)
    return found


def oscillation(layout: Layout, solution: Solution, certainty: Covariance) -> tuple[Estimate, Estimate]:
    """Return natural frequency [Hz] and damping ratio of the first group, standard deviations to first order.

    Both are NaN where the stiffness is not told from zero, its 90 % interval holding it: what no spring brings back has
    no frequency.
    """
    entries, x = layout.entries, solution.values
    at = {entry.local: k for k, entry in reversed(list(enumerate(entries)))}
    stiffness = float(x[at["stiffness"]])
    freedom = certainty.degrees_of_freedom
    std = float(certainty.std[at["stiffness"]])
    if not stiffness > (float(special.stdtrit(freedom, 0.95)) * std if std else 0.0):
        unknown = Estimate(np.nan, np.nan, np.nan, np.nan)
        return unknown, unknown
    root = float(np.sqrt(stiffness))
    hertz = layout.parts[0].scales.omega / (2 * np.pi)
    slope = np.zeros(x.size)
    slope[at["stiffness"]] = hertz / (2 * root)
    frequency = Estimate.student(hertz * root, _std(slope, certainty), freedom)
    slope = np.zeros(x.size)
    if layout.model.law.has(LossFactor):
        slope[at["loss_factor"]] = 0.5
        return frequency, Estimate.student(0.5 * float(x[at["loss_factor"]]), _std(slope, certainty), freedom)
    damping = float(x[at["damping"]]) / (2 * root)
    slope[at["damping"]] = 1 / (2 * root)
    slope[at["stiffness"]] = -damping / (2 * stiffness)
    return frequency, Estimate.student(damping, _std(slope, certainty), freedom)


def _std(slope: Array, certainty: Covariance) -> float:
    part = np.flatnonzero(slope)
    variance = float(slope[part] @ certainty.matrix[np.ix_(part, part)] @ slope[part])
    return float(np.sqrt(max(variance, 0.0)))


def words_and_scales(layout: Layout, values: Array) -> tuple[list[str], Array]:
    """Return what people call the numbers of a layout, and for each the change that matters, shape (m,)."""
    natural = np.array([LOCAL[entry.local].natural for entry in layout.entries])
    gain = [k for k, entry in enumerate(layout.entries) if entry.local == "gain"]
    natural[gain] = 0.5 * np.maximum(np.abs(values[gain]), 1e-6)
    words = [LOCAL[entry.local].word + (f" of {entry.group}" if entry.group else "") for entry in layout.entries]
    return words, natural


def unidentifiable_directions(layout: Layout, solution: Solution, certainty: Covariance) -> tuple[str, ...]:
    """Return one sentence for each direction that the records do not determine."""
    names, natural = words_and_scales(layout, solution.values)
    n, m = solution.jacobian.shape
    shared = n / (certainty.degrees_of_freedom + m)
    noise = float(np.sqrt(solution.sum_of_squares / max(n - m, 1) * max(shared, 1.0)))
    return find_unidentifiable(names, natural, solution.jacobian, noise)


@dataclass(frozen=True, kw_only=True)
class Fitted:
    """What was measured says about a model, in time or in steady states.

    parameters: mechanical numbers by name with unit, over the inertia where that is not known; where the input is a
        torque on an angle or a force on a length, the inertia or mass and its multiples too.
    nuisance: what else was fitted, in its units. rmse: of what was fitted, unit.
    natural_frequency_hz: sqrt(k/I)/2π, of the linear part. damping_ratio: d/(2 sqrt(k I)), or half the loss factor;
        the viscous part where there is dry friction. Both of the first group.
    converged, message: how the search ended. unidentifiable: sentences.
    covariance, solution: in normal form.
    """

    model: Model
    frame: Frame
    parameters: dict[str, Estimate]
    nuisance: dict[str, Estimate]
    natural_frequency_hz: Estimate
    damping_ratio: Estimate
    rmse: float
    unit: str
    converged: bool
    message: str
    unidentifiable: tuple[str, ...]
    covariance: Covariance
    solution: Solution


@dataclass(frozen=True, kw_only=True)
class Fit(Fitted):
    """What records say about a model.

    nuisance: start and rest position of each record. predicted: the fitted output of each, in its unit, all samples.
    kept: which of them were fitted. layout: for profiles and predictions; see `sinew.identify.oscillator.model`.
    """

    records: tuple[Record, ...]
    predicted: tuple[Array, ...]
    kept: tuple[Mask, ...]
    layout: Layout

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the numbers in the covariance, in order."""
        return tuple(entry.local + entry.label() for entry in self.layout.entries)

    @property
    def correlation(self) -> Array:
        """Return the correlation matrix of the numbers in `names`, shape (m, m)."""
        return correlation(self.covariance.matrix)

    @property
    def effective_samples(self) -> float:
        """Return how many independent residuals the fitted samples are worth."""
        return min(self.covariance.degrees_of_freedom + self.solution.values.size, float(self.solution.residual.size))

    def bic(self, effective_samples: float | None = None) -> float:
        """Return the information criterion n ln(mean squared residual) + m ln n.

        effective_samples: n, of independent residuals; to compare models it has to be the same for all, best that of
        the model that fits best. Its own where it is None. What a loss factor saw before the record is not counted in
        m: the record hardly tells it, and it is no mechanics.
        """
        n = self.effective_samples if effective_samples is None else effective_samples
        counted = sum(entry.local not in HISTORIES for entry in self.layout.entries)
        return float(n * np.log(max(self.rmse, 1e-300) ** 2) + counted * np.log(n))

    def residuals(self) -> list[Array]:
        """Return measured less predicted of every record, in its unit, all samples."""
        return [record.output - fitted for record, fitted in zip(self.records, self.predicted, strict=True)]


# The vector that a search moves becomes physical numbers by name.

FREQUENCY = "natural_frequency_hz"
DAMPING = "damping_ratio"


def number_names(fit: Fit) -> tuple[str, ...]:
    """Return the names of the numbers that a fit tells: those of `Fit.parameters`, frequency and damping ratio."""
    return (*fit.parameters, FREQUENCY, DAMPING)


def physical_numbers(fit: Fit, values: Array) -> Array:
    """Return the numbers of `number_names`, in their units, at other vectors of the search.

    values: in normal form, in the order of `Fit.names`, shape (d, m). Returned: shape (d, number).
    They are worked out as those of the fit itself were, so what is NaN there (a spring that pushes away has no natural
    frequency) is NaN here.
    """
    certainty = Covariance(np.zeros_like(fit.covariance.matrix), 1.0)  # only values are asked for
    found = []
    for x in np.asarray(values, dtype=float):
        solution = replace(fit.solution, values=x)
        numbers = mechanical_parameters(fit.layout, solution, certainty)
        frequency, damping = oscillation(fit.layout, solution, certainty)
        found.append([*(numbers[name].value for name in fit.parameters), frequency.value, damping.value])
    return np.array(found, dtype=float).reshape(-1, len(fit.parameters) + 2)


# A fitted model says how its own free swing depends on amplitude: frequency and damping, with bands.
#
# The conservative swing between two turning points of equal potential, r = m + A sin u, has the period
#
#     T = 2 ∫ A cos u / sqrt(2 (E - V(r))) du,  u from -π/2 to π/2,
#
# whose integrand is smooth. What a cycle loses is asked of the damping law along that swing, and spread over the cycle:
# λ = ΔE / (T A dE/dA). Both are exact for a linear joint, and to first order in the damping for the others.

_NODES = 96
_SMALLEST = 0.03  # of the largest amplitude: where a curve begins
_POINTS = 41


@dataclass(frozen=True)
class Swing:
    """Frequency and damping of a fitted model against amplitude, shape (a,) each, from small to large.

    amplitude: half of the way between the turning points, unit of the motion.
    frequency_hz: damped; damping_ratio: λ/sqrt(ω² + λ²). *_low, *_high: the pointwise 90 % band.
    """

    amplitude: Array
    frequency_hz: Array
    frequency_low_hz: Array
    frequency_high_hz: Array
    damping_ratio: Array
    damping_ratio_low: Array
    damping_ratio_high: Array


def swing_of(fit: Fit, largest: float | None = None) -> Swing | None:
    """Return the free swing of a fit, up to an amplitude; None where its spring does not bring it back.

    largest: unit of the motion; the largest that the records of the fit reached where it is None.
    """
    x = fit.solution.values
    if largest is None:
        largest = max(reached(fit, i) for i in range(len(fit.records)))
    amplitude = np.geomspace(_SMALLEST, 1.0, _POINTS) * largest
    value = _curves(fit, x, amplitude)
    known = np.asarray(np.isfinite(value).all(axis=0))
    if not known[0]:
        return None
    count = int(np.argmin(known)) if not known.all() else known.size
    amplitude, value = amplitude[:count], value[:, :count]
    taking = [k for k in _entries(fit) if np.isfinite(fit.covariance.matrix[k, k])]
    slopes = np.zeros((len(taking), *value.shape))
    for i, k in enumerate(taking):
        step = 1e-4 * max(abs(x[k]), 0.01)
        ends = []
        for sign in (1.0, -1.0):
            moved = x.copy()
            moved[k] += sign * step
            ends.append(_curves(fit, moved, amplitude))
        slopes[i] = np.nan_to_num((ends[0] - ends[1]) / (2 * step))
    matrix = fit.covariance.matrix[np.ix_(taking, taking)]
    variance = np.einsum("iqa,ij,jqa->qa", slopes, matrix, slopes)
    half = float(special.stdtrit(fit.covariance.degrees_of_freedom, 0.95)) * np.sqrt(np.maximum(variance, 0.0))
    return Swing(
        amplitude,
        value[0],
        value[0] - half[0],
        value[0] + half[0],
        value[1],
        value[1] - half[1],
        value[1] + half[1],
    )


def _entries(fit: Fit) -> list[int]:
    """Return which numbers of a fit are mechanical and hold for its first record."""
    names = fit.model.mechanics(fit.records[0].excitation)
    group = fit.records[0].group
    return [k for k, entry in enumerate(fit.layout.entries) if entry.local in names and entry.group in ("", group)]


def reached(fit: Fit, i: int) -> float:
    """Return the largest amplitude of the motion in a record: of a rate or acceleration over its frequency."""
    record = fit.records[i]
    fast = (2 * np.pi * fit.natural_frequency_hz.value) ** derivative_order(record.output_unit)
    return 0.5 * float(np.ptp(fit.predicted[i])) / float(fast)


def _curves(fit: Fit, x: Array, amplitude: Array) -> Array:
    """Return damped frequency [Hz] and damping ratio at amplitudes of the motion, shape (2, a)."""
    scales = fit.layout.parts[0].scales
    law = fit.model.law
    local = dict(zip(LOCAL, fit.layout.local(x, 0), strict=True))
    p = {name: local[name] * scales.physical(name) for name in NUMBERS} | {"amplitude": 1.0}
    with np.errstate(invalid="ignore", divide="ignore"):
        energy, omega, cycle = _conservative(p, amplitude, law)
        up, down = (_conservative(p, amplitude * (1 + s), law)[0] for s in (1e-4, -1e-4))
        rate = law.dissipated(p, cycle) * omega / (2 * np.pi) / ((up - down) / 2e-4)
        damped = np.sqrt(omega**2 - 0.25 * p["damping"] ** 2) / (2 * np.pi)
    return np.stack([np.where(np.isfinite(energy), damped, np.nan), rate / omega])


def _conservative(p: dict[str, float], amplitude: Array, law: Law) -> tuple[Array, Array, Cycle]:
    """Return energy over the inertia and angular frequency, shape (a,) each, and the swing without loss."""
    middle = np.zeros_like(amplitude)
    if p["quadratic"]:
        for _ in range(30):
            ends = middle + amplitude, middle - amplitude
            off = law.stored(p, ends[0]) - law.stored(p, ends[1])
            slope = np.asarray(law.springs.force(p, ends[0], 0.0) - law.springs.force(p, ends[1], 0.0))
            middle = np.clip(middle - off / slope, -0.9 * amplitude, 0.9 * amplitude)
    energy = law.stored(p, middle + amplitude)
    u = (np.arange(_NODES) + 0.5) / _NODES * np.pi - 0.5 * np.pi
    r = middle[:, None] + amplitude[:, None] * np.sin(u)
    left = 2.0 * (energy[:, None] - law.stored(p, r))
    speed = np.sqrt(np.where(left > 0, left, np.nan))
    weight = amplitude[:, None] * np.cos(u) * (np.pi / _NODES)
    period = 2.0 * np.sum(weight / speed, axis=1)
    return energy, 2 * np.pi / period, Cycle(amplitude, r, speed, weight)
