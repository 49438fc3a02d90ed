"""Scatter of a fit's numbers over repeats: the bootstrap over whole records.

The covariance of a fit knows the noise inside the records, not what changes from one repeat to the next (friction that
settles, a joint that was clamped anew). Whole records are drawn with replacement and fitted together again.

Few repeats need care. Of R repeats of a group R - 1 are drawn, each weighing R/(R - 1) (Rao and Wu 1988): drawing R
would make the variance of a mean too small by the factor (R - 1)/R, a third for three repeats. With few repeats the
quantiles of the draws are too narrow as well (three repeats have six different draws), so the interval is Student's
about the fit, with as many degrees of freedom as repeats less groups; from ten repeats in every group on it is the
draws' own 5 and 95 % quantiles. Where the draws are few enough all of them are taken, with their probabilities.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement, product

import numpy as np

from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.fitted import DAMPING, FREQUENCY, Fit, number_names, physical_numbers
from sinew.identify.oscillator.least_squares import Problem, Solution, restricted, solve
from sinew.identify.oscillator.model import Model
from sinew.identify.oscillator.record import Record
from sinew.measure.arrays import Array
from sinew.measure.errors import RecordingError, SpecError
from sinew.measure.estimate import Estimate

_MANY = 10  # repeats of every group, from which on the draws' quantiles are the interval
_COARSE = 6  # degrees of freedom below which the message says how coarse the interval is


@dataclass(frozen=True)
class Bootstrap:
    """How a fit's numbers scatter over repeats.

    fit: to all records together. names: as `sinew.identify.oscillator.fitted.number_names` has them.
    estimates: by name: value of the fit, standard deviation and 90 % interval over repeats.
    draws: numbers in every draw, in their units, shape (draw, name); probability: of each draw, shape (draw,), sum one.
    repeats: how many records there are of each group. exact: whether these are all draws that there are.
    message: how it went, a sentence or two.
    """

    fit: Fit
    names: tuple[str, ...]
    estimates: dict[str, Estimate]
    draws: Array
    probability: Array
    repeats: dict[str, int]
    exact: bool
    message: str


def bootstrap_repeats(
    records: Sequence[Record],
    model: Model | str,
    *,
    varying: Sequence[str] = (),
    resamples: int = 200,
    seed: int = 0,
    progress: Callable[[float, float], None] | None = None,
) -> Bootstrap:
    """Return the fit of a model to repeats, its numbers with the intervals that their scatter gives.

    records: repeats of the same experiment; those of one `Record.group` (a pretension, a length) repeat each other, and
        are drawn among themselves. varying: numbers that each group has for itself, see
        `sinew.identify.oscillator.fit.fit`.
    resamples: draws at most. progress: takes (done, total).
    Raises SpecError where a group has one record only, RecordingError where no draw can be fitted, and what `fit`
    raises.
    """
    groups = [record.group for record in records]
    repeats = {group: groups.count(group) for group in dict.fromkeys(groups)}
    if not repeats or min(repeats.values()) < 2:
        lonely = next((group for group, count in repeats.items() if count < 2), "")
        raise SpecError(
            f"found one record {f'of group {lonely!r}' if lonely else 'or none'}, expected at least two repeats of "
            "everything; record again, or take the intervals of the fit"
        )
    if resamples < 20:
        raise SpecError(f"resamples is {resamples}, expected at least 20")
    whole = fit(records, model, varying=varying)
    counts, probability, exact = _draws(groups, repeats, resamples, np.random.default_rng(seed))
    weights = counts * np.array([repeats[group] / (repeats[group] - 1) for group in groups])
    found, good = [], np.ones(len(weights), dtype=bool)
    for i, weight in enumerate(weights):
        solution = _refit(whole, weight)
        good[i] = solution.converged
        found.append(solution.values)
        if progress is not None:
            progress(i + 1, len(weights))
    numbers = physical_numbers(whole, np.array(found))
    good &= np.isfinite(numbers).all(axis=1)
    if not good.any():
        raise RecordingError("no draw of repeats could be fitted; fit the records one by one and look at them")
    share = probability[good] / probability[good].sum()
    estimates = _estimates(whole, numbers[good], share, repeats)
    message = _message(repeats, len(weights), exact, int(np.sum(~good)))
    return Bootstrap(whole, number_names(whole), estimates, numbers[good], share, repeats, exact, message)


def _draws(
    groups: Sequence[str], repeats: dict[str, int], resamples: int, generator: np.random.Generator
) -> tuple[Array, Array, bool]:
    """Return how often each record is in each draw, shape (draw, record), the draws' probabilities, whether all."""
    members = [[i for i, one in enumerate(groups) if one == group] for group in repeats]
    number = math.prod(math.comb(2 * len(own) - 2, len(own) - 1) for own in members)
    if number <= resamples:
        rows, chance = [], []
        for chosen in product(*(combinations_with_replacement(own, len(own) - 1) for own in members)):
            row = np.bincount([i for part in chosen for i in part], minlength=len(groups))
            rows.append(row)
            chance.append(1.0 / math.prod(math.factorial(int(c)) for c in row))
        return np.array(rows, dtype=float), np.array(chance) / sum(chance), True
    counts = np.zeros((resamples, len(groups)))
    for own in members:
        counts[:, own] = generator.multinomial(len(own) - 1, np.full(len(own), 1.0 / len(own)), size=resamples)
    different, times = np.unique(counts, axis=0, return_counts=True)
    return different, times / resamples, False


def _refit(whole: Fit, weight: Array) -> Solution:
    """Return the fit with every record's squares weighed; numbers of records that are not drawn stay where they are."""
    present, layout = np.flatnonzero(weight > 0), whole.layout
    scale = np.repeat(np.sqrt(weight[present]), [int(whole.kept[i].sum()) for i in present])
    free = np.unique(np.concatenate([layout.index[i] for i in present]))
    drawn_layout = replace(
        layout,
        parts=tuple(layout.parts[i] for i in present),
        index=tuple(layout.index[i] for i in present),
        column=tuple(layout.column[i] for i in present),
        ratio=tuple(layout.ratio[i] for i in present),
    )
    x = whole.solution.values.copy()
    problem = restricted(drawn_layout.problem([whole.kept[i] for i in present]), x, free)
    drawn = Problem(lambda v: scale * problem.residual(v), lambda v: scale[:, None] * problem.jacobian(v))
    found = solve(drawn, x[free], tolerance=1e-8, max_evaluations=60)
    x[free] = found.values
    return replace(found, values=x)


def _estimates(whole: Fit, numbers: Array, share: Array, repeats: dict[str, int]) -> dict[str, Estimate]:
    found = {}
    values = physical_numbers(whole, whole.solution.values[None])[0]
    first = next(iter(repeats)) if any(entry.group for entry in whole.layout.entries) else None
    for name, value, column in zip(number_names(whole), values, numbers.T, strict=True):
        own = [count for group, count in repeats.items() if group and name.endswith(f"[{group}]")]
        if first is not None and name in (FREQUENCY, DAMPING):  # those of the first group
            own = [repeats[first]]
        counts = own or list(repeats.values())
        mean = float(share @ column)
        std = float(np.sqrt(share @ (column - mean) ** 2))
        if min(counts) < _MANY:
            found[name] = Estimate.student(float(value), std, sum(counts) - len(counts))
            continue
        order = np.argsort(column)
        low, high = np.interp([0.05, 0.95], np.cumsum(share[order]) - 0.5 * share[order], column[order])
        found[name] = Estimate(float(value), std, float(low), float(high))
    return found


def _message(repeats: dict[str, int], draws: int, exact: bool, lost: int) -> str:
    fewest, freedom = min(repeats.values()), sum(repeats.values()) - len(repeats)
    told = [f"{'all ' if exact else ''}{draws} different draws of repeats"]
    if fewest >= _MANY:
        told.append("intervals are the draws' 5 and 95 % quantiles")
    else:
        told.append(f"intervals are Student's with {freedom} degrees of freedom")
    if freedom < _COARSE:
        told.append(
            f"{sum(repeats.values())} repeats make them coarse: their width is itself known to about "
            f"{100 / math.sqrt(2 * freedom):.0f} %"
        )
    if lost:
        told.append(f"{lost} draws could not be fitted and are left out")
    return "; ".join(told)
