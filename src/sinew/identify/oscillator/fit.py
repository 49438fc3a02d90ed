"""A model's fit to records: output error in the time domain.

The output is simulated from the measured input and an unknown start, and the sum of squares of measured less simulated
is made small: no derivative of measured data is taken, and noise of the output does no harm. Noise of the input does;
it is assumed small.
"""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.signal import fftconvolve

from sinew.analysis.decay.modes import split_poles
from sinew.identify.oscillator.least_squares import Covariance, Problem, Solution, covariance, solve
from sinew.identify.oscillator.model import (
    VISCOUS,
    Entry,
    Fit,
    Layout,
    Model,
    Part,
    get_model,
    make_layout,
    make_part,
    mechanical_parameters,
    nuisance_parameters,
    oscillation,
    unidentifiable_directions,
)
from sinew.identify.oscillator.record import (
    FEWEST,
    Frame,
    Record,
    Scales,
    derivative_order,
    dominant_omega,
    even_samples,
    frames_of,
    input_derivative,
)
from sinew.identify.oscillator.track import LOCAL
from sinew.measure.arrays import Array, Mask
from sinew.measure.errors import RecordingError, SpecError
from sinew.mechanics.laws import HISTORIES, LossFactor, Pendulum, Term
from sinew.solve.programs import configure

Masks = Sequence[Mask]

_COLOURED = 0.2  # correlation of neighbouring residuals from which on their scores are asked too


def fit(
    records: Record | Sequence[Record],
    model: Model | str,
    *,
    selected: Masks | None = None,
    guess: Fit | None = None,
    smaller: Fit | None = None,
) -> Fit:
    """Return the fit of a model to one record, or to several with the same mechanics.

    selected: masks of the samples to be fitted, one for each record, shape (n,); all where it is None. The simulation
        runs through the others, so what it says there is a prediction.
    guess: a fit of the same model to similar records, where the search begins.
    smaller: a fit of another model, with fewer terms or viscous damping, to the same samples; the search begins at what
        it found, too.
    Raises RecordingError for records that cannot be fitted, SpecError for a model that does not go with them.
    """
    configure()
    records = (records,) if isinstance(records, Record) else tuple(records)
    model = get_model(model) if isinstance(model, str) else model
    _check(records, model)
    masks = tuple(np.ones(r.size, dtype=bool) for r in records) if selected is None else tuple(selected)
    frames = (guess.frame,) if guess is not None else frames_of(records[0])
    for number, mask in enumerate(masks):
        if np.count_nonzero(mask) < FEWEST:
            raise RecordingError(
                f"record {number} has {np.count_nonzero(mask)} samples to fit, expected at least {FEWEST}; keep more"
            )
    found = [_fit_in_frame(records, model, frame, masks, guess, smaller) for frame in frames]
    return min(found, key=lambda one: one.rmse)


def _check(records: Sequence[Record], model: Model) -> None:
    if not records:
        raise SpecError("no record to fit")
    if len({(r.excitation, r.output_unit, r.input_unit) for r in records}) > 1:
        raise SpecError("records of one fit need the same excitation and units")
    if model.law.has(Pendulum) and records[0].motion_unit not in ("rad", "1"):
        raise SpecError(f"model {model.name} needs an angle, the output is in {records[0].output_unit}")


def _fit_in_frame(
    records: Sequence[Record],
    model: Model,
    frame: Frame,
    masks: Masks,
    guess: Fit | None,
    smaller: Fit | None,
) -> Fit:
    known = smaller if smaller is not None and smaller.frame == frame else None
    if guess is not None and len(guess.records) == len(records):
        scales, starts = [part.scales for part in guess.layout.parts], None
    else:
        # What is held out must not even choose the start.
        seen = [np.flatnonzero(mask) for mask in masks]
        taught = [record.cut(int(at[0]), int(at[-1]) + 1) for record, at in zip(records, seen, strict=True)]
        scales, starts = map(list, zip(*begin(taught, model, frame), strict=True))
        scales = scales if known is None else [part.scales for part in known.layout.parts]
    parts = [
        make_part(record, model, own, frame, mask) for record, own, mask in zip(records, scales, masks, strict=True)
    ]
    layout = make_layout(model, parts)
    first = guess.solution.values if guess is not None and starts is None else first_values(layout, starts or [])
    carried = carried_over(layout, first, known) if known is not None and starts is not None else None
    solution = search(layout, first, masks, carried, known=guess is not None and starts is None)
    return _tell(layout, solution, masks, frame, records)


def _tell(layout: Layout, solution: Solution, masks: Masks, frame: Frame, records: Sequence[Record]) -> Fit:
    pieces = [slice(a, b) for a, b in pairwise(np.cumsum([0, *(int(m.sum()) for m in masks)]))]
    certainty = _certainty(solution, pieces)
    frequency, damping = oscillation(layout, solution, certainty)
    predicted = tuple(y * p.unit_size for y, p in zip(layout.outputs(solution.values), layout.parts, strict=True))
    off = np.concatenate([(r.output - y)[m] for r, y, m in zip(records, predicted, masks, strict=True)])
    return Fit(
        model=layout.model,
        frame=frame,
        records=tuple(records),
        parameters=mechanical_parameters(layout, solution, certainty),
        nuisance=nuisance_parameters(layout, solution, certainty),
        natural_frequency_hz=frequency,
        damping_ratio=damping,
        predicted=predicted,
        selected=tuple(masks),
        rmse=float(np.sqrt(np.mean(off**2))),
        unit=records[0].output_unit,
        converged=solution.converged,
        message=solution.message,
        unidentifiable=unidentifiable_directions(layout, solution, certainty),
        covariance=certainty,
        solution=solution,
        layout=layout,
    )


def _certainty(solution: Solution, pieces: Sequence[slice]) -> Covariance:
    """Return the covariance for coloured residuals; where they are clearly so, at least that of the scores (HAC)."""
    r = solution.residual
    found = covariance(solution.jacobian, r, "coloured", pieces=pieces)
    neighbours = float(r[1:] @ r[:-1]) / max(float(r @ r), 1e-300)
    if neighbours <= _COLOURED:
        return found
    scores = covariance(solution.jacobian, r, "hac", pieces=pieces)
    with np.errstate(divide="ignore", invalid="ignore"):
        larger = np.nan_to_num(np.maximum(scores.std / found.std, 1.0), nan=1.0, posinf=1.0)
    return Covariance(found.matrix * np.outer(larger, larger), found.degrees_of_freedom)


# A search begins by regression, by a smaller model's fit, or beside a minimum of friction, and is followed to its end.

_LARGE = 0.1  # of the largest output: motion that dry friction does not bring to rest
_AMPLITUDES = (0.2, 0.45)  # of the largest: where friction takes over a share of the work
_SHARES = (0.05, 0.2, 0.4, 0.6, 0.8, 0.95)
_TRIED = 2  # of the splits between friction and viscous damping are followed
_ASIDE, _LEAST_ASIDE = 2.0, 0.03  # standard deviations; of the friction
_ROUNDS = 3
_LEAST_GAIN = 1e-3  # of the residuals' variance
_LOSS_FACTORS = (1e-3, 0.8)
_RESTING = ("start", "start_rate", "offset", "drift", "creep_time")


def carried_over(layout: Layout, first: Array, smaller: Fit) -> Array:
    """Return where a search begins if it knows what a smaller model's fit to the same records found, shape (m,).

    layout: of the larger model, in the scales of the smaller one's. first: where it would begin else. A viscous fit
    gives a loss factor its damping, and dry friction nothing.
    """
    found = {_key(entry): value for entry, value in zip(smaller.layout.entries, smaller.solution.values, strict=True)}
    x = first.copy()
    same_rest = smaller.model.rest == layout.model.rest
    for k, entry in enumerate(layout.entries):
        if entry.local in _RESTING and not same_rest:
            continue
        if _key(entry) in found:
            x[k] = found[_key(entry)]
        elif entry.local == "loss_factor":
            x[k] = _loss_factor(found.get(("damping", -1), 0.0), found)
        elif entry.local == "hysteresis":  # dry friction is its limit
            x[k] = found.get(("coulomb", -1), 0.0)
        elif LOCAL[entry.local].absent:
            x[k] = 0.0
    return x


def _key(entry: Entry) -> tuple[str, int]:
    return entry.local, entry.record


def _loss_factor(damping: float, found: dict[tuple[str, int], float]) -> float:
    stiffness = found.get(("stiffness", -1), 1.0)
    return float(np.clip(damping / np.sqrt(max(stiffness, 1e-3)), *_LOSS_FACTORS))


def remembering_starts(
    layout: Layout, first: Array, masks: Masks, taught: Array | None, problem: Problem
) -> list[Array]:
    """Return the starts of a search for a loss factor: of a decay the viscous fit, let go after a drive or a rest.

    taught: what `carried_over` said of a smaller model; where it is None the viscous fit is made.
    """
    memory = np.array([entry.local == "memory" for entry in layout.entries])
    if not memory.any():
        return [first] if taught is None else [_nearer(problem, first, taught)]
    x = _from_viscous(layout, first, masks) if taught is None else taught
    return [x, np.where(memory, 1.0, x), first]


def _from_viscous(layout: Layout, first: Array, masks: Masks) -> Array:
    at = {_key(entry): k for k, entry in enumerate(layout.entries)}
    viscous = make_layout(layout.model.damped(VISCOUS), layout.parts)
    same = [(entry.local.replace("damping", "loss_factor"), entry.record) for entry in viscous.entries]
    if not all(key in at for key in same):
        return first
    whose = [at[key] for key in same]
    bent = np.array([entry.local in layout.model.law.bends for entry in viscous.entries])
    starts = [first[whose], np.where(bent, 0.0, first[whose])] if bent.any() else [first[whose]]
    values = solve(viscous.problem(masks), *starts, tolerance=1e-6, max_evaluations=60).values
    found = {_key(entry): value for entry, value in zip(viscous.entries, values, strict=True)}
    x = first.copy()
    x[whose] = values
    for k, entry in enumerate(layout.entries):
        if entry.local == "loss_factor":
            x[k] = _loss_factor(float(x[k]), found)
    return x


def dry_starts(layout: Layout, first: Array, masks: Masks, taught: Array | None) -> list[Array]:
    """Return the start of a search with dry friction, whose sum of squares jumps where the motion comes to rest.

    It is smooth as long as the motion is large, so that part is fitted first: the damping without friction is divided
    between both in many ways, of equal work at one amplitude (4 c r = π d ω r²), and the best are followed.
    """
    coulomb, damping, stiffness = (_all_of(layout, name) for name in ("coulomb", "damping", "stiffness"))
    moving = [m & _large(part) for part, m in zip(layout.parts, masks, strict=True)]
    if sum(int(m.sum()) for m in moving) <= 2 * first.size:
        moving = list(masks)
    base = taught
    if base is None:
        base = first.copy()
        base[coulomb] = 0.0
        viscous = replace(layout, model=layout.model.damped(VISCOUS))
        base = solve(viscous.problem(moving), base, tolerance=1e-6, max_evaluations=60).values
    turning = 0.25 * np.pi * np.sqrt(max(float(np.median(base[stiffness])), 1e-3))
    starts = [base] if np.any(base[coulomb] != 0.0) else []
    for amplitude in _AMPLITUDES:
        whole = float(np.median(np.abs(base[damping]))) + float(np.median(base[coulomb])) / (turning * amplitude)
        for share in _SHARES:
            starts.append(base.copy())
            starts[-1][coulomb] = turning * amplitude * share * whole
            starts[-1][damping] = (1.0 - share) * whole
    problem = layout.problem(moving)
    left = [_sum_of_squares(problem.residual(start)) for start in starts]
    best = [starts[k] for k in np.argsort(left)[:_TRIED]]
    return [solve(problem, *best, tolerance=1e-4, max_evaluations=15).values]


def _all_of(layout: Layout, local: str) -> NDArray[np.intp]:
    return np.flatnonzero([entry.local == local for entry in layout.entries])


def _sum_of_squares(residual: Array) -> float:
    with np.errstate(over="ignore"):
        return float(residual @ residual) if np.isfinite(residual).all() else np.inf


def _large(part: Part) -> Mask:
    """Return the samples up to the last at which the output is a tenth of its largest."""
    output = part.record.output - np.median(part.record.output)
    last = int(np.flatnonzero(np.abs(output) > _LARGE * np.abs(output).max())[-1])
    return np.arange(output.size) <= last


def with_dry_friction(layout: Layout, problem: Problem, found: Solution) -> Solution:
    """Return the best solution with dry friction, sought on both sides of the one that was found, too.

    Samples that pass from sliding to rest leave small steps in the sum of squares, and a search from one side ends at
    the first of them: of 40 noisy decays in four a better minimum lay up to three standard deviations further.
    """
    for k in map(int, _all_of(layout, "coulomb")):
        for _ in range(_ROUNDS):
            variance = found.sum_of_squares / max(found.degrees_of_freedom, 1)
            aside = _along(found, k, variance)
            if aside is None:
                break
            other = solve(problem, found.values - aside, found.values + aside, tolerance=1e-6, max_evaluations=20)
            if other.sum_of_squares >= found.sum_of_squares - _LEAST_GAIN * variance:
                break
            found = other
    return found


def _along(found: Solution, k: int, variance: float) -> Array | None:
    """Return the step aside of number k with which the others lean along, shape (m,); None where nothing tells it."""
    lean = found.lean(k)
    left = float(np.linalg.norm(found.jacobian @ lean))
    if not left > 0 or not np.isfinite(lean).all():
        return None
    step = max(_ASIDE * float(np.sqrt(variance)) / left, _LEAST_ASIDE * abs(float(found.values[k])))
    return np.asarray(step * lean)


_TOLERANCE = 1e-8
_POOR, _LOST = 0.35, 0.6  # rmse over the output's: suspicious, and the oscillation's count is lost
_ASTRAY = 1.4  # between two frequencies that should be the same
_SPRINGLESS = 0.3  # of a spring that would swing as the record does: a negative one is none
_HORIZON, _GROWTH = 8.0, 2.5  # periods that are fitted first then, and how their number grows


def begin(records: Sequence[Record], model: Model, frame: Frame) -> list[tuple[Scales, dict[str, float]]]:
    """Return the scales of every record and where its search begins, in SI units; the records share their mechanics."""
    rings = [ringing(one, dominant_omega(one)) if one.excitation == "none" else None for one in records]
    creeps = [
        _creep(record, ring["stiffness"] ** 0.5 if ring else dominant_omega(record)) if model.rest == "creep" else None
        for record, ring in zip(records, rings, strict=True)
    ]
    records = [
        record if creep is None else replace(record, output=record.output - creep.position)
        for record, creep in zip(records, creeps, strict=True)
    ]
    omega = float(np.median([dominant_omega(record) for record in records]))
    values = regress_together(records, model, omega, frame)
    natural = np.sqrt(values[0]["stiffness"]) if values[0]["stiffness"] > 0 else omega
    if records[0].excitation != "none" and 0.2 * omega < natural < 5.0 * omega:
        values = regress_together(records, model, float(natural), frame)
    if values[0]["stiffness"] <= 0:
        springless = records[0].excitation != "none" and values[0]["stiffness"] > -_SPRINGLESS * omega**2
        values = [one | {"stiffness": 0.0 if springless else omega**2} for one in values]
    ring = next((ring for ring in rings if ring), None)
    if ring is not None and _astray(records, values[0], ring):
        # The creep of a rest position, or noise after a short motion, has led the regression astray.
        values = [_with_ringing(one, own or ring, ring) for one, own in zip(values, rings, strict=True)]
        omega = float(np.sqrt(ring["stiffness"]))
    omega = float(np.clip(np.sqrt(values[0]["stiffness"]), 0.2 * omega, 5.0 * omega))
    return [
        (_scales(record, omega, one["offset"]), one if creep is None else one | creep.start(one["offset"]))
        for record, one, creep in zip(records, values, creeps, strict=True)
    ]


def _astray(records: Sequence[Record], values: dict[str, float], ring: dict[str, float]) -> bool:
    """Return whether the ringing has another frequency than a regression, and explains the records better."""
    if 1 / _ASTRAY < np.sqrt(values["stiffness"] / ring["stiffness"]) < _ASTRAY:
        return False
    damping = values.get("damping", 0.0) + values.get("loss_factor", 0.0) * np.sqrt(values["stiffness"])
    of_regression = sum(ringing_misfit(record, values["stiffness"], damping) for record in records)
    return of_regression > sum(ringing_misfit(record, ring["stiffness"], ring["damping"]) for record in records)


def _with_ringing(values: dict[str, float], own: dict[str, float], shared: dict[str, float]) -> dict[str, float]:
    """Return a start with the mechanics of one oscillation, and the start of its own, about the same rest position."""
    mechanics = {name: shared[name] for name in ("stiffness", "damping", "loss_factor") if name in values}
    none = {name: 0.0 for name in values if name in LOCAL and LOCAL[name].absent}
    rest = own["offset"] if abs(values["offset"]) > abs(own["start"]) else values["offset"]
    return values | mechanics | none | {"start": own["start"], "start_rate": own["start_rate"], "offset": rest}


class _Creep(NamedTuple):
    """A rest position that creeps, as the motion's mean over a period tells it: offset + drift (1 - exp(-t/τ)).

    position: shape (n,). creep_time: ln(τ over the record's length).
    """

    position: Array
    offset: float
    drift: float
    creep_time: float

    def start(self, offset: float) -> dict[str, float]:
        """Return what it adds to a start whose offset is that of the motion without the creep."""
        return {"offset": self.offset + offset, "drift": self.drift, "creep_time": self.creep_time}


def _creep(record: Record, omega: float) -> _Creep:
    size = int(np.clip(round(2 * np.pi / omega / record.step_s), 2, record.size // 3))
    share = (record.time_s - record.time_s[0]) / (record.time_s[-1] - record.time_s[0])
    slow = np.convolve(record.output, np.ones(size) / size, "valid")
    middle = np.convolve(share, np.ones(size) / size, "valid")
    best = _Creep(np.zeros(record.size), 0.0, 0.0, -1.0), np.inf
    for creep_time in np.linspace(-4.0, 1.0, 11):
        shape = 1 - np.exp(-np.outer(middle, np.exp(-creep_time)))[:, 0]
        table = np.stack([np.ones(shape.size), shape], axis=1)
        (offset, drift), *_ = np.linalg.lstsq(table, slow, rcond=None)
        left = float(np.sum((slow - table @ (offset, drift)) ** 2))
        if left < best[1]:
            position = offset + drift * (1 - np.exp(-share * np.exp(-creep_time)))
            best = _Creep(position, float(offset), float(drift), float(creep_time)), left
    return best[0]


def _scales(record: Record, omega: float, offset: float) -> Scales:
    order = derivative_order(record.output_unit)
    swing = record.output - (offset if order == 0 else record.output.mean())
    forcing = 1.0
    if record.input is not None:
        driving = record.input - record.input.mean()
        forcing = float(np.sqrt(2.0) * driving.std()) * omega ** input_derivative(record) or 1.0
    return Scales(omega, float(np.abs(swing).max()) / omega**order, forcing)


def first_values(layout: Layout, starts: Sequence[dict[str, float]]) -> Array:
    """Return where a search begins, in normal form; starts: what `begin` said of each part."""
    x = np.zeros(len(layout.entries))
    for k, entry in enumerate(layout.entries):
        which = [i for i in range(len(layout.parts)) if entry.record in (-1, i)]
        if entry.local in ("drift", "creep_time", *HISTORIES):
            own = max(entry.record, 0)
            size = layout.parts[own].unit_size if entry.local == "drift" else 1.0
            x[k] = starts[own].get(entry.local, -1.0 if entry.local == "creep_time" else 0.0) / size
            continue
        normal = []
        for i in which:
            part = layout.parts[i]
            size = part.unit_size if entry.local == "offset" else part.scales.physical(entry.local)
            normal.append(starts[i].get(entry.local, 0.0) / size)
        shared = [n / r for n, r in zip(normal, _ratios(layout, k, which), strict=True)]
        x[k] = float(np.clip(np.median(shared), *LOCAL[entry.local].start))
    return x


def _ratios(layout: Layout, entry: int, which: Sequence[int]) -> list[float]:
    return [float(layout.ratio[i][np.flatnonzero(layout.index[i] == entry)[0]]) for i in which]


def search(layout: Layout, first: Array, masks: Masks, taught: Array | None = None, *, known: bool = False) -> Solution:
    """Return the best solution; where the direct search is lost, the record is taken in bit by bit.

    first: where to begin by regression. taught: where to begin by a smaller model's fit, if there is one; then it is
    one of many fits, and friction is not sought beside its minimum. known: whether `first` is a solution already.
    """
    problem = layout.problem(masks)
    if known:  # whoever found it has taken the record in bit by bit already, where that was needed
        found = solve(problem, first, tolerance=_TOLERANCE, max_evaluations=60)
        return with_dry_friction(layout, problem, found) if layout.model.law.sticks and taught is None else found
    wanted = np.concatenate([p.record.output[m] / p.unit_size for p, m in zip(layout.parts, masks, strict=True)])
    size = float(np.std(wanted) * np.sqrt(wanted.size))
    starts = _law_starts(layout, first, masks, taught, problem)
    if len(starts) > 1:
        starts = [solve(problem, *starts, tolerance=1e-3, max_evaluations=12).values]
    raced = taught is not None and layout.model.law.phase < Term.phase  # by many small steps, and one of many fits
    direct = solve(problem, *starts, tolerance=1e-4 if raced else _TOLERANCE, max_evaluations=12 if raced else 60)
    if layout.model.law.sticks and taught is None:
        direct = with_dry_friction(layout, problem, direct)
    if np.sqrt(direct.sum_of_squares) <= _POOR * size:
        return direct
    grown = [direct]
    if taught is not None and layout.model.law.losses == VISCOUS:
        grown.append(solve(problem, first, taught, tolerance=_TOLERANCE, max_evaluations=60))
    for factor in (1.0, 0.85, 1.18):
        x = first.copy()
        for k, entry in enumerate(layout.entries):
            if entry.local == "stiffness":
                x[k] *= factor**2
        with suppress(RecordingError):  # from there it runs away; the direct search did not
            grown.append(_grow(layout, x, masks, problem))
        if min(np.sqrt(one.sum_of_squares) for one in grown) <= _LOST * size:
            break
    return min(grown, key=lambda solution: solution.sum_of_squares)


def _law_starts(layout: Layout, first: Array, masks: Masks, taught: Array | None, problem: Problem) -> list[Array]:
    """Return the starts that a damping law has; of several the best is followed to the end."""
    if layout.model.law.sticks:
        return dry_starts(layout, first, masks, taught)
    if layout.model.law.has(LossFactor):
        return remembering_starts(layout, first, masks, taught, problem)
    for k, entry in enumerate(layout.entries):
        if LOCAL[entry.local].tried:
            has_friction = taught is not None and bool(np.any(taught[_all_of(layout, "hysteresis")] > 0))
            base = taught if has_friction and taught is not None else first
            tried = LOCAL[entry.local].tried[: 2 if has_friction else None]  # it yields soon where dry friction is near
            return [np.where(np.arange(first.size) == k, value, base) for value in tried]
    return [first] if taught is None else [_nearer(problem, first, taught)]


def _nearer(problem: Problem, *starts: Array) -> Array:
    return min(starts, key=lambda x: _sum_of_squares(problem.residual(x)))


def _grow(layout: Layout, x: Array, masks: Masks, problem: Problem) -> Solution:
    periods = [(p.record.time_s - p.record.time_s[0]) * p.scales.omega / (2 * np.pi) for p in layout.parts]
    longest = max(float(own[-1]) for own in periods)
    horizon = _HORIZON
    while horizon < longest:
        seen = [m & (own <= horizon) for own, m in zip(periods, masks, strict=True)]
        if sum(int(mask.sum()) for mask in seen) > 2 * x.size:
            x = solve(layout.problem(seen), x, tolerance=1e-4, max_evaluations=12).values
        horizon *= _GROWTH
    return solve(problem, x, tolerance=_TOLERANCE, max_evaluations=60)


# A search begins by linear regression on the equation of motion in its weak form.
#
# Multiplied by a smooth bump w that is zero at both ends of a window, and integrated over it, the equation's
# derivatives pass on to w: ∫w r'' = ∫w'' r. So stiffness, damping, friction, cubic and quadratic term and gain follow
# from one linear regression over many windows, without a derivative of measured data.

_AT_START = 0.12  # of a period: samples that tell position and rate at the start
_PENCIL_SAMPLES, _PENCIL_ORDER = 20, 6  # in a period; the oscillation, a harmonic, and two poles for the creep


def ringing(record: Record, omega: float) -> dict[str, float] | None:
    """Return stiffness, damping, offset and start of the one oscillation in a free decay that has most of its energy.

    omega: about its frequency, within a factor of three [rad/s]. By the matrix pencil, which separates it from the
    creep of its rest position; None where it finds none.
    """
    even, y, _ = even_samples(record)
    stride = max(1, int(2 * math.pi / omega / (even[1] - even[0]) / _PENCIL_SAMPLES))
    count = y.size // stride
    means = y[: count * stride].reshape(count, stride).mean(axis=1)
    found = split_poles(means - means[-count // 4 :].mean(), stride * (even[1] - even[0]), (_PENCIL_ORDER,))[0]
    if not found:
        return None
    pole = found[0][0]
    offset, real, imaginary = map(float, np.linalg.lstsq(_wave(even, pole), y, rcond=None)[0])
    amplitude = complex(real, imaginary) / pole ** derivative_order(record.output_unit)
    return {
        "stiffness": abs(pole) ** 2,
        "damping": -2 * pole.real,
        "loss_factor": -2 * pole.real / abs(pole),
        "offset": offset,
        "start": amplitude.real,
        "start_rate": (amplitude * pole).real,
    }


def ringing_misfit(record: Record, stiffness: float, damping: float) -> float:
    """Return the rms of what a linear oscillation with these mechanics, of any start, leaves of a free decay."""
    even, y, _ = even_samples(record)
    table = _wave(even, -0.5 * damping + 1j * math.sqrt(max(stiffness - 0.25 * damping**2, 0.0)))
    if not np.isfinite(table).all():
        return math.inf
    return float(np.std(y - table @ np.linalg.lstsq(table, y, rcond=None)[0]))


def _wave(even: Array, pole: complex) -> Array:
    with np.errstate(over="ignore", invalid="ignore"):
        wave = np.exp(pole * (even - even[0]))
    return np.stack([np.ones(even.size), wave.real, -wave.imag], axis=1)


def regress_together(records: Sequence[Record], model: Model, omega: float, frame: Frame) -> list[dict[str, float]]:
    """Return coefficients of the model in SI units, by name of `LOCAL`, of every record; `offset` in its output's unit.

    All records have the same mechanics, and only a constant is each one's own.
    omega: a frequency of the motion, which sets the length of the windows [rad/s].
    A record of a single frequency tells neither stiffness from inertia nor the gain; several of them do.
    """
    equations = [_equation(record, model, omega, frame) for record in records]
    columns = list(equations[0].columns)
    rows = [np.stack([one.columns[name] for name in columns], axis=1) for one in equations]
    own = np.zeros((sum(row.shape[0] for row in rows), len(rows)))
    ends = np.cumsum([0, *(row.shape[0] for row in rows)])
    for i, one in enumerate(equations):
        own[ends[i] : ends[i + 1], i] = one.constant
    table = np.concatenate([np.concatenate(rows), own], axis=1)
    size = np.linalg.norm(table, axis=0)
    size[size == 0] = 1.0
    target = np.concatenate([one.target for one in equations])
    found = np.linalg.lstsq(table / size, target, rcond=1e-10)[0] / size
    shared = dict(zip(columns, map(float, found), strict=False))
    return [
        _finished(shared, float(constant), one, model, record)
        for constant, one, record in zip(found[len(columns) :], equations, records, strict=True)
    ]


class _Equation(NamedTuple):
    """The weak form of one record: columns by name of `LOCAL`, the constant's, the inertia's, and the motion."""

    columns: dict[str, Array]
    constant: Array
    target: Array
    motion: Array
    centre: float
    start: tuple[float, float]


def _equation(record: Record, model: Model, omega: float, frame: Frame) -> _Equation:
    even, y, given = even_samples(record)
    step = float(even[1] - even[0])
    half = max(4, int(0.6 * 2 * math.pi / omega / step))
    if 2 * half + 8 >= y.size:
        half = max(2, (y.size - 8) // 4)
    order = derivative_order(record.output_unit)
    motion = _integrated(y - y.mean() if order else y, step, order)
    centre = float(motion.mean())
    motion = motion - centre
    driving = None if given is None else _Weak(half, step).of(given, input_derivative(record))
    weak = _Weak(half, step)
    if frame == "absolute" and given is not None:
        motion = motion - _base_share(weak, motion, given, record) * _integrated(given, step, 0)
    few = max(3, int(_AT_START * 2 * math.pi / omega / step))
    line = np.polynomial.Polynomial.fit(even[:few] - even[0], motion[:few], 2 if few > 8 else 1).convert()
    start = float(line(0.0)), float(line.deriv()(0.0))
    centre = centre if order == 0 else float(y.mean())
    columns = _columns(weak, motion, driving, model, record)
    return _Equation(columns, weak.of(np.ones_like(motion), 0), weak.of(motion, 2), motion, centre, start)


def _integrated(y: Array, step: float, order: int) -> Array:
    for _ in range(order):
        y = cumulative_trapezoid(y, dx=step, initial=0)
        y = y - np.polynomial.Polynomial.fit(np.arange(y.size), y, 1)(np.arange(y.size))
    return np.asarray(y, dtype=float)


def _base_share(weak: "_Weak", motion: Array, given: Array, record: Record) -> float:
    """Return how much of the input is in the absolute motion; 1 where both have the same unit."""
    if record.input_unit == record.output_unit or derivative_order(record.input_unit):
        return 1.0 if record.input_unit == record.output_unit else 0.0
    columns = np.stack([-weak.of(motion, 0), -weak.of(motion, 1), weak.of(given, 0), weak.of(given, 1)], axis=1)
    found = np.linalg.lstsq(columns, weak.of(motion, 2), rcond=None)[0]
    return float(found[2] / found[0])


class _Weak:
    """Windows of half-length `half` samples, a quarter of it apart."""

    def __init__(self, half: int, step: float) -> None:
        x = np.linspace(-1.0, 1.0, 2 * half + 1)
        bump = np.polynomial.Polynomial([1.0, 0.0, -1.0]) ** 5
        self._weights = [bump.deriv(k)(x) * (-1.0) ** k / (half * step) ** k if k else bump(x) for k in range(3)]
        self._stride, self.step = max(1, half // 4), step

    def of(self, signal: Array, derivative: int) -> Array:
        """Return ∫ w · d^k signal/dt^k over every window."""
        whole = fftconvolve(signal, self._weights[derivative][::-1], mode="valid")
        return np.asarray(whole[:: self._stride], dtype=float)


def _columns(weak: _Weak, motion: Array, driving: Array | None, model: Model, record: Record) -> dict[str, Array]:
    rate = np.gradient(motion, weak.step)
    columns = {term.numbers[0].name: -weak.of(*term.regressor(motion, rate)) for term in model.law.terms}
    if driving is not None:
        columns["gain"] = driving if record.excitation not in ("base", "lever") else -driving
    return columns


def _finished(
    shared: dict[str, float], constant: float, equation: _Equation, model: Model, record: Record
) -> dict[str, float]:
    values, shift = dict(shared), 0.0
    if derivative_order(record.output_unit) == 0 and values["stiffness"] > 0:
        shift = float(constant / values["stiffness"])
        shift = shift if abs(shift) <= 0.5 * np.abs(equation.motion).max() else 0.0
    for term in model.law.terms:
        values |= term.started(values, float(np.abs(equation.motion).max()))
    position, rate = equation.start
    return values | {"offset": equation.centre + shift, "start": position - shift, "start_rate": rate}
