"""Numbers with their uncertainty, and the one way in which a person reads them.

The digits of a number follow its uncertainty by the rule of the Particle Data Group (Review of Particle Physics,
Introduction, 5.3): two significant digits of the half-width or standard deviation where its first three lie between
100 and 354, else one, and 0.95 to 0.99 become 1.0; value and ends of the interval have the same decimals. So a
terminal, a page and a table for a paper show the standard deviation that JSON holds with every digit. What has no
uncertainty shows four significant digits, and so does a value whose uncertainty is below the round-off of double
precision: there it says nothing of what was measured.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from scipy import special

NORMAL_90 = 1.6448536269514722
"""Half width of a normal 90 % interval by its standard deviation."""
NORMAL_95 = 1.959963984540054
"""Half width of a normal 95 % interval by its standard deviation."""
DIGITS = 4
"""Significant digits of a number whose uncertainty is not known."""
ROUND_OFF = 1e-12
"""Of a value or of data: what is this small is round-off. A double has 1.1e-16 of it, which a fit of thousands of
samples adds up to some 1e-13."""
UNKNOWN = "–"
"""What stands for a number that is not known."""

_TWO_DIGITS_BELOW = 3.55
_PLAIN_FROM, _PLAIN_TO = -4, 6  # powers of ten that are written without an exponent


def finite(value: float) -> float | None:
    """Return a number as JSON holds it: null for one that is not finite."""
    return float(value) if math.isfinite(value) else None


def all_finite(values: Iterable[float]) -> list[float | None]:
    """Return numbers as JSON holds them, see `finite`."""
    return [finite(value) for value in values]


@dataclass(frozen=True)
class Estimate:
    """A measured or fitted quantity: value, standard deviation and 90 % interval, in one unit.

    value, std: in the unit that the name of the quantity carries; std is NaN where it is unknown.
    low, high: ends of the two-sided 90 % interval, same unit.
    """

    value: float
    std: float
    low: float
    high: float

    @staticmethod
    def normal(value: float, std: float) -> "Estimate":
        """Return an estimate whose 90 % interval is the normal one, value ± 1.645 std."""
        half = NORMAL_90 * std
        return Estimate(float(value), float(std), float(value - half), float(value + half))

    @staticmethod
    def student(value: float, std: float, degrees_of_freedom: float) -> "Estimate":
        """Return an estimate whose 90 % interval is Student's, value ± t(0.95, ν) std.

        std: standard deviation of `value` itself (of the mean, not of one draw).
        """
        if not math.isfinite(degrees_of_freedom) or degrees_of_freedom <= 0:
            return Estimate(float(value), float(std), math.nan, math.nan)
        half = float(special.stdtrit(degrees_of_freedom, 0.95)) * std
        return Estimate(float(value), float(std), float(value - half), float(value + half))

    def __str__(self) -> str:
        return self.shown_interval()

    def to_json(self) -> dict[str, float | list[float | None] | None]:
        """Return `{"value", "std", "interval90"}`; what is not finite becomes null."""
        return {
            "value": finite(self.value),
            "std": finite(self.std),
            "interval90": [finite(self.low), finite(self.high)],
        }

    @staticmethod
    def from_json(document: Mapping[str, Any]) -> "Estimate":
        """Return what `to_json` made; null becomes NaN."""
        low, high = document.get("interval90") or (None, None)
        known = (document["value"], document["std"], low, high)
        return Estimate(*(math.nan if one is None else float(one) for one in known))

    def times(self, factor: float) -> "Estimate":
        """Return the estimate in a unit that is 1/factor as large; factor: positive."""
        return Estimate(*(factor * x for x in (self.value, self.std, self.low, self.high)))

    def shown(self, unit: str = "") -> str:
        """Return "value ± std unit", see `pair`."""
        return pair(self.value, self.std, unit)

    def shown_interval(self, unit: str = "") -> str:
        """Return "value unit (low to high)", see `interval`."""
        return interval(self.value, self.low, self.high, unit)


def number(value: float | None, digits: int = DIGITS, unit: str = "") -> str:
    """Return a number whose uncertainty is not known, with `digits` significant digits, no zeros behind them.

    Whole digits are never lost: 12346 stays so.
    """
    if not _known(value):
        return UNKNOWN
    assert value is not None
    if math.isinf(value):
        return _with_unit("∞" if value > 0 else "-∞", unit)
    power = _power(value)
    if value != 0 and not _PLAIN_FROM <= power <= _PLAIN_TO:
        return _with_unit(f"{value:.{digits - 1}e}", unit)
    text = _plain(value, max(0, digits - 1 - power))
    return _with_unit(text.rstrip("0").rstrip(".") if "." in text else text, unit)


def fixed(value: float | None, decimals: int, unit: str = "") -> str:
    """Return a number with so many decimals: for what has a declared resolution, such as a percentage in a table."""
    if not _known(value) or (value is not None and math.isinf(value)):
        return number(value, unit=unit)
    assert value is not None
    return _with_unit(_plain(value, decimals), unit)


def pair(value: float | None, half: float | None, unit: str = "") -> str:
    """Return "value ± half unit" with the decimals that the half-width gives; the value alone where it has none.

    half: standard deviation or half-width of the interval, in the value's unit.
    """
    if (digits := _digits(value, half)) is None:
        return number(value, unit=unit)
    shown, uncertainty, _, exponent = digits
    text = f"{shown} ± {uncertainty}"
    return _with_unit(text if exponent == 0 else f"({text})e{exponent:+03d}", unit)


def parenthesised(value: float | None, std: float | None) -> str:
    """Return "3.021(20)", the uncertainty in units of the last digits, as siunitx and CODATA write it; with an exponent
    "1.23(4)e+08". The value alone where it has none."""
    if (digits := _digits(value, std)) is None:
        return number(value)
    shown, uncertainty, places, exponent = digits
    last = str(round(float(uncertainty) * 10.0 ** max(0, places)))
    return f"{shown}({last}){f'e{exponent:+03d}' if exponent else ''}"


def _digits(value: float | None, half: float | None) -> tuple[str, str, int, int] | None:
    """Return value and uncertainty in the digits that this gives them, their decimals, and the power of ten that both
    are to be multiplied by; None where there is no uncertainty to show."""
    if value is None or half is None or not (math.isfinite(value) and math.isfinite(half)):
        return None
    half = abs(half)
    if half <= ROUND_OFF * abs(value):
        return None
    decimals = _decimals(half)
    exponent = _exponent(value, half, decimals)
    scale, places = 10.0**exponent, decimals + exponent
    return _plain(value / scale, places), _plain(half / scale, places), places, exponent


def interval(value: float | None, low: float | None, high: float | None, unit: str = "") -> str:
    """Return "value unit (low to high)", all with the decimals that half the interval's width gives.

    An end that is not known shows as such, an infinite one as ∞; where neither is known the value stands alone.
    """
    if not _known(value) or value is None or not math.isfinite(value) or not (_known(low) or _known(high)):
        return number(value, unit=unit)
    text, (first, last) = _in_step(value, low, high)
    return f"{_with_unit(text, unit)} ({first} to {last})"


def span(low: float | None, high: float | None, unit: str = "") -> str:
    """Return "low to high unit", both with the decimals that half their distance gives."""
    if not _known(low) and not _known(high):
        return UNKNOWN
    ends = [end for end in (low, high) if end is not None and math.isfinite(end)]
    middle = sum(ends) / len(ends) if ends else 0.0
    return _with_unit(" to ".join(_in_step(middle, low, high)[1]), unit)


def shown(estimate: Mapping[str, Any] | None, unit: str = "") -> str:
    """Return "value ± std unit" of a quantity as JSON holds it (`Estimate.to_json`); a dash for None."""
    return UNKNOWN if estimate is None else pair(estimate["value"], estimate["std"], unit)


def shown_interval(estimate: Mapping[str, Any] | None, unit: str = "") -> str:
    """Return "value unit (low to high)" of a quantity as JSON holds it; a dash for None."""
    low, high = (estimate or {}).get("interval90") or (None, None)
    return UNKNOWN if estimate is None else interval(estimate["value"], low, high, unit)


def typeset(text: str) -> str:
    """Return numbers for a page: the sign of a negative number is a minus, not a hyphen."""
    return "".join(
        "\N{MINUS SIGN}"
        if letter == "-" and text[i + 1 : i + 2] in _AFTER_MINUS and not text[max(0, i - 1) : i].isalnum()
        else letter
        for i, letter in enumerate(text)
    )


_AFTER_MINUS = tuple("0123456789.∞")


def _known(value: float | None) -> bool:
    return value is not None and not math.isnan(value)


def _power(value: float) -> int:
    return 0 if value == 0 else math.floor(math.log10(abs(value)))


def _decimals(half: float) -> int:
    """Return the decimals that an uncertainty gives a value, negative ones for tens."""
    power = _power(half)
    return (1 if round(half / 10.0**power, 2) < _TWO_DIGITS_BELOW else 0) - power  # 0.96 becomes 1.0, as 0.996 does


def _exponent(value: float, half: float, decimals: int) -> int:
    """Return the power of ten that value and uncertainty share on paper; 0 where they are written plainly."""
    power = _power(max(abs(value), half))
    return 0 if _PLAIN_FROM <= power <= _PLAIN_TO and decimals <= 7 else power


def _in_step(value: float, low: float | None, high: float | None) -> tuple[str, tuple[str, str]]:
    """Return value and both ends as text with the same decimals."""
    known = [end for end in (low, high) if end is not None and math.isfinite(end)]
    width = abs(known[-1] - (known[0] if len(known) > 1 else value)) / (2 if len(known) > 1 else 1) if known else 0.0
    if width <= ROUND_OFF * max(map(abs, (value, *known))):
        return number(value), (_end(low, number), _end(high, number))
    decimals = _decimals(width)
    exponent = _exponent(value, width, decimals)
    scale, places = 10.0**exponent, decimals + exponent
    tail = "" if exponent == 0 else f"e{exponent:+03d}"

    def written(one: float) -> str:
        return f"{_plain(one / scale, places)}{tail}"

    return written(value), (_end(low, written), _end(high, written))


def _end(end: float | None, finite: Any) -> str:
    return number(end) if not _known(end) or math.isinf(end or 0.0) else str(finite(end))


def _plain(value: float, places: int) -> str:
    """Return a number without an exponent, with so many decimals; negative ones round to tens. Never "-0"."""
    text = f"{round(value, places) if places < 0 else value:.{max(0, places)}f}"
    return text.removeprefix("-") if not text.strip("-0.") else text


def _with_unit(text: str, unit: str) -> str:
    return f"{text} {unit}" if unit else text
