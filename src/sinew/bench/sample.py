"""This is where one cycle of the bench is a row: what was asked, what every device answered, and when."""

from dataclasses import dataclass

__all__ = ["MISSING", "Sample"]

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
    that each told last [V].
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
