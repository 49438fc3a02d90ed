"""This is where models compete for a record: held-out prediction first, the information criterion second.

A model stays in the race if it predicts the held-out samples no worse than the best predictor does (blocks of squared
errors compared in pairs, two standard errors). Of those that stay the smallest BIC wins, or a smaller model whose BIC
is within 2 of it. Where another damping law comes within a factor e³ = 20 of its evidence and is no mere extension of
it, the record cannot tell the two apart, and the verdict says so.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sinew.identify.fit import fit
from sinew.identify.fitted import Fit
from sinew.identify.held_out import HeldOut, Split, fit_and_predict
from sinew.identify.model import MODELS, Model
from sinew.measure.errors import RecordingError

__all__ = ["Comparison", "Row", "compare", "compare_laws"]

Array = NDArray[np.float64]

_CLEAR, _HINT = 6.0, 2.0  # differences of BIC: told for certain; too small to add a term
_WORSE = 2.0  # standard errors of the paired difference of squared errors
_BLOCKS = 12
_HOPELESS = 3.0  # times the held-out error
_LAWS = {"viscous": "viscous damping", "loss-factor": "a constant loss factor", "coulomb": "viscous and dry friction"}


@dataclass(frozen=True)
class Row:
    """One model's result: rmse over the held-out samples, in the unit of the output, and BIC over the training ones."""

    model: Model
    rmse_test: float
    bic: float
    held_out: HeldOut


@dataclass(frozen=True)
class Comparison:
    """Which model the record supports.

    rows: best first. best: the fit of the winner, to all of the record where blocks of it were held out.
    decided: whether the damping law is told from the others. verdict: one sentence.
    """

    rows: tuple[Row, ...]
    best: Fit
    decided: bool
    verdict: str


def compare(split: Split, models: Sequence[Model], known: Sequence[Row] = ()) -> Comparison:
    """Return which of the models a record supports. known: rows of the same split, whose models are not fitted again.

    Raises RecordingError where none of them can be fitted.
    """
    rows: list[Row] = []
    refused: list[RecordingError] = []
    for model in models:
        if already := [row for row in known if row.model == model]:
            rows += already
            continue
        try:
            found = fit_and_predict(split, model)
        except RecordingError as error:
            refused.append(error)
            continue
        if np.isfinite(found.rmse):
            rows.append(Row(model, found.rmse, np.nan, found))
    if not rows:
        raise refused[0] if refused else RecordingError("no model can be fitted to this record")
    # Misfit makes residuals smooth, so the number that are independent is the best model's, the same for all.
    independent = min((row.held_out.fit for row in rows), key=lambda one: one.rmse).effective_samples
    rows = [replace(row, bic=row.held_out.fit.bic(independent)) for row in rows]
    staying = _staying(rows)
    lowest = min(row.bic for row in staying)
    best = min((row for row in staying if row.bic < lowest + _HINT), key=lambda row: (_size(row.model), row.bic))
    rivals = [row for row in staying if _rivals(row, best, staying)]
    if any(row.model.damping == "viscous" for row in rivals):  # nothing speaks against the plainest law
        plain = min((row for row in rivals if row.model.damping == "viscous"), key=lambda row: row.bic)
        best, rivals = plain, [best, *(row for row in rivals if row.model.damping != "viscous")]
    stays = [id(row) for row in staying]
    rows.sort(key=lambda row: (row is not best, id(row) not in stays, row.bic))
    final = best.held_out.fit
    if split.interleaved:
        final = fit(split.record, best.model, guess=final)
    return Comparison(tuple(rows), final, not rivals, _verdict(best, rivals, rows))


def compare_laws(split: Split, progress: Callable[[float, float], None] | None = None) -> Comparison:
    """Return the best of all damping laws and stiffness laws: the stiffness first, then the damping with it."""
    stiffness = compare(split, [MODELS[name] for name in ("linear", "cubic", "cubic-quadratic")])
    if progress is not None:
        progress(1, 2)
    first = stiffness.rows[0]
    linear = next((row for row in stiffness.rows if row.model.name == "linear"), first)
    # A damping law can do what a stiffness term had mimicked, unless the linear spring is hopeless.
    terms = {first.model.terms, ()} if linear.rmse_test < _HOPELESS * first.rmse_test else {first.model.terms}
    tried = [model for model in MODELS.values() if not model.pendulum and model.terms in terms]
    found = compare(split, list(dict.fromkeys([*(row.model for row in stiffness.rows), *tried])), stiffness.rows)
    if progress is not None:
        progress(2, 2)
    return found


def _size(model: Model) -> int:
    return len(model.mechanics("none"))


def _staying(rows: Sequence[Row]) -> list[Row]:
    converged = [row for row in rows if row.held_out.fit.converged] or list(rows)
    first = min(converged, key=lambda row: row.rmse_test)
    return [row for row in converged if not _is_worse(row.held_out.residual, first.held_out.residual)]


def _is_worse(one: Array, other: Array) -> bool:
    """Return whether one model's squared errors are larger than another's beyond chance, in blocks of samples."""
    size = max(1, one.size // _BLOCKS)
    count = one.size // size
    difference = (one**2 - other**2)[: count * size].reshape(count, size).mean(axis=1)
    if count < 4:
        return bool(difference.mean() > 0.1 * float(np.mean(other**2)))
    error = float(difference.std(ddof=1)) / np.sqrt(count)
    return bool(difference.mean() > _WORSE * error and difference.mean() > 0.01 * float(np.mean(other**2)))


def _rivals(row: Row, best: Row, staying: Sequence[Row]) -> bool:
    """Return whether another damping law has nearly the evidence of the best and is no mere extension of it."""
    if row.model.damping == best.model.damping or row.bic > best.bic + _CLEAR:
        return False
    if row.model.damping != "coulomb":
        return True
    # Dry friction extends viscous damping, and is no rival where it adds nothing to it.
    return not any(other.model.damping == "viscous" and other.bic <= row.bic for other in staying)


def _verdict(best: Row, rivals: Sequence[Row], rows: Sequence[Row]) -> str:
    law = _LAWS[best.model.damping]
    stiffness = {(): "a linear spring", ("cubic",): "a cubic spring"}.get(
        best.model.terms, "a pendulum" if best.model.pendulum else "a spring with quadratic and cubic terms"
    )
    if rivals:
        others = " or ".join(dict.fromkeys(_LAWS[row.model.damping] for row in rivals))
        return (
            f"cannot tell {law} from {others} in this record (BIC within {_CLEAR:g}, held-out errors alike); "
            f"{stiffness} with {law} is reported"
        )
    if len(rows) == 1:
        return f"{stiffness} with {law} was fitted; no other model was tried"
    second = min((row for row in rows if row is not best), key=lambda row: row.bic)
    return (
        f"{stiffness} with {law} is preferred: held-out rmse {best.rmse_test:.3g} against {second.rmse_test:.3g} of "
        f"{second.model.name}, BIC smaller by {second.bic - best.bic:.3g}"
    )
