"""Sketch of a curve for who moves a slider: the same equations, few harmonics, long steps, no refining.

Held against curves refined to 19 harmonics and more, of 30 joints drawn at random (silicone 40 to 80 by 60 to 150 mm,
guides on circles of 15 to 60 mm, levers of 4 to 20 g m², 0 to 12 mm of pretension, 2 to 30° of drive): amplitudes lay
within 0.4 % of the curve's height, the point of 90° within 0.05 % in frequency, the peak within 0.3 % in frequency and,
where it did not lie at the end of the band, 0.2 % in amplitude. A curve takes 50 ms once its code is compiled, a long
one twice that. Folds come and go in pairs where a curve is all but upright; pairs within 0.2 % of a frequency are left
out.
"""

import time
from collections.abc import Sequence

import numpy as np

from sinew.measure.arrays import Array, wrapped_lag
from sinew.predict.band import crest
from sinew.predict.joint import RESOLUTION
from sinew.solve.balance import Equations, Lane, Size, orders
from sinew.solve.branch import Branch, Mark, Prediction
from sinew.solve.continuation import OUTSIDE, Stride
from sinew.solve.curves import ENDS, Problem, first_curves
from sinew.solve.examination import (
    drive_phasor,
    half_range,
    lag_product,
    largest_multiplier,
    maps_of,
    phasors,
    rows_of,
)
from sinew.solve.landmark import FOLD, QUARTER, guesses

SKETCH_ERROR = 5e-3
"""Error of a sketched amplitude, in shares of the largest [1]: above the largest that was found."""

_SIZE, _STABILITY = Size(7, 32), Size(7, 64)
_STRIDE = Stride(first=0.05, most=0.2, correction=3e-2, tolerance=1e-3)
_EVERY = 2
"""So many points share one map of disturbances; between them the multiplier is interpolated."""

_APART = 2e-3


def sketch(problem: Problem, band_hz: Sequence[float]) -> Prediction:
    """Return the curves of all lanes over a band of frequencies [Hz], unrefined; `error` is `SKETCH_ERROR` throughout.

    Marked points are interpolated between the points of the curve, the peak as `sinew.predict.band.crest` does.
    """
    begin = time.perf_counter()
    window = 2 * np.pi * np.asarray(band_hz, dtype=float) / np.asarray(problem.lane.omega)[0]
    curve = first_curves(problem, window, RESOLUTION._replace(stride=_STRIDE), _SIZE)
    branches = []
    for i, (count, status) in enumerate(zip(np.asarray(curve.number), np.asarray(curve.status), strict=True)):
        points, tangents = (np.asarray(rows)[i, :count] for rows in (curve.points, curve.tangents))
        lane = rows_of(problem.lane, np.full(count, i))
        branches.append(_branch(points, tangents, lane, problem.equations, int(status)))
    return Prediction(tuple(branches), _SIZE.harmonics, SKETCH_ERROR, time.perf_counter() - begin)


def _branch(points: Array, tangents: Array, lane: Lane, equations: Equations, status: int) -> Branch:
    harmonics, count = _SIZE.harmonics, len(points)
    scale = np.asarray(lane.scale)[0] if count else np.ones(len(equations.coordinates))
    hertz = float(np.asarray(lane.omega)[0]) / (2 * np.pi) if count else 1.0
    response, drive = scale[equations.response], 1.0 if equations.drive is None else scale[equations.drive]
    height, product = half_range(points, equations, harmonics).value, lag_product(points, equations, harmonics)[0]
    folds, quarter = [], None
    for guess in guesses(points, tangents, height, product) if count > 2 else []:
        at = guess.point[None]
        size = float(half_range(at, equations, harmonics).value[0] * response)
        lag = float(wrapped_lag(np.conj(lag_product(at, equations, harmonics)[0]))[0])
        mark = Mark(float(at[0, -1]) * hertz, size, lag)
        if guess.kind == FOLD:
            folds.append(mark)
        elif guess.kind == QUARTER:
            quarter = mark
    branch = Branch(
        frequency_hz=points[:, -1] * hertz,
        amplitude=height * response,
        phase=wrapped_lag(np.conj(product)),
        orders=orders(equations.coordinates[equations.response], harmonics),
        harmonics=phasors(points, equations, harmonics, equations.response) * response,
        drive=drive_phasor(points, equations, harmonics) * drive,
        multiplier=_multipliers(points, lane, equations),
        folds=tuple(_distinct(folds)),
        peak=None,
        phase_90=quarter,
        error=np.full(count, SKETCH_ERROR),
        complete=status == OUTSIDE,
        message=ENDS[status],
    )
    return Branch(**{**branch.__dict__, "peak": crest(branch)})


def _distinct(folds: list[Mark]) -> list[Mark]:
    """Return the folds without pairs that undo each other within a hair of a frequency."""
    kept: list[Mark] = []
    for fold in folds:
        if kept and abs(fold.frequency_hz / kept[-1].frequency_hz - 1) < _APART:
            kept.pop()
        else:
            kept.append(fold)
    return kept


def _multipliers(points: Array, lane: Lane, equations: Equations) -> Array:
    """Return the modulus of the largest multiplier of each point, (n,)."""
    count = len(points)
    if not count:
        return np.zeros(0)
    some = np.unique(np.append(np.arange(0, count, _EVERY), count - 1))
    maps = maps_of(points[some], rows_of(lane, some), equations, _STABILITY)
    return np.asarray(np.interp(np.arange(count), some, largest_multiplier(maps, equations)))
