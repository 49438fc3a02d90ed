"""This is where it is written which device of the bus is which part of the rig, and which way round it is mounted."""

from collections import Counter
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

__all__ = ["Axis", "Id", "Sign", "Wiring"]

Id = Annotated[int, Field(ge=0, le=252)]
Sign = Literal[1, -1]
Axis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]

_POSSIBLE_TURNS = 1_048_575  # counts of goal_position, either way


class Wiring(BaseModel):
    """Ids, models, signs and zero of the devices on the bus.

    baud: of the bus [1/s]. tendon_ids, drive_id, imu_id: of the devices; tendon motors in the order of the tendons.
    tendon_model, drive_model, imu_model: as the register tables are called.
    tendon_pull: 1 where more counts of the encoder pull the tendon, -1 where they let it go.
    drive_sign: 1 where more counts turn the lever positively against the head, else -1.
    drive_zero_counts: encoder reading with the lever in its middle.
    imu_axes: the axes of the chip that point along x, y and z of the head's frame H; together right-handed.
    latency_ms: of port, driver and operating system; how much longer than on the wire an answer may take.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    baud: int = Field(default=1_000_000, gt=0)
    tendon_ids: Annotated[tuple[Id, ...], Field(min_length=2, max_length=12)] = (1, 2, 3, 4)
    drive_id: Id = 5
    imu_id: Id = 200
    tendon_model: str = "XH430-W350"
    drive_model: str = "XM430-W350"
    imu_model: str = "OpenCR node"
    tendon_pull: tuple[Sign, ...] = (1, 1, 1, 1)
    drive_sign: Sign = 1
    drive_zero_counts: int = Field(default=2048, ge=-_POSSIBLE_TURNS, le=_POSSIBLE_TURNS)
    imu_axes: tuple[Axis, Axis, Axis] = ("+x", "+y", "+z")
    latency_ms: float = Field(default=4.0, gt=0, le=1000)

    @classmethod
    def of(cls, tendons: int) -> "Wiring":
        """Return the wiring of a bench with so many tendons and ids counted from 1; as assumed where a rig has none."""
        ids = tuple(range(1, tendons + 1))
        return cls(tendon_ids=ids, drive_id=tendons + 1, tendon_pull=(1,) * tendons)

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        ids = (*self.tendon_ids, self.drive_id, self.imu_id)
        doubled = [device for device, times in Counter(ids).items() if times > 1]
        if doubled:
            raise ValueError(f"id {doubled[0]} stands for two devices; expected a different id for each")
        if len(self.tendon_pull) != len(self.tendon_ids):
            raise ValueError(
                f"tendon_pull has {len(self.tendon_pull)} signs for {len(self.tendon_ids)} tendon_ids; "
                "expected one for each"
            )
        if _handedness(self.imu_axes) != 1:
            raise ValueError(
                f"imu_axes {', '.join(self.imu_axes)} are no right-handed frame; "
                "expected each of x, y and z once, and z where x turned to y points"
            )
        return self


def _handedness(axes: tuple[Axis, Axis, Axis]) -> int:
    """Return the determinant of the rotation: 1 right-handed, -1 left-handed, 0 where an axis is missing."""
    letters = "".join(axis[1] for axis in axes)
    sign = {"xyz": 1, "yzx": 1, "zxy": 1, "xzy": -1, "zyx": -1, "yxz": -1}.get(letters, 0)
    return -sign if sum(axis[0] == "-" for axis in axes) % 2 else sign
