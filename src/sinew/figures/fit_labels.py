"""This is where what a fit found gets the words and units that a figure shows."""

import math
import re

from sinew.measure.estimate import pair, typeset

__all__ = ["axis_label", "parameter_label", "shown_unit", "value_and_std"]

_SHOWN: dict[str, tuple[float, str]] = {
    "rad": (180 / math.pi, "degrees"),
    "rad/s": (180 / math.pi, "degrees/s"),
    "rad/s2": (180 / math.pi, "degrees/s²"),
    "m": (1e3, "mm"),
    "m/s2": (1.0, "m/s²"),
    "N*m": (1.0, "N m"),
    "1": (1.0, ""),
}
_UNITS = {
    "n": "N", "m": "m", "kg": "kg", "s": "s", "rad": "rad", "v": "V", "a": "A", "pa": "Pa", "mm": "mm", "hz": "Hz",
}  # fmt: skip
_WORDS = {"coulomb": "dry friction", "quadratic": "quadratic term", "cubic": "cubic term"}
_POWERS = {"2": "²", "3": "³"}


def shown_unit(unit: str) -> tuple[float, str]:
    """Return what a number in an SI unit is multiplied by for a figure, and the unit that is written there."""
    return _SHOWN.get(unit, (1.0, unit.replace("*", " ").replace("2", "²").replace("3", "³")))


def axis_label(quantity: str, unit: str) -> str:
    """Return the label of an axis for a quantity that is held in an SI unit: "output in degrees"."""
    shown = shown_unit(unit)[1]
    return f"{quantity} in {shown}" if shown else quantity


def parameter_label(name: str) -> tuple[str, str]:
    """Return words and unit of a parameter from its name: "stiffness_n_m_per_rad" gives ("stiffness", "N m/rad")."""
    found = re.fullmatch(r"(?P<stem>[^\[]*)(?P<group>\[.*\])?", name)
    assert found is not None
    tokens, group = re.split(r"[_.]", found["stem"]), found["group"] or ""
    first = len(tokens)
    while first > 1 and (tokens[first - 1] == "per" or _unit(tokens[first - 1])):
        first -= 1
    words = _WORDS.get(tokens[0], " ".join(tokens[:first])) + (f" {group[1:-1]}" if group else "")
    above, _, below = " ".join(tokens[first:]).partition("per")
    top, bottom = ([_unit(token) for token in part.split()] for part in (above, below))
    if not bottom:
        return words, " ".join(top)
    under = f"({' '.join(bottom)})" if len(bottom) > 1 else bottom[0]
    return words, f"{' '.join(top) or '1'}/{under}"


def _unit(token: str) -> str:
    """Return a unit as print has it from its token in a name ("s2" gives "s²"); empty for what is no unit."""
    plain, power = (token[:-1], token[-1]) if token[-1:] in _POWERS else (token, "")
    return _UNITS[plain] + _POWERS.get(power, "") if plain in _UNITS else ""


def value_and_std(value: float, std: float) -> str:
    """Return "value ± std" with the digits that the std gives, the value alone where the std is not known."""
    return typeset(pair(value, std))
