"""Units and numbers as people write them: a unit becomes SI and radians, a text becomes numbers or a sentence why not.

Decimals have a point. Where a list is expected, commas, semicolons and blanks separate its numbers: "2,5" is 2 and 5.
Only a comma between two digits next to another separator, as in "1,5; 2,5", may be a decimal comma; it is refused.
"""

import math
import re
import tokenize
from collections.abc import Callable
from datetime import UTC, datetime
from functools import cache
from typing import Any, NamedTuple

import pint

from sinew.measure.errors import UnitError

STANDARD_GRAVITY = 9.80665
"""Standard gravity [m/s²]."""

# Words that people write and pint does not read, or reads as something else (it takes "Nm" for a yarn count).
_SPELLINGS = {
    "degs": "deg",
    "Deg": "deg",
    "dps": "(deg/s)",
    "rev": "turn",
    "rps": "(turn/s)",
    "hz": "Hz",
    "Nm": "(N*m)",
    "mNm": "(mN*m)",
    "Nmm": "(N*mm)",
    "Ncm": "(N*cm)",
    "Nms": "(N*m*s)",
    "volts": "V",
    "msec": "ms",
    "usec": "us",
}
_AMBIGUOUS = {
    "g": "'gram' or 'g_0' (9.80665 m/s2)",
    "G": "'g_0' (9.80665 m/s2) or 'gauss'",
    "mg": "'milligram' or 'mg_0' (9.80665e-3 m/s2)",
}
# The units that Sinew writes. The first of a dimension wins, unless the second was asked for by name.
_PREFERRED = (
    *("m", "m/s", "m/s2", "rad", "rad/s", "rad/s2", "s", "1/s", "kg", "kg*m2", "N", "N/m", "N*m", "N*m/rad"),
    *("N*m*s/rad", "Pa", "V", "V/s", "A", "W", "ohm", "T"),
)
_BY_NAME = {"hertz": "Hz", "joule": "J"}

# What pint raises on text that is no unit, besides its own errors.
_UNREADABLE = (tokenize.TokenError, ArithmeticError, AssertionError, AttributeError, LookupError, TypeError, ValueError)
_WORD = re.compile(r"(?<!\w)[^\W\d_]+(?!\w)")
_LETTERS = re.compile(r"[A-Za-z_°µμΩ%·²³⁻¹\s*/^().\-0-9]{1,40}")
_POWER_OF_NUMBER = re.compile(r"[\d)]\s*(\*\*|\^)|\d{3}")
_BARE_POWER = re.compile(r"(?<=[A-Za-zµμΩ])([234])(?!\w)")


_DECIMAL_COMMA = re.compile(r"(?<=\d),(?=\d)")


def one_number(text: str) -> float:
    """Return the finite number that a text is. Raises ValueError with a sentence."""
    try:
        number = float(text.strip())
    except ValueError:
        point = text.strip().replace(",", ".")
        try:
            float(point)
        except ValueError:
            raise ValueError(f"found {text.strip()!r}, expected a number") from None
        raise ValueError(f"found {text.strip()!r}, expected one number; decimals take a point: {point}") from None
    if not math.isfinite(number):
        raise ValueError(f"found {number:g}, expected a finite number")
    return number


def number_list(text: str) -> list[float]:
    """Return the numbers of a list, at least one; a comma separates them.

    Raises ValueError with a sentence where one is missing or is no number, and where a comma between digits stands
    next to another separator and may be a decimal comma.
    """
    inner = text.strip(" \t\n,;[]")
    if _DECIMAL_COMMA.search(inner) and re.search(r"[;\s]", inner):
        raise ValueError(
            f"found {inner!r}, where a comma may separate numbers or decimals; write "
            f"{_DECIMAL_COMMA.sub('.', inner)!r} for decimals, {_DECIMAL_COMMA.sub(', ', inner)!r} for a list"
        )
    if re.search(r"[,;]\s*[,;]", inner):
        raise ValueError(f"found {inner!r}, where a number is missing between two commas")
    parts = [part for part in re.split(r"[,;\s]+", inner) if part]
    if not parts:
        raise ValueError("found nothing, expected numbers with commas between them, as 0, 4, 8")
    return [one_number(part) for part in parts]


def local_time(moment: str) -> str:
    """Return an ISO 8601 time as people read it, in the zone of this computer: "2026-03-01 14:05+01:00".

    A time without a zone is taken to be UTC, as recordings have it. What is no time comes back as it is.
    """
    try:
        at = datetime.fromisoformat(moment)
    except ValueError:
        return moment
    at = at if at.tzinfo is not None else at.replace(tzinfo=UTC)
    return at.astimezone().isoformat(sep=" ", timespec="minutes")


@cache
def _registry() -> "pint.UnitRegistry[Any]":
    return pint.UnitRegistry()


@cache
def _parse(unit: str) -> Any:
    text = unit.strip()
    if text in _AMBIGUOUS:
        raise UnitError(f"unit {unit!r} is ambiguous; write {_AMBIGUOUS[text]}")
    unknown = UnitError(f"unknown unit {unit!r}; write it like deg, rad, mm, m, s, ms, Hz, V, A, N*m, deg/s or 1")
    if text in ("1", ""):
        return _registry().parse_units("")
    if not _LETTERS.fullmatch(text) or _POWER_OF_NUMBER.search(text):
        raise unknown
    text = _WORD.sub(lambda word: _SPELLINGS.get(word[0], word[0]), _BARE_POWER.sub(r"**\1", text))
    try:
        parsed = _registry().parse_units(text)
        size = _registry().Quantity(1.0, parsed).to_base_units().magnitude
    except (*_UNREADABLE, pint.PintError) as error:
        raise unknown from error
    if not 0 < size < float("inf"):  # a power so high that no number holds its factor
        raise unknown
    return parsed


def _factor(unit: str, scale: Callable[[float], float]) -> float:
    """Return the factor of a conversion that must have no offset (degrees Celsius) and no logarithm (decibel)."""
    if scale(0.0) != 0:
        raise UnitError(f"unit {unit!r} does not start at zero (offset or logarithm); convert the column beforehand")
    return scale(1.0)


@cache
def convert(unit: str, to: str) -> float:
    """Return the factor that turns a number in `unit` into one in `to`.

    Raises UnitError where a unit is unknown, has an offset or is logarithmic, or the dimensions differ.
    """
    source, target = _parse(unit), _parse(to)
    quantity = _registry().Quantity
    try:
        return _factor(unit, lambda number: float(quantity(number, source).to(target).magnitude))
    except pint.PintError as error:
        raise UnitError(f"unit {unit!r} cannot be turned into {to!r}: {error}") from error


def _base(unit: Any) -> Any:
    return _registry().Quantity(1.0, unit).to_base_units().units


@cache
def _preferred() -> dict[Any, str]:
    return {_base(_parse(text)): text for text in reversed(_PREFERRED)}


@cache
def canonical_unit(unit: str) -> tuple[str, float]:
    """Return (SI unit with radians for angles, factor) for any unit; "1" for a plain number.

    The SI unit is written the way the schema writes it where it is a common one ("N*m", "rad/s", "m/s2", "V").
    Raises UnitError where the unit is unknown, ambiguous (g), logarithmic, or has an offset (degrees Celsius).
    """
    parsed = _parse(unit)
    base = _base(parsed)
    quantity = _registry().Quantity
    factor = _factor(unit, lambda number: float(quantity(number, parsed).to(base).magnitude))
    for name, text in _BY_NAME.items():
        if name in str(parsed) and _base(_parse(text)) == base:
            return text, factor
    if base.dimensionless and "radian" not in str(base):
        return "1", convert(unit, "1")
    return _preferred().get(base) or f"{base:~C}", factor


def with_unit(words: str, unit: str) -> str:
    """Return the head of a column of a quantity: "force/N", "decay rate/(1/s)", "gain" of a plain number."""
    if unit in ("1", ""):
        return words
    return f"{words}/({unit})" if re.search(r"[/* ]", unit) else f"{words}/{unit}"


_TOKENS = {"hz": "Hz", "v": "V", "n": "N", "a": "A", "w": "W", "j": "J", "pa": "Pa"} | {
    one: one for one in ("m", "mm", "kg", "s", "ms", "rad", "deg")
}


class NamedUnit(NamedTuple):
    """A name taken apart: its words, and the units above and below the stroke, each (symbol, power)."""

    words: tuple[str, ...]
    above: tuple[tuple[str, int], ...]
    below: tuple[tuple[str, int], ...]


def named_unit(name: str) -> NamedUnit:
    """Return words and unit of a quantity from its name in a document, which ends with the unit.

    Units behind `per` are below the stroke: `stiffness_n_m_per_rad`, `cubic_per_s2_rad2` [1/(s² rad²)]. Without it the
    angle of a torque or an energy is, `stiffness_n_m_rad` [N m/rad], and what follows an angle or a length is,
    `omega_rad_s`.
    """
    tokens = tuple(re.split(r"[_.]", name))
    first = len(tokens)
    while first > 1 and (tokens[first - 1] == "per" or _token(tokens[first - 1])):
        first -= 1
    unit = tokens[first:]
    if "per" in unit:
        cut = unit.index("per")
        above, below = unit[:cut], unit[cut + 1 :]
    else:
        parts = [one[0] for one in map(_token, unit) if one]
        of_angle = len(unit) > 1 and parts[-1] in ("rad", "deg")
        over = len(unit) == 2 and parts[0] in ("rad", "deg", "m", "mm")
        above, below = (unit[:-1], unit[-1:]) if of_angle or over else (unit, ())
    return NamedUnit(tokens[:first], *(tuple(filter(None, map(_token, part))) for part in (above, below)))


def _token(token: str) -> tuple[str, int] | None:
    """Return symbol and power of a unit in a name ("s2" gives ("s", 2)), None of what is no unit."""
    found = re.fullmatch(r"([a-z]+?)([2-6]?)", token)
    return (_TOKENS[found[1]], int(found[2] or 1)) if found and found[1] in _TOKENS else None
