"""This is where an answer to an open question of the paper is held: a verdict, its numbers, what they rest on."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special

from sinew.measure.estimate import Estimate

__all__ = ["CANNOT_TELL", "Answer", "Cell", "Pooled", "cannot_tell", "in_words", "pool_repeats", "scaled"]

Array = NDArray[np.float64]
Cell = float | Estimate

CANNOT_TELL = "cannot tell"
"""Verdict where the recording lacks what an answer needs, or where its interval holds every verdict."""


@dataclass(frozen=True)
class Answer:
    """What a recording says about one question.

    name: short, for files and JSON. question: in full, with the paper's section. verdict: a few words, or
    `CANNOT_TELL`. sentences: the verdict in full, then what it rests on and what limits it.
    numbers: by name with unit; the first is the headline. rows: one for each pretension, by name with unit.
    """

    name: str
    question: str
    verdict: str
    sentences: tuple[str, ...]
    numbers: Mapping[str, Estimate] = field(default_factory=dict)
    rows: tuple[Mapping[str, Cell], ...] = ()

    @property
    def told(self) -> bool:
        """Return whether the recording answers the question."""
        return self.verdict != CANNOT_TELL

    def column(self, name: str) -> tuple[Array, Array, Array]:
        """Return (value, low, high) of a column of the rows, shape (p,) each; NaN where a row lacks it."""
        cells = [row.get(name, math.nan) for row in self.rows]
        found = [(c.value, c.low, c.high) if isinstance(c, Estimate) else (c, c, c) for c in cells]
        value, low, high = np.array(found, dtype=float).reshape(-1, 3).T
        return value, low, high

    def to_json(self) -> dict[str, Any]:
        """Return the answer as plain numbers, lists and texts; what is not finite becomes null."""

        def plain(cell: Cell) -> Any:
            if isinstance(cell, Estimate):
                return cell.to_json()
            return float(cell) if math.isfinite(cell) else None

        return {
            "name": self.name,
            "question": self.question,
            "verdict": self.verdict,
            "sentences": list(self.sentences),
            "numbers": {name: one.to_json() for name, one in self.numbers.items()},
            "rows": [{name: plain(cell) for name, cell in row.items()} for row in self.rows],
        }


def cannot_tell(name: str, question: str, *why: str) -> Answer:
    """Return the answer of a recording that lacks what the question needs; why: sentences."""
    return Answer(name, question, CANNOT_TELL, why)


@dataclass(frozen=True)
class Pooled:
    """Means over repeats of several conditions, whose scatter is taken to be the same.

    estimates: one for each condition. std: of a single draw, by all of them, with its degrees of freedom.
    shared: standard uncertainty of each that repeating does not make smaller.
    """

    estimates: tuple[Estimate, ...]
    std: float
    degrees_of_freedom: float
    shared: tuple[float, ...]

    def significant(self, level: float = 0.1) -> tuple[int, int]:
        """Return how many conditions lie above and below zero beyond chance, at a level for all of them together."""
        count = sum(math.isfinite(one.std) for one in self.estimates)
        if not count or not self.degrees_of_freedom > 0:
            return 0, 0
        t = float(special.stdtrit(self.degrees_of_freedom, 1.0 - level / (2.0 * count)))
        reach = [t * one.std for one in self.estimates]
        above = sum(one.value > r for one, r in zip(self.estimates, reach, strict=True))
        return above, sum(one.value < -r for one, r in zip(self.estimates, reach, strict=True))


def pool_repeats(
    groups: Sequence[Sequence[float]], stds: Sequence[Sequence[float]], shared: Sequence[float] | None = None
) -> Pooled:
    """Return the mean of each condition's repeats with a 90 % interval from the scatter of all conditions.

    groups: repeats of each condition, NaN left out. stds: standard deviation of each repeat by its own fit. shared:
    standard uncertainty of each condition beside the scatter.

    The standard deviation of one repeat is the larger of the pooled scatter (Σ(r - 1) degrees of freedom) and the root
    mean square of the fits' own; without any repeats it is the latter, its intervals normal.
    """
    rows = [np.asarray(group, dtype=float) for group in groups]
    known = [row[np.isfinite(row)] for row in rows]
    freedom = sum(max(row.size - 1, 0) for row in known)
    squares = sum(float(((row - row.mean()) ** 2).sum()) for row in known if row.size > 1)
    own = np.array([value for row in stds for value in row], dtype=float)
    own = own[np.isfinite(own)]
    by_fit = float(np.sqrt(np.mean(own**2))) if own.size else math.nan
    scatter = math.sqrt(squares / freedom) if freedom else math.nan
    std = float(np.fmax(scatter, by_fit))
    dof = float(freedom) if freedom and scatter >= np.nan_to_num(by_fit) else 1e6
    beside = tuple(0.0 for _ in rows) if shared is None else tuple(map(float, shared))
    return Pooled(tuple(_mean(row, std, dof, more) for row, more in zip(known, beside, strict=True)), std, dof, beside)


def _mean(row: Array, std: float, dof: float, shared: float) -> Estimate:
    if not row.size or not math.isfinite(std):
        return Estimate(float(row.mean()) if row.size else math.nan, math.nan, math.nan, math.nan)
    return Estimate.student(float(row.mean()), math.hypot(std / math.sqrt(row.size), shared), dof)


def scaled(estimate: Estimate, factor: float) -> Estimate:
    """Return an estimate times a positive factor."""
    return Estimate(*(factor * x for x in (estimate.value, estimate.std, estimate.low, estimate.high)))


def in_words(estimate: Estimate, factor: float = 1.0, unit: str = "") -> str:
    """Return "value [low, high] unit" of an estimate times a factor, to two digits of the width of its interval."""
    value, low, high = (factor * x for x in (estimate.value, estimate.low, estimate.high))
    width = abs(high - low)
    if math.isfinite(width) and width > 0:
        places = min(6, max(0, 1 - math.floor(math.log10(width))))
        text = f"{value:.{places}f} [{low:.{places}f}, {high:.{places}f}]"
    elif math.isnan(width):
        text = f"{value:.3g}"
    else:
        text = f"{value:.3g} [{low:.3g}, {high:.3g}]"
    return f"{text} {unit}".rstrip().replace("-", "−").replace("inf", "∞")
