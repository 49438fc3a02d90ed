"""Search among runs: words and conditions on numbers, read into a condition of SQL.

A query is words and conditions with spaces between, all of which must hold: `aged f_r>3.2 pretension=6 tag:first`.
Conditions on what was measured hold at one and the same pretension. `=` takes what rounds to the digits that were
written: f_r=3.2 is 3.15 to 3.25; a pretension, as a number that was set, is met exactly.
"""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import NamedTuple

from sinew.measure.errors import SpecError
from sinew.measure.units import one_number


class Quantity(NamedTuple):
    """What a run has found at a pretension. words: its title. unit: empty for a plain number. called: names in a query,
    the shortest first."""

    words: str
    unit: str
    called: tuple[str, ...]

    def head(self, between: str = " / ") -> str:
        """Return the head of a column of it: its name and its unit."""
        return f"{self.called[0]}{between}{self.unit}" if self.unit else self.called[0]


QUANTITIES: Mapping[str, Quantity] = {
    "resonance_hz": Quantity("frequency of the largest fundamental", "Hz", ("f_r", "fr")),
    "damping_ratio": Quantity("Lehr's damping", "", ("D", "damping")),
    "gain_peak": Quantity("largest gain", "", ("gain",)),
    "phase_90_hz": Quantity("frequency of 90° of lag", "Hz", ("f_90", "f90")),
    "half_power_width_hz": Quantity("half-power width", "Hz", ("width",)),
    "decay_frequency_hz": Quantity("frequency of the decay", "Hz", ("f_d", "fd")),
    "decay_rate_per_s": Quantity("decay rate", "1/s", ("rate", "decay")),
    "paper_resonance_hz": Quantity("frequency of the largest mean of peaks (Eq. 6)", "Hz", ("f_paper",)),
    "gain_peak_measured_drive": Quantity("largest gain over the measured lever", "", ("gain_measured",)),
    "energy_reduction": Quantity("energy saved by the resonance", "", ("saved",)),
    "paper_stiffness_n_m_rad": Quantity("stiffness ω² I", "N m/rad", ("k", "stiffness")),
    "paper_damping_n_m_s_rad": Quantity("damping constant 2 λ I", "N m s/rad", ("d", "damping_constant")),
}
"""What is kept of each run at each pretension, by its name in results."""

COMMON = ("resonance_hz", "damping_ratio", "gain_peak")
"""The three that every list shows."""

_OF_RUN = {"duration": "duration_s", "segments": "groups_done", "bytes": "bytes"}
_TEXTS = {
    "name": "name",
    "run": "name",
    "rig": "rig",
    "plan": "plan",
    "source": "source",
    "state": "state",
    "reason": "sentence",
    "notes": "notes",
}
_DATES = ("begin", "began", "date")
_SIGNS = {":": "=", "=": "=", "==": "=", "!=": "!=", "<": "<", "<=": "<=", ">": ">", ">=": ">="}
_TERM = re.compile(r"(?P<key>[A-Za-z_][A-Za-z0-9_]*)\s*(?P<sign>==|!=|<=|>=|[:=<>])\s*(?P<value>\"[^\"]*\"|\S*)")
_PART = re.compile(r"-?(?:[A-Za-z_][A-Za-z0-9_]*\s*(?:==|!=|<=|>=|[:=<>])\s*)?(?:\"[^\"]*\"|[^\s\"]+)")
_DATE = re.compile(r"\d{4}(-\d{2}){0,2}")
_MOST_CHARACTERS, _MOST_TERMS = 500, 30
_SET_EXACTLY = 1e-6  # mm


def columns_of(quantity: str) -> tuple[str, str, str, str]:
    """Return the columns of the index that hold value, standard deviation and ends of the interval of a quantity."""
    return quantity, f"{quantity}_std", f"{quantity}_low", f"{quantity}_high"


def quantity_of(name: str) -> str:
    """Return the name in results of a quantity as people call it: fr, f_r, D, gain. Raises SpecError for another."""
    found = _quantity_or_none(name)
    if found is None:
        raise SpecError(f"found the quantity {name!r}, expected one of {', '.join(_names_of_quantities())}")
    return found


def _quantity_or_none(name: str) -> str | None:
    for quantity, about in QUANTITIES.items():
        if name == quantity or name in about.called:
            return quantity
    folded = [q for q, about in QUANTITIES.items() if name.casefold() in map(str.casefold, about.called)]
    return folded[0] if len(folded) == 1 else None  # D and d are two


def _names_of_quantities() -> list[str]:
    return [about.called[0] for about in QUANTITIES.values()]


@dataclass
class Query:
    """A search as SQL. runs: conditions on a run `r`; found: on what it found at a pretension, `f`; each with its
    parameters. Text is compared in lower case."""

    runs: list[str] = field(default_factory=list)
    found: list[str] = field(default_factory=list)
    of_runs: list[object] = field(default_factory=list)
    of_found: list[object] = field(default_factory=list)

    @property
    def where(self) -> tuple[str, list[object]]:
        """The condition on a run, with what it found among it, and its parameters."""
        conditions, parameters = list(self.runs), list(self.of_runs)
        if self.found:
            conditions.append(f"EXISTS (SELECT 1 FROM found f WHERE f.run = r.name AND {' AND '.join(self.found)})")
            parameters += self.of_found
        return " AND ".join(conditions) or "1", parameters


def parse_query(text: str) -> Query:
    """Return what a search asks for. Raises SpecError, naming the part, where it is none."""
    if len(text) > _MOST_CHARACTERS:
        raise SpecError(f"found a search of {len(text)} characters, expected at most {_MOST_CHARACTERS}")
    if text.count('"') % 2:
        raise SpecError(f'found a quote without its end in the search {text!r}, expected pairs of "')
    query = Query()
    terms = list(_terms(text))
    if len(terms) > _MOST_TERMS:
        raise SpecError(f"found a search of {len(terms)} parts, expected at most {_MOST_TERMS}")
    for is_not, key, sign, value in terms:
        _add(query, is_not, key, sign, value)
    return query


def _terms(text: str) -> Iterator[tuple[bool, str, str, str]]:
    """Yield (whether it must not hold, key, sign, value); a word has neither key nor sign."""
    for part in _PART.findall(text):
        is_not = part.startswith("-") and len(part) > 1
        plain = part[1:] if is_not else part
        found = _TERM.fullmatch(plain)
        if found is None:
            dangling = re.fullmatch(r"([A-Za-z_]\w*)\s*(==|!=|<=|>=|[:=<>])", plain)
            if dangling or plain[0] in "<>=":
                raise SpecError(f"found {plain!r} in the search, expected a name, a sign and a value, as in f_r>3.2")
            yield is_not, "", "", plain.strip('"')
        else:
            yield is_not, found["key"], _SIGNS[found["sign"]], found["value"].strip('"')


def _add(query: Query, is_not: bool, key: str, sign: str, value: str) -> None:
    if not key:
        query.runs.append(f"r.words {'NOT ' if is_not else ''}LIKE ? ESCAPE '\\'")
        query.of_runs.append(_like(value))
        return
    if value == "":
        raise SpecError(f"found {key}{sign} without a value in the search, as in f_r>3.2 or tag:aged")
    quantity, lower = _quantity_or_none(key), key.lower()
    if lower in ("tag", "tags"):
        _need_equals(key, sign)
        wanted = is_not == (sign == "!=")
        query.runs.append(f"r.tags {'' if wanted else 'NOT '}LIKE ? ESCAPE '\\'")
        query.of_runs.append(f"% {_escaped(value)} %")
    elif lower in _TEXTS:
        _need_equals(key, sign)
        wanted = is_not == (sign == "!=")
        query.runs.append(f"lower(coalesce(r.{_TEXTS[lower]}, '')) {'' if wanted else 'NOT '}LIKE ? ESCAPE '\\'")
        query.of_runs.append(_like(value))
    elif lower in _DATES:
        _refuse_not(is_not, key)
        _add_date(query, key, sign, value)
    elif lower in _OF_RUN:
        _refuse_not(is_not, key)
        condition, numbers = _compared(f"r.{_OF_RUN[lower]}", key, sign, value)
        query.runs.append(condition)
        query.of_runs += numbers
    elif quantity is not None or lower in ("pretension", "pretension_mm", "p"):
        _refuse_not(is_not, key)
        condition, numbers = _compared(f"f.{quantity or 'pretension_mm'}", key, sign, value, is_set=quantity is None)
        query.found.append(condition)
        query.of_found += numbers
    else:
        known = ["pretension", *_names_of_quantities(), *_TEXTS, "tag", "begin", *_OF_RUN]
        near = get_close_matches(key, known, 1)
        hint = f"; is {near[0]} meant?" if near else ""
        raise SpecError(
            f"found {key!r} in the search, expected one of {', '.join(known)}{hint} "
            '(text with a sign in it stands in quotes: "a:b")'
        )


def _need_equals(key: str, sign: str) -> None:
    if sign not in ("=", "!="):
        raise SpecError(f"found {key}{sign} in the search, expected {key}: or {key}!= as {key} is text")


def _refuse_not(is_not: bool, key: str) -> None:
    if is_not:
        raise SpecError(f"found -{key} in the search; turn the sign of the condition round instead: {key}<= for {key}>")


def _compared(column: str, key: str, sign: str, value: str, is_set: bool = False) -> tuple[str, list[object]]:
    """Return the condition on a number, and its parameters. is_set: an equal one is meant exactly."""
    low, dots, high = value.partition("..")
    if dots:
        if sign != "=":
            raise SpecError(f"found {key}{sign}{value} in the search, expected a range as {key}=LOW..HIGH")
        return f"{column} BETWEEN ? AND ?", [*sorted((_number(key, low), _number(key, high)))]
    number = _number(key, value)
    if sign not in ("=", "!="):
        return f"{column} {sign} ?", [number]
    half = _SET_EXACTLY if is_set else _half_a_digit(value)
    return f"{column} {'' if sign == '=' else 'NOT '}BETWEEN ? AND ?", [number - half, number + half]


def _number(key: str, text: str) -> float:
    try:
        number = one_number(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise SpecError(f"found {key} with {text!r} in the search, expected a number, as in {key}>3.2 or {key}=3..3.4")
    return number


def _half_a_digit(text: str) -> float:
    """Return half of the last digit that was written."""
    mantissa, _, power = text.lower().partition("e")
    return float(0.5 * 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2])))


def _add_date(query: Query, key: str, sign: str, value: str) -> None:
    if not _DATE.fullmatch(value):
        raise SpecError(
            f"found {key} with {value!r} in the search, expected a date, as in {key}>=2026-03 or {key}=2026"
        )
    # A begin starts with its date: what is later than all of a month is greater than the month and a letter behind it.
    last = f"{value}~"
    if sign in ("=", "!="):
        query.runs.append(f"{'' if sign == '=' else 'NOT '}(r.started BETWEEN ? AND ?)")
        query.of_runs += [value, last]
    else:
        query.runs.append(f"r.started {sign} ?")
        query.of_runs.append(last if sign in (">", "<=") else value)


def _escaped(text: str) -> str:
    return re.sub(r"([\\%_])", r"\\\1", text.lower())


def _like(text: str) -> str:
    return f"%{_escaped(text)}%"
