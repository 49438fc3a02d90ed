"""A model's fit to records: output error in the time domain.

The output is simulated from the measured input and an unknown start, and the sum of squares of measured less simulated
is made small: no derivative of measured data is taken, and noise of the output does no harm. Noise of the input does;
it is assumed small.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sinew.identify.oscillator.certainty import Covariance, covariance
from sinew.identify.oscillator.fitted import (
    Fit,
    mechanical_parameters,
    nuisance_parameters,
    oscillation,
    unidentifiable_directions,
)
from sinew.identify.oscillator.layout import Layout, make_layout, make_part
from sinew.identify.oscillator.least_squares import Solution
from sinew.identify.oscillator.model import Model, get_model
from sinew.identify.oscillator.record import FEWEST, Frame, Record, Scales, frames_of
from sinew.identify.oscillator.search import begin, carried_over, first_values, search
from sinew.measure.errors import RecordingError, SpecError
from sinew.mechanics.laws import Pendulum
from sinew.twin.cache import configure

Masks = Sequence[NDArray[np.bool_]]

_COLOURED = 0.2  # correlation of neighbouring residuals from which on their scores are asked too


def fit(
    records: Record | Sequence[Record],
    model: Model | str,
    *,
    varying: Sequence[str] = (),
    kept: Masks | None = None,
    guess: Fit | None = None,
    smaller: Fit | None = None,
) -> Fit:
    """Return the fit of a model to one record, or to several with the same mechanics.

    varying: of several records, the mechanical numbers (names of `LOCAL`: stiffness, damping, ...) that differ from
        group to group (`Record.group`); all others are shared.
    kept: masks of the samples to be fitted, one for each record, shape (n,); all where it is None. The simulation runs
        through the others, so what it says there is a prediction.
    guess: a fit of the same model to similar records, where the search begins.
    smaller: a fit of another model, with fewer terms or viscous damping, to the same samples; the search begins at what
        it found, too.
    Raises RecordingError for records that cannot be fitted, SpecError for a model that does not go with them.
    """
    configure()
    records = (records,) if isinstance(records, Record) else tuple(records)
    model = get_model(model) if isinstance(model, str) else model
    _check(records, model)
    masks = tuple(np.ones(r.size, dtype=bool) for r in records) if kept is None else tuple(kept)
    frames = (guess.frame,) if guess is not None else frames_of(records[0])
    for number, mask in enumerate(masks):
        if np.count_nonzero(mask) < FEWEST:
            raise RecordingError(
                f"record {number} has {np.count_nonzero(mask)} samples to fit, expected at least {FEWEST}; keep more"
            )
    found = [_fit_in_frame(records, model, frame, varying, masks, guess, smaller) for frame in frames]
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
    varying: Sequence[str],
    masks: Masks,
    guess: Fit | None,
    smaller: Fit | None,
) -> Fit:
    known = smaller if smaller is not None and smaller.frame == frame else None
    if guess is not None and len(guess.records) == len(records):
        scales, starts = [part.scales for part in guess.layout.parts], None
    else:
        scales, starts = _begin(records, model, frame, varying, masks)
        scales = scales if known is None else [part.scales for part in known.layout.parts]
    parts = [
        make_part(record, model, own, frame, mask) for record, own, mask in zip(records, scales, masks, strict=True)
    ]
    layout = make_layout(model, parts, varying)
    first = guess.solution.values if guess is not None and starts is None else first_values(layout, starts or [])
    taught = carried_over(layout, first, known) if known is not None and starts is not None else None
    solution = search(layout, first, masks, taught, known=guess is not None and starts is None)
    return _tell(layout, solution, masks, frame, records)


def _begin(
    records: Sequence[Record], model: Model, frame: Frame, varying: Sequence[str], masks: Masks
) -> tuple[list[Scales], list[dict[str, float]]]:
    """Return scales and starts of the records, begun together, or by group where the groups differ."""
    taught = []
    for record, mask in zip(records, masks, strict=True):  # what is held out must not even choose the start
        seen = np.flatnonzero(mask)
        taught.append(record.cut(int(seen[0]), int(seen[-1]) + 1))
    found: dict[int, tuple[Scales, dict[str, float]]] = {}
    groups = [record.group if varying else "" for record in records]
    for group in dict.fromkeys(groups):
        mine = [i for i, one in enumerate(groups) if one == group]
        found |= dict(zip(mine, begin([taught[i] for i in mine], model, frame), strict=True))
    return [found[i][0] for i in range(len(records))], [found[i][1] for i in range(len(records))]


def _tell(layout: Layout, solution: Solution, masks: Masks, frame: Frame, records: Sequence[Record]) -> Fit:
    pieces = [slice(a, b) for a, b in pairwise(np.cumsum([0, *(int(m.sum()) for m in masks)]))]
    certainty = _certainty(solution, pieces)
    parameters = mechanical_parameters(layout, solution, certainty)
    frequency, damping = oscillation(layout, solution, certainty)
    predicted = tuple(y * p.unit_size for y, p in zip(layout.outputs(solution.values), layout.parts, strict=True))
    off = np.concatenate([(r.output - y)[m] for r, y, m in zip(records, predicted, masks, strict=True)])
    return Fit(
        layout.model,
        frame,
        tuple(records),
        parameters,
        nuisance_parameters(layout, solution, certainty),
        frequency,
        damping,
        predicted,
        tuple(masks),
        float(np.sqrt(np.mean(off**2))),
        records[0].output_unit,
        solution.converged,
        solution.message,
        unidentifiable_directions(layout, solution, certainty),
        certainty,
        solution,
        layout,
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
