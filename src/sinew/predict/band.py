"""This is where the curves of drawn rigs become bands over frequency, and intervals of what is marked on a curve.

Curves with folds have several motions at one frequency. A band is therefore of what a sweep meets
(`sinew.predict.sweep`): up, with growing frequency, and down. Near a fold some draws have jumped and others have not;
there the band spans both.

Draws are computed with few harmonics, and the nominal curve with few and with many. What the many change there is taken
over to the draws, so that a band lies about the curve that is shown.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sinew.measure.estimate import Estimate
from sinew.predict.branch import Branch, Mark
from sinew.predict.sweep import Direction, Swept, sweep

__all__ = ["Band", "Marked", "Tube", "band_of", "crest", "estimate_of_deviations"]

Array = NDArray[np.float64]

_ENDS = (0.05, 0.5, 0.95)
_METHOD: Literal["median_unbiased"] = "median_unbiased"  # the usual rule makes the bands of few draws too narrow
_TOP, _FEWEST, _DEGREE = 0.9, 7, 4
_SMALL = 0.05


@dataclass(frozen=True)
class Tube:
    """5 %, 50 % and 95 % quantiles of a number over frequency, (g,), NaN where no draw's curve reaches."""

    low: Array
    median: Array
    high: Array


@dataclass(frozen=True)
class Marked:
    """A marked point with intervals: frequency [Hz], amplitude [rad]; draws: how many of them have it."""

    frequency_hz: Estimate
    amplitude: Estimate
    draws: int


@dataclass(frozen=True)
class Band:
    """What is known of one curve.

    frequency_hz: (g,). up, down: amplitude (half of peak to peak [rad]) and phase (lag [rad]) that a sweep meets.
    reached: how many draws have a curve at each frequency, (g,). peak, phase_90: None where the nominal curve has none.
    folds: of the nominal curve, in its order; of the draws those with as many folds count.
    draws: all of them; complete: those whose curve reaches the end of the band; folded: those with folds.
    """

    frequency_hz: Array
    up: tuple[Tube, Tube]
    down: tuple[Tube, Tube]
    reached: NDArray[np.int64]
    peak: Marked | None
    phase_90: Marked | None
    folds: tuple[Marked, ...]
    draws: int
    complete: int
    folded: int


def band_of(nominal: Branch, coarse: Branch, drawn: Sequence[Branch], frequency_hz: Array | None = None) -> Band:
    """Return the band of one curve.

    nominal: the curve that is shown. coarse: the same, computed as the draws were. drawn: curves of the draws.
    frequency_hz: increasing, (g,); else that of the nominal curve's points.
    """
    at = np.unique(nominal.frequency_hz) if frequency_hz is None else frequency_hz
    up, reached = _tubes(nominal, coarse, drawn, at, "up")
    folded = sum(bool(one.folds) for one in drawn)
    down = _tubes(nominal, coarse, drawn, at, "down")[0] if folded or nominal.folds else up
    same = [one for one in drawn if len(one.folds) == len(nominal.folds) == len(coarse.folds)]
    return Band(
        at,
        up,
        down,
        reached,
        _marked(nominal.peak, crest(coarse), [crest(one) for one in drawn]),
        _marked(nominal.phase_90, coarse.phase_90, [one.phase_90 for one in drawn]),
        tuple(
            marked
            for i, fold in enumerate(nominal.folds)
            if (marked := _marked(fold, _fold(i)(coarse), list(map(_fold(i), same)))) is not None
        ),
        len(drawn),
        sum(one.complete for one in drawn),
        folded,
    )


def crest(branch: Branch) -> Mark | None:
    """Return the largest amplitude of a curve, None where it lies at an end.

    Frequency and amplitude of the top are polynomials of the lag, which goes on through a fold.

    The top is what lies above nine tenths of the largest amplitude about it, seven points at least. Where the equations
    have corners the points scatter by some 1e-4 of the amplitude, and the largest one by some 1e-3 in frequency; many
    curves that are compared may differ by less.
    """
    size = branch.amplitude
    if size.size < _FEWEST:
        return None
    i = int(np.argmax(size))
    if i in (0, size.size - 1):
        return None
    low = high = i
    while low > 0 and (size[low - 1] >= _TOP * size[i] or (i - low < _FEWEST // 2)):
        low -= 1
    while high < size.size - 1 and (size[high + 1] >= _TOP * size[i] or (high - i < _FEWEST // 2)):
        high += 1
    top = slice(low, high + 1)
    lag = np.unwrap(branch.phase[top])
    fits = [np.polynomial.Polynomial.fit(lag, row[top], _DEGREE) for row in (branch.frequency_hz, size)]
    fine = np.linspace(float(lag.min()), float(lag.max()), 2001)
    best = float(fine[int(np.argmax(fits[1](fine)))])
    return Mark(float(fits[0](best)), float(fits[1](best)), best)


def _fold(index: int) -> Callable[[Branch], Mark | None]:
    return lambda branch: branch.folds[index] if index < len(branch.folds) else None


def _marked(nominal: Mark | None, coarse: Mark | None, drawn: Sequence[Mark | None]) -> Marked | None:
    """Return a mark of the nominal curve with the intervals that the draws' deviations from the coarse one give."""
    if nominal is None:
        return None
    there = [one for one in drawn if one is not None]
    centre = coarse or nominal
    frequency = np.array([one.frequency_hz - centre.frequency_hz for one in there])
    amplitude = np.array([one.amplitude - centre.amplitude for one in there])
    return Marked(
        estimate_of_deviations(nominal.frequency_hz, frequency),
        estimate_of_deviations(nominal.amplitude, amplitude),
        len(there),
    )


def estimate_of_deviations(value: float, off: Array) -> Estimate:
    """Return a value with the standard deviation and the 5 % and 95 % quantiles of what draws deviate from it, (d,);
    NaN for fewer than two draws."""
    if off.size < 2:
        return Estimate(value, float("nan"), float("nan"), float("nan"))
    low, high = np.quantile(off, (_ENDS[0], _ENDS[2]), method=_METHOD)
    return Estimate(value, float(off.std(ddof=1)), value + float(low), value + float(high))


def _tubes(
    nominal: Branch, coarse: Branch, drawn: Sequence[Branch], at: Array, direction: Direction
) -> tuple[tuple[Tube, Tube], NDArray[np.int64]]:
    """Return (tubes of amplitude and phase, draws that reach each frequency)."""
    fine, rough = sweep(nominal, at, direction), sweep(coarse, at, direction)
    ratio, shift = _correction(fine, rough)
    swept = [sweep(one, at, direction) for one in drawn]
    amplitude = np.array([one.amplitude * ratio for one in swept]).reshape(len(drawn), at.size)
    base = np.where(np.isfinite(fine.phase), fine.phase, np.pi / 2)
    apart = np.array([one.phase + shift - base for one in swept]).reshape(len(drawn), at.size)
    apart = np.mod(apart + np.pi, 2 * np.pi) - np.pi
    return (_tube(amplitude), _tube(base + apart)), np.isfinite(amplitude).sum(axis=0)


def _correction(fine: Swept, rough: Swept) -> tuple[Array, Array]:
    """Return what many harmonics change: factor of the amplitude, shift of the lag [rad]; (1, 0) where they would move
    the curve across a fold."""
    ratio = np.divide(fine.amplitude, rough.amplitude, out=np.ones_like(fine.amplitude), where=rough.amplitude > 0)
    shift = np.mod(fine.phase - rough.phase + np.pi, 2 * np.pi) - np.pi
    good = np.isfinite(ratio) & (np.abs(ratio - 1) < _SMALL) & (np.abs(shift) < _SMALL)
    return np.where(good, ratio, 1.0), np.where(good, shift, 0.0)


def _tube(values: Array) -> Tube:
    """Return the quantiles over the first axis of values (draw, g), NaN left out."""
    found = np.full((3, values.shape[1]), np.nan)
    known = np.isfinite(values).any(axis=0)
    if known.any():
        found[:, known] = np.nanquantile(values[:, known], _ENDS, axis=0, method=_METHOD)
    return Tube(*found)
