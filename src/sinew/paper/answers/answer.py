"""An answer to an open question of the paper: a verdict, its numbers, what they rest on."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sinew.measure.arrays import Array
from sinew.measure.estimate import Estimate, finite, interval, typeset

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
        rows = [
            {name: cell.to_json() if isinstance(cell, Estimate) else finite(cell) for name, cell in row.items()}
            for row in self.rows
        ]
        return {
            "name": self.name,
            "question": self.question,
            "verdict": self.verdict,
            "sentences": list(self.sentences),
            "numbers": {name: one.to_json() for name, one in self.numbers.items()},
            "rows": rows,
        }


def cannot_tell(name: str, question: str, *why: str) -> Answer:
    """Return the answer of a recording that lacks what the question needs; why: sentences."""
    return Answer(name, question, CANNOT_TELL, why)


def in_words(estimate: Estimate, factor: float = 1.0, unit: str = "") -> str:
    """Return "value unit (low to high)" of an estimate times a factor, its digits by the width of its interval."""
    value, low, high = (factor * x for x in (estimate.value, estimate.low, estimate.high))
    return typeset(interval(value, low, high, unit))
