"""This is where models compete for several segments of one experiment: every third of them is held out in turn.

A joint that was recorded at many frequencies, or under several pretensions, is one joint: the segments share its
mechanics, or, under several pretensions, its inertia ratio, while stiffness and damping belong to a pretension. A model
is fitted to two thirds of the segments and predicts the others, of which only the start is sought, from their first two
periods. The information criterion is that of the fit to all segments. What decides is told in
`sinew.identify.comparison`.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from sinew.identify.comparison import Comparison, Row, choose, conclude, laws_to_try
from sinew.identify.fit import fit
from sinew.identify.held_out import HeldOut, predict
from sinew.identify.model import Model, get_model
from sinew.identify.record import Record
from sinew.measure.errors import RecordingError, SpecError

__all__ = ["compare_segments", "varying_mechanics"]

Array = NDArray[np.float64]

_FOLDS = 3
_FEWEST = 3


def varying_mechanics(records: Sequence[Record]) -> tuple[str, ...]:
    """Return the names (of `LOCAL`) that differ from group to group: all mechanics but the gain; none for one group."""
    if len({record.group for record in records}) < 2:
        return ()
    return ("stiffness", "damping", "loss_factor", "coulomb", "quadratic", "cubic")


def compare_segments(
    records: Sequence[Record],
    models: Sequence[Model | str] | None = None,
    *,
    varying: Sequence[str] | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> Comparison:
    """Return which of the models several segments of one experiment support.

    records: three or more; `Record.group` names the pretension. models: every damping law with every stiffness law if
        None. varying: mechanical numbers that differ from group to group, see `varying_mechanics`.
    progress: called with (done, total) fits.

    rows[0].rmse_test is over the held-out segments, each of which was held out once.
    Raises SpecError for fewer than three segments, RecordingError where no model can be fitted to them.
    """
    records = tuple(records)
    tried = [get_model(m) if isinstance(m, str) else m for m in (laws_to_try() if models is None else models)]
    free = tuple(varying_mechanics(records) if varying is None else varying)
    groups = [record.group if free else "" for record in records]
    _check(records, groups)
    folds = _folds(groups)
    rows: list[Row] = []
    refused: list[RecordingError] = []
    for done, model in enumerate(tried):
        try:
            rows.append(_row(records, model, free, folds))
        except RecordingError as error:
            refused.append(error)
        if progress is not None:
            progress(done + 1, len(tried))
    rows = [row for row in rows if np.isfinite(row.rmse_test)]
    if not rows:
        raise refused[0] if refused else RecordingError("no model can be fitted to these segments")
    choice = choose(rows)
    count = len(set(groups))
    what = f"recording ({len(records)} segments" + (f" at {count} pretensions" if count > 1 else "") + ")"
    return conclude(choice, choice.best.held_out.fit, what)


def _check(records: Sequence[Record], groups: Sequence[str]) -> None:
    if len(records) < _FEWEST:
        raise SpecError(f"found {len(records)} segments, expected at least {_FEWEST}; record more of them")
    if alone := [group for group in dict.fromkeys(groups) if groups.count(group) < 2]:
        raise SpecError(f"found one segment at {alone[0]}, expected two or more, to hold one out; leave it out")


def _folds(groups: Sequence[str]) -> NDArray[np.intp]:
    """Return which fold holds a segment out, shape (records,): every third of its group."""
    return np.array([(list(groups[:i]).count(group) + 1) % _FOLDS for i, group in enumerate(groups)])


def _row(records: Sequence[Record], model: Model, varying: Sequence[str], folds: NDArray[np.intp]) -> Row:
    whole = fit(records, model, varying=varying)
    residuals: list[Array] = [np.zeros(0)] * len(records)
    for fold in range(_FOLDS):
        taught = fit([r for r, own in zip(records, folds, strict=True) if own != fold], model, varying=varying)
        for i in map(int, np.flatnonzero(folds == fold)):
            residuals[i] = records[i].output - predict(taught, records[i])
    squares = np.array([float(np.mean(r**2)) for r in residuals])
    together = np.concatenate(residuals)
    return Row(model, float(np.sqrt(np.mean(together**2))), np.nan, HeldOut(whole, together), squares)
