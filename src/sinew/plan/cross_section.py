"""This is where the cross-section of a silicone is described that is no solid circle."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from sinew.plan.parameter import Parameter, not_negative, positive

__all__ = ["CrossSection"]


class CrossSection(BaseModel):
    """What the equations need of a section, instead of the solid circle that the silicone's diameter stands for.

    shape: in words. area [m²]. torsion_constant: St Venant's J [m⁴], which with the silicone's G·J sets G, hence the
    axial stiffness. least_moment, greatest_moment: principal second moments [m⁴]; their sum is the polar moment.
    warping_constant [m⁶]. perimeter: of all edges [m]. shear_arm: the largest shear strain per twist [m]; left out
    where a re-entrant corner makes it unbounded.
    The equations take area and torsion constant; the others tell what the prediction is worth.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    shape: str = Field(min_length=1)
    area: Annotated[Parameter, positive("m^2")]
    torsion_constant: Annotated[Parameter, positive("m^4")]
    least_moment: Annotated[Parameter, positive("m^4")]
    greatest_moment: Annotated[Parameter, positive("m^4")]
    warping_constant: Annotated[Parameter, not_negative("m^6")]
    perimeter: Annotated[Parameter, positive("m")]
    shear_arm: Annotated[Parameter, positive("m")] | None = None
