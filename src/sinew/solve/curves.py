"""Curves of lanes: first points, continuation, examination, marked points, harmonics enough."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sinew.measure.arrays import Array, wrapped_lag
from sinew.solve.balance import Equations, Lane, Size, embedded, orders, scales, slices, unknowns
from sinew.solve.branch import (
    FOLD,
    PEAK,
    QUARTER,
    Branch,
    Guess,
    Located,
    Mark,
    Prediction,
    Search,
    guesses,
    interpolated_peak,
    locate,
)
from sinew.solve.continuation import LIMIT, LOST, OUTSIDE, POINTS, STUCK, Curve, Stride, follow
from sinew.solve.examination import Examination, examine, in_blocks, largest_multiplier, pool, rows_of

LANES = 4
"""Lanes that are followed together."""

_RAMP = (0.1, 0.25, 0.5, 0.75, 1.0)
_NEAR = 0.02
ENDS = {
    OUTSIDE: "the curve was followed through the band",
    LIMIT: f"the curve was not finished after {POINTS} points; narrow the band",
    STUCK: "the curve was lost where even the smallest step found no steady motion",
    LOST: "no steady motion was found at the first frequency; begin at another one or with a smaller drive",
}
"""How a curve ended, in words, by its status."""


class Resolution(NamedTuple):
    """sizes: pairs of waves, those that the curve is followed with and the finer ones that its points are refined to;
    tried one after the other until the error estimate is below the tolerance [1]. stride: along the curve. search: of
    the marked points. stability: whether multipliers are wanted; else they are NaN."""

    sizes: tuple[tuple[Size, Size], ...]
    tolerance: float
    stride: Stride = Stride()
    search: Search = Search()
    stability: bool = True


class Problem(NamedTuple):
    """Lanes to be computed. lane: with a leading axis. rest: mean of each coordinate without drive, (lane, c).
    weakened: returns the equations' numbers with a share of their drive. eased: returns numbers that are the easier to
    balance the smaller the share is, for a first point that is not found at once; None for weakened ones."""

    equations: Equations
    lane: Lane
    rest: Array
    weakened: Callable[[Any, float], Any]
    eased: Callable[[Any, float], Any] | None = None


def at_rest(problem: Problem, size: Size, frequency: float) -> Array:
    """Return scaled unknowns (lane, m + 1) of no motion at a scaled frequency."""
    equations, lanes = problem.equations, problem.rest.shape[0]
    x = np.zeros((lanes, unknowns(equations, size.harmonics) + 1))
    for c, part in enumerate(slices(equations, size.harmonics)):
        if orders(equations.coordinates[c], size.harmonics)[0] == 0:
            x[:, part.start] = problem.rest[:, c] / np.asarray(problem.lane.scale)[:, c]
    x[:, -1] = frequency
    return x


def _followed(
    start: Array, lane: Lane, window: Array, limit: int, equations: Equations, size: Size, stride: Stride
) -> Curve:
    """Return the curves from the given motions, in blocks of `LANES` on all cores."""
    go = partial(follow, window=window, limit=np.int64(limit), stride=stride)
    return Curve(*in_blocks(go, start, lane, equations, size, 1 if len(start) == 1 else LANES))  # type: ignore[arg-type]


def _ramped(start: Array, problem: Problem, window: Array, resolution: Resolution, size: Size) -> Array:
    """Return first points that were reached with a growing drive, or as `Problem.eased` says."""
    x = start
    for share in _RAMP:
        lane = problem.lane._replace(p=(problem.eased or problem.weakened)(problem.lane.p, share))
        curve = _followed(x, lane, window, 1, problem.equations, size, resolution.stride)
        reached = np.asarray(curve.number) > 0
        x = np.where(reached[:, None], np.asarray(curve.points)[:, 0], x)
    return x


def first_curves(problem: Problem, window: Array, resolution: Resolution, size: Size) -> Curve:
    """Return the curves of all lanes as they were followed, in scaled unknowns; the drive grows where it must.

    window: scaled frequencies at which they begin and end, (2,). resolution: whose stride is taken.
    """
    start = at_rest(problem, size, float(window[0]))
    args = problem.equations, size, resolution.stride
    curve = _followed(start, problem.lane, window, POINTS, *args)
    lost = np.flatnonzero(np.asarray(curve.status) == LOST)
    if not lost.size:
        return curve
    some = problem._replace(lane=rows_of(problem.lane, lost), rest=problem.rest[lost])
    again = _followed(_ramped(start[lost], some, window, resolution, size), some.lane, window, POINTS, *args)
    rows = [np.array(leaf) for leaf in curve]
    for row, better in zip(rows, again, strict=True):
        row[lost] = np.asarray(better)
    return Curve(*rows)  # type: ignore[arg-type]


def _located(found: list[tuple[int, Guess]], problem: Problem, search: Search, size: Size, fine: Size) -> list[Located]:
    """Return the located point of each guess (lane, guess) with the finer waves."""
    if not found:
        return []
    slots = embedded(problem.equations, size.harmonics, fine.harmonics)
    x, normal = np.zeros((2, len(found), slots[-1] + 1))
    x[:, slots], normal[:, slots] = (np.stack([getattr(g, name) for _, g in found]) for name in ("point", "tangent"))
    kind = np.array([guess.kind for _, guess in found])
    lane = rows_of(problem.lane, np.array([i for i, _ in found]))
    done = locate(x, normal, kind, lane, problem.equations, fine, search)
    return [Located(*(row[i] for row in done)) for i in range(len(found))]


def _branch(
    lane: int,
    problem: Problem,
    fine: Size,
    curve: Curve,
    seen: Examination,
    part: NDArray[np.intp],
    marks: list[tuple[Guess, Located]],
    enough: float,
) -> Branch:
    equations, own = problem.equations, rows_of(problem.lane, np.array(lane))
    scale, hertz = own.scale, float(own.omega) / (2 * np.pi)
    response, drive = scale[equations.response], 1.0 if equations.drive is None else scale[equations.drive]
    count, status = seen.frequency.size, int(curve.status[lane])
    by_kind: dict[int, list[Mark]] = {FOLD: [], PEAK: [], QUARTER: []}
    notes, lost = [ENDS[status]], 0
    missing = int(curve.number[lane]) - count
    if missing:
        notes.append(
            f"{missing} points could not be refined to {fine.harmonics} harmonics and were left out; corners in the "
            "motion, as of tendons that go slack, need more"
        )
    for guess, at in marks:
        if float(at.error) < enough and abs(float(at.points[-1] - guess.point[-1])) < _NEAR:
            mark = Mark(
                float(at.points[-1]) * hertz, float(at.half_range * response), float(wrapped_lag(np.conj(at.lag)))
            )
            by_kind[guess.kind].append(mark)
        elif guess.kind == PEAK and not missing:
            where = interpolated_peak(
                seen.frequency * hertz, seen.half_range * response, wrapped_lag(np.conj(seen.product))
            )
            by_kind[PEAK].append(Mark(*where))
            notes.append("its peak was interpolated")
        else:
            lost += 1
    if lost:
        notes.append(f"{lost} of its folds, peaks and places where it lags by 90° could not be located")
    largest = float(np.max(seen.half_range, initial=0.0)) or 1.0
    error = np.maximum(np.abs(seen.range_change) / largest, np.abs(seen.frequency_change))
    return Branch(
        frequency_hz=seen.frequency * hertz,
        amplitude=seen.half_range * response,
        phase=wrapped_lag(np.conj(seen.product)),
        orders=orders(equations.coordinates[equations.response], fine.harmonics),
        harmonics=seen.response * response,
        drive=seen.drive * drive,
        multiplier=largest_multiplier(seen.maps, equations) if seen.maps.size else np.full(count, np.nan),
        folds=tuple(by_kind[FOLD]),
        peak=by_kind[PEAK][0] if by_kind[PEAK] else None,
        phase_90=by_kind[QUARTER][0] if by_kind[QUARTER] else None,
        error=error,
        complete=status == OUTSIDE,
        message="; ".join(notes),
        motion=seen.motion[:, :-1]
        * np.asarray(scales(rows_of(problem.lane, np.array(lane)), equations, fine.harmonics)),
        waves=fine.harmonics,
        holes=np.flatnonzero(np.diff(part) > 1) + 1,
    )


def _resolved(problem: Problem, window: Array, resolution: Resolution, size: Size, fine: Size) -> list[Branch]:
    equations = problem.equations
    curve = first_curves(problem, window, resolution, size)
    count = np.asarray(curve.number)
    lanes = np.repeat(np.arange(count.size), count)
    at = np.concatenate([np.arange(n) for n in count])
    points, tangents = np.asarray(curve.points)[lanes, at], np.asarray(curve.tangents)[lanes, at]
    across = tangents.copy()
    fixed = (at == 0) | ((at == count[lanes] - 1) & (np.asarray(curve.status)[lanes] == OUTSIDE))
    across[fixed] = np.eye(points.shape[1])[-1]  # the ends stay at their frequency
    own = rows_of(problem.lane, lanes)
    seen = examine(points, across, own, equations, size, fine, stability=resolution.stability)
    parts = [np.flatnonzero(seen.settled & (lanes == i)) for i in range(count.size)]
    each = [Examination(*(leaf[part] for leaf in seen)) for part in parts]  # type: ignore[arg-type]
    found: list[tuple[int, Guess]] = []
    for lane, (part, one) in enumerate(zip(parts, each, strict=True)):
        if part.size > 2:
            marked = guesses(points[part], tangents[part], one.half_range, one.product)
            found += [(lane, guess) for guess in marked]
    places = _located(found, problem, resolution.search, size, fine)
    marks: list[list[tuple[Guess, Located]]] = [[] for _ in each]
    for (lane, guess), resolved in zip(found, places, strict=True):
        marks[lane].append((guess, resolved))
    enough = resolution.search.enough

    def branch(i: int) -> Branch:
        return _branch(i, problem, fine, curve, each[i], parts[i], marks[i], enough)

    return list(pool().map(branch, range(len(each))))


def predict(problem: Problem, band_hz: Sequence[float], resolution: Resolution) -> Prediction:
    """Return the curves of all lanes from the lower end of a band of frequencies [Hz] on.

    Sizes of waves are tried one after the other until the error estimate is below the tolerance; finer ones that lose
    a curve on its way do not replace coarser ones that did not.
    """
    begin = time.perf_counter()
    omega = np.asarray(problem.lane.omega)
    window = 2 * np.pi * np.asarray(band_hz, dtype=float) / omega[0]
    best, reached = Prediction((), 0, np.inf, 0.0), -1
    for size, fine in resolution.sizes:
        branches = _resolved(problem, window, resolution, size, fine)
        error = max((float(np.max(b.error, initial=0.0)) for b in branches), default=0.0)
        complete = sum(b.complete for b in branches)
        if complete >= reached:
            best, reached = Prediction(tuple(branches), fine.harmonics, error, 0.0), complete
        if error <= resolution.tolerance:
            break
    return replace(best, wall_s=time.perf_counter() - begin)
