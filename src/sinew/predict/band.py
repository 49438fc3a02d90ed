"""Bands over frequency from the curves of drawn rigs, and intervals of what is marked on a curve.

Curves with folds have several motions at one frequency. A band is therefore of what a sweep meets
(`sinew.solve.branch`): up, with growing frequency, and down. Near a fold some draws have jumped and others
have not; there the band spans both.

Draws are computed with few harmonics, and the nominal curve with few and with many. What the many change there is taken
over to the draws, so that a band lies about the curve that is shown.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray

from sinew.measure.arrays import Array
from sinew.measure.errors import SpecError
from sinew.measure.estimate import NORMAL_90, Estimate
from sinew.measure.result import Column, Result
from sinew.plan.parameter import Parameter
from sinew.plan.plan import TendonMode
from sinew.plan.rig import RigSpec
from sinew.predict.joint import RESOLUTION, joint_problem
from sinew.solve.balance import Size
from sinew.solve.branch import Branch, Direction, Mark, Prediction, Swept, sweep
from sinew.solve.curves import Problem, Resolution, predict
from sinew.twin.parameters import Effects

_ENDS = (0.05, 0.5, 0.95)
_METHOD: Literal["median_unbiased"] = "median_unbiased"  # the usual rule makes the bands of few draws too narrow
_TOP, _FEWEST, _DEGREE = 0.9, 7, 4
_SMALL = 0.05


@dataclass(frozen=True, repr=False)
class Tube(Result):
    """5 %, 50 % and 95 % quantiles of a number over frequency, (g,), NaN where no draw's curve reaches."""

    low: Column
    median: Column
    high: Column

    def times(self, factor: float) -> "Tube":
        """Return it in a unit that is 1/factor as large."""
        return Tube(*(factor * part for part in (self.low, self.median, self.high)))


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


# Rigs are drawn from what is known of a calibrated one: its parameters, as they vary together.
#
# The parameters of the rig's `[calibration]` table are drawn from their joint normal distribution. Parameters with a
# 90 % interval that the table does not name are drawn independently, with the interval's half width over 1.645 as
# standard deviation. A draw in which a parameter lies outside its bounds is drawn again.

_TIMES = 200
_NEGATIVE = 1e-4


class Draws(NamedTuple):
    """Rigs that are as likely as the calibration says. names: of the k parameters that vary. values: (draw, k), SI.
    remarks: sentences on what to know of them."""

    rigs: tuple[RigSpec, ...]
    names: tuple[str, ...]
    values: Array
    remarks: tuple[str, ...]


def spread_of(rig: RigSpec) -> tuple[tuple[str, ...], Array]:
    """Return (dotted names of the parameters that vary, their covariance (k, k) in SI).

    Raises SpecError where nothing is known to vary, or where the correlations contradict each other.
    """
    table, known = dict(rig.parameters()), rig.calibration
    joint = () if known is None else known.parameters
    alone = [name for name, one in table.items() if one.interval90 is not None and name not in joint]
    names = (*joint, *alone)
    if not names:
        raise SpecError(
            f"the rig {rig.name} holds no intervals, so nothing is known of how far it can be off; give one that "
            "sinew calibrate wrote"
        )
    covariance = np.zeros((len(names), len(names)))
    if known is not None:
        lower = np.zeros((len(joint), len(joint)))
        for i, row in enumerate(known.correlation):
            lower[i, : i + 1] = row
        whole = lower + np.tril(lower, -1).T
        if np.linalg.eigvalsh(whole)[0] < -_NEGATIVE:
            raise SpecError(
                f"the correlations in [calibration] of the rig {rig.name} contradict each other (an eigenvalue is "
                "negative); calibrate anew, or take the table out"
            )
        covariance[: len(joint), : len(joint)] = np.outer(known.std, known.std) * whole
    for i, name in enumerate(alone, start=len(joint)):
        low, high = table[name].interval90 or (np.nan, np.nan)
        covariance[i, i] = ((high - low) / (2 * NORMAL_90)) ** 2
    return names, covariance


def draw_rigs(rig: RigSpec, count: int, seed: int) -> Draws:
    """Return `count` rigs drawn about a calibrated one; the same seed gives the same rigs.

    Raises SpecError as `spread_of`, and where hardly any draw lies inside the parameters' bounds.
    """
    names, covariance = spread_of(rig)
    table = dict(rig.parameters())
    centre = np.array([table[name].value for name in names])
    low, high = (np.array([table[name].bounds[i] for name in names]) for i in (0, 1))
    rng = np.random.default_rng(seed)
    factor, drawn, tried = factor_of(covariance), np.zeros((0, len(names))), 0
    room = 1e-9 * (high - low)
    while len(drawn) < count:
        tried += count
        if tried > _TIMES * count:
            raise SpecError(
                f"hardly any draw of the rig {rig.name} lies inside the bounds of its parameters; calibrate from "
                "recordings that tell more, or widen the bounds"
            )
        some = centre + rng.standard_normal((count, len(names))) @ factor.T
        inside = np.all((some >= low - room) & (some <= high + room), axis=1)
        drawn = np.concatenate([drawn, some[inside]])
    drawn = np.clip(drawn[:count], low, high)
    return Draws(
        tuple(_moved(rig, names, row) for row in drawn), names, drawn, tuple(_remarks(rig, table, tried, count))
    )


def carried_over(base: RigSpec, rig: RigSpec) -> tuple[RigSpec, tuple[str, ...]]:
    """Return (a rig that was made from a calibrated one, with what is still known of it; what is no longer known).

    Parameters that have kept their value and its origin keep their uncertainty. Dotted names of those that have not are
    returned: they are what the design says, and are taken as certain, unless they have an interval of their own.
    """
    before, after = dict(base.parameters()), dict(rig.parameters())
    known, old = base.calibration, [name for name, one in before.items() if one.interval90 is not None]
    names = dict.fromkeys((*old, *(known.parameters if known is not None else ())))
    carried = [
        name for name in names if (after[name].value, after[name].origin) == (before[name].value, before[name].origin)
    ]
    intervals = {name: {"interval90": before[name].interval90} for name in carried}
    parts: dict[str, object] = {}
    for part in {name.split(".")[0] for name in carried}:
        mine = {name.split(".")[1]: row for name, row in intervals.items() if name.startswith(f"{part}.")}
        section = getattr(rig, part)
        parts[part] = section.model_copy(
            update={name: getattr(section, name).model_copy(update=row) for name, row in mine.items()}
        )
    parts["calibration"] = None if known is None else known.only(carried)
    certain = tuple(name for name in names if name not in carried and after[name].interval90 is None)
    return rig.model_copy(update=parts), certain


def factor_of(covariance: Array) -> Array:
    """Return F with F Fᵀ = covariance, (k, k); what rounding made negative counts as zero."""
    std = np.sqrt(np.diag(covariance))
    safe = np.where(std > 0, std, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(safe, safe))
    return np.asarray(std[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


def _remarks(rig: RigSpec, table: dict[str, Parameter], tried: int, count: int) -> list[str]:
    lines = []
    if rig.calibration is None:
        lines.append(
            "the rig has intervals but no [calibration] table, so its parameters were drawn independently and the "
            "bands are too wide where they are known better together; calibrate it anew"
        )
    fixed = [name for name, one in table.items() if one.origin == "assumed" and one.bounds[0] < one.bounds[1]]
    lines.append(f"{len(fixed)} assumed parameters are held at their values; the bands say nothing of them")
    if tried > 2 * count:
        lines.append("more than half of the draws lay outside the bounds of the parameters and were drawn again")
    return lines


def _moved(rig: RigSpec, names: tuple[str, ...], values: Array) -> RigSpec:
    """Return the rig with other values, without intervals and calibration of its own."""
    parts: dict[str, dict[str, Parameter]] = {}
    for dotted, value in zip(names, values.tolist(), strict=True):
        part, name = dotted.split(".")
        old = getattr(getattr(rig, part), name)
        parts.setdefault(part, {})[name] = old.model_copy(update={"value": value, "interval90": None})
    moved: dict[str, object] = {part: getattr(rig, part).model_copy(update=rows) for part, rows in parts.items()}
    return rig.model_copy(update={**moved, "calibration": None})


# The curves of drawn rigs are computed: many lanes at once, with few harmonics.

COARSE = RESOLUTION._replace(sizes=((Size(7, 64), Size(7, 64)),))
"""Waves of the draws: those that a curve is followed with, not refined."""

_DRAWN = COARSE._replace(stability=False)
_RIGS = 16

Make = Callable[[RigSpec], Problem]


def joined(problems: Sequence[Problem]) -> Problem:
    """Return the lanes of several problems of the same equations as one problem."""
    first = problems[0]

    def side_by_side(*leaves: Any) -> Any:
        return np.concatenate([np.asarray(leaf) for leaf in leaves])

    lane = jax.tree.map(side_by_side, *(one.lane for one in problems))
    return first._replace(lane=lane, rest=np.concatenate([one.rest for one in problems]))


def drawn_branches(
    rigs: Sequence[RigSpec],
    make: Make,
    band_hz: tuple[float, float],
    resolution: Resolution = _DRAWN,
    progress: Callable[[float, float], None] | None = None,
) -> list[tuple[Branch, ...]]:
    """Return the curves of every rig, one tuple each, without their multipliers.

    make: returns a rig's problem; the same lanes for each. progress: called with (done, total) rigs.
    """
    found: list[tuple[Branch, ...]] = []
    for begin in range(0, len(rigs), _RIGS):
        some = [make(rig) for rig in rigs[begin : begin + _RIGS]]
        branches = predict(joined(some), band_hz, resolution).branches
        width = len(branches) // len(some)
        found += [branches[i : i + width] for i in range(0, len(branches), width)]
        if progress is not None:
            progress(len(found), len(rigs))
    return found


def bands_of(
    prediction: Prediction,
    rig: RigSpec,
    draws: Draws,
    pretension_mm: Sequence[float],
    amplitude_deg: float,
    band_hz: tuple[float, float],
    *,
    mode: TendonMode = "position",
    effects: Effects | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> list[Band]:
    """Return the band of each curve of a prediction.

    prediction: of the rig itself, at these pretensions [mm], amplitude of the command [deg] and band of frequencies;
    draws: of that rig. progress: called with (done, total) rigs.
    """

    def make(one: RigSpec) -> Problem:
        return joint_problem(one, list(pretension_mm), amplitude_deg, band_hz, mode=mode, effects=effects)

    coarse, *drawn = drawn_branches([rig, *draws.rigs], make, band_hz, progress=progress)
    return [
        band_of(nominal, coarse[i], [branches[i] for branches in drawn])
        for i, nominal in enumerate(prediction.branches)
    ]
