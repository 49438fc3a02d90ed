"""A campaign: pretensions, sweep, ring-downs, the pose of the head at rest, and the segments they unroll to."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from sinew.measure.errors import SpecError
from sinew.measure.recording import Excitation, Segment, SegmentKind
from sinew.plan.parameter import NotNegative, Positive, Settings

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


TendonMode = Literal["position", "position-with-current-limit", "current"]
Held = Literal["command", "lever", "torsion"]
Drive = Literal["lever", "pitch", "roll"]
"""What is driven: the lever, or the tendons against one another: they tilt it about y (pitch) or z (roll) of B."""
Duration = Annotated[float, Field(gt=0, le=3600)]
Count = Annotated[int, Field(ge=1, le=100_000)]

MOST_GROUPS = 100_000
"""More groups than that are a slip of the pen: a campaign of a week at six seconds each."""

MOST_PRETENSIONS = 500
"""More pretensions than that are one, too: at 12 mm of travel they are nearer to each other than a motor can set."""

MOST_FREQUENCIES = 5000
"""So are more frequencies than that."""

MOST_SAMPLES = 10**9
"""And more samples in a campaign: two months at 200 Hz."""

_MOST_LISTED = 6


def listed(values: Sequence[float] | Sequence[str]) -> str:
    """Return numbers or words in a row: 3, 4 and 5."""
    words = [one if isinstance(one, str) else f"{one:g}" for one in values]
    if len(words) > _MOST_LISTED:
        words = [*words[: _MOST_LISTED - 1], f"{len(words) - _MOST_LISTED + 1} more"]
    return " and ".join([*([", ".join(words[:-1])] if words[1:] else []), *words[-1:]])


def _few(most: int, what: str) -> BeforeValidator:
    """Return what refuses too long a list before anything is made of it."""

    def refuse_many(value: object) -> object:
        if isinstance(value, (list, tuple)) and len(value) > most:
            raise ValueError(
                f"found {len(value)} {what}, expected at most {most}; take a larger step or split the plan"
            )
        return value

    return BeforeValidator(refuse_many)


def _visited_once(pretension_mm: tuple[float, ...]) -> tuple[float, ...]:
    twice = sorted(p for p, count in Counter(pretension_mm).items() if count > 1)
    if twice:
        raise ValueError(
            f"found {listed(twice)} more than once, and the later visit would overwrite the earlier; "
            "list it once and raise repeats"
        )
    return pretension_mm


def _increasing(frequency_hz: tuple[float, ...]) -> tuple[float, ...]:
    falls = [f"{a:g} to {b:g}" for a, b in pairwise(frequency_hz) if b <= a]
    if falls:
        raise ValueError(f"found {listed(falls)}, expected that it increases from one entry to the next")
    return frequency_hz


class Pretension(Settings):
    """The pretensions to visit and how the tendon motors hold them.

    pretension_mm: common shortening of the four tendons from first contact [mm], in the order of visiting.
    mode: position, position with a current limit, or current (constant tension).
    rest_s: idle record after each change, at rest, for the gyroscope bias [s].
    """

    pretension_mm: Annotated[
        tuple[NotNegative, ...],
        Field(min_length=1),
        _few(MOST_PRETENSIONS, "pretensions"),
        AfterValidator(_visited_once),
    ]
    mode: TendonMode = "position"
    rest_s: Duration = 1.0


LEVER_DEG = 20.0
"""The paper's amplitude of the lever θ_d [deg]."""


# What a sweep or a ring-down drives: the lever, which turns by A sin Ωt, or the tendons against one another, while the
# lever is held at its zero. Then each takes up A sin Ωt times (y_i roll - z_i pitch)/r of cable, at (y_i, z_i) on its
# circle r: the amplitude is that of a tendon furthest from the axis of the tilt.


class _Driven(Settings):
    """What a sweep and a ring-down say of their drive; the amplitude is of what is driven."""

    frequency_hz: tuple[Positive, ...]
    drive: Drive = "lever"
    amplitude_deg: Positive = LEVER_DEG
    amplitude_mm: Positive | None = None

    @model_validator(mode="after")
    def _amplitude_of_the_drive(self) -> Self:
        if self.drive == "lever" and self.amplitude_mm is not None:
            raise ValueError('amplitude_mm is of the tendons; write drive = "pitch" or "roll", or leave it out')
        if self.drive != "lever" and self.amplitude_mm is None:
            raise ValueError(f'drive = "{self.drive}" needs amplitude_mm, how much cable the tendons take up')
        if self.drive != "lever" and self.amplitude_deg != LEVER_DEG:
            raise ValueError(f'amplitude_deg is of the lever, which is held with drive = "{self.drive}"; leave it out')
        return self


class Sweep(_Driven):
    """Frequency groups (paper, section 4.1): at each frequency settle, then record whole periods.

    frequency_hz: drive frequencies [Hz], increasing.
    drive: the lever, or the tendons in pitch or roll. amplitude_deg: nominal amplitude of the lever θ_d [deg];
    amplitude_mm: of the tendons, where these drive [mm].
    settle_s: transient delay before each group [s] (paper: 3 s).
    periods: recorded periods in a group (paper: 5).
    repeats: measurements of each group n_m (paper: 3).
    """

    frequency_hz: Annotated[
        tuple[Positive, ...],
        Field(min_length=1),
        _few(MOST_FREQUENCIES, "frequencies"),
        AfterValidator(_increasing),
    ]
    settle_s: Annotated[float, Field(ge=0, le=3600)] = 3.0
    periods: Count = 5
    repeats: Count = 3


class RingDown(_Driven):
    """Free decays (paper, section 4.2): drive, stop the drive at its zero crossing, record.

    frequency_hz: drive frequency [Hz] at the first and at the last pretension of the plan, linear between.
    drive, amplitude_deg, amplitude_mm: as of a sweep; the tendons driven in pitch or roll give a decay in bending.
    drive_s: how long the drive runs before it stops, at least [s].
    record_s: how long the free decay is recorded [s].
    repeats: number of decays at each pretension.
    """

    frequency_hz: tuple[Positive, Positive]
    drive_s: Duration = 3.0
    record_s: Duration = 3.0
    repeats: Count = 3


class Impulse(Settings):
    """Blows: the head at rest in its pose gets an angular impulse, and rings down.

    about: torsion (about the head's x axis), pitch or roll (about y or z of frame B). impulse_n_m_s: of the blow
    [N m s]; that of a hammer is its impulse [N s] times its distance from the axis. record_s: length of the record [s].
    repeats: number of blows at each pretension.
    """

    about: Literal["torsion", "pitch", "roll"]
    impulse_n_m_s: Positive
    record_s: Duration = 3.0
    repeats: Count = 3


class Track(Settings):
    """Resonance tracking: at each pretension, and with each amplitude, the drive is kept at 90° of phase.

    amplitude_deg: amplitudes that are held [deg], one motion for each. held: of what: the lever's command, the measured
    lever, or the torsion. start_hz: first drive frequency, None: the expected resonance; low_hz, high_hz: bounds [Hz].
    duration_s: of a motion at one pretension, or of the change of one that moves [s].
    pretension_to_mm: where the pretension moves to while it is tracked [mm]; None where it stays.
    wanted_hz: resonance frequencies (first, last) that the pretension is to follow within duration_s, on the way
    between the plan's pretension and pretension_to_mm; None where it is not led by a frequency.
    lead_s, tail_s: how long a moving pretension stands before and after its motion [s].
    gap_s: how long the sensor may be silent before the run ends [s]; until then the drive goes on as it did.
    """

    amplitude_deg: Annotated[tuple[Positive, ...], Field(min_length=1), _few(MOST_FREQUENCIES, "amplitudes")]
    held: Held = "command"
    start_hz: Positive | None = None
    low_hz: Positive
    high_hz: Positive
    duration_s: Duration
    pretension_to_mm: NotNegative | None = None
    wanted_hz: tuple[Positive, Positive] | None = None
    lead_s: Duration = 5.0
    tail_s: Duration = 2.0
    gap_s: Annotated[float, Field(ge=0.05, le=5.0)] = 1.0

    @model_validator(mode="after")
    def _in_order(self) -> "Track":
        start = self.low_hz if self.start_hz is None else self.start_hz
        if not (self.low_hz <= start <= self.high_hz and self.low_hz < self.high_hz):
            raise ValueError(
                f"found a first frequency of {start:g} Hz with bounds of {self.low_hz:g} and {self.high_hz:g} Hz, "
                "expected low_hz <= start_hz <= high_hz"
            )
        if self.wanted_hz is not None and self.pretension_to_mm is None:
            raise ValueError("wanted_hz needs pretension_to_mm: the end of the range in which the pretension may move")
        return self

    @property
    def motion_s(self) -> float:
        """Length of one motion [s]."""
        return self.duration_s + (0.0 if self.pretension_to_mm is None else self.lead_s + self.tail_s)


@dataclass(frozen=True)
class Group:
    """One motion of the drive from rest: a settle followed by a record, or an idle record.

    kind: of the record (steady, ring-down, idle or tracking).
    pretension_mm, frequency_hz, amplitude_deg, repeat: as in `sinew.measure.recording.Segment`.
    settle_s: how long the drive runs before the record [s]; a ring-down's drive stops at its end.
    record_s: length of the record [s].
    excitation, amplitude_mm, impulse_n_m_s: as in that Segment. pose: of the head at rest.
    """

    kind: SegmentKind
    pretension_mm: float
    frequency_hz: float
    amplitude_deg: float
    repeat: int
    settle_s: float
    record_s: float
    excitation: Excitation = "lever"
    amplitude_mm: float = math.nan
    impulse_n_m_s: float = math.nan
    pose: Pose = STRAIGHT

    @property
    def duration_s(self) -> float:
        """Length of settle and record together [s]."""
        return self.settle_s + self.record_s

    def segment(self, kind: SegmentKind) -> Segment:
        """Return what a recording says of this group's settle or record."""
        return Segment(
            kind,
            self.pretension_mm,
            self.frequency_hz,
            self.amplitude_deg,
            self.repeat,
            *self.pose.bend_and_azimuth_deg,
            self.excitation,
            self.amplitude_mm,
            self.impulse_n_m_s,
        )

    def sample_counts(self, sample_hz: float) -> tuple[int, int]:
        """Return the numbers of samples in settle and record at a sample rate [Hz]."""
        settle = math.ceil(self.settle_s * sample_hz - 1e-9)
        return settle, max(1, round(self.record_s * sample_hz))


class Plan(Settings):
    """A whole campaign.

    name: for titles and file names.
    sample_hz: rate at which motors and IMU are recorded [Hz].
    pose: of the head at rest, in all of the campaign; None: upright.
    """

    name: str = Field(min_length=1)
    sample_hz: Positive = 200.0
    pose: Pose | None = None
    pretension: Pretension
    sweep: Sweep | None = None
    ring_down: RingDown | None = None
    impulse: Impulse | None = None
    track: Track | None = None

    @model_validator(mode="after")
    def _something_to_do(self) -> "Plan":
        if self.sweep is None and self.ring_down is None and self.impulse is None and self.track is None:
            raise ValueError("a plan needs a [sweep], a [ring_down] or both, an [impulse], or a [track]")
        if self.track is not None and self.is_spatial:
            raise ValueError("a [track] follows the torsion of an upright head; leave [pose] and other drives out")
        moves = self.track is not None and self.track.pretension_to_mm is not None
        if moves and self.pretension.mode != "position":
            raise ValueError(f"found mode {self.pretension.mode}, a pretension that moves needs the mode position")
        return self

    @model_validator(mode="after")
    def _not_endless(self) -> "Plan":
        sweep = len(self.sweep.frequency_hz) * self.sweep.repeats if self.sweep is not None else 0
        decays = self.ring_down.repeats if self.ring_down is not None else 0
        decays += self.impulse.repeats if self.impulse is not None else 0
        tracks = len(self.track.amplitude_deg) if self.track is not None else 0
        groups = len(self.pretension.pretension_mm) * (1 + sweep + decays + tracks)
        if groups > MOST_GROUPS:
            raise ValueError(
                f"found {groups} groups (pretensions x frequencies x repeats), expected at most {MOST_GROUPS}; "
                "lower repeats or split the campaign"
            )
        samples = len(self.pretension.pretension_mm) * self._groups_s() * self.sample_hz
        if samples > MOST_SAMPLES:
            raise ValueError(
                f"found {samples:.3g} samples in the whole campaign, expected at most {MOST_SAMPLES:.0e}; "
                "lower periods, durations or sample_hz, raise the lowest frequency, or split the campaign"
            )
        return self

    def _groups_s(self) -> float:
        """Return how long the groups of one pretension take [s], without making them."""
        total = self.pretension.rest_s
        if (sweep := self.sweep) is not None:
            recorded = sum(sweep.periods / frequency for frequency in sweep.frequency_hz)
            total += sweep.repeats * (recorded + len(sweep.frequency_hz) * sweep.settle_s)
        if (ring := self.ring_down) is not None:
            total += ring.repeats * (ring.drive_s + 1 / min(ring.frequency_hz) + ring.record_s)
        if self.impulse is not None:
            total += self.impulse.repeats * self.impulse.record_s
        if self.track is not None:
            total += len(self.track.amplitude_deg) * self.track.motion_s
        return total

    @property
    def rest_pose(self) -> Pose:
        """Return the pose of the head at rest, upright where the plan says nothing."""
        return self.pose or STRAIGHT

    @property
    def is_spatial(self) -> bool:
        """Whether the head is bent, or moved by something else than the lever: the joint does more than turn."""
        parts = (self.sweep, self.ring_down)
        sways = any(part is not None and part.drive != "lever" for part in parts)
        return not self.rest_pose.is_straight or sways or self.impulse is not None

    def groups(self) -> list[Group]:
        """Return the whole campaign as groups, in the order in which they are run."""
        return [group for index in range(len(self.pretension.pretension_mm)) for group in self._groups_at(index)]

    def _groups_at(self, index: int) -> Iterator[Group]:
        pretension, pose = self.pretension.pretension_mm[index], self.rest_pose
        yield Group("idle", pretension, math.nan, math.nan, 0, 0.0, self.pretension.rest_s, pose=pose)
        if (sweep := self.sweep) is not None:
            driven = _driven(sweep, pose)
            for repeat in range(sweep.repeats):
                for frequency in sweep.frequency_hz:
                    times: dict[str, Any] = {"settle_s": sweep.settle_s, "record_s": sweep.periods / frequency}
                    yield Group("steady", pretension, frequency, repeat=repeat, **times, **driven)
        if (ring := self.ring_down) is not None:
            first, last = self.pretension.pretension_mm[0], self.pretension.pretension_mm[-1]
            share = (pretension - first) / (last - first) if last != first else 0.0
            frequency = ring.frequency_hz[0] + share * (ring.frequency_hz[1] - ring.frequency_hz[0])
            stop, driven = _crossing_after(ring.drive_s, frequency), _driven(ring, pose)
            for repeat in range(ring.repeats):
                yield Group(
                    "ring-down", pretension, frequency, repeat=repeat, settle_s=stop, record_s=ring.record_s, **driven
                )
        if (blow := self.impulse) is not None:
            for repeat in range(blow.repeats):
                yield Group(
                    "ring-down",
                    pretension,
                    math.nan,
                    math.nan,
                    repeat,
                    0.0,
                    blow.record_s,
                    _BLOWS[blow.about],
                    impulse_n_m_s=blow.impulse_n_m_s,
                    pose=pose,
                )
        if (track := self.track) is not None:
            for amplitude in track.amplitude_deg:
                yield Group("tracking", pretension, math.nan, amplitude, 0, 0.0, track.motion_s)


_BLOWS: dict[str, Excitation] = {"torsion": "impulse-torsion", "pitch": "impulse-pitch", "roll": "impulse-roll"}


def _driven(part: _Driven, pose: Pose) -> dict[str, Any]:
    """Return what a group says of its drive and its pose."""
    if part.amplitude_mm is None:
        return {"amplitude_deg": part.amplitude_deg, "pose": pose}
    return {"amplitude_deg": math.nan, "excitation": part.drive, "amplitude_mm": part.amplitude_mm, "pose": pose}


def require_motors(plan: Plan, who: str) -> None:
    """Raise SpecError for a plan whose head `who` has no motor to move so: blows, and tendons that hold tensions."""
    if plan.impulse is not None:
        raise SpecError(
            f"plan {plan.name} asks for blows about {plan.impulse.about}, {who} has no hammer; `sinew simulate` runs "
            "such a plan on the twin, and without [impulse] it can be run"
        )
    if plan.pretension.mode != "position" and (drives := _other_drives(plan)):
        raise SpecError(
            f"plan {plan.name} asks for {' and '.join(drives)} while the tendon motors are in mode "
            f'{plan.pretension.mode}, {who} drives tendons that hold positions; set pretension.mode = "position"'
        )


def _other_drives(plan: Plan) -> list[str]:
    driven = (("sweep", plan.sweep), ("ring_down", plan.ring_down))
    others = [f"a {name} driven in {part.drive}" for name, part in driven if part is not None and part.drive != "lever"]
    return others + ([f"blows about {plan.impulse.about}"] if plan.impulse is not None else [])


def _crossing_after(time_s: float, frequency_hz: float) -> float:
    """Return the first rising zero crossing of sin(2π f t) at or after a time [s]."""
    return math.ceil(time_s * frequency_hz - 1e-9) / frequency_hz
