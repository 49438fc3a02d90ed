"""This is where a test bed is described: every parameter with value, unit, origin and bounds."""

from collections.abc import Iterator
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from sinew.plan.parameter import Parameter, Quantity

__all__ = ["Bus", "Drive", "Imu", "Inertia", "Limits", "Repeatability", "RigSpec", "Silicone", "Tendons"]

_STRICT = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
Positive = Annotated[float, Field(gt=0)]
Window = tuple[float, float]


class Silicone(BaseModel):
    """The continuum: a solid cylinder, incompressible neo-Hookean, with a loss factor.

    torsional_rigidity: relaxed G·J (paper Eq. 5). diameter then fixes J = π d⁴/32, hence G.
    loss_factor: tan δ, about constant over 0.3-30 Hz.
    viscous: torsional dashpot in parallel; zero in the paper's rig, used for linear reference joints.
    """

    model_config = _STRICT

    length: Quantity["m"]
    torsional_rigidity: Quantity["N*m^2"]
    diameter: Quantity["m"]
    loss_factor: Quantity["1"]
    viscous: Quantity["N*m*s/rad"]


class Inertia(BaseModel):
    """What moves. head: I_h without the lever, about the joint's axis; lever: I_l with its weights."""

    model_config = _STRICT

    head: Quantity["kg*m^2"]
    lever: Quantity["kg*m^2"]
    head_mass: Quantity["kg"]


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
    base_radius: Quantity["m"]
    head_radius: Quantity["m"]
    free_span: Quantity["m"]
    cable_stiffness: Quantity["N/m"]
    servo_stiffness: Quantity["N/m"]
    first_contact_tension: Quantity["N"]
    guide_friction: Quantity["m"]
    presliding_angle: Quantity["rad"]
    pulley_radius: Quantity["m"]
    torque_constant: Quantity["N*m/A"]
    current_lsb: Quantity["A"]
    counts_per_turn: Quantity["1"]


class Drive(BaseModel):
    """The motor that swings the lever: geared DC motor with a proportional position loop on its duty.

    stall_torque, no_load_speed, stall_current: at nominal_voltage, at the horn.
    supply_voltage: what the bench feeds. friction: Coulomb friction at the horn, contained in the data-sheet line.
    position_gain: duty per radian of error, the register P gain times the encoder resolution over the duty range.
    duty_limit: 1 is full supply. armature: rotor inertia seen at the horn.
    """

    model_config = _STRICT

    nominal_voltage: Quantity["V"]
    supply_voltage: Quantity["V"]
    stall_torque: Quantity["N*m"]
    no_load_speed: Quantity["rad/s"]
    stall_current: Quantity["A"]
    friction: Quantity["N*m"]
    position_gain: Quantity["1/rad"]
    duty_limit: Quantity["1"]
    armature: Quantity["kg*m^2"]
    current_lsb: Quantity["A"]
    duty_lsb: Quantity["1"]
    counts_per_turn: Quantity["1"]


class Imu(BaseModel):
    """Gyroscope and accelerometer on the head plate.

    low_pass: corner of the second-order Butterworth low-pass [Hz]; residual_delay: what the data sheet's delay
    is longer than that filter's [s]; average_samples: moving average over so many samples at the sample rate.
    dead_band: readings of at most so many LSB are reported as zero (stock OpenCR library).
    delay_std: standard uncertainty of the whole delay [s].
    bias: rest reading that the start-up zeroing leaves. mount_radius: distance of the chip from the joint's axis.
    """

    model_config = _STRICT

    gyro_range: Quantity["rad/s"]
    gyro_lsb: Quantity["rad/s"]
    gyro_noise: Quantity["rad/s"]
    gyro_bias: Quantity["rad/s"]
    accelerometer_range: Quantity["m/s^2"]
    accelerometer_lsb: Quantity["m/s^2"]
    accelerometer_noise: Quantity["m/s^2"]
    mount_radius: Quantity["m"]
    low_pass: Quantity["Hz"]
    residual_delay: Quantity["s"]
    average_samples: int = Field(ge=1, le=64)
    dead_band: int = Field(ge=0, le=64)
    delay_std: Quantity["s"]


class Bus(BaseModel):
    """Time of the samples. stamp_jitter: standard deviation of the host's stamps; drive_delay: age of the drive's
    encoder reading at the stamp, minus that of the IMU's newest sample; both in seconds."""

    model_config = _STRICT

    stamp_jitter: Quantity["s"]
    drive_delay: Quantity["s"]


class Repeatability(BaseModel):
    """How far repetitions differ: standard deviations of the set pretension [m] and of the guide friction [1]."""

    model_config = _STRICT

    pretension: Quantity["m"]
    guide_friction: Quantity["1"]


class Limits(BaseModel):
    """What the rig must not exceed; a plan is refused, and a bench stops, beyond them."""

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
    safe_state: Annotated[str, Field(pattern="^(hold|release)$")] = "release"


class RigSpec(BaseModel):
    """A whole test bed, as data."""

    model_config = _STRICT

    name: str = Field(min_length=1)
    silicone: Silicone
    inertia: Inertia
    tendons: Tendons
    drive: Drive
    imu: Imu
    bus: Bus
    repeatability: Repeatability
    limits: Limits

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
