"""This is where a test bed is described: every parameter with value, unit, origin and bounds."""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from sinew.plan.calibrated import Calibrated
from sinew.plan.cross_section import CrossSection
from sinew.plan.parameter import Parameter, not_negative, positive, signed
from sinew.plan.wiring import Wiring

__all__ = ["Bus", "Drive", "Imu", "Inertia", "Limits", "Repeatability", "RigSpec", "Silicone", "Tendons"]

_STRICT = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
Positive = Annotated[float, Field(gt=0)]


def _ordered(window: tuple[float, float]) -> tuple[float, float]:
    if not window[0] < window[1]:
        raise ValueError(f"the first number, {window[0]:g}, must be below the second, {window[1]:g}")
    return window


Window = Annotated[tuple[float, float], AfterValidator(_ordered)]


class Silicone(BaseModel):
    """The continuum: a solid cylinder, incompressible neo-Hookean, with a loss factor.

    torsional_rigidity: relaxed G·J (paper Eq. 5). diameter then fixes J = π d⁴/32, hence G; where the rig has a
    `section`, that fixes J, and the diameter is only that of the circle around it.
    loss_factor: tan δ, about constant over 0.3-30 Hz.
    viscous: torsional dashpot in parallel; zero in the paper's rig, used for linear reference joints.
    """

    model_config = _STRICT

    length: Annotated[Parameter, positive("m")]
    torsional_rigidity: Annotated[Parameter, positive("N*m^2")]
    diameter: Annotated[Parameter, positive("m")]
    loss_factor: Annotated[Parameter, not_negative("1")]
    viscous: Annotated[Parameter, not_negative("N*m*s/rad")]


class Inertia(BaseModel):
    """What moves. head: I_h without the lever, about the joint's axis; lever: I_l with its weights."""

    model_config = _STRICT

    head: Annotated[Parameter, positive("kg*m^2")]
    lever: Annotated[Parameter, positive("kg*m^2")]
    head_mass: Annotated[Parameter, positive("kg")]


class Tendons(BaseModel):
    """Straight tendons between base and head, each pulled by its own motor.

    base_radius, head_radius: of the circles of guides [m]; free_span: length between them at rest [m].
    cable_stiffness and servo_stiffness act in series [N/m], along the cable.
    first_contact_tension: tension of each tendon at pretension zero [N].
    guide_friction: friction torque on the head per newton of total tension [N m/N].
    presliding_angle: torsion over which the friction torque builds up [rad].
    pulley_radius: of the motor pulleys [m]; torque_constant: of the tendon motors [N m/A].
    current_lsb: unit of the current register [A]; counts_per_turn: of the encoder.
    """

    model_config = _STRICT

    count: int = Field(ge=2, le=12)
    base_radius: Annotated[Parameter, positive("m")]
    head_radius: Annotated[Parameter, positive("m")]
    free_span: Annotated[Parameter, positive("m")]
    cable_stiffness: Annotated[Parameter, positive("N/m")]
    servo_stiffness: Annotated[Parameter, positive("N/m")]
    first_contact_tension: Annotated[Parameter, not_negative("N")]
    guide_friction: Annotated[Parameter, not_negative("m")]
    presliding_angle: Annotated[Parameter, positive("rad")]
    pulley_radius: Annotated[Parameter, positive("m")]
    torque_constant: Annotated[Parameter, positive("N*m/A")]
    current_lsb: Annotated[Parameter, positive("A")]
    counts_per_turn: Annotated[Parameter, positive("1")]


class Drive(BaseModel):
    """The motor that swings the lever: geared DC motor with a proportional position loop on its duty.

    stall_torque, no_load_speed, stall_current: at nominal_voltage, at the horn.
    supply_voltage: what the bench feeds. friction: Coulomb friction at the horn, contained in the data-sheet line.
    position_gain: duty per radian of error, the register P gain times the encoder resolution over the duty range.
    duty_limit: 1 is full supply. armature: rotor inertia seen at the horn.
    """

    model_config = _STRICT

    nominal_voltage: Annotated[Parameter, positive("V")]
    supply_voltage: Annotated[Parameter, positive("V")]
    stall_torque: Annotated[Parameter, positive("N*m")]
    no_load_speed: Annotated[Parameter, positive("rad/s")]
    stall_current: Annotated[Parameter, positive("A")]
    friction: Annotated[Parameter, not_negative("N*m")]
    position_gain: Annotated[Parameter, positive("1/rad")]
    duty_limit: Annotated[Parameter, positive("1")]
    armature: Annotated[Parameter, positive("kg*m^2")]
    current_lsb: Annotated[Parameter, positive("A")]
    duty_lsb: Annotated[Parameter, positive("1")]
    counts_per_turn: Annotated[Parameter, positive("1")]


class Imu(BaseModel):
    """Gyroscope and accelerometer on the head plate.

    low_pass: corner of the second-order Butterworth low-pass [Hz]; residual_delay: what the data sheet's delay
    is longer than that filter's [s]; average_samples: moving average over so many samples at the sample rate.
    dead_band: readings of at most so many LSB are reported as zero (stock OpenCR library).
    delay_std: standard uncertainty of the whole delay [s].
    bias: rest reading that the start-up zeroing leaves. mount_radius: distance of the chip from the joint's axis.
    """

    model_config = _STRICT

    gyro_range: Annotated[Parameter, positive("rad/s")]
    gyro_lsb: Annotated[Parameter, positive("rad/s")]
    gyro_noise: Annotated[Parameter, not_negative("rad/s")]
    gyro_bias: Annotated[Parameter, signed("rad/s")]
    accelerometer_range: Annotated[Parameter, positive("m/s^2")]
    accelerometer_lsb: Annotated[Parameter, positive("m/s^2")]
    accelerometer_noise: Annotated[Parameter, not_negative("m/s^2")]
    mount_radius: Annotated[Parameter, not_negative("m")]
    low_pass: Annotated[Parameter, positive("Hz")]
    residual_delay: Annotated[Parameter, not_negative("s")]
    average_samples: int = Field(ge=1, le=64)
    dead_band: int = Field(ge=0, le=64)
    delay_std: Annotated[Parameter, not_negative("s")]


class Bus(BaseModel):
    """Time of the samples. stamp_jitter: standard deviation of the host's stamps; drive_delay: age of the drive's
    encoder reading at the stamp, minus that of the IMU's newest sample; both in seconds."""

    model_config = _STRICT

    stamp_jitter: Annotated[Parameter, not_negative("s")]
    drive_delay: Annotated[Parameter, signed("s")]


class Repeatability(BaseModel):
    """How far repetitions differ: standard deviations of the set pretension [m] and of the guide friction [1]."""

    model_config = _STRICT

    pretension: Annotated[Parameter, not_negative("m")]
    guide_friction: Annotated[Parameter, not_negative("1")]


class Limits(BaseModel):
    """What the rig must not exceed; a plan is refused, and a bench stops, beyond them.

    tendon_travel_mm: how far a tendon motor may be from its first contact, as length of cable; pulling is positive.
    drive_window_deg: how far the lever may be from its zero, either way.
    resumes_after_pause: how often a run goes on by itself after the computer paused for longer than the motors wait;
    None: three times where the rig declares release, never where it declares hold.
    """

    model_config = _STRICT

    pretension_mm: Window
    tension_n: Positive
    torsion_deg: Positive
    tilt_deg: Positive
    drive_amplitude_deg: Positive
    drive_hz: Positive
    drive_current_a: Positive
    tendon_current_a: Positive
    temperature_c: Positive
    voltage_v: Window
    tendon_travel_mm: Window = (-20.0, 40.0)
    drive_window_deg: Positive = 90.0
    safe_state: Annotated[str, Field(pattern="^(hold|release)$")] = "release"
    resumes_after_pause: Annotated[int, Field(ge=0, le=100)] | None = None

    @property
    def most_resumes(self) -> int:
        """How often a run goes on by itself after a pause of the computer."""
        if self.resumes_after_pause is not None:
            return self.resumes_after_pause
        return 3 if self.safe_state == "release" else 0


class RigSpec(BaseModel):
    """A whole test bed, as data.

    section: of a silicone that is no solid circle; None where the diameter says it all.
    calibration: how the calibrated parameters vary together; None where that is not known. As the intervals it is left
    out of `model_dump`: a rig with other values was not calibrated to them.
    """

    model_config = _STRICT

    name: str = Field(min_length=1)
    silicone: Silicone
    section: CrossSection | None = None
    inertia: Inertia
    tendons: Tendons
    drive: Drive
    imu: Imu
    bus: Bus
    repeatability: Repeatability
    limits: Limits
    wiring: Wiring = Wiring()
    calibration: Calibrated | None = Field(default=None, exclude=True)

    @model_validator(mode="before")
    @classmethod
    def _with_wiring(cls, data: Any) -> Any:
        """Give a rig without wiring the one that is usual for its number of tendons."""
        if isinstance(data, Mapping) and "wiring" not in data and isinstance(data.get("tendons"), Mapping):
            count = data["tendons"].get("count")
            if isinstance(count, int) and 2 <= count <= 12:
                return {**data, "wiring": Wiring.of(count).model_dump()}
        return data

    @model_validator(mode="after")
    def _every_tendon_has_a_motor(self) -> Self:
        if len(self.wiring.tendon_ids) != self.tendons.count:
            raise ValueError(
                f"wiring.tendon_ids has {len(self.wiring.tendon_ids)} ids and tendons.count is {self.tendons.count}; "
                "expected one motor for each tendon"
            )
        return self

    @model_validator(mode="after")
    def _calibrated_parameters_are_there(self) -> Self:
        if self.calibration is not None:
            table = dict(self.parameters())
            for name in self.calibration.parameters:
                if name not in table or table[name].origin != "calibrated":
                    found = f"has origin {table[name].origin}" if name in table else "is not in the rig"
                    raise ValueError(
                        f"calibration names {name}, which {found}; where it was changed by hand, take [calibration] out"
                    )
        return self

    @property
    def area_over_torsion_constant(self) -> float:
        """Return A/J of the silicone's section [1/m²]: 8/d² of a solid circle."""
        if self.section is None:
            return 8 / self.silicone.diameter.value**2
        return self.section.area.value / self.section.torsion_constant.value

    @property
    def bending_over_torsional_rigidity(self) -> float:
        """Return E I/(G J) of the incompressible silicone, 3 I/J, about its weaker axis [1]: 1.5 of a solid circle."""
        if self.section is None:
            return 1.5
        return 3 * self.section.least_moment.value / self.section.torsion_constant.value

    def parameters(self) -> Iterator[tuple[str, Parameter]]:
        """Yield (dotted name, parameter) of every parameter."""
        for part_name in type(self).model_fields:
            part = getattr(self, part_name)
            if isinstance(part, BaseModel):
                for name in type(part).model_fields:
                    parameter = getattr(part, name)
                    if isinstance(parameter, Parameter):
                        yield f"{part_name}.{name}", parameter

    def with_values(self, values: dict[str, float], origin: str | None = None) -> "RigSpec":
        """Return a copy with other values (by dotted name, in each parameter's unit), validated.

        Raises pydantic's ValidationError outside the bounds, KeyError for an unknown name.
        """
        data = self.model_dump()
        for dotted, value in values.items():
            part, name = dotted.split(".")
            row = data[part][name]
            row["value"] = float(value)
            if origin is not None:
                row["origin"] = origin
        return RigSpec.model_validate(data)
