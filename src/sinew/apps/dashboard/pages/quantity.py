"""This is where an estimate gets the words in which a page says it."""

import math
from typing import Any

__all__ = ["quantity"]


def quantity(estimate: dict[str, Any], unit: str) -> str:
    """Return an estimate as a page says it: value and 90 % interval with unit, to two digits of its uncertainty."""
    value, (low, high) = estimate["value"], estimate["interval90"]
    if value is None:
        return "–"
    unit = f" {unit}" if unit else ""
    if low is None or high is None or high <= low:
        return f"{value:.4g}{unit}"
    places = max(0, 1 - math.floor(math.log10(high - low)))
    return f"{value:.{places}f}{unit} ({low:.{places}f} to {high:.{places}f})"
