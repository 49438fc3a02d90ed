"""One cycle of the bench as a row: what was asked, what every device answered, and when."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, fields

from sinew.plan.rig import RigSpec

MISSING = float("nan")
"""Stands for a reading that a device did not give; the row is kept, and the recording leaves it out."""


@dataclass(frozen=True, slots=True)
class Sample:
    """One cycle. Readings are in SI; those that did not come are `MISSING`.

    time_s: host's monotonic time at which the drive's encoder was read [s].
    imu_time_s: host's time at which the newest IMU sample was taken [s], from the node's own counter.
    drive_command_rad: commanded lever angle at the time that the row gets in a recording, time_s + bus.drive_delay.
    tendon_goal: what the tendon motors were told [rad or A]. tendon_rad, tendon_current_a: by tendon; pulling is
    positive. gyro_rad_s, acceleration_m_s2: axes of frame H. tilt_rad: angle between head plate and level.
    late_s: how much later than due the cycle began [s].
    imu_counter_s: the node's own time of that IMU sample [s], wrapping at 2³² µs; MISSING where it is not known, then
    the samples' order has to do.
    tendon_pwm: duty of the tendon motors, by tendon; pulling is positive. supply_v: mean over the motors of the voltage
    that each told last [V]. sensors: what those with a node of their own told, in the rig's order and their channels'
    units. drive_goal_rad: the lever's goal that the drive's register held when it was read, which it went by.
    """

    time_s: float
    imu_time_s: float
    drive_command_rad: float
    drive_rad: float
    drive_current_a: float
    drive_pwm: float
    tendon_goal: tuple[float, ...]
    tendon_rad: tuple[float, ...]
    tendon_current_a: tuple[float, ...]
    gyro_rad_s: tuple[float, float, float]
    acceleration_m_s2: tuple[float, float, float]
    tilt_rad: float
    late_s: float
    imu_counter_s: float = MISSING
    tendon_pwm: tuple[float, ...] = ()
    supply_v: float = MISSING
    sensors: tuple[float, ...] = ()
    drive_goal_rad: float = MISSING


# The tables of a journal are written down, and how a sample becomes a row of them.
#
# Every value stands in a column of its own, with its unit in its name, so that a journal can be read with nothing but
# SQLite. A reading that did not come is NULL.

APPLICATION_ID = 0x53694E77
"""What tells a journal of Sinew from any other SQLite file."""

JOURNAL_VERSION = 3
"""Changes whenever a table does."""

REGISTERS = "registers of run "
"""Key in the table `meta`, with the run's number behind it, of the motors' registers as JSON."""

_TENDON = {"tendon_goal": "goal", "tendon_rad": "rad", "tendon_current_a": "current_a", "tendon_pwm": "pwm"}
_AXES = {"gyro_rad_s": ("gyro", "rad_s"), "acceleration_m_s2": ("acceleration", "m_s2")}

_TABLES = (
    "CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL)",
    # One row for each time that a run wrote here: its monotonic clock is its own.
    "CREATE TABLE sessions (id INTEGER PRIMARY KEY, date TEXT NOT NULL)",
    """CREATE TABLE segments (
        id INTEGER PRIMARY KEY, session INTEGER NOT NULL, plan_group INTEGER, attempt INTEGER NOT NULL,
        kind TEXT NOT NULL, pretension_mm REAL, frequency_hz REAL, amplitude_deg REAL, repeat INTEGER,
        state TEXT NOT NULL, first_sample INTEGER NOT NULL, end_sample INTEGER, started_s REAL, ended_s REAL,
        note TEXT NOT NULL)""",
    "CREATE TABLE finished (plan_group INTEGER PRIMARY KEY, session INTEGER NOT NULL, attempt INTEGER NOT NULL)",
    "CREATE TABLE events (id INTEGER PRIMARY KEY, session INTEGER NOT NULL, time_s REAL, date TEXT NOT NULL, "
    "kind TEXT NOT NULL, sentence TEXT NOT NULL)",
    "CREATE TABLE counts (session INTEGER NOT NULL, name TEXT NOT NULL, number REAL NOT NULL, "
    "PRIMARY KEY (session, name))",
)


def sample_columns(rig: RigSpec) -> tuple[str, ...]:
    """Return the columns of a sample of a rig, in the order of `sample_row`."""
    tendons = rig.tendons.count
    names: list[str] = []
    for name in (field.name for field in fields(Sample)):
        if name in _TENDON:
            names += [f"tendon_{i + 1}_{_TENDON[name]}" for i in range(tendons)]
        elif name in _AXES:
            what, unit = _AXES[name]
            names += [f"{what}_{axis}_{unit}" for axis in "xyz"]
        elif name == "sensors":
            names += [sensor.channel for sensor in rig.sensors]
        else:
            names.append(name)
    return tuple(names)


def sample_row(sample: Sample) -> tuple[float, ...]:
    """Return the numbers of a sample one after the other."""
    # Written out, for it runs 200 times a second beside the control loop.
    return (
        sample.time_s,
        sample.imu_time_s,
        sample.drive_command_rad,
        sample.drive_rad,
        sample.drive_current_a,
        sample.drive_pwm,
        *sample.tendon_goal,
        *sample.tendon_rad,
        *sample.tendon_current_a,
        *sample.gyro_rad_s,
        *sample.acceleration_m_s2,
        sample.tilt_rad,
        sample.late_s,
        sample.imu_counter_s,
        *(sample.tendon_pwm or (MISSING,) * len(sample.tendon_rad)),
        sample.supply_v,
        *sample.sensors,
        sample.drive_goal_rad,
    )


def insert_sample(columns: Collection[str]) -> str:
    """Return the statement that takes (id, session, segment, *sample_row)."""
    return (
        f"INSERT INTO samples (id, session, segment, {', '.join(columns)}) "
        f"VALUES ({', '.join('?' * (3 + len(columns)))})"
    )


def statements(sample: Collection[str]) -> Iterator[str]:
    """Yield the statements that make the tables of a journal for samples of these columns."""
    yield f"PRAGMA application_id = {APPLICATION_ID}"
    yield f"PRAGMA user_version = {JOURNAL_VERSION}"
    yield from _TABLES
    columns = ", ".join(f"{name} REAL" for name in sample)
    yield f"CREATE TABLE samples (id INTEGER PRIMARY KEY, session INTEGER NOT NULL, segment INTEGER, {columns})"
