"""One number of a rig, with its unit, its origin and its bounds."""

import math
from collections.abc import Callable
from decimal import Decimal
from typing import Annotated, Literal, cast

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from sinew.measure.errors import UnitError
from sinew.measure.units import convert

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Origin = Literal["paper", "data sheet", "measured", "calibrated", "assumed"]


class Settings(BaseModel):
    """Settings as a file has them: they do not change, know no other key, and are finite."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Parameter(Settings):
    """A number with unit, origin and bounds.

    value: in `unit`.
    origin: paper, data sheet, measured (read from the bench itself, as `sinew doctor --guide` does), calibrated (fitted
    to the paper's or a bench's numbers) or assumed.
    bounds: what is physically thinkable, (low, high) in `unit`; a calibration stays inside.
    interval90: ends of the 90 % interval, in `unit`: of a calibrated value or a material's; None where not known.
    note: where exactly the number is from, one sentence.

    `model_dump` leaves the interval out: who makes a rig with other values from that (`RigSpec.with_values`) has a rig
    that was not calibrated to them.
    """

    value: float
    unit: str
    origin: Origin
    bounds: tuple[float, float]
    interval90: tuple[float, float] | None = Field(default=None, exclude=True)
    note: str = ""

    @model_validator(mode="after")
    def _inside_bounds(self) -> "Parameter":
        low, high = self.bounds
        if not low <= self.value <= high:
            raise ValueError(f"value {self.value:g} {self.unit} is outside its bounds [{low:g}, {high:g}]")
        if self.interval90 is not None and not self.interval90[0] <= self.value <= self.interval90[1]:
            raise ValueError(
                f"value {self.value:g} {self.unit} is outside its 90 % interval [{self.interval90[0]:g}, "
                f"{self.interval90[1]:g}]; where the value was changed by hand, take interval90 out"
            )
        return self

    def numbers(self) -> tuple[float, ...]:
        """Return value, bounds and, where there is one, interval: all that carries the unit."""
        return (self.value, *self.bounds, *(self.interval90 or ()))


def converted(number: float, unit: str, to: str) -> float:
    """Return a number in another unit; a decimal prefix shifts the written point, so that 27.4 mm is 0.0274 m.

    Raises UnitError where a unit is unknown or the dimensions differ.
    """
    if unit == to:
        return number
    factor = convert(unit, to)
    exponent = round(math.log10(factor))
    if factor == float(f"1e{exponent}"):
        return float(Decimal(repr(float(number))).scaleb(exponent))
    return number * factor


def signed(unit: str) -> AfterValidator:
    """Return the validator of a parameter that is kept in `unit`, whatever unit the file used."""

    def to_unit(parameter: Parameter) -> Parameter:
        if parameter.unit == unit:
            return parameter
        try:
            value, low, high, *ends = (converted(x, parameter.unit, unit) for x in parameter.numbers())
        except UnitError as error:
            raise ValueError(str(error)) from error
        return Parameter(
            value=value,
            unit=unit,
            origin=parameter.origin,
            bounds=(low, high),
            interval90=(ends[0], ends[1]) if ends else None,
            note=parameter.note,
        )

    return AfterValidator(to_unit)


def not_negative(unit: str) -> AfterValidator:
    """Return the validator of a parameter that is kept in `unit` and must not be negative, nor its bounds."""
    return _from_zero(unit, strictly=False)


def positive(unit: str) -> AfterValidator:
    """Return the validator of a parameter that is kept in `unit` and must be positive, and so its bounds."""
    return _from_zero(unit, strictly=True)


def _from_zero(unit: str, *, strictly: bool) -> AfterValidator:
    convert_first = cast(Callable[[Parameter], Parameter], signed(unit).func)

    def check(parameter: Parameter) -> Parameter:
        low = parameter.bounds[0]
        if low < 0 or (strictly and low == 0):
            raise ValueError(f"lower bound {low:g} {parameter.unit} must be {'above' if strictly else 'at least'} 0")
        return convert_first(parameter)

    return AfterValidator(check)
