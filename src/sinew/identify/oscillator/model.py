"""A model: a law of its motion, what its rest does, how its numbers are called, and their layout in a search."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import special, stats

from sinew.identify.oscillator.least_squares import Covariance, Problem, Solution, estimates, find_unidentifiable
from sinew.identify.oscillator.record import Excitation, Frame, Record, Scales, derivative_order, grid_of
from sinew.identify.oscillator.track import LOCAL, PLACE, Grid, track, track_slopes
from sinew.measure.arrays import Array, Mask
from sinew.measure.errors import SpecError
from sinew.measure.estimate import Estimate
from sinew.mechanics.laws import (
    HISTORIES,
    BoucWen,
    Cubic,
    Drag,
    DryFriction,
    Law,
    Linear,
    LossFactor,
    Pendulum,
    Quadratic,
    Viscous,
)

Rest = Literal["offset", "creep"]


@dataclass(frozen=True)
class Model:
    """One degree of freedom: r'' + law = input.

    name: what the command line calls it. law: the sum of its terms.
    rest: what the rest position does during the record: an offset, or an exponential creep.
    """

    name: str
    law: Law
    rest: Rest = "offset"

    def resting(self, rest: Rest) -> "Model":
        """Return the same model with another rest position."""
        return replace(self, rest=rest)

    def damped(self, losses: Law) -> "Model":
        """Return the same model with other losses."""
        return replace(self, law=self.law.springs + losses)

    def mechanics(self, excitation: Excitation) -> tuple[str, ...]:
        """Return the names (of `LOCAL`) of its mechanical numbers under an excitation."""
        return tuple(n.name for n in self.law.numbers) + (() if excitation == "none" else ("gain",))

    def nuisance(self, excitation: Excitation) -> tuple[str, ...]:
        """Return the names (of `LOCAL`) of the numbers that every record has for itself."""
        creep = ("drift", "creep_time") if self.rest == "creep" else ()
        return ("start", "start_rate", "offset", *creep, *self.law.histories(excitation == "none"))


VISCOUS = Law((Viscous(),))
"""The plainest loss, which other laws are held against."""

MODELS: dict[str, Model] = {
    name: Model(name, law)
    for name, law in {
        "linear": Linear() + Viscous(),
        "loss-factor": Linear() + LossFactor(),
        "coulomb": Linear() + Viscous() + DryFriction(),
        "cubic": Linear() + Viscous() + Cubic(),
        "cubic-quadratic": Linear() + Viscous() + Quadratic() + Cubic(),
        "loss-factor-cubic": Linear() + LossFactor() + Cubic(),
        "loss-factor-cubic-quadratic": Linear() + LossFactor() + Quadratic() + Cubic(),
        "coulomb-cubic": Linear() + Viscous() + DryFriction() + Cubic(),
        "coulomb-cubic-quadratic": Linear() + Viscous() + DryFriction() + Quadratic() + Cubic(),
        "pendulum": Pendulum() + Viscous(),
        "coulomb-pendulum": Pendulum() + Viscous() + DryFriction(),
        "bouc-wen": Linear() + Viscous() + BoucWen(),
        "bouc-wen-cubic": Linear() + Viscous() + BoucWen() + Cubic(),
        "drag": Linear() + Viscous() + Drag(),
        "drag-cubic": Linear() + Viscous() + Drag() + Cubic(),
        "drag-cubic-quadratic": Linear() + Viscous() + Drag() + Quadratic() + Cubic(),
        "drag-pendulum": Pendulum() + Viscous() + Drag(),
    }.items()
}


def get_model(name: str) -> Model:
    """Return the model of this name. Raises SpecError with the names there are."""
    if name == "tendon":
        raise SpecError(
            "model tendon is a rig's and is fitted to its recording (sinew.identify.joint.fit); choose cubic or auto"
        )
    if name not in MODELS:
        raise SpecError(f"model is {name!r}, expected auto or one of {', '.join(MODELS)}")
    return MODELS[name]


def parameter_name(local: str, excitation: Excitation, motion_unit: str, input_unit: str) -> str:
    """Return the name, with its unit, of a mechanical number divided by the inertia.

    `stiffness_per_s2` is k/I, `cubic_per_s2_rad2` is k₃/I, `coulomb_rad_per_s2` is the friction torque over I;
    a lever's `lever_inertia_ratio` is I_l/I. input_unit: of the input's motion for a base or lever.
    """
    unit, given = _token(motion_unit), _token(input_unit)
    if local == "gain" and unit == given:
        return {"lever": "lever_inertia_ratio", "base": "base_gain"}.get(excitation, "input_gain_per_s2")
    if local == "gain" and excitation in ("lever", "base"):
        return "_".join(filter(None, (f"{excitation}_gain", unit, "per" if given else "", given)))
    if local == "gain":
        return "_".join(filter(None, ("input_gain", unit, "per_s2", given)))  # 1/I where unit over unit is 1/I's
    return LOCAL[local].over_inertia(unit)


def _token(unit: str) -> str:
    return "" if unit == "1" else re.sub(r"[^a-z0-9]+", "_", unit.lower()).strip("_")


# The numbers that a search moves are laid out over one or several records.
#
# Mechanical numbers are shared by all records; each record has its own start and rest position. A search sees one
# vector in normal form, near one; every record sees the numbers of `LOCAL`.

_LINEAR_CREEP = 6.0  # of `creep_time`: the drift is a straight line


@dataclass(frozen=True)
class Part:
    """One record, ready to be simulated.

    selected: which of its samples the search sees, shape (n,). unit_size: A ω_r^order, the normal form of the output.
    """

    record: Record
    scales: Scales
    grid: Grid
    samples: NDArray[np.intp]
    selected: Mask
    order: int
    unit_size: float
    fixed: Array


@dataclass(frozen=True)
class Entry:
    """One number of the search: its name in `LOCAL`, and the record that it belongs to, -1 for all of them."""

    local: str
    record: int = -1

    def label(self) -> str:
        """Return what tells it from its namesakes."""
        return f"[{self.record}]" if self.record >= 0 else ""


@dataclass(frozen=True)
class Layout:
    """Which number goes where.

    entries: of the vector x, m of them. index, column, ratio: for each part, which of x it takes, which of `LOCAL`
    they are, and the factor between the two normal forms.
    """

    model: Model
    parts: tuple[Part, ...]
    entries: tuple[Entry, ...]
    index: tuple[NDArray[np.intp], ...]
    column: tuple[NDArray[np.intp], ...]
    ratio: tuple[Array, ...]

    def local(self, x: Array, part: int) -> Array:
        """Return the numbers of `LOCAL` of one part, shape (local,)."""
        p = self.parts[part].fixed.copy()
        p[self.column[part]] = x[self.index[part]] * self.ratio[part]
        return p

    def outputs(self, x: Array) -> list[Array]:
        """Return what every part would measure at its samples, in normal form."""
        return [self._track(x, i, part.record.size) for i, part in enumerate(self.parts)]

    def _track(self, x: Array, i: int, end: int) -> Array:
        part = self.parts[i]
        return np.asarray(track(self.local(x, i), part.grid, self.model.law, part.order)[part.samples[:end]])

    def problem(self, seen: Sequence[Mask]) -> Problem:
        """Return the least-squares problem over the samples that are seen, one mask for each part."""
        ends = [int(np.flatnonzero(mask)[-1]) + 1 if mask.any() else 1 for mask in seen]
        masks = [mask[:end] for mask, end in zip(seen, ends, strict=True)]
        wanted = [part.record.output[:end] / part.unit_size for part, end in zip(self.parts, ends, strict=True)]

        def residual(x: Array) -> Array:
            return np.concatenate([(self._track(x, i, ends[i]) - wanted[i])[mask] for i, mask in enumerate(masks)])

        def jacobian(x: Array) -> Array:
            return np.concatenate([self._slopes(x, i, ends[i])[mask] for i, mask in enumerate(masks)])

        return Problem(residual, jacobian)

    def _slopes(self, x: Array, i: int, end: int) -> Array:
        part = self.parts[i]
        slopes = track_slopes(self.local(x, i), self.column[i], part.grid, self.model.law, part.order)
        found = np.zeros((end, x.size))
        found[:, self.index[i]] = slopes[part.samples[:end]] * self.ratio[i]
        return found


def make_part(record: Record, model: Model, scales: Scales, frame: Frame, selected: Mask) -> Part:
    """Return a record ready to be simulated with a model."""
    grid, samples = grid_of(record, scales, frame, model.law)
    order = derivative_order(record.output_unit)
    fixed = np.zeros(len(LOCAL))
    fixed[PLACE["creep_time"]] = _LINEAR_CREEP
    if record.excitation == "base":
        fixed[PLACE["gain"]] = 1.0 / scales.physical("gain")
    size = scales.amplitude * scales.omega**order
    return Part(record, scales, grid, samples, selected, order, size, fixed)


def free_mechanics(model: Model, record: Record) -> tuple[str, ...]:
    """Return the mechanical numbers that are sought; the gain of a base in the output's own unit is one."""
    known = record.excitation == "base" and record.input_motion_unit == record.motion_unit
    return tuple(name for name in model.mechanics(record.excitation) if not (known and name == "gain"))


def make_layout(model: Model, parts: Sequence[Part], steady: Sequence[str] | None = None) -> Layout:
    """Return the layout of a fit.

    steady: of steady states, which have neither start nor rest position, the names of the numbers instead of `LOCAL`.
    """
    rank = PLACE if steady is None else {name: k for k, name in enumerate(steady)}
    entries = [Entry(name) for name in free_mechanics(model, parts[0].record)]
    if steady is None:
        entries += [
            Entry(name, i if len(parts) > 1 else -1)
            for i in range(len(parts))
            for name in model.nuisance(parts[i].record.excitation)
        ]
    index, column, ratio = [], [], []
    for i, part in enumerate(parts):
        mine = [k for k, entry in enumerate(entries) if entry.record in (-1, i)]
        index.append(np.array(mine, dtype=np.intp))
        column.append(np.array([rank[entries[k].local] for k in mine], dtype=np.intp))
        ratio.append(np.array([_ratio(entries[k].local, parts[0].scales, part.scales) for k in mine]))
    return Layout(model, tuple(parts), tuple(entries), tuple(index), tuple(column), tuple(ratio))


def _ratio(local: str, first: Scales, own: Scales) -> float:
    if local in ("start", "start_rate", "offset", "drift", "creep_time", *HISTORIES):
        return 1.0
    return first.physical(local) / own.physical(local)


# The result of a fit: numbers with intervals, and what they do not tell.

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
        found[name] = _scaled(one, scales.physical(entry.local))
        if kind is not None and gain is not None and (entry.local == "gain" or LOCAL[entry.local].force):
            called = kind[0] if entry.local == "gain" else LOCAL[entry.local].in_full(*kind[1:])
            factor = (1.0 if entry.local == "gain" else scales.physical(entry.local)) / scales.physical("gain")
            whole = _over(k, gain, solution.values, certainty)
            full[called] = _scaled(whole, factor)
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
    """Return natural frequency [Hz] and damping ratio, standard deviations to first order.

    Both are NaN where the stiffness is not told from zero, its 90 % interval holding it: what no spring brings back has
    no frequency.
    """
    entries, x = layout.entries, solution.values
    at = {entry.local: k for k, entry in enumerate(entries)}
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
    return [LOCAL[entry.local].word for entry in layout.entries], natural


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
        the viscous part where there is dry friction.
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
    selected: which of them were fitted. layout: for draws and predictions; see `sinew.identify.oscillator.model`.
    """

    records: tuple[Record, ...]
    predicted: tuple[Array, ...]
    selected: tuple[Mask, ...]
    layout: Layout

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the numbers in the covariance, in order."""
        return tuple(entry.local + entry.label() for entry in self.layout.entries)

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


def reached(fit: Fit, i: int) -> float:
    """Return the largest amplitude of the motion in a record: of a rate or acceleration over its frequency."""
    record = fit.records[i]
    fast = (2 * np.pi * fit.natural_frequency_hz.value) ** derivative_order(record.output_unit)
    return 0.5 * float(np.ptp(fit.predicted[i])) / float(fast)


# What residuals say against a model.

_LAGS = 20
SIGNIFICANT = 0.01
_FEWEST_BLOCKS = 8


@dataclass(frozen=True)
class Trends:
    """How the residuals' size goes with amplitude and with frequency, each Spearman's rank correlation and its p, NaN
    of fewer than 8 sizes."""

    amplitude: tuple[float, float]
    frequency: tuple[float, float]

    def sentences(self) -> tuple[str, ...]:
        """Return the trends in words; nothing where they may be chance."""
        both = ((self.amplitude, "amplitude"), (self.frequency, "frequency"))
        return tuple(
            f"residuals {'grow' if trend > 0 else 'shrink'} with {of}" for (trend, p), of in both if p < SIGNIFICANT
        )


@dataclass(frozen=True)
class ResidualTests:
    """What the residuals of one record, or of several, look like.

    white_p: of Ljung and Box over 20 lags, summed over the records; neighbours: correlation of neighbouring residuals.
    trends: of them with the output's, over blocks of a period (of 8 records or more: over the records).
    share: rms of the residuals over the standard deviation of the output.
    """

    white_p: float
    neighbours: float
    trends: Trends
    share: float

    def sentences(self) -> tuple[str, ...]:
        """Return what speaks against the model, in words; none where nothing does."""
        coloured = f"residuals are not white (neighbours correlate by {self.neighbours:.2f})"
        return (*([coloured] if self.white_p < SIGNIFICANT else []), *self.trends.sentences())

    def telling(self) -> str:
        """Return how all the tests came out, in words."""
        found = list(self.sentences())
        if self.white_p >= SIGNIFICANT:
            found.insert(0, "residuals are white")
        if np.isnan(self.trends.amplitude[1]):
            found.append("there are too few periods to ask them for trends")
        elif not self.trends.sentences():
            found.append("they show no trend with amplitude or frequency")
        return ", ".join(found)


def ask_fit(fit: Fit) -> ResidualTests:
    """Return the tests of the residuals of a fit over the samples that it was fitted to, from the first to the last."""
    parts = [slice(int(seen[0]), int(seen[-1]) + 1) for seen in map(np.flatnonzero, fit.selected)]
    records = [record.cut(part.start, part.stop) for record, part in zip(fit.records, parts, strict=True)]
    residuals = [r[part] for r, part in zip(fit.residuals(), parts, strict=True)]
    return ask_residuals(records, residuals, 2 * np.pi * fit.natural_frequency_hz.value)


def ask_residuals(
    records: Record | Sequence[Record], residuals: Array | Sequence[Array], omega: float
) -> ResidualTests:
    """Return the tests of the residuals of one record, or of several that were fitted together.

    residuals: in the unit of the output, one array of shape (n,) for each record. omega: angular frequency whose period
    makes the blocks [rad/s].
    """
    one = isinstance(records, Record)
    owners = (records,) if isinstance(records, Record) else tuple(records)
    centred = [np.asarray(r) - np.mean(r) for r in ([residuals] if one else residuals)]
    power = sum(float(r @ r) for r in centred)
    boxes = [_box(r) for r in centred]
    near = sum(float(r[1:] @ r[:-1]) for r in centred) / max(power, 1e-300)
    whole = len(owners) >= _FEWEST_BLOCKS
    blocks = np.concatenate([_split(o, r, omega, whole) for o, r in zip(owners, centred, strict=True)])
    size = sum(r.size for r in centred)
    moved = sum(float(np.sum((o.output - o.output.mean()) ** 2)) for o in owners)
    return ResidualTests(
        float(special.chdtrc(sum(lags for _, lags in boxes), sum(box for box, _ in boxes))),
        near,
        Trends(*(rank_trend(blocks[:, k], blocks[:, 0]) for k in (1, 2))),
        float(np.sqrt(power / size) / max(np.sqrt(moved / size), 1e-300)),
    )


def _box(r: Array) -> tuple[float, int]:
    """Return the statistic of Ljung and Box, and over how many lags."""
    lags = min(_LAGS, r.size // 5)
    each = np.array([float(r[k:] @ r[:-k]) for k in range(1, lags + 1)]) / max(float(r @ r), 1e-300)
    return r.size * (r.size + 2) * float(np.sum(each**2 / (r.size - np.arange(1, lags + 1)))), lags


def _split(record: Record, r: Array, omega: float, whole: bool) -> Array:
    """Return rms of the residuals, amplitude and frequency of the output in every block, shape (b, 3)."""
    period = 2 * np.pi / omega / record.step_s if np.isfinite(omega) and omega > 0 else r.size / _FEWEST_BLOCKS
    size = r.size if whole else min(max(4, round(period)), r.size)
    count = r.size // size
    blocks = r[: count * size].reshape(count, size)
    output = record.output[: count * size].reshape(count, size)
    if not whole:
        output = output - record.output.mean()
    deviation = np.maximum(output.std(axis=1), 1e-150)
    turns = np.sqrt(np.mean(np.diff(output, axis=1) ** 2, axis=1)) / deviation / record.step_s
    return np.stack([np.sqrt(np.mean(blocks**2, axis=1)), output.std(axis=1), turns], axis=1)


def rank_trend(against: Array, size: Array) -> tuple[float, float]:
    """Return Spearman's rank correlation of two arrays, shape (b,), and its p; NaN where b is below 8."""
    if size.size < _FEWEST_BLOCKS:
        return np.nan, np.nan
    if np.ptp(against) == 0 or np.ptp(size) == 0:
        return 0.0, 1.0
    found = stats.spearmanr(against, size)
    return float(found.statistic), float(found.pvalue)
