"""The pose of the head at rest: how far the joint is bent, and where to."""

import math
from typing import Annotated

from pydantic import Field, model_validator

from sinew.plan.parameter import Settings

MOST_BEND_DEG = 90.0
"""No pose is bent further: a clamped joint of silicone does not get there with its tendons taut."""

_Angle = Annotated[float, Field(ge=-360, le=360)]
_Tilt = Annotated[float, Field(ge=-MOST_BEND_DEG, le=MOST_BEND_DEG)]


def swing_of_bend(bend: float, azimuth: float) -> tuple[float, float]:
    """Return pitch and roll, the rotation vector about y and z of frame B of a bend towards an azimuth [rad].

    pitch = -bend sin(azimuth), roll = bend cos(azimuth); of a bend of 1 it is the axis.
    """
    return -bend * math.sin(azimuth), bend * math.cos(azimuth)


def bend_of_swing(pitch: float, roll: float) -> tuple[float, float]:
    """Return bend and azimuth [rad] of a pitch and roll; an azimuth of 0 where nothing is bent."""
    bend = math.hypot(pitch, roll)
    return (bend, math.atan2(-pitch, roll)) if bend > _UPRIGHT else (0.0, 0.0)


_UPRIGHT = 1e-9
"""Bend [rad] below which there is no direction to tell."""


class Pose(Settings):
    """How the head stands at rest, as bend and azimuth or as pitch and roll.

    bend_deg: angle between the x axes of base and head, not negative. azimuth_deg: direction in which the head leans,
    from the y axis of frame B towards z; the lever at rest lies along y. pitch_deg, roll_deg: components about y and z
    of the one turn that brings the head there. They say the same, see `swing_of_bend`.
    """

    bend_deg: Annotated[float, Field(ge=0, le=MOST_BEND_DEG)] | None = None
    azimuth_deg: _Angle | None = None
    pitch_deg: _Tilt | None = None
    roll_deg: _Tilt | None = None

    @model_validator(mode="after")
    def _one_or_the_other(self) -> "Pose":
        given = [name for name in type(self).model_fields if getattr(self, name) is not None]
        if given not in (["bend_deg", "azimuth_deg"], ["pitch_deg", "roll_deg"]):
            raise ValueError(
                f"found {' and '.join(given) or 'nothing'}, expected bend_deg and azimuth_deg or pitch_deg and roll_deg"
            )
        if math.degrees(self.bend_rad) > MOST_BEND_DEG * (1 + 1e-12):
            raise ValueError(
                f"pitch_deg and roll_deg bend the head by {math.degrees(self.bend_rad):.0f}°, expected at most "
                f"{MOST_BEND_DEG:g}° in all"
            )
        return self

    @property
    def bend_rad(self) -> float:
        """Return the bend β [rad], not negative."""
        return math.radians(self.bend_deg) if self.bend_deg is not None else bend_of_swing(*self.swing_rad)[0]

    @property
    def azimuth_rad(self) -> float:
        """Return the azimuth α [rad]; 0 where nothing is bent."""
        if self.azimuth_deg is not None:
            return math.radians(self.azimuth_deg)
        return bend_of_swing(*self.swing_rad)[1]

    @property
    def swing_rad(self) -> tuple[float, float]:
        """Return pitch and roll [rad], the rotation vector of the swing about y and z of frame B."""
        if self.bend_deg is None or self.azimuth_deg is None:
            return math.radians(self.pitch_deg or 0.0), math.radians(self.roll_deg or 0.0)
        return swing_of_bend(math.radians(self.bend_deg), math.radians(self.azimuth_deg))

    @property
    def bend_and_azimuth_deg(self) -> tuple[float, float]:
        """Return bend and azimuth [deg], as a recording has them; (0, 0) where nothing is bent."""
        if self.is_straight:
            return 0.0, 0.0
        if self.bend_deg is not None and self.azimuth_deg is not None:
            return self.bend_deg, self.azimuth_deg
        return math.degrees(self.bend_rad), math.degrees(self.azimuth_rad)

    @property
    def is_straight(self) -> bool:
        """Whether the head stands upright."""
        return self.bend_rad == 0.0

    def words(self) -> str:
        """Return the pose in a few words: "a bend of 20° towards 90°", "an upright head"."""
        if self.is_straight:
            return "an upright head"
        bend, azimuth = self.bend_and_azimuth_deg
        return f"a bend of {bend:.4g}° towards {azimuth:.4g}°"

    def to_json(self) -> dict[str, float]:
        """Return the pose both ways, as JSON holds it."""
        bend, azimuth = self.bend_and_azimuth_deg
        pitch, roll = map(math.degrees, self.swing_rad)
        return {"bend_deg": bend, "azimuth_deg": azimuth, "pitch_deg": pitch, "roll_deg": roll}


STRAIGHT: Pose = Pose(bend_deg=0.0, azimuth_deg=0.0)
"""The pose of a plan that says nothing of one."""
