"""This is where a rig says what it was calibrated from, and how its calibrated parameters vary together."""

from collections.abc import Collection
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

__all__ = ["Calibrated"]

NotNegative = Annotated[float, Field(ge=0)]
Correlation = Annotated[float, Field(ge=-1, le=1)]


class Calibrated(BaseModel):
    """The joint uncertainty of a rig's calibrated parameters, k of them, and where it is from.

    recordings: file and beginning of the content hash of each. pretension_mm: at which they were made, increasing.
    parameters: dotted names. std: standard deviations, in the unit that the rig keeps each parameter in (SI), (k,).
    correlation: rows of its lower triangle, the diagonal of ones among them: row i has i + 1 numbers.

    The parameters' uncertainty is a normal distribution about the rig's values with covariance
    std_i · std_j · correlation_ij. What is tied (the head's inertia to the lever's) is correlated by 1 or -1.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    recordings: tuple[str, ...] = ()
    pretension_mm: tuple[NotNegative, ...] = ()
    parameters: tuple[str, ...] = Field(min_length=1)
    std: tuple[NotNegative, ...]
    correlation: tuple[tuple[Correlation, ...], ...]

    def only(self, names: Collection[str]) -> "Calibrated | None":
        """Return the same of some parameters alone, None where none of them is among these."""
        index = [i for i, name in enumerate(self.parameters) if name in names]
        if not index:
            return None
        return Calibrated(
            recordings=self.recordings,
            pretension_mm=self.pretension_mm,
            parameters=tuple(self.parameters[i] for i in index),
            std=tuple(self.std[i] for i in index),
            correlation=tuple(tuple(self.correlation[i][j] for j in index if j <= i) for i in index),
        )

    @model_validator(mode="after")
    def _sizes_agree(self) -> Self:
        count = len(self.parameters)
        if len(set(self.parameters)) != count:
            raise ValueError("parameters lists a name twice; list each once")
        if len(self.std) != count:
            raise ValueError(f"std has {len(self.std)} numbers, expected one for each of {count} parameters")
        if [len(row) for row in self.correlation] != list(range(1, count + 1)):
            raise ValueError(f"correlation must have {count} rows of 1 to {count} numbers, its lower triangle")
        if any(row[-1] != 1 for row in self.correlation):
            raise ValueError("correlation must end each row with 1, its diagonal")
        return self
