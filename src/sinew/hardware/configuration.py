"""This is where it is said how a motor must be set up for the bench, and where it is brought there.

Set in every motor: return delay 0, an answer to everything, no reversal and no profile, its limits of current,
temperature and voltage not wider than the rig's, and a shutdown on overload, electrical shock and overheating. In the
drive: position mode, and its position limits not wider than the rig's window.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from sinew.hardware.errors import DeviceError
from sinew.hardware.motor import Motor
from sinew.hardware.motor_registers import POSITION_MODE
from sinew.hardware.servos import DriveServo
from sinew.plan.rig import Limits

__all__ = [
    "SHUTDOWN",
    "Setting",
    "answer_everything",
    "apply_settings",
    "configure_drive",
    "configure_motor",
    "drive_settings",
    "motor_settings",
    "narrow_settings",
    "read_counts",
]

SHUTDOWN = 1 << 2 | 1 << 4 | 1 << 5
"""Overheating, electrical shock and overload: the bits of the register shutdown as from the factory."""

_READ = (
    "return_delay_time",
    "drive_mode",
    "temperature_limit",
    "max_voltage_limit",
    "min_voltage_limit",
    "current_limit",
    "max_position_limit",
    "min_position_limit",
    "shutdown",
    "profile_acceleration",
    "profile_velocity",
)
_ROUNDING = 1e-6


@dataclass(frozen=True, slots=True)
class Setting:
    """A register that is not as the bench wants it: counts found, and counts expected."""

    register: str
    found: int
    expected: int


def motor_settings(motor: Motor, counts: Mapping[str, int], limits: Limits, current: float) -> list[Setting]:
    """Return what is to be changed in a motor.

    counts: what its registers hold, by name. current: the largest that the rig allows it [A].
    """

    def at_most(register: str, quantity: float) -> int:
        return min(counts[register], math.floor(quantity / motor.table[register].scale + _ROUNDING))

    low, high = limits.voltage_v
    lowest = math.ceil(low / motor.table["min_voltage_limit"].scale - _ROUNDING)
    wanted = {
        "return_delay_time": 0,
        "drive_mode": 0,
        "temperature_limit": at_most("temperature_limit", limits.temperature_c),
        "max_voltage_limit": at_most("max_voltage_limit", high),
        "min_voltage_limit": max(counts["min_voltage_limit"], lowest),
        "current_limit": at_most("current_limit", current),
        "shutdown": counts["shutdown"] | SHUTDOWN,
        "profile_acceleration": 0,
        "profile_velocity": 0,
    }
    return _different(counts, wanted)


def drive_settings(drive: DriveServo, counts: Mapping[str, int]) -> list[Setting]:
    """Return what is to be changed in the drive besides: position limits wider than the rig's window."""
    return [setting for setting in _window(drive, counts) if _is_wider(setting)]


def narrow_settings(drive: DriveServo, counts: Mapping[str, int]) -> list[Setting]:
    """Return position limits of the drive that keep it from a part of the rig's window: goals there it would ignore."""
    return [setting for setting in _window(drive, counts) if not _is_wider(setting)]


def apply_settings(motor: Motor, settings: Sequence[Setting]) -> None:
    """Store settings and read each back. Raises DeviceError if the motor does not take one, or its torque is on."""
    motor.require_torque_off("to be set up")
    for setting in settings:
        motor.ensure_count(setting.register, setting.expected)


def configure_motor(motor: Motor, limits: Limits, current: float) -> None:
    """Set up a motor that answers everything, with its torque off; only what differs is written.

    current: the largest that the rig allows it [A]. Raises DeviceError, also for a homing offset.
    """
    if offset := motor.get_count("homing_offset"):
        raise DeviceError(
            f"{motor.name} (id {motor.id}) has a homing offset of {offset} counts, expected 0: with one the motor "
            "moves when its bus watchdog stops it; `sinew doctor --fix` removes it"
        )
    apply_settings(motor, motor_settings(motor, read_counts(motor), limits, current))


def configure_drive(drive: DriveServo) -> None:
    """Set the drive's mode and its position limits, with the torque off.

    Raises DeviceError, also where its limits are narrower than the rig's window: it would ignore goals.
    """
    drive.set_mode(POSITION_MODE)
    counts = read_counts(drive)
    if narrow_settings(drive, counts):
        raise DeviceError(
            f"{drive.name} (id {drive.id}) keeps to counts {counts['min_position_limit']} to "
            f"{counts['max_position_limit']}, expected {drive.lowest_count} to {drive.highest_count} for the rig's "
            "drive_window_deg, beyond which it would ignore goals; make the window smaller, or widen the limits with "
            "`sinew doctor --fix`"
        )
    apply_settings(drive, drive_settings(drive, counts))


def answer_everything(motor: Motor) -> None:
    """Have a motor answer reads and writes. Raises DeviceError if it does not."""
    row = motor.table["status_return_level"]
    if motor.bus.read(motor.id, row.address, row.size).data != b"\x02":
        # One that answers only pings, or only reads, says nothing to this either.
        motor.bus.write(motor.id, row.address, b"\x02", retries=0)
    motor.ensure_count("status_return_level", 2)


def read_counts(motor: Motor) -> dict[str, int]:
    """Return the registers that the settings look at. Raises DeviceError."""
    return motor.get_counts(_READ)


def _window(drive: DriveServo, counts: Mapping[str, int]) -> list[Setting]:
    wanted = {"max_position_limit": drive.highest_count, "min_position_limit": drive.lowest_count}
    return _different(counts, wanted)


def _is_wider(setting: Setting) -> bool:
    return (setting.found > setting.expected) == (setting.register == "max_position_limit")


def _different(counts: Mapping[str, int], wanted: Mapping[str, int]) -> list[Setting]:
    return [Setting(name, counts[name], count) for name, count in wanted.items() if counts[name] != count]
