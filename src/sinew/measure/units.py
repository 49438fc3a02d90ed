"""This is where a unit that a person wrote becomes SI and radians."""

from functools import cache
from typing import TYPE_CHECKING, Any

from sinew.measure.errors import UnitError

if TYPE_CHECKING:
    import pint

__all__ = ["canonical_unit", "convert"]


@cache
def _registry() -> "pint.UnitRegistry[Any]":
    import pint  # noqa: PLC0415  (half a second; only files with units pay for it)

    return pint.UnitRegistry()


def _parse(unit: str) -> Any:
    import pint  # noqa: PLC0415

    try:
        return _registry().parse_units("" if unit.strip() in ("1", "") else unit)
    except (pint.PintError, AttributeError, ValueError, TypeError) as error:
        raise UnitError(f"unknown unit {unit!r}; write it like deg, rad, mm, m, s, ms, Hz, V, A, N*m or 1") from error


@cache
def convert(unit: str, to: str) -> float:
    """Return the factor that turns a number in `unit` into one in `to`.

    Raises UnitError where a unit is unknown or the dimensions differ.
    """
    import pint  # noqa: PLC0415

    source, target = _parse(unit), _parse(to)
    try:
        return float(_registry().Quantity(1.0, source).to(target).magnitude)
    except pint.PintError as error:
        raise UnitError(f"unit {unit!r} cannot be turned into {to!r}: {error}") from error


def canonical_unit(unit: str) -> tuple[str, float]:
    """Return (SI unit with radians for angles, factor) for any unit; "1" for a plain number.

    Raises UnitError where the unit is unknown or has an offset (degrees Celsius).
    """
    if unit.strip() in ("1", ""):
        return "1", 1.0
    parsed = _parse(unit)
    registry = _registry()
    if registry.Quantity(1.0, parsed).check("[]"):
        angle = "deg" in unit.lower() or "rad" in unit.lower() or "turn" in unit.lower() or "rev" in unit.lower()
        return ("rad", convert(unit, "rad")) if angle else ("1", convert(unit, "1"))
    base = registry.Quantity(1.0, parsed).to_base_units()
    offset = registry.Quantity(0.0, parsed).to_base_units().magnitude
    if abs(offset) > 0:
        raise UnitError(f"unit {unit!r} has an offset; convert the column to an absolute unit first")
    return f"{base.units:~C}", float(base.magnitude)
