"""This is where a number keeps its uncertainty."""

import math
from dataclasses import dataclass

from scipy import special

__all__ = ["Estimate"]


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
        half = 1.6448536269514722 * std
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

    def to_json(self) -> dict[str, float | list[float | None] | None]:
        """Return `{"value", "std", "interval90"}`; what is not finite becomes null."""

        def number(x: float) -> float | None:
            return float(x) if math.isfinite(x) else None

        return {
            "value": number(self.value),
            "std": number(self.std),
            "interval90": [number(self.low), number(self.high)],
        }
