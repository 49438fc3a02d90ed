"""A test bed: every parameter with value, unit, origin and bounds."""

import math
from abc import abstractmethod
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, Field, model_validator

from sinew.measure.arrays import Array
from sinew.measure.errors import SpecError
from sinew.mechanics.guides import GUIDE_LAWS, GuideFriction, GuideLaw
from sinew.plan.parameter import NotNegative, Parameter, Positive, Settings, not_negative, positive, signed
from sinew.plan.servo import MOST_TURN_COUNTS, PAPER_DRIVE, PAPER_TENDON, SERVOS, winding_resistance

# It is written which device of the bus is which part of the rig, and which way round it is mounted.

Id = Annotated[int, Field(ge=0, le=252)]
Sign = Literal[1, -1]
Axis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
_Amount = TypeVar("_Amount", float, NDArray[np.float64])


def _known(model: str) -> str:
    if model not in SERVOS:
        raise ValueError(f"no servo {model!r} is known; expected one of {', '.join(SERVOS)}")
    return model


ServoModel = Annotated[str, AfterValidator(_known)]


class Wiring(Settings):
    """Ids, models, signs and zero of the devices on the bus.

    baud: of the bus [1/s]. tendon_ids, drive_id, imu_id: of the devices; tendon motors in the order of the tendons.
    tendon_model, drive_model: of `sinew.plan.servo`. imu_model: as its register table is called.
    tendon_pull: 1 where more counts of the encoder pull the tendon, -1 where they let it go.
    drive_sign: 1 where more counts turn the lever positively against the head, else -1.
    drive_zero_counts: encoder reading with the lever in its middle.
    imu_axes: the axes of the chip that point along x, y and z of the head's frame H; together right-handed.
    latency_ms: of port, driver and operating system; how much longer than on the wire an answer may take.
    measured: names of those of these keys that were found on the bench itself; the others are as somebody wrote them.
    """

    baud: int = Field(default=1_000_000, gt=0)
    tendon_ids: Annotated[tuple[Id, ...], Field(min_length=2, max_length=12)] = (1, 2, 3, 4)
    drive_id: Id = 5
    imu_id: Id = 200
    tendon_model: ServoModel = PAPER_TENDON
    drive_model: ServoModel = PAPER_DRIVE
    imu_model: str = "OpenCR node"
    tendon_pull: tuple[Sign, ...] = (1, 1, 1, 1)
    drive_sign: Sign = 1
    drive_zero_counts: int = Field(default=2048, ge=-MOST_TURN_COUNTS, le=MOST_TURN_COUNTS)
    imu_axes: tuple[Axis, Axis, Axis] = ("+x", "+y", "+z")
    latency_ms: float = Field(default=4.0, gt=0, le=1000)
    measured: tuple[str, ...] = ()

    @classmethod
    def of(cls, tendons: int) -> "Wiring":
        """Return the wiring of a bench with so many tendons and ids counted from 1; as assumed where a rig has none."""
        ids = tuple(range(1, tendons + 1))
        return cls(tendon_ids=ids, drive_id=tendons + 1, tendon_pull=(1,) * tendons)

    @model_validator(mode="after")
    def _measured_keys_are_there(self) -> Self:
        for name in self.measured:
            if name == "measured" or name not in type(self).model_fields:
                raise ValueError(f"measured names {name}; expected keys of the wiring, such as tendon_pull")
        return self

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


# A rig says what it was calibrated from, and how its calibrated parameters vary together.

Correlation = Annotated[float, Field(ge=-1, le=1)]


class Calibrated(Settings):
    """The joint uncertainty of a rig's calibrated parameters, k of them, and where it is from.

    recordings: file and beginning of the content hash of each. pretension_mm: at which they were made, increasing.
    parameters: dotted names. std: standard deviations, in the unit that the rig keeps each parameter in (SI), (k,).
    correlation: rows of its lower triangle, the diagonal of ones among them: row i has i + 1 numbers.

    The parameters' uncertainty is a normal distribution about the rig's values with covariance
    std_i · std_j · correlation_ij. What is tied (the head's inertia to the lever's) is correlated by 1 or -1.
    """

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


# The cross-section of a silicone is described that is no solid circle.


class CrossSection(Settings):
    """What the equations need of a section, instead of the solid circle that the silicone's diameter stands for.

    shape: in words. area [m²]. torsion_constant: St Venant's J [m⁴], which with the silicone's G·J sets G, hence the
    axial stiffness. least_moment, greatest_moment: principal second moments [m⁴]; their sum is the polar moment.
    warping_constant [m⁶]. perimeter: of all edges [m]. shear_arm: the largest shear strain per twist [m]; left out
    where a re-entrant corner makes it unbounded. hull_mm: corners (y, z) of its convex hull about the centroid; left
    out where it is round. Bending about y has the least moment, so the wide side lies along y.
    Torsion takes area and torsion constant, bending the moments; the others tell what meets the surface and what the
    prediction is worth.
    """

    shape: str = Field(min_length=1)
    hull_mm: Annotated[tuple[tuple[float, float], ...], Field(min_length=3)] | None = None
    area: Annotated[Parameter, positive("m^2")]
    torsion_constant: Annotated[Parameter, positive("m^4")]
    least_moment: Annotated[Parameter, positive("m^4")]
    greatest_moment: Annotated[Parameter, positive("m^4")]
    warping_constant: Annotated[Parameter, not_negative("m^6")]
    perimeter: Annotated[Parameter, positive("m")]
    shear_arm: Annotated[Parameter, positive("m")] | None = None


def _ordered(window: tuple[float, float]) -> tuple[float, float]:
    if not window[0] < window[1]:
        raise ValueError(f"the first number, {window[0]:g}, must be below the second, {window[1]:g}")
    return window


Window = Annotated[tuple[float, float], AfterValidator(_ordered)]


class Silicone(Settings):
    """The continuum: a solid cylinder, incompressible neo-Hookean, with a loss factor.

    torsional_rigidity: relaxed G·J (paper Eq. 5). diameter then fixes J = π d⁴/32, hence G; where the rig has a
    `section`, that fixes J, and the diameter is only that of the circle around it.
    loss_factor: tan δ, about constant over 0.3-30 Hz.
    viscous: torsional dashpot in parallel; zero in the paper's rig, used for linear reference joints.
    """

    length: Annotated[Parameter, positive("m")]
    torsional_rigidity: Annotated[Parameter, positive("N*m^2")]
    diameter: Annotated[Parameter, positive("m")]
    loss_factor: Annotated[Parameter, not_negative("1")]
    viscous: Annotated[Parameter, not_negative("N*m*s/rad")]

    def stiffness(self, shortening: _Amount) -> _Amount:
        """Return the torsional stiffness at small angles [N m/rad] where it is shortened [m]: G J/(L - x)."""
        return self.torsional_rigidity.value / (self.length.value - shortening)


class Inertia(Settings):
    """What moves. head: I_h without the lever, about the joint's axis; lever: I_l with its weights."""

    head: Annotated[Parameter, positive("kg*m^2")]
    lever: Annotated[Parameter, positive("kg*m^2")]
    head_mass: Annotated[Parameter, positive("kg")]


class Spatial(Settings):
    """What a joint that bends needs beside torsion and compression; none of it matters while it stands straight.

    density: of the silicone. rest_bend_deg, rest_azimuth_deg: the bend at which it was cast, and its direction from y
    towards z; zero for a straight joint.
    head_height: of the centre of mass of what is fixed to the head plate, above the plate; its mass is
    `inertia.head_mass` less the lever's. head_across: its moment about its centre, across the axis; along it,
    `inertia.head`. lever_mass, lever_height: of the lever with its weights. lever_along: its moment about its arms;
    about both other axes, `inertia.lever`.
    routing: chord, tendons run straight from plate to plate; channel, in channels of the silicone that they follow.
    """

    density: Annotated[Parameter, positive("kg/m^3")]
    rest_bend_deg: Annotated[float, Field(ge=-60, le=60)] = 0.0
    rest_azimuth_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    head_height: Annotated[Parameter, not_negative("m")]
    head_across: Annotated[Parameter, positive("kg*m^2")]
    lever_mass: Annotated[Parameter, positive("kg")]
    lever_height: Annotated[Parameter, not_negative("m")]
    lever_along: Annotated[Parameter, positive("kg*m^2")]
    routing: Literal["chord", "channel"] = "chord"


class Tendons(Settings):
    """Straight tendons between base and head, each pulled by its own motor.

    base_radius, head_radius: of the circles of guides [m]; free_span: length between them at rest [m].
    cable_stiffness and servo_stiffness act in series [N/m], along the cable.
    first_contact_tension: tension of each tendon at pretension zero [N].
    guide_law: of the guides' friction. guide_friction: its torque on the head per newton of total tension [N m/N].
    presliding_angle: torsion over which that torque builds up [rad].
    pulley_radius: of the motor pulleys [m]; torque_constant: of the tendon motors [N m/A].
    current_lsb: unit of the current register [A]; counts_per_turn: of the encoder.
    """

    count: int = Field(ge=2, le=12)
    base_radius: Annotated[Parameter, positive("m")]
    head_radius: Annotated[Parameter, positive("m")]
    free_span: Annotated[Parameter, positive("m")]
    cable_stiffness: Annotated[Parameter, positive("N/m")]
    servo_stiffness: Annotated[Parameter, positive("N/m")]
    first_contact_tension: Annotated[Parameter, not_negative("N")]
    guide_law: GuideLaw = "dahl"
    guide_friction: Annotated[Parameter, not_negative("m")]
    presliding_angle: Annotated[Parameter, positive("rad")]
    pulley_radius: Annotated[Parameter, positive("m")]
    torque_constant: Annotated[Parameter, positive("N*m/A")]
    current_lsb: Annotated[Parameter, positive("A")]
    counts_per_turn: Annotated[Parameter, positive("1")]

    @property
    def guides(self) -> GuideFriction:
        """Return the friction of the guides."""
        return GUIDE_LAWS[self.guide_law](self.guide_friction.value, self.presliding_angle.value)

    def damping(self, tension: float, stiffness: float, swing: Array) -> Array:
        """Return Lehr's damping that the guides' loop gives a joint, loop/(2π k a²), at amplitudes a [rad].

        tension: of all tendons together [N]. stiffness: k of the joint [N m/rad].
        """
        return np.asarray(self.guides.loss(tension, swing) / (2.0 * math.pi * stiffness * swing**2))

    def stiffness(self, tension: _Amount, shortening: _Amount) -> _Amount:
        """Return the torsional stiffness at small angles [N m/rad]: ΣT r_b r_h/(ℓ - x).

        tension: of all tendons together, which stays [N]. shortening: of the joint [m].
        """
        return tension * (self.base_radius.value * self.head_radius.value) / (self.free_span.value - shortening)

    def current(self, tension: _Amount) -> _Amount:
        """Return the current [A] with which a tendon's motor holds a tension [N]."""
        return tension * self.pulley_radius.value / self.torque_constant.value

    def tension(self, current: _Amount) -> _Amount:
        """Return the tension [N] that a tendon's motor holds with a current [A]."""
        return current * self.torque_constant.value / self.pulley_radius.value


LIMIT_RESERVE_N = 5.0
"""Tension above that at rest at which a current-limited position loop yields [N]; the paper does not give it."""


class Drive(Settings):
    """The motor that swings the lever: geared DC motor with a proportional position loop on its duty.

    stall_torque, no_load_speed, stall_current: at nominal_voltage, at the horn.
    supply_voltage: what the bench feeds. friction: Coulomb friction at the horn, contained in the data-sheet line.
    position_gain: duty per radian of error, the register P gain times the encoder resolution over the duty range.
    duty_limit: 1 is full supply. armature: rotor inertia seen at the horn.
    """

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

    # The torque line goes through stall torque and no-load speed at nominal voltage, its friction taken out already.

    @property
    def supply_share(self) -> float:
        """Return the supply over the voltage that stall torque, current and no-load speed belong to [1]."""
        return self.supply_voltage.value / self.nominal_voltage.value

    @property
    def duty_torque(self) -> float:
        """Return the torque of the whole supply's current at standstill [N m], friction not taken out."""
        return (self.stall_torque.value + self.friction.value) * self.supply_share

    @property
    def speed_slope(self) -> float:
        """Return what the torque line falls by with the speed [N m s/rad]."""
        return self.stall_torque.value / self.no_load_speed.value

    @property
    def torque_constant(self) -> float:
        """Return the torque of the current, friction not taken out [N m/A]."""
        return (self.stall_torque.value + self.friction.value) / self.stall_current.value

    @property
    def resistance(self) -> float:
        """Return that of winding, brushes and bridge [Ω]."""
        return winding_resistance(self.nominal_voltage.value, self.stall_current.value)


NODE_HZ = 200.0
"""How often the OpenCR's stock library takes the sample that its readings are means of [Hz]."""


class Imu(Settings):
    """Gyroscope and accelerometer on the head plate.

    low_pass: corner of the second-order Butterworth low-pass [Hz]; residual_delay: what the data sheet's delay
    is longer than that filter's [s]; average_samples: moving average over so many samples at the sample rate.
    dead_band: readings of at most so many LSB are reported as zero (stock OpenCR library).
    delay_std: standard uncertainty of the whole delay [s].
    bias: rest reading that the start-up zeroing leaves. mount_radius: distance of the chip from the joint's axis.
    """

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

    @property
    def filter_delay(self) -> float:
        """Return by how much the chip's filter is late at low frequency [s]: √2/(2π f), and what is beyond."""
        return math.sqrt(2.0) / (2.0 * math.pi * self.low_pass.value) + self.residual_delay.value


class Bus(Settings):
    """Time of the samples. stamp_jitter: standard deviation of the host's stamps; drive_delay: age of the drive's
    encoder reading at the stamp, minus that of the IMU's newest sample; both in seconds."""

    stamp_jitter: Annotated[Parameter, not_negative("s")]
    drive_delay: Annotated[Parameter, signed("s")]


class Repeatability(Settings):
    """How far repetitions differ: standard deviations of the set pretension [m] and of the guide friction [1]."""

    pretension: Annotated[Parameter, not_negative("m")]
    guide_friction: Annotated[Parameter, not_negative("1")]


_EMULATED_RESUMES = 10

TORSO_ROLL_DEG = 40.0
"""How far the paper's torso rolls, either way (Fig. 11) [deg]."""


class Limits(Settings):
    """What the rig must not exceed; a plan is refused, and a bench stops, beyond them.

    tendon_travel_mm: how far a tendon motor may be from its first contact, as length of cable; pulling is positive.
    drive_window_deg: how far the lever may be from its zero, either way.
    tilt_deg: how far the head may lean away from the pose that was asked for, level where none was.
    bend_deg: how far that pose may be bent; None: 40°, as far as the paper's torso rolls.
    resumes_after_pause: how often a run goes on by itself after the computer paused for longer than the motors wait;
    None: ten times on an emulated bench, never on a real one, which stops for somebody to look.
    """

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
    bend_deg: Positive | None = None

    @property
    def most_bend_deg(self) -> float:
        """How far the head may be asked to bend [deg]."""
        return TORSO_ROLL_DEG if self.bend_deg is None else self.bend_deg

    def most_resumes(self, *, is_emulated: bool) -> int:
        """Return how often a run goes on by itself after a pause of the computer, on an emulated or a real bench."""
        if self.resumes_after_pause is not None:
            return self.resumes_after_pause
        return _EMULATED_RESUMES if is_emulated else 0


class BusSensor(Settings):
    """A sensor on a node of its own on the bus; a kind of it is a part of the rig, and says what it measures.

    The node has two registers of two bytes: its model number at 0 and its value at 32, signed. model, number: what the
    node is called and answers to a ping. channel: variable of the recording schema, one value a sample. unit: of
    channel and noise, as register tables write it. lsb: of the register [unit].
    id: on the bus. noise: standard deviation of a value.
    """

    model: ClassVar[str]
    number: ClassVar[int]
    channel: ClassVar[str]
    unit: ClassVar[str]
    lsb: ClassVar[float]

    id: Id
    noise: Parameter

    @abstractmethod
    def true_value(self, tension_n: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what it would tell without noise, (...), where the tendons carry such tensions [N], (..., tendon)."""

    def reading(self, tension_n: NDArray[np.float64], rng: np.random.Generator | None) -> NDArray[np.float64]:
        """Return what it tells [unit]: the true value; with an rng, noisy and in whole counts of its register."""
        value = self.true_value(tension_n)
        if rng is None:
            return value
        counts = np.round((value + self.noise.value * rng.standard_normal(value.shape)) / self.lsb)
        return np.asarray(np.clip(counts, -32_768, 32_767) * self.lsb)


class LoadCell(BusSensor):
    """A load cell in one tendon: a strain gauge whose amplifier hangs on a microcontroller that answers on the bus.

    tendon: in which it sits, from 1. Its register counts 10 mN, up to 327 N.
    """

    model, number, channel, unit, lsb = "load cell", 0x7401, "load_cell_n", "N", 0.01

    tendon: int = Field(ge=1)
    noise: Annotated[Parameter, not_negative("N")]

    def true_value(self, tension_n: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(tension_n[..., self.tendon - 1])


class RigSpec(Settings):
    """A whole test bed, as data.

    section: of a silicone that is no solid circle; None where the diameter says it all. space: masses and routing of a
    joint that bends; None where a rig only twists. load_cell: None where no tendon has one.
    calibration: how the calibrated parameters vary together; None where that is not known. As the intervals it is left
    out of `model_dump`: a rig with other values was not calibrated to them.
    """

    name: str = Field(min_length=1)
    silicone: Silicone
    section: CrossSection | None = None
    inertia: Inertia
    space: Spatial | None = None
    tendons: Tendons
    drive: Drive
    imu: Imu
    bus: Bus
    repeatability: Repeatability
    limits: Limits
    wiring: Wiring = Wiring()
    load_cell: LoadCell | None = None
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
    def _sensors_have_ids_of_their_own(self) -> Self:
        taken = {*self.wiring.tendon_ids, self.wiring.drive_id, self.wiring.imu_id}
        for sensor in self.sensors:
            if sensor.id in taken:
                raise ValueError(f"id {sensor.id} of the {sensor.model} stands for two devices; expected another")
            taken.add(sensor.id)
        if self.load_cell is not None and self.load_cell.tendon > self.tendons.count:
            raise ValueError(
                f"load_cell.tendon is {self.load_cell.tendon}; expected one of {self.tendons.count} tendons"
            )
        return self

    @property
    def sensors(self) -> tuple[BusSensor, ...]:
        """Return the sensors that have a node of their own, in the order of the rig's parts."""
        parts = (getattr(self, name) for name in type(self).model_fields)
        return tuple(part for part in parts if isinstance(part, BusSensor))

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
    def axial_stiffness(self) -> float:
        """Return the axial stiffness of the untwisted incompressible silicone [N/m]: 3 G A/L."""
        return 3 * self.silicone.stiffness(0.0) * self.area_over_torsion_constant

    def swing_pull(self, torsion: float, taken_up: float = 0.0, shortened: float = 0.0) -> float:
        """Return by how much a swing raises the tension of a tendon that is held by position [N].

        torsion: its amplitude [rad], by which the span between guides grows to √(ℓ² + r_b² + r_h² - 2 r_b r_h cos φ).
        taken_up: amplitude of a tendon that drives it [m]. shortened: what the silicone is at rest [m]. Cable and servo
        give way, and the silicone under all, which pushes by G J φ²/(2 L² λ²) as it is twisted (Rivlin), and resists by
        G A (1 + 2/λ³)/L at rest. A constant loss factor η makes it stiffer by f^(2η/π), over two decades of f. On the
        emulated bench swings of 57°, 40° and 28° at 0, 4 and 12 mm pull 1.5, 1.1 and 0.9 N more: the head has mass.
        """
        tendons, silicone, stretch = self.tendons, self.silicone, 1 - shortened / self.silicone.length.value
        base, head, span = tendons.base_radius.value, tendons.head_radius.value, tendons.free_span.value - shortened
        grown = math.sqrt(span**2 + base**2 + head**2 - 2 * base * head * math.cos(torsion))
        longer = grown - math.hypot(span, base - head) + taken_up
        push = silicone.stiffness(0.0) / silicone.length.value * torsion**2 / (2 * stretch**2)
        stiffer = math.pow(100, 2 * silicone.loss_factor.value / math.pi) - 1
        axial = self.axial_stiffness * ((1 + 2 / stretch**3) / 3 + stiffer)
        series = 1 / tendons.cable_stiffness.value + 1 / tendons.servo_stiffness.value
        return (longer + push / axial) / (series + tendons.count / axial)

    @property
    def bending_over_torsional_rigidity(self) -> float:
        """Return E I/(G J) of the incompressible silicone, 3 I/J, about its weaker axis [1]: 1.5 of a solid circle."""
        if self.section is None:
            return 1.5
        return 3 * self.section.least_moment.value / self.section.torsion_constant.value

    def support(self, direction: float | Array) -> Array:
        """Return how far the silicone's section reaches in directions from y towards z [rad], to the tangent across
        [m]; in all of them the radius of the circle around it where the rig does not say more."""
        hull = None if self.section is None else self.section.hull_mm
        if hull is None:
            return np.full(np.shape(direction), self.silicone.diameter.value / 2)
        along = np.stack([np.cos(direction), np.sin(direction)], axis=-1)
        return 1e-3 * np.max(along @ np.array(hull).T, axis=-1)  # type: ignore[no-any-return]

    def outline(self, direction: Array) -> Array:
        """Return the points (n, 2) of the silicone's surface in directions (n,) from y towards z [rad], along y and z
        [m]; of a section that is not round those of its hull, else of the circle around it."""
        rays = np.stack([np.cos(direction), np.sin(direction)], axis=-1)
        hull = None if self.section is None else self.section.hull_mm
        if hull is None:
            return np.asarray(0.5 * self.silicone.diameter.value * rays, dtype=np.float64)
        corners = 1e-3 * np.array(hull)
        edges = np.roll(corners, -1, axis=0) - corners
        across = np.stack([edges[:, 1], -edges[:, 0]], axis=-1)
        away = np.einsum("ei,ei->e", across, corners)
        across *= np.sign(away)[:, None]  # outwards, however the corners go round
        share = np.max(rays @ (across / np.abs(away)[:, None]).T, axis=-1)
        return np.asarray(rays / share[:, None], dtype=np.float64)

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


class Moments(NamedTuple):
    """Principal moments of inertia of head and lever about their centres, along x, y and z of frame H (3,) [kg m²].

    assumptions: sentences on those that the rig only assumes.
    """

    head: Array
    lever: Array
    assumptions: tuple[str, ...]


def moments_of(rig: RigSpec) -> Moments:
    """Return the principal moments of a rig's head and lever, each as a body can have them.

    No moment of a body is larger than the sum of the other two. The head has the same across in every direction, so
    that is at least half of the one along the axis; the lever's about its arms is at most twice that across them. Where
    a rig breaks this by a moment that it assumes, the nearest possible one is taken and said. A rig without [space]
    has the moments of thin discs. Raises SpecError where the impossible moment was not assumed.
    """
    head, lever, space = rig.inertia.head.value, rig.inertia.lever.value, rig.space
    if space is None:
        return Moments(np.array([head, head / 2, head / 2]), np.array([lever, lever / 2, lever]), ())
    across, along = space.head_across.value, space.lever_along.value
    said = []
    if 2 * across < head:
        across = head / 2
        said.append(_completed(rig, "head_across", across, f"less than half of inertia.head, {head:g} kg m²"))
    elif space.head_across.origin == "assumed":
        note = f": {space.head_across.note}" if space.head_across.note else ""
        said.append(f"assumed: space.head_across, the head's moment across its axis, is {across:.4g} kg m²{note}")
    if along > 2 * lever:
        along = 2 * lever
        said.append(_completed(rig, "lever_along", along, f"more than twice inertia.lever, {lever:g} kg m²"))
    return Moments(np.array([head, across, across]), np.array([lever, along, lever]), tuple(said))


def _completed(rig: RigSpec, name: str, taken: float, fault: str) -> str:
    """Return what is said where an assumed moment is replaced. Raises SpecError where it was not assumed."""
    given: Parameter = getattr(rig.space, name)
    found = f"space.{name} is {given.value:g} kg m², {fault}; no body has such moments of inertia"
    if given.origin != "assumed":
        raise SpecError(f"rig {rig.name}: {found}; expected a {given.origin} value that a body can have, correct one")
    return f"{found}. {taken:.4g} kg m², the nearest possible, is assumed; write the right value into the rig"
