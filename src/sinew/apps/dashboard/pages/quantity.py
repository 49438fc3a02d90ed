"""Estimates in the words of a page."""

from typing import Any

from sinew.measure.estimate import shown_interval, typeset


def quantity(estimate: dict[str, Any], unit: str) -> str:
    """Return an estimate as a page says it: value and 90 % interval with unit, its digits by its uncertainty."""
    return typeset(shown_interval(estimate, unit))
