"""An answer to an open question of the paper: a verdict, its numbers, and two sentences."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sinew.measure.arrays import Array
from sinew.measure.estimate import Estimate, interval, typeset
from sinew.measure.result import plain

Cell = float | Estimate

CANNOT_TELL = "cannot tell"
"""Verdict where the recording lacks what an answer needs, or where its interval holds every verdict."""

QUESTIONS = {
    "hardening": "Is the hardening real: does the stiffness change with amplitude, beyond chance? (section 5.2.3)",
    "saturation": "Is the saturation the drive's or the joint's? (sections 4.1 and 5.2.4)",
    "losses": "How much of D is sensor delay, silicone, guide friction? (sections 4.2, 5.2.5 and 5.3)",
    "constancy": "Does Lehr's damping D stay constant over pretension, beyond chance? (section 4.2)",
    "delay": "Which delay would explain the phase? (sections 5.2.5 and 5.3)",
    "bent-resonance": "Does the resonance move when the joint bends? (sections 5.2.2 and 5.3)",
    "bent-coupling": "What else moves with the torsion of a bent joint? (sections 5.2.2 and 5.3)",
    "asymmetry": "How unequal do the tendons' tensions get where the joint bends? (section 5.2.1)",
    "spinal-engine": "Is there a spinal engine, and how much twist does it give? (section 5.1)",
    "carrying": "What does the joint carry in pitch and roll? (section 5.1)",
}
"""The questions by their names: five are asked of a recording, five of a rig that bends."""


@dataclass(frozen=True)
class Answer:
    """What a recording or a rig says about one question.

    name: of the question, in `QUESTIONS`. verdict: a few words, or `CANNOT_TELL`. sentences: the verdict in full, then
    what limits it or how a bench would test it. numbers: by name with unit; the first is the headline. rows: one for
    each pretension, or pretension and bend, by name with unit. shown: the columns that are drawn.
    """

    name: str
    verdict: str
    sentences: tuple[str, ...]
    numbers: Mapping[str, Estimate] = field(default_factory=dict)
    rows: tuple[Mapping[str, Cell], ...] = ()
    shown: tuple[str, ...] = ()

    @property
    def question(self) -> str:
        """Return the question in full, with the paper's section."""
        return QUESTIONS[self.name]

    @property
    def is_answered(self) -> bool:
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
        said = {"name": self.name, "question": self.question, "verdict": self.verdict, "sentences": self.sentences}
        found: dict[str, Any] = plain(said | {"numbers": self.numbers, "rows": self.rows})
        return found


def rows_of(**columns: Sequence[Cell]) -> tuple[dict[str, Cell], ...]:
    """Return the rows of an answer by its columns, all of one length."""
    return tuple(dict(zip(columns, cells, strict=True)) for cells in zip(*columns.values(), strict=True))


def cannot_tell(name: str, *why: str) -> Answer:
    """Return the answer of a recording that lacks what the question needs; why: sentences."""
    return Answer(name, CANNOT_TELL, why)


def exact(value: float) -> Estimate:
    """Return a number that has no interval of its own."""
    return Estimate(value, math.nan, math.nan, math.nan)


def in_words(estimate: Estimate, factor: float = 1.0, unit: str = "") -> str:
    """Return "value unit (low to high)" of an estimate times a factor, its digits by the width of its interval."""
    value, low, high = (factor * x for x in (estimate.value, estimate.low, estimate.high))
    return typeset(interval(value, low, high, unit))
