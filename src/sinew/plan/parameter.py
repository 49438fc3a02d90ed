"""This is where one number of a rig keeps its unit, its origin and its bounds."""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, model_validator

from sinew.measure.errors import UnitError
from sinew.measure.units import convert

__all__ = ["Origin", "Parameter", "Quantity"]

Origin = Literal["paper", "data sheet", "calibrated", "assumed"]


class Parameter(BaseModel):
    """A number with unit, origin and bounds.

    value: in `unit`.
    origin: paper, data sheet, calibrated (fitted to the paper's or a bench's numbers) or assumed.
    bounds: what is physically thinkable, (low, high) in `unit`; a calibration stays inside.
    note: where exactly the number is from, one sentence.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    value: float
    unit: str
    origin: Origin
    bounds: tuple[float, float]
    note: str = ""

    @model_validator(mode="after")
    def _inside_bounds(self) -> "Parameter":
        low, high = self.bounds
        if not low <= self.value <= high:
            raise ValueError(f"value {self.value:g} {self.unit} is outside its bounds [{low:g}, {high:g}]")
        return self

    def replaced(self, value: float, origin: Origin | None = None) -> "Parameter":
        """Return the same parameter with another value, and with another origin if one is given."""
        return Parameter(**{**self.model_dump(), "value": float(value), "origin": origin or self.origin})


def _in_unit(unit: str) -> Any:
    def to_unit(parameter: Parameter) -> Parameter:
        if parameter.unit == unit:
            return parameter
        try:
            factor = convert(parameter.unit, unit)
        except UnitError as error:
            raise ValueError(str(error)) from error
        low, high = parameter.bounds
        return Parameter(
            value=parameter.value * factor,
            unit=unit,
            origin=parameter.origin,
            bounds=(low * factor, high * factor),
            note=parameter.note,
        )

    return to_unit


class Quantity:
    """`Quantity["m"]` is the type of a parameter that is kept in metres, whatever unit the file used."""

    def __class_getitem__(cls, unit: str) -> Any:
        return Annotated[Parameter, AfterValidator(_in_unit(unit))]
